"""The project says one thing in all places: version, commands, what the workflow and the hooks run."""

import re
import tomllib
from pathlib import Path

import hagoromo as hg
from hagoromo.files.cache import SOURCES
from studies.__main__ import main
from studies.table_of_studies import STUDIES

ROOT = Path(__file__).resolve().parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_version_is_the_same_in_code_wheel_citation_and_changelog():
    """The wheel's is that of the code: pyproject.toml reads it there."""
    assert re.search(r"^version: (.+)$", text("CITATION.cff"), re.MULTILINE)[1] == hg.__version__  # type: ignore[index]
    versions = re.findall(r"^## (\S+)", text("CHANGELOG.md"), re.MULTILINE)
    assert hg.__version__ in versions[:2] and versions[0] in (hg.__version__, "Unreleased")
    assert 'dynamic = ["version"]' in text("pyproject.toml")


def test_a_package_is_listed_alike_in_all_places():
    """Else its types or layers are not checked, its changes do not renew the cache, or it is not shipped."""
    tool = tomllib.loads(text("pyproject.toml"))["tool"]
    packages = sorted(path.parent.name for path in ROOT.glob("hagoromo*/__init__.py"))
    shipped = [name for name in packages if name != "hagoromo_blender"]
    assert tool["hatch"]["build"]["targets"]["wheel"]["packages"] == tool["importlinter"]["root_packages"] == shipped
    assert set(packages) <= set(tool["pyrefly"]["project-includes"])
    assert [*SOURCES, "hagoromo_start"] == shipped
    beside = r"preload_modules: \[(.+)\]", r"imports: \[(.+)\]"
    for file, pattern in zip(("mkdocs.yml", "packaging/conda/recipe.yaml"), beside, strict=True):
        assert {*re.findall(pattern, text(file))[0].split(", "), "hagoromo"} == set(SOURCES), file
    assert set(re.findall(r"^!(hagoromo\w*)$", text("packaging/Dockerfile.dockerignore"), re.MULTILINE)) == set(shipped)


def test_the_workflow_runs_what_anybody_runs():
    assert "run: .ci/run\n" in text(".github/workflows/ci.yml")
    assert "make --no-print-directory test" in text(".ci/run")


def test_hooks_run_the_quick_checks_of_make_test():
    """Each of the checks that come before pytest, by the same command of .venv."""
    hooks = re.findall(r"entry: \.venv/bin/(\S+)", text(".pre-commit-config.yaml"))
    steps = re.findall(r"^\t\$\(BIN\)/(\S+)", text("Makefile").split("\ntest:", 1)[1].split("\n\n", 1)[0], re.MULTILINE)
    assert hooks == [step for step in steps if step != "pytest"]


def test_make_help_says_what_every_target_is():
    targets = " ".join(re.findall(r"^\.PHONY: (.+)$", text("Makefile"), re.MULTILINE)).split()
    assert sorted(targets) == sorted(re.findall(r"^([a-z-]+):.* ## \S", text("Makefile"), re.MULTILINE))


def test_every_study_runs_files_that_are_there_and_every_page_of_figures_names_its_study():
    for name, study in STUDIES.items():
        for arguments in study.runs:
            assert arguments[0] == "-m" and (ROOT / f"{arguments[1].replace('.', '/')}.py").is_file(), name
        for pattern, target in study.copies:
            assert (ROOT / target).exists(), (name, target)
            if pattern.endswith(".md"):
                page = text(f"docs/{pattern.rsplit('/', 1)[1]}")
                assert f"`python -m studies {name}`" in page, name


def test_a_name_that_is_no_study_ends_in_a_line_and_status_2(capsys):
    assert main(["lamps", "lamsp"]) == 2
    assert "there is no study 'lamsp': give one of real, relit" in capsys.readouterr().err
    assert main([]) == 0
    listed = capsys.readouterr().out
    assert all(f"  {name} " in listed for name in STUDIES)


def test_options_behind_one_name_go_to_the_first_command_of_a_study(capfd, monkeypatch):
    """Behind its own, and no document is changed; behind two names, or none, they end in a line."""
    monkeypatch.chdir(ROOT)
    study = next(name for name, study in STUDIES.items() if study.copies and not study.needs_demo)
    assert main([study, "--help"]) == 0
    said = capfd.readouterr()
    assert "usage: " in said.out and "--out" in said.out and " -> docs" not in said.out
    assert main([study, "lamps", "--force"]) == main(["--force"]) == 2
    assert "--force stands behind 2 names" in (said := capfd.readouterr().err) and "behind 0 names" in said


def test_a_name_of_a_class_has_one_meaning():
    """In the packages, the studies, the benchmarks and the tests alike."""
    places: dict[str, list[str]] = {}
    for folder in ("hagoromo*", "studies", "benchmarks", "fuzz", "packaging", "tests"):
        for path in sorted(ROOT.glob(f"{folder}/**/*.py")):
            for name in re.findall(r"^ *class (\w+)[(:]", path.read_text(encoding="utf-8"), re.MULTILINE):
                places.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert len(places) > 900
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
