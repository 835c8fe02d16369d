"""Where the memory of NumPy's arrays lies is chance: were kernels to depend on it, chance would compile them anew."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, column
from hagoromo.measurement.normals.shading import shading
from tests.compilations import compilations

GOLD = hg.Reflectance(0.1, 0.3, 0.2, 1.5, hg.Spectrum.constant(1.0))
VIEW = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
SCENE = hg.Scene(VIEW, (hg.Lamp(to_lamp=(0.0, 0.5, 1.0)),), surfaces=(hg.Surface.sphere((0.0, 0.0, 0.0), 0.1, GOLD),))
WAYS = np.random.default_rng(1).normal(size=(96, 3)) * 0.2 + (0.0, 0.0, 1.0)
WORK = {
    "rays": lambda: hg.march(SCENE, WAYS, -WAYS),
    "directions": lambda: GOLD.evaluate((0.0, 0.0, 1.0), WAYS, WAYS[::-1]),
    "pixels": lambda: shading(WAYS, WAYS[None], WAYS, np.full((96, 5), -1.0)),
}


@pytest.mark.parametrize("work", WORK)
def test_work_that_is_done_again_compiles_nothing(work):
    """In between, memory is taken that moves what comes next."""
    WORK[work]()
    taken = []
    for k in range(12):
        taken.append([np.empty(96, kind) for kind in (np.float32, np.float64) for _ in range(k % 5)])
        assert compilations(WORK[work]) == 0


@pytest.mark.parametrize("count", [1, 23])
def test_columns_that_lie_anywhere_are_read_by_one_kernel(count):
    """One number is no constant of the kernel either."""
    memory = np.zeros(4 * count + 64, np.uint8)

    def read(start):
        part = memory[start : start + 4 * count].view(np.float32)
        part[:] = np.arange(count) + start
        np.testing.assert_array_equal(np.array(column(arrays().Float, part) + 1.0), part + np.float32(1.0))

    read(0)
    assert sum(compilations(lambda start=start: read(start)) for start in range(4, 64, 4)) == 0
