"""Photographs in tiles: the same normals and depth as of the whole, and no scratch left behind."""

from dataclasses import dataclass

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.exr import read_exr
from hagoromo.measurement.surface import large_capture
from hagoromo.measurement.surface import tile_store as store_module
from hagoromo.measurement.surface.tile_store import tile_store
from hagoromo.photograph.capture import Capture, save_capture
from studies.near_rig import SURFACE_DISTANCE, Look, ring_rig, simulate, sphere


@dataclass(frozen=True)
class Held:
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
    capture, _ = simulate(ring_rig(53, 47, 5), sphere, Look(0.2), bits=10)
    seen = np.zeros((47, 53), int)
    with tile_store(Held(capture), tmp_path) as store:
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
    capture, _ = simulate(ring_rig(31, 29, 4), sphere, Look(0.2), bits=10)
    with pytest.raises(KeyboardInterrupt), tile_store(Held(capture, broken=2), tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_measure_solves_large_photographs_in_tiles(small_tiles, tmp_path, monkeypatch):
    """A ball under near lamps, taken for too large: the goal of the whole solution holds for the tiles.

    A coarse pixel is 7 mm wide here, and only the coarse photographs determine the depth: to within one.
    """
    monkeypatch.setattr(large_capture, "LARGEST_CAPTURE_BYTES", 0)
    capture, truth = simulate(ring_rig(120, 96, 8), sphere, Look(0.3), bits=10)
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
