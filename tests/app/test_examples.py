"""Every example runs as it stands on one core in a minute, says what it promises, and becomes a page and a notebook."""

import ast
import json

import pytest

from docs.hooks.example import RUN, cells_of, examples, notebook, page, run_of
from hagoromo.files.png import read_png

SAID = {
    "01_measure_a_ball": ["alpha", "beta", "gamma", "95 % interval"],
    "02_fit_a_table": ["not a dichromatic", "(rms) within 60°"],
    "03_expose_again": ["canon_eos_300d", "Nikon", "R/G"],
    "04_spectra_of_skin": ["of the truth", "ΔE00 of pale and flushed skin"],
    "05_all_orders": ["march", "full states that its mean", "path"],
    "06_gradient": ["central difference", "the density is off by"],
    "07_a_matter_of_ones_own": ["VolumeBox(", "image.exr image.png"],
    "08_bsdf_in_mitsuba": ["the two differ by 0.", "largest difference"],
    "09_preview": ["pixels after", "100% of the work", "the same bits: True"],
    "11_two_dates": ["regions that changed: colour in 1", "registered to 0.00"],
    "10_recover": ["Recovered('figure'", "gamma", "view 17", "dB", "its surface is off by 0."],
}
MOST_S = 60.0  # of processor time
PUBLIC = {"hagoromo", "hagoromo_formats.mitsuba"}


@pytest.mark.parametrize("script", examples(), ids=lambda script: script.stem)
def test_an_example_uses_public_names_only(script):
    tree = ast.parse(script.read_text(encoding="utf-8"))
    modules = [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
    modules += [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert {module for module in modules if module.startswith("hagoromo")} <= PUBLIC


def test_every_example_is_run():
    assert [script.stem for script in examples()] == sorted(SAID)


def test_cells_are_text_and_code_on_their_lines():
    script = '"""Title\n\nAbout it.\n"""\n\nimport os\n\n# %%\n# Text\n# more\n\nx = 1\n\n# %%\ny = 2\n'
    title, about, cells = cells_of(script)
    assert (title, about) == ("Title", "About it.")
    assert [tuple(cell) for cell in cells] == [("", "import os", 5), ("Text\nmore", "x = 1", 11), ("", "y = 2", 14)]
    for cell in cells:
        assert script.splitlines()[cell.above] == cell.code


def test_a_page_and_a_notebook_hold_text_code_and_output():
    picture = {"file": "a_1.png", "alt": "a curve"}
    cell = {"text": "Text", "code": "print(1)", "output": "1\n", "pictures": [picture]}
    run = {"title": "Title", "about": "About", "cells": [cell], "cpu_s": 2.4}
    shown = page("a.py", run)
    for part in (
        "# Title",
        "About",
        "Text",
        "```python\nprint(1)\n```",
        "\n1\n```",
        "![a curve](a_1.png)",
        "(a.py)",
        "2 s",
    ):
        assert part in shown
    made = json.loads(json.dumps(notebook(run)))
    assert [one["cell_type"] for one in made["cells"]] == ["markdown", "markdown", "code"]
    assert made["nbformat"] == 4 and made["cells"][2]["outputs"][0]["text"] == "1\n"


@pytest.mark.nightly
@pytest.mark.parametrize("script", examples(), ids=lambda script: script.stem)
def test_an_example_runs(script):
    """As the site shows it: the run is kept for that, until the script or the packages change."""
    home = run_of(script)
    run = json.loads((home / RUN).read_text(encoding="utf-8"))
    printed = "".join(cell["output"] for cell in run["cells"])
    assert all(word in printed for word in SAID[script.stem]), printed
    assert run["cpu_s"] < MOST_S
    pictures = [one for cell in run["cells"] for one in cell["pictures"]]
    assert pictures and all(one["alt"] for one in pictures)
    for one in pictures:
        assert read_png(home / one["file"]).std() > 1.0  # not blank
    assert sorted(path.name for path in home.iterdir()) == sorted([RUN, *(one["file"] for one in pictures)])
