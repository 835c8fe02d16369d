"""One thread or many: a picture and a box have the same bits. No kernel adds in the order in which threads end."""

from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays, set_threads
from hagoromo.camera.camera import Camera
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

CAMERA = Camera(401, 307, (500.0, 500.0), (200.0, 150.0)).look_at((0.2, -0.4, 0.5), (0.1, 0.1, 0.1))


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """Sets the number of threads of kernels; afterwards it is as before."""
    before = dr.thread_count()
    yield dr.set_thread_count
    dr.set_thread_count(before)


def made() -> tuple[VolumeBox, np.ndarray]:
    """A box that is filled, and a picture of it: some 120,000 rays, of which a thread takes 16,000 at a time."""

    def waves(p: Any) -> tuple[Any, Any]:
        return dr.square(dr.sin(40.0 * p.x) * dr.sin(50.0 * p.y) * dr.sin(60.0 * p.z)), arrays().Array3f(0, 0, 1)

    matter = Reflectance(0.2, 0.3, 0.3, 1.5, Spectrum.constant(1.0), element="cylinder")
    box = VolumeBox.from_field(waves, (71, 73, 67), 0.003, 200.0, [matter])
    return box, render(Scene(CAMERA, (Lamp(to_lamp=(0.2, -0.3, 1.0)),), (box,))).weights


def test_threads_change_no_bit(threads):
    threads(1)
    box, picture = made()
    threads(3)
    again, same = made()
    assert np.array_equal(same, picture) and picture.max() > 0.0
    assert all(np.array_equal(a, b) for a, b in zip(again.bricks.dense(), box.bricks.dense(), strict=True))


def test_numbers_too_small_for_a_float_are_0_with_any_number_of_threads(threads):
    """A thread alone is Python's own, which keeps them: cloth of texels had other bits on workers of one thread."""
    found = []
    for count in (1, 2):
        set_threads(count)
        small = dr.opaque(arrays().Float, 1e-30, 100_000)
        found.append(np.array(small * 1e-10 * 1e30))
    assert np.array_equal(found[0], found[1]) and not found[0].any()
