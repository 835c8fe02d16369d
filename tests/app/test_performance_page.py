"""The page of performance is made from its records, and only from them."""

import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = ("page", "plots", "tables", "turns", "peers_table")


@pytest.fixture
def page(monkeypatch):
    """The module, found as the benchmark finds it, and forgotten afterwards."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    yield importlib.import_module("page")
    for name in MODULES:
        sys.modules.pop(name, None)


def test_the_page_has_one_place_for_every_record(page):
    text = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    marks = re.findall(r"<!-- (\w+) -->", text)
    assert sorted(mark for mark in marks if mark != "end") == sorted([*page.TABLES, "open_box", "peers"])
    assert marks[1::2] == ["end"] * len(marks[::2]), "every place is closed before the next one opens"


def test_what_stands_between_marks_is_replaced_and_nothing_else(page):
    text = "a\n<!-- x -->\nold\n<!-- end -->\nb\n<!-- y -->\nkept\n<!-- end -->\n"
    assert page.replaced(text, "x", "new \\1") == text.replace("old", "new \\1")
    with pytest.raises(ValueError, match="no marks for z"):
        page.replaced(text, "z", "new")


def test_the_slope_of_a_power_law_is_its_exponent(page):
    rows = [{"n": n, "s": 3.0 * n**1.5} for n in (2, 3, 5, 7)]
    slope = importlib.import_module("tables").slope(rows, "n", "s")
    assert slope == pytest.approx(1.5, rel=1e-12)  # a least-squares line through points on a line: rounding alone
