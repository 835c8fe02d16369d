"""What all fits of photographs share: the reading of a pixel, and the body colours that follow from all else."""

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.measurement.photometric.reading import PixelBodies, reading


def test_a_reading_is_the_same_for_floats_numpy_and_dr_jit():
    """Eq. (2) by hand: 0.2 · 0.8 + 1.1 · 0.3 = 0.49; single precision on the device."""
    jit = arrays()
    assert reading(0.2, 0.8, 1.1, 0.3) == 0.2 * 0.8 + 1.1 * 0.3
    assert reading(0.2, 0.8, None, 0.3) == 0.2 * 0.8 + 0.3
    np.testing.assert_allclose(reading(np.full(3, 0.2), 0.8, 1.1, 0.3), 0.49)
    assert dr.allclose(reading(jit.Float(0.2), 0.8, 1.1, jit.Float(0.3)), 0.49)


def test_bodies_of_pixels_are_the_least_squares_of_each():
    """Oracle: `lstsq` of every pixel and channel by itself; its residual is what the projection leaves."""
    random = np.random.default_rng(3)
    pixel, lit, values = random.integers(0, 7, 53), random.uniform(0.1, 1, (53, 3)), random.normal(size=(53, 3))
    weight = random.uniform(0.0, 2.0, (53, 3)) * (random.uniform(size=(53, 3)) > 0.2)
    weight[pixel == 5, 1] = 0.0  # a channel that was not measured in a pixel
    bodies = PixelBodies(pixel, lit, weight)
    for p in range(7):
        for c in range(3):
            own, root = pixel == p, np.sqrt(weight[pixel == p, c])
            (best,), *_ = np.linalg.lstsq((root * lit[own, c])[:, None], root * values[own, c])
            np.testing.assert_allclose(bodies.of(values)[p, c], best, atol=1e-12)
            np.testing.assert_allclose(bodies.light(values)[own, c], best * lit[own, c], atol=1e-12)
    np.testing.assert_allclose(np.sum(bodies.leverage(), axis=0), np.count_nonzero(bodies.power > 0.0, axis=0))
