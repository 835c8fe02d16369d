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
    assert sorted(mark for mark in marks if mark != "end") == sorted([*page.TABLES, "open_box", "orders", "peers"])
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


def test_all_orders_have_a_table_for_each_scene(page):
    """Rows of rivals, of what was refused, and of the chase."""
    tables = importlib.import_module("tables")
    race = {"by": "path", "walks": 8, "cpu_s": 2.0, "noise_1": 0.16, "noise_32": 0.01}
    other = race | {"by": "Mitsuba volpath", "cpu_s": 30.0, "mean": 1.001, "mean_error": 0.002}
    full = {
        "by": "full",
        "walks": 4,
        "cpu_s": 3.0,
        "noise_1": 0.03,
        "noise_32": 0.02,
        "mean": 0.99,
        "mean_error": 0.001,
    }
    again = {"by": "full, another camera", "walks": 4, "cpu_s": 0.5, "march_s": 0.25}
    chase = [{"by": "Mitsuba volpath", "chase": 20.1, "walks": 64, "cpu_s": 60.3, "noise_1": 0.06}]
    found = {
        "title": "cloth",
        "same": True,
        "pixels": 512,
        "error": 0.01,
        "most": 8.0,
        "rounds": 3,
        "seeds": "1 to 3",
    }
    found |= {"load_before": 2.0, "rows": [race, other, full | {"memory": 0.2}, again], "chase": chase}
    text = tables.orders_table(found)
    assert "| Mitsuba volpath | 8 | 30 | 15 | 16 | 1 | 1.0010 ± 0.0020 |" in text
    assert "march of the same camera: 2.00." in text and "off by 3 %" in text
    assert "| Mitsuba volpath | 60.3 | 20.1 | 64 | 6 |" in text
    refused = tables.orders_table(found | {"rows": [race, {"by": "full", "refused": "it has texels"}]})
    assert refused.endswith("Mode full: it has texels.")
