"""Photographs in tiles: the same normals and depth as of the whole, and no scratch left behind."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.exr import read_exr
from hagoromo.measurement.error_files import SharedErrors, read_shared_errors, write_errors
from hagoromo.measurement.normals import lobe_fit
from hagoromo.measurement.normals.highlight_check import angles
from hagoromo.measurement.normals.lobe_fit import with_lobes
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.surface import solved_surface, tile_lobes, tile_pixels, tiles
from hagoromo.measurement.surface import tile_store as store_module
from hagoromo.measurement.surface.depth import DepthSurface
from hagoromo.measurement.surface.tile_store import tile_store
from hagoromo.photograph.capture import Capture, save_capture
from studies import glossy_objects
from studies.glossy_objects import GLOSSY, glossy_object
from studies.mirror_objects import mirror_object
from studies.near_rig import SURFACE_DISTANCE, Finish, ring_rig, simulate, sphere
from tests.inverse.test_further_lobes import solved


@dataclass(frozen=True)
class HeldPhotographs:
    """Photographs that are in memory already, which break off before one of them, if asked to."""

    capture: Capture
    broken: int = -1

    @property
    def count(self) -> int:
        return len(self.capture.photographs)

    def photograph(self, number: int):
        if number == self.broken:
            raise KeyboardInterrupt
        return self.capture.photographs[number]


@pytest.fixture
def small_tiles(monkeypatch):
    monkeypatch.setattr(store_module, "SIDE", 41)
    monkeypatch.setattr(store_module, "COARSE_PIXELS", 3000)


def test_a_store_gives_the_photographs_back(small_tiles, tmp_path):
    """To 2⁻¹¹ of the value, a half's rounding, and of the deviation; every valid pixel once."""
    capture, _ = simulate(ring_rig(53, 47, 5), sphere, Finish(0.2), bits=10)
    seen = np.zeros((47, 53), int)
    with tile_store(HeldPhotographs(capture), tmp_path) as store:
        for tile in range(store.count):
            stack, rows, columns = store.stack(tile)
            seen[rows, columns] += 1
            for k, photograph in enumerate(capture.photographs):
                valid = photograph.mask[rows, columns]
                np.testing.assert_array_equal(stack.valid[k], valid)
                np.testing.assert_allclose(
                    stack.values[k][valid], photograph.values[rows, columns][valid], rtol=2**-11, atol=1e-6
                )
                np.testing.assert_allclose(
                    stack.variance[k][valid], photograph.variance[rows, columns][valid], rtol=2**-8
                )
    masks = np.sum([photograph.mask for photograph in capture.photographs], axis=0)
    np.testing.assert_array_equal(seen, masks >= 4)
    assert not list(tmp_path.iterdir())


def test_an_interrupt_leaves_no_scratch(small_tiles, tmp_path):
    capture, _ = simulate(ring_rig(31, 29, 4), sphere, Finish(0.2), bits=10)
    with pytest.raises(KeyboardInterrupt), tile_store(HeldPhotographs(capture, broken=2), tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@pytest.fixture
def waxed(small_tiles, tmp_path, monkeypatch):
    """A glossy object as a whole with its normals, its store of tiles, and its coarse solution with one lobe."""
    monkeypatch.setitem(GLOSSY, "waxed", glossy_objects.TrueGloss(0.05, (0.5, 10.0), (10.0, 2.5)))
    monkeypatch.setattr(store_module, "COARSE_PIXELS", 1024)
    monkeypatch.setattr(lobe_fit, "LOBE_PIXELS", 1500)
    capture, normals = glossy_object("waxed", 7, size=96)
    with tile_store(HeldPhotographs(capture), tmp_path) as store:
        assert store.factor == 3 and store.count > 1
        mean = normals.reshape(32, 3, 32, 3, 3).mean(axis=(1, 3))
        mean /= np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1e-9)
        views, fit = solved(store.coarse, mean, GLOSSY["waxed"])
        images = views.image(fit.normals), views.image(np.full(len(views.rows), 1e-6)), views.image(fit.body.T)
        labels = views.image(np.zeros(len(views.rows), int), -1)
        surface = DepthSurface(views.image(views.points), np.full(labels.shape, 1e-6, np.float32))
        yield capture, normals, store, tile_pixels.Coarse(store.coarse, NormalMap(*images, labels, fit, views), surface)


def test_pixels_of_full_size_are_chosen_by_their_nearest_highlight(waxed):
    """Those near a highlight are more often chosen than by chance; values are those of the photographs."""
    capture, normals, store, coarse = waxed
    found = tile_lobes.sampled(store, coarse, np.random.default_rng(0))
    assert found is not None
    views = found.views
    for k, photograph in enumerate(capture.photographs):
        raw = photograph.values[views.rows, views.columns].T / views.light[k]
        np.testing.assert_allclose(views.values[k], np.where(found.trust.trusted[k], raw, views.values[k]), rtol=1e-3)
        assert found.trust.lower[k].any() == (~photograph.mask & (normals[..., 2] != 0.0)).any()
    assert len(views.rows) <= 1.1 * lobe_fit.LOBE_PIXELS
    every = hg.views_from_capture(capture)
    near = [
        np.mean(angles(normals[one.rows, one.columns], one).min(axis=0) < np.radians(4.0)) for one in (views, every)
    ]
    assert near[0] > 1.5 * near[1]


@pytest.mark.slow
def test_lobes_of_tiles_are_those_of_the_whole(waxed):
    """A spike of 2.5° on a haze of 10°, which squares of 3 pixels blur: β and γ of both lobes are within 15 % and 5 %
    of the truth and, on the same object as a whole, of each other; the coarse photographs alone do not have the spike.
    """
    capture, normals, store, coarse = waxed
    found = tile_lobes.with_lobes_of_tiles(store, coarse)
    tile = tiles._solve_tile(tile_pixels.Known(store, found), 0)
    assert tile is not None
    views, one = solved(capture, normals, GLOSSY["waxed"])
    whole = with_lobes(capture, views, one)
    both = [lobes_of(fit) for fit in (found.normal_map.fit, whole)]
    truth = np.log([[0.5, np.radians(10.0)], [10.0, np.radians(2.5)]])
    for these, others in ((both[0], truth), (both[0], both[1])):
        assert np.all(np.abs(these - others) < [0.15, 0.05])
    blurred = lobes_of(with_lobes(store.coarse, coarse.normal_map.views, coarse.normal_map.fit))
    assert blurred.shape != truth.shape or np.abs(blurred - truth).max() > 0.3
    body = views.image(whole.body.T)[tile.rows, tile.columns]
    assert np.median(tile.body / np.maximum(body, 1e-9)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.nightly
def test_errors_of_tiles_are_those_of_the_whole(small_tiles, tmp_path):
    """Shared errors, over the object, agree to 20 %: those of the whole follow from 1200 of its 4700 pixels. The
    whole variance does to a factor of 1.5, and is true as often: of rms over σ √3 an angle has 95 % if two turns are
    normal; so without errors of the pixels' width, or of lamps left out, either fails at the rim.
    """
    capture, truth = glossy_object("glaze", size=84)
    coarse, fine = solved_surface.solve_large(HeldPhotographs(capture), tmp_path, 50.0)
    whole = hg.solve_normals(capture)
    errors = [one.fit.errors for one in (coarse.normal_map, whole)]
    shared = [np.sqrt(np.mean(one.shared)) for one in errors if one is not None]
    assert shared[0] == pytest.approx(shared[1], rel=0.2)
    known = np.isfinite(fine.variance) & np.isfinite(whole.variance)
    stated = [np.sqrt(one[known].mean()) for one in (fine.variance, whole.variance)]
    assert 1 / 1.5 < stated[0] / stated[1] < 1.5
    off, of_whole, apart = (angle(*pair)[known] for pair in (
        (fine.normals, truth), (whole.normals, truth), (fine.normals, whole.normals)))  # fmt: skip
    assert 0.93 < np.mean(off**2 < 3.0 * fine.variance[known])
    # both are of the same smooth surface
    assert fine.stiffness is not None and whole.fit.smooth is not None
    assert fine.stiffness.value == whole.fit.smooth.stiffness.value
    assert np.mean(apart**2 < 3.0 * whole.variance[known]) > 0.99
    assert np.sqrt(np.mean(apart**2)) < 0.3 * stated[1]
    assert np.sqrt(np.mean(off**2)) < 1.2 * np.sqrt(np.mean(of_whole**2))
    assert fine.summed is not None
    assert np.isfinite(fine.summed[known]).all()


@pytest.mark.nightly
def test_narrow_highlights_in_tiles_follow_from_smooth_normals(small_tiles, tmp_path, monkeypatch):
    """A mirror-like ball whose normals of single pixels are off by a third of a degree: in tiles by 0.108°, and as a
    whole by 0.120°, with errors that hold for 99 and 92 %. They are 0.07° apart; lobes that are found on normals that
    are not smooth yet, two in place of three, make 0.15° of it.
    """
    monkeypatch.setattr(store_module, "SIDE", 48)
    ball = mirror_object("ball", 96, 24)
    coarse, fine = solved_surface.solve_large(HeldPhotographs(ball.capture), tmp_path, 50.0)
    whole = hg.solve_normals(ball.capture)
    assert fine.stiffness is not None
    both = [lobes_of(fit) for fit in (coarse.normal_map.fit, whole.fit)]
    assert both[0].shape == both[1].shape == (3, 2)
    assert np.all(np.abs(both[0] - both[1])[[0, 2]] < [0.15, 0.1])  # the widest and the narrowest
    known = np.isfinite(fine.variance) & np.isfinite(whole.variance) & (np.abs(ball.normals).sum(axis=2) > 0.0)
    off, apart = (angle(fine.normals, one)[known] for one in (ball.normals, whole.normals))
    assert np.degrees(np.sqrt(np.mean(off**2))) < 0.13
    assert np.degrees(np.sqrt(np.mean(apart**2))) < 0.09
    assert np.mean(off**2 < 3.0 * fine.variance[known]) > 0.93


def test_shared_errors_of_squares_are_read_for_every_pixel(tmp_path):
    """Of each pixel those of its square; of pixels beyond the last whole square, that one's; variances stay."""
    random = np.random.default_rng(5)
    squares = SharedErrors(*(random.normal(size=(2, 3, 5, *rest)).astype(np.float32) for rest in ((3,), ())))
    whole = np.full((11, 17), 100.0)
    write_errors(tmp_path, (whole, whole), squares)
    read = read_shared_errors(tmp_path / "shared_errors.exr", (11, 17))
    assert read is not None
    for row, column in ((0, 0), (4, 8), (10, 16), (2, 3)):
        at = min(row // 3, 2), min(column // 3, 4)
        np.testing.assert_array_equal(read.normals[:, row, column], squares.normals[:, *at])
        np.testing.assert_array_equal(read.distance[:, row, column], squares.distance[:, *at])
    own = read_exr(tmp_path / "variance.exr")[0]["own.normal"]
    np.testing.assert_allclose(own, whole - read.variances[0], rtol=1e-5)
    with pytest.raises(hg.InputError, match="measure again"):
        read_shared_errors(tmp_path / "shared_errors.exr", (11, 40))


@pytest.mark.parametrize(
    ("lamps", "processes", "said"),
    [(7, 1, "about 2 min with 1 process"), (7, 2, "1 min with 2 processes"), (8, 1, "about 4 min with 1 process")],
)
def test_the_time_of_tiles_is_said_before_they_are_solved(lamps, processes, said):
    """6.5 million pixels of so many photographs, of which a core solves a million in 2.8 s; normals from eight lamps
    are smoothed, too, and take 1.8 times as long.
    """

    class Large:
        count = lamps

        def photograph(self, number: int):
            return SimpleNamespace(values=np.broadcast_to(np.float32(0.0), (2500, 2600, 3)))

    assert said in solved_surface.expected_time(Large(), processes)  # type: ignore[arg-type]


def angle(one, other):
    """(h, w) [rad]"""
    return np.arccos(np.clip(np.sum(one * other, axis=2), -1.0, 1.0))


def lobes_of(fit):
    """ln β and ln γ of all lobes of the first material."""
    return np.concatenate([fit.gloss.rows[:1, :2], np.log(fit.lobes.each[0] if fit.lobes else np.zeros((0, 2)))])


@pytest.mark.slow
def test_measure_solves_large_photographs_in_tiles(small_tiles, tmp_path, monkeypatch):
    """A ball under near lamps, taken for too large: the goal of the whole solution holds for the tiles.

    A coarse pixel is 7 mm wide here, and only the coarse photographs determine the depth: to within one.
    """
    monkeypatch.setattr(solved_surface, "LARGEST_CAPTURE_BYTES", 0)
    capture, truth = simulate(ring_rig(120, 96, 8), sphere, Finish(0.3), bits=10)
    save_capture(capture, tmp_path / "capture")
    hg.measure(tmp_path / "capture", distance=1.03 * SURFACE_DISTANCE, scratch=tmp_path).save(tmp_path / "out")
    normals, points = (read_exr(tmp_path / "out" / f"{what}.exr")[0] for what in ("normals", "points"))
    found = np.stack([normals[f"N.{axis}"] for axis in "XYZ"], axis=2)
    known = np.linalg.norm(found, axis=2) > 0.5
    assert known.sum() > 0.95 * (truth.labels >= 0).sum()
    off = np.degrees(np.arccos(np.clip(np.sum(found * truth.normals, axis=2)[known], -1.0, 1.0)))
    assert off.mean() < 1.5
    assert np.median(np.abs(points["P.Z"] - truth.points[..., 2])[known]) < 0.007
    assert list(tmp_path.rglob(".tiles*")) == []
