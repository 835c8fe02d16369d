"""Fibres of one voxel: their light does not break into beads, along the fibre or across the picture."""

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.shape import coverage
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Lighting, Materials, palette_of
from hagoromo.transport.march import march
from hagoromo.transport.medium import Medium
from hagoromo.volume.box import VolumeBox

WHITE = Spectrum.constant(1.0)
FIBRE = Reflectance(0.25, 0.2, 0.25, 1.5, WHITE, element="cylinder")
MIDDLE = (32.3, 32.4, 32.2)  # off the voxels' centres


def light_along(tilt: float, across: int) -> np.ndarray:
    """Light of a fibre one voxel thick, tilted against the lattice, at 40 places along it; `across` rays a voxel."""
    jit = arrays()
    along = np.array([1.0, np.tan(tilt), 0.37 * np.tan(tilt)])
    along /= np.linalg.norm(along)
    axis = jit.Array3f(*map(float, along))

    def field(p):
        offset = p - jit.Array3f(*MIDDLE)
        away = dr.norm(offset - axis * dr.dot(offset, axis))
        return coverage(away - 0.5, 2.0), axis

    medium = Medium([VolumeBox.from_field(field, (64, 64, 64), 1.0, 0.5, [FIBRE])])
    lighting = Lighting([Lamp(to_lamp=(0.3, -0.2, -1.0))], Materials([FIBRE], palette_of([FIBRE], [], [WHITE])))
    u, w = np.meshgrid(np.linspace(12, 52, 40), (np.arange(8 * across) + 0.5) / across - 4, indexing="ij")
    y = MIDDLE[1] + (u - MIDDLE[0]) * np.tan(tilt) + w
    origin = jit.Array3f(*(np.float32(v.ravel()) for v in (u, y)), -5.0)
    direction = jit.Array3f(0, 0, 1) + 0 * origin
    channels, _ = march(medium, lighting, origin, direction, jit.Float(0), jit.Float(dr.inf))
    return (np.array(channels[0]) + np.array(channels[1])).reshape(u.shape).mean(axis=1)


@pytest.mark.parametrize("across", [1, 16], ids=("a ray a voxel", "many rays"))
@pytest.mark.parametrize("tilt", [0.05, 0.3, 0.785])
def test_a_fibre_of_one_voxel_shows_no_beads(tilt, across):
    """A fibre kept as voxels in or out would vary by its whole light; a tenth is not seen as beads."""
    light = light_along(tilt, across)
    assert light.min() > 0
    assert light.std() < 0.1 * light.mean()
