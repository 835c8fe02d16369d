"""The film in raking light: where its lamp stands, what it shows, its files, and what it refuses."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo_page.publication.publish import page_source
from hagoromo_page.raking import RakingLight, raking
from tests.inverse.simulated_relief import SimulatedRelief, relief_camera, relief_measurement


def measurement(size=32, relief=None):
    return relief_measurement(relief or SimulatedRelief(seed=1), relief_camera(size), 1)


def test_the_lamp_goes_round_at_its_elevation_clockwise_from_the_top():
    light = RakingLight(page_source(measurement(), None).maps, 15.0)
    around = np.array([light.to_lamp(k / 8) for k in range(8)])
    np.testing.assert_allclose(np.degrees(np.arcsin(around @ light.up)), 15.0)
    assert around[0, 1] > 0.9 and around[2, 0] > 0.9 and around[4, 1] < -0.9 and around[6, 0] < -0.9


def test_a_flake_is_dark_towards_the_lamp_and_lit_on_its_far_edge():
    """A hole of 0.3 mm in a flat plate, under a lamp on the left at 10°: its left edge turns away from the lamp."""

    class FlatRelief(SimulatedRelief):
        def height(self, x, y):
            return -3e-4 * self._inside((0.0, 0.0, 0.006), x, y)

    maps = page_source(measurement(64, FlatRelief()), None).maps
    light = RakingLight(maps, 10.0)
    share = light.lit(0.75).mean(axis=2) / np.maximum(maps.body.mean(axis=2), 1e-9)  # the lamp on the left
    middle = share[share.shape[0] // 2]
    left, right = (middle[share.shape[1] // 2 + side * 10 + np.arange(-2, 3)] for side in (-1, 1))
    assert left.min() < 0.3 * np.median(share[maps.known]) and right.max() > 2.0 * np.median(share[maps.known])


def test_frames_are_written_with_a_sheet_and_as_a_film(tmp_path):
    measurement().save(tmp_path / "measured")
    command = ["raking", str(tmp_path / "measured"), "--frames", "3", "--longest", "24"]
    assert main([*command, "--out", str(tmp_path / "frames")]) == 0
    names = sorted(one.name for one in (tmp_path / "frames").glob("*.png"))
    assert names == ["frame_00000.png", "frame_00001.png", "frame_00002.png", "sheet.png"]
    pictures = [hg.read_png(tmp_path / "frames" / name) for name in names[:3]]
    assert max(pictures[0].shape) == 24 and not np.array_equal(pictures[0], pictures[1])
    assert 180 < max(picture.max() for picture in pictures) <= 255
    assert main([*command, "--out", str(tmp_path / "film.gif")]) == 0
    assert (tmp_path / "film.gif").read_bytes()[:4] == b"GIF8"


@pytest.mark.parametrize(
    ("options", "words"),
    [({"elevation": 0.0}, "0° above"), ({"elevation": 95.0}, "95° above"), ({"frames": 0}, "0 frames")],
)
def test_what_cannot_be_lit_is_refused(tmp_path, options, words):
    with pytest.raises(InputError, match=words):
        raking(measurement(), tmp_path / "film.gif", **options)


def test_a_measurement_without_depth_is_refused(tmp_path, capsys):
    measurement().save(tmp_path / "measured")
    (tmp_path / "measured" / "points.exr").unlink()
    assert main(["raking", str(tmp_path / "measured"), "--out", str(tmp_path / "film.gif")]) == 2
    assert "no depth" in capsys.readouterr().err and not (tmp_path / "film.gif").exists()
