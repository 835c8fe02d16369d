"""The tutorial of many views is run as it stands on its page, with fewer pixels."""

from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.record import read_json
from studies.all_around import all_around
from tests.app.page_commands import run_page

PAGE = Path(__file__).parents[2] / "docs" / "tutorial_views.md"
VIEWS, WIDTH = 30, 400
pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The folder in which the page was run."""
    pytest.importorskip("pycolmap", reason="poses from photographs need pycolmap: pip install 'hagoromo[views]'")
    folder = tmp_path_factory.mktemp("views")
    simulated = "python -m studies.all_around --out around --views 30 --width 480"
    run_page(PAGE, folder, {simulated: lambda: all_around("around", VIEWS, WIDTH)})
    return folder


def test_cameras_stand_where_they_stood(home):
    """To 1 % of their distance from each other: scale and shape of the ring; the direction of x is not known."""
    true = np.array(read_json(home / "around" / "truth.json")["places"])
    found = np.array([p.camera.position for p in hg.load_capture(home / "capture").photographs])
    assert len(found) == VIEWS
    apart = [np.linalg.norm(places[:, None] - places, axis=2) for places in (true, found)]
    assert np.abs(apart[1] - apart[0]).max() < 0.01 * apart[0].max()


def test_the_object_is_recovered(home):
    record, true = read_json(home / "object.json"), read_json(home / "around" / "truth.json")
    assert np.mean([score["psnr"] for score in record["kept_aside"]]) > 30.0  # dB
    assert record["material"]["gamma"] == pytest.approx(true["gamma"], rel=0.1)
    low, high = record["material"]["interval_95"]["beta"]
    assert low < true["beta"] < high


def test_pictures_film_and_page_are_there(home):
    assert hg.read_png(home / "evening.png").max() > 60
    assert (home / "turning.gif").stat().st_size > 10_000 and (home / "page.html").is_file()
