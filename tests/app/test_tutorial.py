"""The tutorial is run as it stands on its page: every block of commands and of Python, in a folder of its own."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.files.exr import read_exr
from hagoromo.files.record import read_json
from studies.lab import lab

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
# Stands for `hagoromo` and `python` on the path: notes its arguments.
NOTED = """#!{python}
import json, os, sys
print(json.dumps([os.path.basename(sys.argv[0]), sys.argv[1:]]), file=open(os.environ["NOTES"], "a"))
"""


def blocks() -> list[tuple[str, str]]:
    page = re.sub(r"^> ?", "", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)  # notes hold commands as well
    return re.findall(r"^```(sh|python)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


def test_the_python_of_the_page_uses_public_names_only():
    code = "\n".join(block for language, block in blocks() if language == "python")
    assert code and set(re.findall(r"^(?:from|import) (hagoromo\S*)", code, re.MULTILINE)) == {"hagoromo"}


def run(name: str, arguments: list[str]) -> None:
    """What a shell would have run, in this process: importing everything anew would take most of the time."""
    if name == "hagoromo":
        assert main(arguments) == 0, arguments
    else:
        assert arguments[:3] == ["-m", "studies.lab", "--out"] and arguments[4] == "--width"
        lab(arguments[3], int(arguments[5]))


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The folder in which the whole page was run."""
    folder = tmp_path_factory.mktemp("tutorial")
    for name in ("hagoromo", "python"):
        (folder / "bin").mkdir(exist_ok=True)
        (folder / "bin" / name).write_text(NOTED.format(python=sys.executable))
        (folder / "bin" / name).chmod(0o755)
    notes, before = folder / "notes", Path.cwd()
    environment = os.environ | {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "NOTES": str(notes)}
    os.chdir(folder)
    try:
        for language, block in blocks():
            if language == "python":
                exec(compile(block, str(PAGE), "exec"), {})
                continue
            notes.write_text("")
            subprocess.run(["bash", "-euo", "pipefail", "-c", block], env=environment, check=True)
            for line in notes.read_text().splitlines():
                run(*json.loads(line))
    finally:
        os.chdir(before)
    return folder


@pytest.mark.nightly
def test_the_camera_and_the_lamps_are_found(home):
    """The focal length to 0.5 %, of which its standard deviation is most; lamps to a degree, which is theirs."""
    true = read_json(home / "lab" / "truth" / "camera.json")
    assert read_json(home / "camera.json")["fl_x"] == pytest.approx(true["fl_x"], rel=5e-3)
    towards = [lamp["to_lamp"] for lamp in read_json(home / "lab" / "truth" / "lamps.json")]
    found = [lamp["to_lamp"] for lamp in read_json(home / "lamps.json")["lamps"]]
    cosines = np.clip(np.einsum("ki,ki->k", towards, found), -1.0, 1.0)
    assert np.degrees(np.arccos(cosines)).max() < 1.0


@pytest.mark.nightly
def test_the_surface_is_found(home):
    """Normals to 3° in the mean: lamps at 4 m are taken for far ones, which alone is up to 0.8°."""
    found, true = (
        np.stack([read_exr(home / path / "normals.exr")[0][f"N.{axis}"] for axis in "XYZ"], axis=2)
        for path in ("measured", "lab/truth")
    )
    both = (np.linalg.norm(found, axis=2) > 0.5) & (np.linalg.norm(true, axis=2) > 0.5)
    assert both.mean() > 0.2
    assert np.degrees(np.arccos(np.clip(np.sum(found * true, axis=2)[both], -1.0, 1.0))).mean() < 3.0


@pytest.mark.nightly
def test_the_boxes_are_near_the_photograph_kept_aside(home):
    """15 % of the photograph, 5 ΔE00: most of it at the terminator and where the upper part shades the lower."""
    compared = read_json(home / "relit" / "relit.json")[0]["compared"]["boxes"]
    assert compared["relative_rmse"] < 0.15 and compared["delta_e_2000"] < 5.0
    assert (home / "relit" / "report.html").is_file() and (home / "evening.png").is_file()


def test_the_laboratory_is_the_same_every_time(tmp_path):
    one, other = (lab(tmp_path / name, 60) for name in ("one", "other"))
    files = [path.relative_to(one) for path in sorted(one.rglob("*.*"))]
    assert len(files) > 30 and all((one / file).read_bytes() == (other / file).read_bytes() for file in files)


def test_the_messages_that_it_lists_are_those_of_the_package():
    rows = re.findall(
        r"^\| (.+?) \| .+ \|$", PAGE.read_text(encoding="utf-8").split("## When it is refused")[1], re.MULTILINE
    )
    source = "".join(path.read_text(encoding="utf-8") for path in (PAGE.parents[1] / "hagoromo").rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)  # messages that go on in the next line
    for row in rows[1:]:
        parts = [part.strip() for part in re.split(r"…|\(.*?\)|\d+", row) if len(part.strip()) > 8]
        assert parts and all(part in source for part in parts), row
