"""The site of the documents: it builds without a warning, has every public name, and every citation of the model leads
to a section of it.
"""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from markdown.extensions.toc import slugify

import hagoromo
from tests.app.in_browser import CHROMIUM, FLAGS, started

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
CITED = re.compile(r"MODEL §(\d+(?:\.\d+)?)")
SECTION = re.compile(r"^#+ §(\d+(?:\.\d+)?) .*\{ #s([\d-]+) \}$", re.MULTILINE)
SOURCE = re.compile(r"([A-ZÁ-Ž][\w’'-]+)(?: (?:and|&) ([A-Z][\w-]+)| et al\.?)?,? \(?((?:19|20)\d\d)\b")  # author, year
NO_SOURCES = {"CIE", "Schema", "Integument"}  # a standard, a dialect, a title's end
GUIDES = [guide for guide in sorted((ROOT / "docs" / "howto").glob("*.md")) if guide.name != "index.md"]
DRAWN = {"svg", "title", "defs", "marker", "path", "rect", "text", "g"}
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s:]*)\)")  # to a page or a place of it, not to another site
HEADING, PLACE = re.compile(r"^#+ +(.+?) *$", re.MULTILINE), re.compile(r"\{ ?#([\w.-]+)|id=\"([^\"]+)\"")
MADE = {"reference", "examples"}  # folders of pages that the build of the site writes
NAMES = [name for name in vars(hagoromo)["__all__"] if not name.startswith("__")]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site as `make docs` builds it: a dead link, an unknown citation or a name without a docstring ends it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


@pytest.mark.nightly
def test_every_public_name_is_in_the_reference(site):
    pages = "".join(page.read_text(encoding="utf-8") for page in (site / "reference" / "api").glob("*.html"))
    missing = [name for name in NAMES if f'id="hagoromo.{name}"' not in pages]
    assert NAMES and not missing


@pytest.mark.nightly
def test_every_command_is_in_the_reference(site):
    page = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    for verb in ("measure", "render", "compare", "calibrate-lamps", "info"):
        assert f'id="{verb}"' in page


@pytest.mark.nightly
def test_the_site_loads_nothing_from_elsewhere(site):
    """Pages work without a network: links may lead out, but no script, style, font or picture comes from there."""
    loads = re.compile(r'<(?:script|img|iframe|source)[^>]* src="?https?:|<link[^>]* href="?https?:[^>]*stylesheet')
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    assert [page.name for page in pages if loads.search(page.read_text(encoding="utf-8"))] == []


@pytest.mark.nightly
def test_drawings_hold_nothing_but_drawing(site):
    """HTML within a drawing ends it: what follows would be text below it."""
    page = (site / "architecture.html").read_text(encoding="utf-8")
    drawings = re.findall(r'<svg class="drawing".*?</svg>', page, re.DOTALL)
    assert len(drawings) == 2 and "hagoromo_page/" in drawings[1]
    assert {tag for drawing in drawings for tag in re.findall(r"<([a-z]+)", drawing)} <= DRAWN


@pytest.mark.nightly
def test_equations_are_drawn(site):
    """No LaTeX is left for a script to set, but in the labels of the drawings."""
    page = (site / "model" / "reflection.html").read_text(encoding="utf-8")
    assert page.count('class="equation"') > 20 and "arithmatex" not in page


@pytest.mark.parametrize("guide", GUIDES, ids=lambda guide: guide.stem)
def test_a_guide_begins_with_the_words_that_it_needs(guide):
    """Three at least, each an entry of the glossary; the strict build of the site finds their places."""
    _, words, *_ = guide.read_text(encoding="utf-8").split("\n\n")
    assert words.startswith("*Words:* ") and len(re.findall(r"\]\(\.\./glossary\.md#[\w-]+\)", words)) >= 3


@pytest.mark.nightly
def test_search_works_from_a_file(site):
    """A browser starts no worker and fetches nothing for a page of file://; nothing is asked of elsewhere."""
    with started() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        shown, said, asked = browser.new_page(viewport={"width": 1250, "height": 900}), [], []
        shown.on("console", lambda one: said.append(one.text))
        shown.on("pageerror", lambda one: said.append(str(one)))
        shown.on("request", lambda one: asked.append(one.url))
        shown.goto((site / "howto" / "lab.html").as_uri())
        shown.locator(".md-search__input").click()
        shown.keyboard.type("deep shadow map")
        found = shown.locator(".md-search-result__link")
        found.first.wait_for()
        places = [found.nth(k).get_attribute("href") or "" for k in range(found.count())]
        assert "decisions/deep_shadow_maps.html" in places[0], places
        found.first.click()
        shown.locator("mark").first.wait_for()
        browser.close()
    assert said == [] and [address for address in asked if not address.startswith("file:")] == []


def places(page: Path) -> set[str]:
    """What a link to a page may lead to."""
    text = page.read_text(encoding="utf-8")
    headings = {slugify(re.sub(r"\]\([^)]*\)|[`*\[]", "", heading), "-") for heading in HEADING.findall(text)}
    return headings | {name for found in PLACE.findall(text) for name in found if name}


def test_links_lead_to_pages_and_places_that_are_there():
    """The build of the site says so, too, at night."""
    docs, dead, count = ROOT / "docs", [], 0
    for page in [page for page in docs.rglob("*.md") if page.parent.name != "hooks"]:
        for link in LINK.findall(re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)):
            name, _, place = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            count += 1
            if target.is_file():
                dead += [(page.name, link)] if place and target.suffix == ".md" and place not in places(target) else []
            elif target.is_relative_to(docs) and target.relative_to(docs).parts[0] not in MADE:
                dead.append((page.name, link))
    assert count > 400 and dead == []


def test_citations_of_the_model_lead_to_its_sections():
    """Every "MODEL §n" in the code, the tests and the benchmarks is a heading "§n" of docs/model with its anchor."""
    sections = {}
    for page in (ROOT / "docs" / "model").glob("*.md"):
        for number, anchor in SECTION.findall(page.read_text(encoding="utf-8")):
            assert anchor == number.replace(".", "-") and number not in sections
            sections[number] = page.name
    cited = {
        (number, path.name)
        for room in (*WHEEL, "studies", "tests", "benchmarks")
        for path in (ROOT / room).rglob("*.py")
        for number in CITED.findall(path.read_text(encoding="utf-8"))
    }
    assert len(cited) > 20 and sections
    assert {(number, name) for number, name in cited if number not in sections} == set()


def test_sources_of_docstrings_are_in_the_bibliography():
    """Every "Author year" in the code is an entry of docs/references.bib."""
    bib = (ROOT / "docs" / "references.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{([^,]+),$", bib, re.MULTILINE)
    assert len(set(keys)) == len(keys)
    authors = re.findall(r"author = \{(.*)\},\n.*\n  year = \{(\d+)\}", bib)
    known = {(name.split(",")[0], year) for names, year in authors for name in names.split(" and ")}
    cited = {
        (first, second, year)
        for room in (*WHEEL, "studies")
        for path in (ROOT / room).rglob("*.py")
        for first, second, year in SOURCE.findall(" ".join(path.read_text(encoding="utf-8").split()))
        if first not in NO_SOURCES
    }
    assert len(cited) > 50
    assert {c for c in cited if (c[0], c[2]) not in known and (c[1], c[2]) not in known} == set()
