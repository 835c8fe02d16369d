"""Windows and macOS, as far as a test on another system sees them: no call that POSIX alone has, text files of one
encoding, and commands that run where Windows' limits are imitated (`imitated_windows.py`).
"""

import ast
import io
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import pytest

import hagoromo as hg
from hagoromo.app.everywhere import printable_streams
from hagoromo.errors import InputError
from hagoromo.files.checks import check_name
from hagoromo.files.whole import check_file
from hagoromo_formats.cameras.opencv_file import nodes_by_opencv
from hagoromo_start import _wrong_number
from hagoromo_start.caches import find_caches
from tests.app.imitated_windows import MODULES, NAMES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
WRITTEN = (*PACKAGES, "studies", "benchmarks", "examples", "docs/hooks")  # where text files are read and written
WORDS = re.compile(rf"\b({'|'.join(sorted(MODULES.union(*NAMES.values())))})\b")  # a file without any is not parsed
OPENED = re.compile(r"open\(|read_text\(|write_text\(")
GUARDS = ("sys.platform", "os.name", "hasattr(", "platform.system(")


def sources(folders: tuple[str, ...]) -> list[Path]:
    return [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]


def posix_only(text: str) -> list[str]:
    """Lines of a module that Windows cannot run and that no test of the platform, and no `try`, stands around."""
    if not WORDS.search(text):
        return []
    tree = ast.parse(text)
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.split(".")[0] in MODULES]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module] if (node.module or "").split(".")[0] in MODULES else []
            names += [alias.name for alias in node.names if alias.name in NAMES.get(node.module or "", ())]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            names = [node.attr] if node.attr in NAMES.get(node.value.id, ()) else []
        else:
            continue
        if names and not is_guarded(node, parents):
            found.append(f"{node.lineno}: {', '.join(map(str, names))}")
    return found


def is_guarded(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    while node in parents:
        node = parents[node]
        if isinstance(node, (ast.If, ast.IfExp)) and any(guard in ast.unparse(node.test) for guard in GUARDS):
            return True
        if isinstance(node, ast.Try):
            caught = " ".join(ast.unparse(handler.type) for handler in node.handlers if handler.type)
            if "ImportError" in caught or "AttributeError" in caught or "ModuleNotFoundError" in caught:
                return True
    return False


def without_encoding(text: str) -> list[int]:
    """Lines that open a text file in the encoding of the system."""
    if not OPENED.search(text):
        return []
    lines = []
    for call in (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)):
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        named = {keyword.arg for keyword in call.keywords}
        if isinstance(call.func, ast.Attribute) and name in ("read_text", "write_text"):
            if "encoding" not in named:
                lines.append(call.lineno)
        elif name in ("open", "fdopen") and opens_text(call) and "encoding" not in named:
            lines.append(call.lineno)
    return lines


def opens_text(call: ast.Call) -> bool:
    """Whether a call of open(path, mode), or of path.open(mode), opens a text file."""
    place = 0 if isinstance(call.func, ast.Attribute) and call.func.attr == "open" else 1
    is_module = isinstance(call.func, ast.Attribute) and isinstance(call.func.value, ast.Name)
    if is_module and ast.unparse(call.func) in ("os.open", "Image.open", "webbrowser.open", "OpenEXR.open"):
        return False
    modes = [keyword.value for keyword in call.keywords if keyword.arg == "mode"] + call.args[place : place + 1]
    texts = [mode.value for mode in modes if isinstance(mode, ast.Constant) and isinstance(mode.value, str)]
    return (bool(texts) and "b" not in texts[0]) or not modes


def found_in(folders: tuple[str, ...], look) -> dict[str, list]:
    """Files of the folders with what `look` finds in their text, if it finds something."""
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in sources(folders)}
    assert len(texts) > 300
    return {name: lines for name, text in texts.items() if (lines := look(text))}


def test_the_packages_use_nothing_that_posix_alone_has():
    assert found_in(PACKAGES, posix_only) == {}


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("import fcntl", ["1: fcntl"]),
        ("from os import fork", ["1: fork"]),
        ("def f():\n    import resource", ["2: resource"]),
        ("import os\nx = os.sysconf('SC_PAGE_SIZE')", ["2: sysconf"]),
        ("import os, sys\nif sys.platform != 'win32':\n    os.getuid()", []),
        ("import os\nx = os.getuid() if hasattr(os, 'getuid') else 0", []),
        ("try:\n    import fcntl\nexcept ImportError:\n    fcntl = None", []),
        ("try:\n    import fcntl\nexcept OSError:\n    fcntl = None", ["2: fcntl"]),
    ],
)
def test_what_posix_alone_has_is_found_unless_it_is_guarded(text, lines):
    assert posix_only(text) == lines


def test_text_files_have_one_encoding_on_every_system():
    assert found_in(WRITTEN, without_encoding) == {}


def test_text_in_the_encoding_of_the_system_is_found():
    text = "open(p)\nopen(p, 'rb')\nopen(p, 'w', encoding='utf-8')\np.open('w')\np.read_text()\nos.open(p, 0)\n"
    text += "p.write_text(t)\np.write_text(t, encoding='utf-8')\nwrite_text(p, t)\n"
    assert without_encoding(text) == [1, 4, 5, 7]


def test_streams_of_a_code_page_print_every_message(monkeypatch):
    """Windows gives a file or pipe the code page 1252, which has neither Δ nor →, nor names that are no Unicode."""
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="cp1252", errors="strict"))
    monkeypatch.delenv("PYTHONIOENCODING", raising=False)
    with pytest.raises(UnicodeEncodeError):
        print("ΔE₀₀", flush=True)
    printable_streams()
    print("ΔE₀₀ → α \udcff", flush=True)
    assert raw.getvalue().decode("utf-8").splitlines() == ["ΔE₀₀ → α \\udcff"]


def test_an_encoding_that_the_user_has_set_stays(monkeypatch):
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="cp1252", errors="strict"))
    monkeypatch.setenv("PYTHONIOENCODING", "cp1252")
    printable_streams()
    print("10 µm, Δ", flush=True)
    assert raw.getvalue().decode("cp1252").splitlines() == ["10 µm, \\u0394"]


@pytest.mark.parametrize("name", ["NUL", "con.exr", "results/aux.png", "COM1", "lpt9.tar.gz", "a.", "b ", "x.exr:s"])
def test_names_that_windows_keeps_are_refused_there(name, monkeypatch, tmp_path):
    (tmp_path / "results").mkdir()
    check_file(tmp_path / name, force=False)  # elsewhere they are names as any other
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(InputError, match="Windows keeps the name"):
        check_file(tmp_path / name, force=False)


@pytest.mark.parametrize("name", ["../console.exr", "nulls/com.png", "./com10", "C:/pictures/a.b.exr", "conic.exr"])
def test_other_names_are_not(name, monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    check_name(name)


@pytest.mark.parametrize("suffix", [".yml", ".json"])
def test_opencv_is_given_no_name_that_it_cannot_open_on_windows(suffix, monkeypatch, tmp_path):
    """OpenCV's files are opened by names of the code page there: others are read by Python."""
    path, names = tmp_path / f"kamera Δ{suffix}", []
    camera = hg.Camera(64, 48, (90.0, 91.0), (32.5, 24.0), (0.1, -0.02, 0, 0, 0, 0, 0, 0))
    hg.write_views(path, {"": camera}, "opencv")
    real = cv2.FileStorage
    hg.read_views(path)  # so that libraries are loaded as this system has them
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(cv2, "FileStorage", lambda name, flags: names.append(name) or real(name, flags))
    assert nodes_by_opencv(path)["k"][0, 0] == camera.focal[0]  # what runs in a process apart, here
    assert len(names) == 1 and "Δ" not in names[0]


SCENE = """
[camera]
size = [21, 15]
focal = [200.0, 200.0]
eye = [0.0, -0.05, 0.0]

[[lamp]]
name = "schlüssel"
position = [0.5, -2.0, 1.0]
intensity = 3.0

[[box]]
file = "häut α.zarr"
"""


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="which files are open is read from /proc")
def test_commands_run_where_windows_limits_are_imitated(tmp_path, recipe):
    """Twice each: what a command leaves open, it could not replace. The folder has a space and letters beyond 1252."""
    home = tmp_path / "mes données Δ"
    home.mkdir()
    (home / "haut.toml").write_text(recipe.replace("6.0", "3.0"), encoding="utf-8")
    (home / "scene.toml").write_text(SCENE, encoding="utf-8")
    build = ["build", "haut.toml", "--out", "häut α.zarr", "--force"]
    render = ["render", "scene.toml", "--out", "bild é α.exr", "--force"]
    commands = [["--help"], build, build, render, render, ["info", "häut α.zarr"], ["info", "Δ.exr"]]
    command = [sys.executable, Path(__file__).with_name("imitated_windows.py"), json.dumps(commands)]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONIOENCODING"}
    done = subprocess.run(command, cwd=home, env=environment, capture_output=True, timeout=300, check=False)
    said = done.stdout.decode("utf-8")
    assert [line for line in said.splitlines() if line.startswith("status")] == ["status 0"] * 6 + ["status 2"], (
        said + done.stderr.decode("utf-8")
    )
    assert said.count("wrote häut α.zarr") == 2 and said.count("wrote bild é α.exr") == 2 and "usage: hagoromo" in said
    assert done.stderr.decode("utf-8").splitlines() == ["hagoromo: Δ.exr does not exist: check the path"]
    left = sorted(path.name for path in home.iterdir())
    assert left == ["bild é α.exr", "bild é α.png", "haut.toml", "häut α.zarr", "scene.toml"]


WITHOUT_HOME = """
import sys, hagoromo_start
sys.argv = ["hagoromo", "--version"]
hagoromo_start.main()
from hagoromo.backend import arrays
import matplotlib.font_manager, os
assert float((arrays().Float([1.0]) + 2.0)[0]) == 3.0
print(os.environ.get("DRJIT_CACHE_DIR"), os.environ.get("MPLCONFIGDIR"))
"""


@pytest.mark.skipif(os.name != "posix", reason="HOME is POSIX's")
def test_a_home_that_cannot_be_written_is_not_spoken_of(tmp_path):
    """Dr.Jit and Matplotlib print four lines about it by themselves; their caches get a folder of the user's own.

    Nor does Matplotlib refuse the backend of a notebook from which a command was started.
    """
    environment = os.environ | {"HOME": os.path.join(os.devnull, "nobody"), "TMPDIR": str(tmp_path)}
    environment["MPLBACKEND"] = "module://of_a_notebook"
    for name in ("DRJIT_CACHE_DIR", "MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    command = [sys.executable, "-c", WITHOUT_HOME]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    own = tmp_path / f"hagoromo-{os.getuid()}"
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1].split() == [str(own / "drjit_cache_dir"), str(own / "mplconfigdir")]
    assert own.stat().st_mode & 0o777 == 0o700 and any((own / "drjit_cache_dir").iterdir())


@pytest.mark.skipif(os.name != "posix", reason="HOME is POSIX's")
def test_a_folder_that_others_may_write_is_no_cache(monkeypatch, tmp_path):
    """Kernels are code; without a place for them the environment is left as it is, but for HOME."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / f"hagoromo-{os.getuid()}").mkdir()
    (tmp_path / f"hagoromo-{os.getuid()}").chmod(0o777)
    monkeypatch.setenv("HOME", os.path.join(os.devnull, "nobody"))
    monkeypatch.delenv("DRJIT_CACHE_DIR", raising=False)
    find_caches()
    assert "DRJIT_CACHE_DIR" not in os.environ
    (tmp_path / f"hagoromo-{os.getuid()}").chmod(0o700)
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path / "fonts"))
    find_caches()
    assert os.environ["DRJIT_CACHE_DIR"].startswith(str(tmp_path)) and os.environ["MPLCONFIGDIR"].endswith("fonts")
    monkeypatch.delenv("HOME")
    find_caches()
    assert os.path.isabs(os.environ["HOME"])


@pytest.mark.parametrize("name", ["OPENCV_IO_MAX_IMAGE_PIXELS", "OPENCV_FOR_THREADS_NUM", "SOURCE_DATE_EPOCH"])
def test_a_variable_that_ends_a_library_is_refused(name, monkeypatch):
    """OpenCV aborted the process at its first picture, and the lock and the work folder of the result stayed."""
    monkeypatch.setenv(name, "x\nx")
    assert _wrong_number() == f"hagoromo: {name} is 'x\\nx' in the environment: give a whole number, or unset it"
    for value in ("", "x1", "-1", "9" * 19):
        monkeypatch.setenv(name, value)
        assert name in _wrong_number()
    monkeypatch.setenv(name, "1073741824")
    assert _wrong_number() == ""
