"""What is shipped: the wheel and the sdist hold what they must and nothing else, the wheel runs where it is installed,
and the recipes of conda and Docker ask for what the package asks for.
"""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import textwrap
import tomllib
import venv
import zipfile
from email.parser import Parser
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
import yaml
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import hagoromo as hg

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
REQUIRED = {canonicalize_name(r.name): r for r in map(Requirement, PROJECT["project"]["dependencies"])}
# names of conda-forge that are others than those of the package index
CONDA_NAMES = {"py-opencv": "opencv-python-headless", "openexr-python": "openexr", "matplotlib-base": "matplotlib"}
PINS = runpy.run_path(str(ROOT / "packaging" / "pins.py"))
BUILD = "import sys, hatchling.build as b; print(b.build_wheel(sys.argv[1])); print(b.build_sdist(sys.argv[1]))"


def built(source: Path, out: Path) -> tuple[Path, Path]:
    """The wheel and the sdist of the checkout `source`, written to `out`; nothing is downloaded."""
    done = subprocess.run([sys.executable, "-c", BUILD, out], cwd=source, capture_output=True, text=True, check=True)
    wheel, sdist = done.stdout.split()
    return out / wheel, out / sdist


@pytest.fixture(scope="module")
def dist(tmp_path_factory) -> tuple[Path, Path]:
    return built(ROOT, tmp_path_factory.mktemp("dist"))


def files_of(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_wheel_holds_the_packages_with_their_data_and_nothing_else(dist):
    names = {name for name in files_of(dist[0]) if ".dist-info/" not in name}
    paths = [path for package in WHEEL for path in (ROOT / package).rglob("*") if path.is_file()]
    recipes = {f"hagoromo/matter/recipes/{path.name}" for path in (ROOT / "examples" / "recipes").iterdir()}
    assert names == recipes | {path.relative_to(ROOT).as_posix() for path in paths if "__pycache__" not in path.parts}
    assert {Path(name).suffix for name in names - recipes} == {
        ".py",
        ".pyi",
        ".j2",
        ".typed",
        ".js",
        ".css",
        ".html",
        ".frag",
    }
    assert {"hagoromo_page/report/templates/measure.html.j2", "hagoromo/__init__.pyi", "hagoromo/py.typed"} < names


def test_metadata_of_the_wheel_is_that_of_the_project(dist):
    files = files_of(dist[0])
    home = f"hagoromo-{hg.__version__}.dist-info"
    record = Parser().parsestr(files[f"{home}/METADATA"].decode("utf-8"))
    assert record["Name"] == "hagoromo" and record["Version"] == hg.__version__
    assert record["Requires-Python"] == PROJECT["project"]["requires-python"]
    assert set(record.get_all("Provides-Extra", [])) == set(PROJECT["project"]["optional-dependencies"])
    asked = [Requirement(line) for line in record.get_all("Requires-Dist", []) if "extra ==" not in line]
    assert {canonicalize_name(r.name): r.specifier for r in asked} == {n: r.specifier for n, r in REQUIRED.items()}
    entries = files[f"{home}/entry_points.txt"].decode("utf-8")
    assert "hagoromo = hagoromo_start:main" in entries and "figure = hagoromo_matter.figure.recipe:KIND" in entries
    assert f"{home}/licenses/LICENSE" in files


def parts_of(wheel: Path) -> dict[str, Any]:
    """The list of parts (SBOM) in a wheel."""
    return json.loads(files_of(wheel)[f"hagoromo-{hg.__version__}.dist-info/sboms/hagoromo.cdx.json"])


def installed(wanted: Requirement) -> dict[str, str]:
    """Versions of what a requirement brings on this machine, by the metadata of the packages that are installed."""
    found, left = {}, [(wanted.name, extra) for extra in ("", *wanted.extras)]
    for name, extra in left:
        package = distribution(name)
        found[canonicalize_name(name)] = package.version
        for needs in map(Requirement, package.requires or []):
            if needs.marker is None or needs.marker.evaluate({"extra": extra}):
                left += [each for each in ((needs.name, e) for e in ("", *needs.extras)) if each not in left]
    return found


def test_the_list_of_parts_in_the_wheel_is_valid(dist):
    """By the library of CycloneDX: its schema, strictly, and the identity of each package; every part has its place."""
    parts = parts_of(dist[0])
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(json.dumps(parts)) is None
    own = parts["metadata"]["component"]
    for part in (own, *parts["components"]):
        name = PackageURL.from_string(part["purl"])
        assert (name.type, name.name, name.version) == ("pypi", canonicalize_name(part["name"]), part["version"])
    assert own["version"] == hg.__version__ and own["licenses"] == [{"license": {"id": "Apache-2.0"}}]
    refs = {own["bom-ref"], *(part["bom-ref"] for part in parts["components"])}
    edges = {edge["ref"]: edge["dependsOn"] for edge in parts["dependencies"]}
    assert edges.keys() == refs and len(refs) == len(parts["components"]) + 1
    reached = {own["bom-ref"]}
    for _ in refs:
        reached |= {child for ref in reached for child in edges[ref]}
    assert reached == refs


def test_the_list_of_parts_names_what_is_installed(dist):
    """What the package and `dev` bring here by the metadata of their packages, at these versions, with its scope."""
    parts = {part["name"]: part for part in parts_of(dist[0])["components"]}
    required = installed(Requirement("hagoromo"))
    developers = installed(Requirement("hagoromo[dev]"))
    del required["hagoromo"], developers["hagoromo"]
    assert developers.items() <= {name: part["version"] for name, part in parts.items()}.items()
    assert {name for name in developers if parts[name]["scope"] == "required"} == required.keys()
    elsewhere = {name for name, pin in PINS["pins_of"](text("constraints.txt")).items() if pin.marker}
    assert {name for name, part in parts.items() if part["scope"] == "required"} - elsewhere <= required.keys()
    extras = {name: {p["value"] for p in part.get("properties", [])} for name, part in parts.items()}
    assert extras["viser"] == {"view", "dev"} and extras["vtk"] == {"vtk", "bench"} and extras["numpy"] == set()


@pytest.mark.nightly
def test_the_sdist_builds_the_same_wheel(dist, tmp_path):
    with tarfile.open(dist[1]) as archive:
        archive.extractall(tmp_path, filter="data")
    source = tmp_path / f"hagoromo-{hg.__version__}"
    assert (source / "constraints.txt").is_file() and (source / "tests" / "conftest.py").is_file()
    assert not any((source / name).exists() for name in ("out", ".venv", ".git"))
    assert files_of(built(source, tmp_path)[0]) == files_of(dist[0])


@pytest.mark.nightly
def test_the_wheel_runs_where_it_is_installed(dist, tmp_path):
    """An environment of its own, as pipx makes one; the libraries are those at hand, seen through a path file."""
    venv.create(tmp_path / "env", with_pip=False)
    binaries = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin")
    python = binaries / Path(sys.executable).name
    pip = [sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "install", "--no-deps", "--no-index", dist[0]], check=True, timeout=300)
    site = "import sysconfig; print(sysconfig.get_paths()['purelib'])"
    own = Path(subprocess.run([python, "-c", site], capture_output=True, text=True, check=True).stdout.strip())
    libraries = Path(str(distribution("numpy").locate_file(""))).resolve()
    (own / "libraries.pth").write_text(f"{libraries}\n", encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def said(*arguments: str) -> str:
        command = [binaries / "hagoromo", *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr.decode("utf-8")
        return done.stdout.decode("utf-8")

    assert said("--version") == f"hagoromo {hg.__version__}\n"
    assert "doctor" in said("--help")
    facts = json.loads(said("doctor", "--json"))
    assert Path(facts["hagoromo"]["folder"].replace("~", str(Path.home()))) == own and facts["can_render"]
    assert "recipe-figure" in said("schema").splitlines()  # of the wheel's own entry point
    code = textwrap.dedent("""
        import jinja2
        for package in ("hagoromo_page.report", "hagoromo_matter.demo"):
            loader = jinja2.PackageLoader(package)
            for name in loader.list_templates():
                print(loader.get_source(jinja2.Environment(), name)[1])
    """)
    shown = subprocess.run([python, "-c", code], cwd=tmp_path, env=environment, capture_output=True, check=True)
    paths = shown.stdout.decode("utf-8").splitlines()
    own_files = [file for package in ("hagoromo_page/report", "hagoromo_matter/demo") for file in
                 (ROOT / package / "templates").iterdir()]  # fmt: skip
    assert len(paths) == len(own_files) and all(Path(path).is_relative_to(own) for path in paths)


def test_the_conda_recipe_asks_for_what_the_package_asks_for():
    recipe = yaml.safe_load(text("packaging/conda/recipe.yaml"))
    assert recipe["context"]["version"] == hg.__version__ and recipe["schema_version"] == 1
    assert f">={recipe['context']['python_min']}" == PROJECT["project"]["requires-python"]
    rows = [line.split(" ", 1) for line in recipe["requirements"]["run"] if " " in line]
    asked = {CONDA_NAMES.get(name, name): bound for name, bound in rows if name != "python"}
    assert asked == {name: str(requirement.specifier) for name, requirement in REQUIRED.items()}


def test_containers_and_environments_install_the_same_llvm_and_a_python_that_is_tested():
    """Neither has been built here: at least they agree with what is."""
    first = re.search(r"for version in (\d+)", text(".ci/llvm"))
    assert first is not None
    dockerfile, workflow = text("packaging/Dockerfile"), yaml.safe_load(text(".github/workflows/ci.yml"))
    environment = yaml.safe_load(text("packaging/conda/environment.yaml"))["dependencies"]
    pythons = workflow["jobs"]["check"]["strategy"]["matrix"]["python"]
    assert f"libllvm{first[1]}" in dockerfile and f"libllvm{first[1]}" in environment
    assert f"libllvm{first[1]} " in text(".github/workflows/ci.yml")
    chosen = re.search(r"^ARG PYTHON=([\d.]+)$", dockerfile, re.MULTILINE)
    assert chosen is not None and chosen[1] in pythons and f"python {chosen[1]}.*" in environment
    assert re.findall(r"^USER (\w+)$", dockerfile, re.MULTILINE) == ["hagoromo"]  # not root
    kept = {line[1:] for line in text("packaging/Dockerfile.dockerignore").splitlines() if line.startswith("!")}
    files = {"LICENSE", "README.md", "constraints.txt", "pyproject.toml", "packaging/pins.py", "packaging/sbom.py"}
    assert kept == {*WHEEL, "examples/recipes", *files}


def test_the_container_gets_what_the_wheel_is_built_of(dist, tmp_path):
    """The files that its .dockerignore lets through, and no others, build the same wheel."""
    source = tmp_path / "source"
    source.mkdir()
    for line in text("packaging/Dockerfile.dockerignore").splitlines():
        if line.startswith("!"):
            copy = shutil.copytree if (ROOT / line[1:]).is_dir() else shutil.copy
            (source / line[1:]).parent.mkdir(exist_ok=True)
            copy(ROOT / line[1:], source / line[1:])
    assert files_of(built(source, tmp_path)[0]) == files_of(dist[0])


def test_every_python_that_is_claimed_is_tested():
    claimed = re.findall(r"Python :: (3\.\d+)", text("pyproject.toml"))
    workflow = yaml.safe_load(text(".github/workflows/ci.yml"))
    assert set(claimed) <= set(workflow["jobs"]["check"]["strategy"]["matrix"]["python"])
    assert f">={claimed[0]}" == PROJECT["project"]["requires-python"]
