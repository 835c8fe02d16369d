"""Pins: one for every requirement, with hashes; lower bounds that were tested; nothing is installed without a hash."""

import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "packaging" / "pins.py"
PINS = runpy.run_path(str(SCRIPT))
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS, GROUPS = PYPROJECT["project"]["optional-dependencies"], PYPROJECT["dependency-groups"]
ASKED = ["hagoromo", *(f"hagoromo[{extra}]" for extra in EXTRAS), *GROUPS]


def pins_of(name: str):
    return PINS["pins_of"]((ROOT / name).read_text(encoding="utf-8"))


CONSTRAINTS, LOWEST = pins_of("constraints.txt"), pins_of("packaging/lowest.txt")
REQUIREMENTS = [Requirement(line) for line in PINS["requirements"](PYPROJECT, ASKED)]


def test_every_requirement_has_a_pin_that_it_allows():
    for requirement in REQUIREMENTS:
        assert Version(CONSTRAINTS[canonicalize_name(requirement.name)].version) in requirement.specifier, requirement
    assert PYPROJECT["build-system"]["requires"] == [line for line in GROUPS["build"] if "hatchling" in line]


@pytest.mark.parametrize("file", ["constraints.txt", "packaging/lowest.txt", "benchmarks/cycles.txt"])
def test_every_pin_has_hashes_and_is_read_whole(file):
    text, pins = (ROOT / file).read_text(encoding="utf-8"), pins_of(file)
    lines = [line for line in text.splitlines() if line[:1].isalnum()]
    assert len(pins) == len(lines)
    assert all(0 < len(set(pin.hashes)) == len(pin.hashes) for pin in pins.values())
    assert sum(len(pin.hashes) for pin in pins.values()) == text.count("--hash=sha256:")
    for pin in pins.values():
        assert Version(pin.version) and Marker(pin.marker or "python_version > '3'")  # both are read as pip reads them


def test_lower_bounds_are_the_versions_that_were_tested():
    """lowest.txt is what `make lowest` installs: a bound that was lowered or raised without it is refused."""
    for requirement in REQUIREMENTS:
        name = canonicalize_name(requirement.name)
        if str(requirement) in GROUPS["pins"] or (requirement.marker and not requirement.marker.evaluate()):
            continue
        bounds = [Version(part.version) for part in requirement.specifier if part.operator in (">=", "==")]
        assert bounds == [Version(LOWEST[name].version)], requirement


@pytest.mark.parametrize("asked", ASKED)
def test_the_pins_of_a_set_up_are_whole(asked):
    """Everything that a chosen pin was pinned for is reached from the requirements, and nothing else is chosen."""
    lines = PINS["requirements"](PYPROJECT, [asked])
    chosen = PINS["needed"](CONSTRAINTS, lines)
    direct = {canonicalize_name(Requirement(line).name) for line in lines}
    assert direct <= chosen.keys()
    assert all(direct & {name} or chosen.keys() & set(pin.via) for name, pin in chosen.items())
    assert not any(set(pin.via) & chosen.keys() for name, pin in CONSTRAINTS.items() if name not in chosen)


def test_the_script_prints_lines_for_pip():
    done = subprocess.run([sys.executable, "-S", SCRIPT, "hagoromo[view]", "build"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed = PINS["pins_of"](done.stdout)
    assert {"numpy", "viser", "hatchling"} < printed.keys() and "pytest" not in printed
    assert all(pin._replace(via=()) == CONSTRAINTS[name]._replace(via=()) for name, pin in printed.items())


@pytest.mark.parametrize("asked", ["hagoromo[veiw]", "veiw", "-", "hagoromo["])
def test_what_is_not_there_is_refused_in_one_line(asked):
    done = subprocess.run([sys.executable, SCRIPT, asked], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.count("\n") == 1, done.stderr


@pytest.mark.parametrize(
    "file", ["Makefile", ".github/workflows/ci.yml", ".github/workflows/audit.yml", "packaging/Dockerfile"]
)
def test_nothing_is_installed_without_its_hash(file):
    """Every `pip install` asks for hashes, or is of this checkout alone."""
    text = (ROOT / file).read_text(encoding="utf-8")
    for name, value in re.findall(r"^(\w+) := (.*)$", text, re.MULTILINE):
        text = text.replace(f"$({name})", value)
    commands = [line for line in text.splitlines() if "pip install" in line and ":=" not in line]
    assert all("--require-hashes" in line or "--no-deps" in line for line in commands), commands
    assert len(commands) == {"Makefile": 7, "ci.yml": 2, "audit.yml": 0, "Dockerfile": 3}[Path(file).name]


def test_the_workflow_audits_what_is_pinned_every_week():
    audit = yaml.safe_load((ROOT / ".github/workflows/audit.yml").read_text(encoding="utf-8"))
    assert [step["run"] for step in audit["jobs"]["audit"]["steps"] if "run" in step] == [
        "make --no-print-directory audit"
    ]
    assert audit[True]["schedule"]  # `on`, which YAML takes for a truth
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(r"/pip-audit --requirement constraints.txt --require-hashes --disable-pip", makefile)
