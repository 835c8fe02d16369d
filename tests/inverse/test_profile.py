"""Profiles: heights along a line, their stated band against the truth, files, and lines that cannot be followed."""

import csv

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.error_files import SharedErrors
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.surface.depth import surface_from_normals
from tests.inverse.simulated_relief import (
    SimulatedRelief,
    dome,
    places,
    relief_camera,
    relief_capture,
    relief_measurement,
)

LINES = (((0.2, 0.3), (0.8, 0.7)), ((0.08, 0.5), (0.92, 0.5)), ((0.5, 0.5), (0.65, 0.5)), ((0.08, 0.2), (0.08, 0.8)))
TURN = 0.01  # rad, errors of normals about each of two axes


def shape(size):
    """Points, normals and mask of a relief, and its camera."""
    camera = relief_camera(size)
    rows, columns = np.mgrid[:size, :size] + 0.5
    return (camera, *places(SimulatedRelief(seed=1), camera, rows, columns))


def shared_turns(normals, inside):
    """(2, h, w, 3) two errors that all pixels share: one that is alike everywhere, one that turns over the picture."""
    size = len(normals)
    y, x = np.mgrid[:size, :size] / size
    zero = np.zeros((size, size))
    modes = np.stack(
        [np.stack([zero + 0.004, zero, zero], 2), 0.005 * np.stack([np.sin(3 * x), np.cos(3 * y), zero], 2)]
    )
    modes -= np.einsum("mhwi,hwi->mhw", modes, normals)[..., None] * normals
    return np.where(inside[..., None], modes, 0.0)


def coverage(size, draws, lines):
    """Share of true heights in their stated band, for each line, over `draws` of the errors of normals."""
    camera, points, normals, inside = shape(size)
    modes, random = shared_turns(normals, inside), np.random.default_rng(0)
    own = np.where(inside, 2.0 * TURN**2, 0.0)
    of_truth = SeenSurface(
        camera, inside, np.where(inside[..., None], points, 0.0), normals, None, None, None, None, None, True
    )
    hits = [[] for _ in lines]
    for _ in range(draws):
        noisy = normals + TURN * random.standard_normal(normals.shape)
        noisy += np.einsum("m,mhwi->hwi", random.standard_normal(2), modes)
        noisy = np.where(inside[..., None], noisy / np.linalg.norm(noisy, axis=2, keepdims=True), 0.0)
        solved = surface_from_normals(noisy, camera, 0.4, np.where(inside, own, 1.0), draws=1, modes=modes)
        assert solved.modes is not None
        shared = SharedErrors(modes, solved.modes)
        measured = SeenSurface(camera, inside, solved.points, noisy, None, None, own, own, shared, True).sharpened()
        for hit, line in zip(hits, lines, strict=True):
            start, end = (np.array(one) * size for one in line)
            found, truth = hg.profile(measured, start, end), hg.profile(of_truth, start, end)
            true_height = np.interp(found.distance, truth.distance, truth.height)
            between = found.error > 0.0
            hit.append((np.abs(true_height - found.height) < NORMAL_95 * found.error)[between])
    return [float(np.mean(hit)) for hit in hits]


def test_the_band_holds_the_true_heights():
    """95 % of them; 25 draws of lines that err alike along themselves: to 8 %."""
    (share,) = coverage(32, 25, LINES[:1])
    assert share == pytest.approx(0.95, abs=0.08)


@pytest.mark.nightly
def test_the_band_holds_the_true_heights_of_long_and_short_lines_and_at_the_rim():
    """95 ± 3 % of them, over 150 draws."""
    np.testing.assert_allclose(coverage(48, 150, LINES), 0.95, atol=0.03)


def test_averages_over_squares_give_the_band_of_all_pixels(monkeypatch):
    """To a tenth, inside the surface: squares leave out its rim, near which they make the band too wide."""
    camera, points, normals, inside = shape(144)
    own, points = np.where(inside, 2.0 * TURN**2, 0.0), np.where(inside[..., None], points, 0.0)
    seen = SeenSurface(camera, inside, points, normals, None, None, own, own, None, True)
    whole = hg.profile(seen, (50, 58), (94, 86)).error
    monkeypatch.setattr("hagoromo.measurement.inspection.height_errors.MOST_PIXELS", 2600)
    coarse = hg.profile(seen, (50, 58), (94, 86)).error
    np.testing.assert_allclose(coarse[9:-9], whole[9:-9], rtol=0.1)
    assert (coarse[1:-1] > 0.9 * whole[1:-1]).all()  # beside the ends it is wider


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:exponent")  # of a relief so flat the shading says little
def test_a_measured_relief_has_its_true_heights_in_the_band():
    """Of photographs: the shares of three lines together, which err alike along themselves; a true flake of 0.1 mm."""
    relief = SimulatedRelief(seed=1, flake={(-0.006, 0.003, 0.0035): 1e-4})
    camera = relief_camera(96)
    seen = seen_surface(hg.measure(relief_capture(relief, camera, dome(12), 3), distance=0.4))
    rows, columns = np.mgrid[:96, :96] + 0.5
    points, normals, inside = places(relief, camera, rows, columns)
    truth = SeenSurface(
        camera, inside, np.where(inside[..., None], points, 0.0), normals, None, None, None, None, None, True
    )
    inside_band = []
    for line in LINES[:3]:
        start, end = (96 * np.array(one) for one in line)
        found, true = hg.profile(seen, start, end), hg.profile(truth, start, end)
        off = np.abs(np.interp(found.distance, true.distance, true.height) - found.height)
        inside_band.append(off <= NORMAL_95 * found.error + 1e-9)
    assert np.mean(np.concatenate(inside_band)) > 0.8


def test_a_line_is_as_long_as_its_pixels():
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1)
    scaled = hg.profile(measurement, (8, 10), (24, 20))
    pixel = 1e3 * 0.4 / relief_camera(32).focal[0]
    assert scaled.unit == "mm" and scaled.distance[-1] == pytest.approx(pixel * np.hypot(16, 10), rel=0.02)


def test_a_given_shape_has_heights_and_no_band():
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1, errors=False)
    found = hg.profile(measurement, (8, 10), (24, 20))
    assert np.isnan(found.error).all() and "without errors" in found.remarks[0] and "without a band" in repr(found)


def test_files_hold_what_python_gives(tmp_path):
    """A table with empty cells in a gap, a plot, and the same from the command."""
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1)
    measurement.labels[14:16, 15:17] = -1
    measurement.save(tmp_path / "measured")
    found = hg.profile(tmp_path / "measured", (6, 15), (26, 15))
    command = ["profile", str(tmp_path / "measured"), "--line", "6", "15", "26", "15", "--out", str(tmp_path / "p.csv")]
    assert main(command) == 0 and (tmp_path / "p.png").stat().st_size > 5000
    with open(tmp_path / "p.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.height) and sum(not row["height_mm"] for row in rows) == (~found.known).sum() > 0
    read = [float(row["height_mm"]) for row in rows if row["height_mm"]]
    np.testing.assert_allclose(read, found.height[found.known], rtol=1e-8, atol=1e-12)


def test_parts_that_are_not_connected_have_no_band_between_them():
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1)
    measurement.labels[:, 15:18] = -1
    found = hg.profile(measurement, (6, 15), (26, 15))
    assert np.isnan(found.error).all() and any("gap" in one for one in found.remarks)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ((10, 10, 10, 10), "0 px long"),
        ((10, 10, 400, 10), "leaves the picture"),
        ((0, 0, 20, 20), "first end of the line"),
        ((20, 20, float("nan"), 0), "two places"),
    ],
)
def test_a_line_that_cannot_be_followed_is_refused(line, words):
    measurement = relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1)
    with pytest.raises(InputError, match=words):
        hg.profile(measurement, line[:2], line[2:])


def test_a_measurement_without_depth_is_refused_in_a_line(tmp_path, capsys):
    relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1).save(tmp_path / "measured")
    (tmp_path / "measured" / "points.exr").unlink()
    for command in (["profile", "--line", "1", "2", "3", "9", "--out", str(tmp_path / "p.csv")],
                    ["maps", "--out", str(tmp_path / "maps")]):  # fmt: skip
        assert main([command[0], str(tmp_path / "measured"), *command[1:]]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "maps").exists() and not (tmp_path / "p.csv").exists()


def test_maps_are_written_with_their_scale(tmp_path):
    """EXR of the values, PNG of the same size across or a whole number of times, and numbers."""
    found = hg.inspection_maps(relief_measurement(SimulatedRelief(seed=1), relief_camera(32), 1))
    found.save(tmp_path / "maps")
    layers, _ = hg.read_exr(tmp_path / "maps" / "curvature.exr")
    known = layers["known"] > 0
    np.testing.assert_allclose(layers["curvature"][known], found.curvature.value[known], rtol=1e-6)
    for name in ("curvature", "occlusion", "stretch"):
        assert hg.read_png(tmp_path / "maps" / f"{name}.png").shape[1] % 32 == 0
    record = hg.read_json(tmp_path / "maps" / "maps.json")
    assert record["curvature"]["unit"] == "1/mm" and record["pixel_mm"] == pytest.approx(1.18, rel=0.02)


def test_heights_beyond_a_step_that_normals_do_not_show_have_no_band():
    """A flat surface, one half of which stands five pixels of depth lower, as shadows may show."""
    camera, size = relief_camera(32), 32
    normals = np.broadcast_to([0.0, 0.0, 1.0], (size, size, 3))
    ray, every = camera.pixel_directions(), np.ones((size, size), bool)
    depth = 0.4 * (1.0 + np.where(np.arange(size) < 20, 0.0, 5.0) / camera.focal[0])
    points = camera.position - ray / ray[..., 2:] * depth[:, None]
    own = np.full(every.shape, 1e-6)
    seen = SeenSurface(camera, every, points, normals, None, None, own, own, None, True)
    beside, over = hg.profile(seen, (16, 4), (16, 28)), hg.profile(seen, (4, 16), (28, 16))
    assert np.isfinite(beside.error).all() and not any("step" in one for one in beside.remarks)
    assert not np.isfinite(over.error[1:-1]).any() and any("step" in one for one in over.remarks)
