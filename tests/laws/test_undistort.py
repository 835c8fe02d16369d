"""Undistort: what a pinhole of the same matrix sees, to what bilinear resampling allows."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.photograph.development.development import Development
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.undistort import undistorted

LENS = Camera(97, 71, (103.0, 101.0), (50.3, 34.1), (-0.25, 0.06, 0.002, -0.001, 0.0))


def scene(camera: Camera) -> np.ndarray:
    """Light (h, w, 2) of smooth functions of the direction: waves of 30 px."""
    x, y = np.moveaxis(camera.pixel_directions()[..., :2], -1, 0)
    return np.stack([2.0 + np.sin(20 * x) * np.cos(20 * y), 2.0 + np.cos(20 * x + 10 * y)], axis=2)


def developed(values: np.ndarray, valid: np.ndarray) -> Development:
    values = values.astype(np.float32)
    native = np.ones(values.shape, bool)
    return Development(values, np.float32(0.01) * values, valid, native, Noise(1.0, 1.0), {}, [], {}, 0.0, 0.0)


def test_a_distorted_photograph_becomes_that_of_a_pinhole():
    """To 1 %: an eighth of the square of a pixel's share of the wave, (2π/30)², and noise there is none."""
    pinhole = replace(LENS, distortion=(0.0,) * 8)
    valid = np.ones((71, 97), bool)
    valid[30, 40] = False
    found = undistorted(developed(scene(LENS), valid), LENS)
    true = scene(pinhole)
    assert found.valid.mean() > 0.9  # a barrel's pinhole sees less: all of it is in the photograph
    np.testing.assert_allclose(found.values[found.valid], true[found.valid], rtol=0.01)
    np.testing.assert_allclose(found.variance[found.valid], 0.01 * found.values[found.valid], rtol=1e-3)
    holes = np.argwhere(~found.valid[5:-5, 5:-5]) + 5
    assert 1 <= len(holes) <= 4 and np.abs(holes - (30, 40)).max() <= 2


def test_what_the_photograph_does_not_reach_is_invalid():
    """A pincushion's pinhole sees further than the photograph in its corners."""
    lens = replace(LENS, distortion=(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    found = undistorted(developed(scene(lens), np.ones((71, 97), bool)), lens)
    assert not found.valid[0, 0] and found.valid[35, 48]


def test_a_photograph_of_another_camera_is_refused():
    with pytest.raises(InputError, match="97 × 71"):
        undistorted(developed(np.ones((31, 37, 3)), np.ones((31, 37), bool)), LENS)
