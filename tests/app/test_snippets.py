"""Every Python snippet of README and docs runs as it stands, beside a small capture and a scene.toml."""

import re
from pathlib import Path

import pytest

import hagoromo as hg
from studies.recover_scenes import TrueObject, shots, simulated

ROOT = Path(__file__).parents[2]
# They run with their commands, in test_tutorial.py and test_region_spectra.py.
ELSEWHERE = ("tutorial.md", "tutorial_skin.md")
SCENE = """
[camera]
preset = "canon_eos_kiss_digital"
binning = 32
eye = [0.0, -0.4, 0.0]

[[lamp]]
name = "key"
position = [0.2, -0.8, 0.3]
spectrum = "D65"

[[lamp]]
name = "top"
position = [0.0, -0.2, 0.9]
spectrum = "D65"

[[lamp]]
name = "rim"
position = [0.0, 0.4, -0.8]
spectrum = "D65"

[[surface]]
name = "ball"
shape = "sphere"
scale = 0.03
reflectance = {alpha = 0.1, beta = 1.5, gamma = 0.18, n = 1.5, body_colour = 0.8}
"""


def snippets(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


PAGES = [
    page
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if page.name not in ELSEWHERE and snippets(page)
]


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with scene.toml and capture/, photographs of that scene, and with all_around/, those of many views."""
    folder = tmp_path_factory.mktemp("snippets")
    (folder / "scene.toml").write_text(SCENE)
    hg.simulate(folder / "scene.toml", name="ball").save(folder / "capture")
    simulated(TrueObject(flat=True), shots(9, 5, 60, 1, pixels=40), 1).capture.save(folder / "all_around")
    return folder


def test_the_readme_has_a_snippet():
    assert ROOT / "README.md" in PAGES


@pytest.mark.by_night(*(f"docs/howto/{name}.md" for name in ("appearance_researcher", "derivatives", "recover")))
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_snippets_of_a_page_run(page, home, monkeypatch):
    monkeypatch.chdir(home)
    names = {}
    for snippet in snippets(page):
        exec(compile(snippet, str(page), "exec"), names)


def test_a_parameter_and_a_varnish_print_what_their_pages_say(capsys):
    """Of "Add a parameter" and of the example of a varnish: what stands behind # beside or below what prints."""
    said, printed = [], []
    for page, word in (("architecture.md", "LambertBody"), ("model/reflection.md", "varnish_n")):
        (snippet,) = (one for one in snippets(ROOT / "docs" / page) if word in one)
        exec(compile(snippet, page, "exec"), {})
        said += re.findall(r"^(?:print\(.*\)  )?# (.*)$", snippet, re.MULTILINE)
        printed += capsys.readouterr().out.splitlines()
    assert said == printed and len(said) == 5
