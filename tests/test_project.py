"""The project says one thing in all places: version, commands, what the workflow and the hooks run."""

import re
from pathlib import Path

import hagoromo as hg

ROOT = Path(__file__).resolve().parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_version_is_the_same_in_code_wheel_citation_and_changelog():
    """The wheel's is that of the code: pyproject.toml reads it there."""
    assert re.search(r"^version: (.+)$", text("CITATION.cff"), re.MULTILINE)[1] == hg.__version__  # type: ignore[index]
    versions = re.findall(r"^## (\S+)", text("CHANGELOG.md"), re.MULTILINE)
    assert hg.__version__ in versions[:2] and versions[0] in (hg.__version__, "Unreleased")
    assert 'dynamic = ["version"]' in text("pyproject.toml")


def test_the_workflow_runs_what_anybody_runs():
    assert "run: .ci/run\n" in text(".github/workflows/ci.yml")
    assert "make --no-print-directory test" in text(".ci/run")


def test_hooks_run_the_quick_checks_of_make_test():
    """Each of the checks that come before pytest, by the same command of .venv."""
    hooks = re.findall(r"entry: \.venv/bin/(\S+)", text(".pre-commit-config.yaml"))
    steps = re.findall(r"^\t\$\(BIN\)/(\S+)", text("Makefile").split("\ntest:", 1)[1].split("\n\n", 1)[0], re.MULTILINE)
    assert hooks == [step for step in steps if step != "pytest"]


def test_contributing_knows_every_target_of_the_makefile():
    targets = re.findall(r"^\.PHONY: (.+)$", text("Makefile"), re.MULTILINE)
    for target in " ".join(targets).split():
        assert f"make {target}`" in text("CONTRIBUTING.md"), target
