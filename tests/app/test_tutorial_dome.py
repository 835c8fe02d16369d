"""The tutorial of the dome is run as it stands on its page, with fewer lamps and pixels."""

import re
from pathlib import Path

import numpy as np
import pytest

from hagoromo.files.exr import read_exr
from hagoromo.files.record import read_json
from studies.dome import dome, dome_lamps
from studies.tutorial_pictures import normals_off
from tests.app.page_commands import run_page

PAGE = Path(__file__).parents[2] / "docs" / "tutorial_dome.md"
LAMPS, WIDTH = 10, 120


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The folder in which the page was run."""
    folder = tmp_path_factory.mktemp("dome")
    simulated = "python -m studies.dome --out dome --lamps 48 --width 240"
    run_page(PAGE, folder, {simulated: lambda: dome("dome", LAMPS, WIDTH)})
    return folder


@pytest.mark.nightly
def test_the_lamps_of_the_ball_are_those_of_the_dome(home):
    """To 5°: the ball is 29 px wide here, where a pixel is 4° of the lamp."""
    found = np.array([lamp["to_lamp"] for lamp in read_json(home / "capture" / "transforms.json")["lamps"]])
    off = np.degrees(np.arccos(np.clip(np.sum(found * dome_lamps(LAMPS), axis=1), -1.0, 1.0)))
    assert off.max() < 5.0 and np.median(off) < 2.5


@pytest.mark.nightly
def test_the_surface_is_found_and_the_photographs_are_linear(home):
    known, true = (read_exr(home / path / "normals.exr")[0]["N.Z"] != 0.0 for path in ("measured", "dome/truth"))
    assert (known & true).sum() > 0.9 * true.sum()
    assert normals_off(home) < 2.0
    record = read_json(home / "measured" / "assumptions.json")
    assert not record["bent"] and record["assumptions"]["transfer"] == "srgb, as stated"
    assert "linear in light" in record["assumptions"]["linearity"]
    assert "What was taken for given" in (home / "measured" / "report.html").read_text(encoding="utf-8")
    assert (home / "page.html").is_file()


def test_the_messages_that_it_lists_are_those_of_the_package():
    rows = re.findall(r"^\| (.+?) \| .+ \|$", PAGE.read_text(encoding="utf-8").split("refused")[1], re.MULTILINE)
    source = "".join(path.read_text(encoding="utf-8") for path in (PAGE.parents[1] / "hagoromo").rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)
    for row in rows[1:]:
        parts = [part.strip() for part in row.split("…") if len(part.strip()) > 8]
        assert parts and all(part in source for part in parts), row
