"""Fibres: those of one voxel do not break into beads, and the sign of a tangent has no meaning."""

from collections.abc import Sequence

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.shape import coverage
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import march
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import palette_of
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


SHAPE = (23, 29, 31)  # voxels (z, y, x)


def rope(turned: int | None = None, which: Sequence[Element] = ("cylinder", "plane")) -> hg.VolumeBox:
    """A soft ball of cylinders that curl, planes, or half of each; `turned`: seed of the signs of tangents."""
    z, y, x = np.meshgrid(*(np.arange(n) + 0.5 for n in SHAPE), indexing="ij")
    offset = np.stack([x, y, z], axis=-1) - np.array(SHAPE[::-1]) / 2
    density = np.clip((10.0 - np.linalg.norm(offset, axis=-1)) / 3.0, 0.0, 1.0)
    kinds = [Reflectance(0.2, 0.3, 0.25, 1.5, WHITE, element=element) for element in which]
    material = ((offset[..., 0] + 0.3 * offset[..., 1] > 0) * (len(kinds) - 1)).astype(np.uint8)
    cylinder = np.array(which)[material] == "cylinder"
    tangent = np.cross(offset, (0.2, 0.1, 1.0)) + np.array((0.0, 0.0, 4.0))
    axis = np.where(cylinder[..., None], tangent, offset)
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    if turned is not None:
        sign = np.random.default_rng(turned).choice([-1.0, 1.0], density.shape)
        axis *= np.where(cylinder, sign, 1.0)[..., None]
    pose = np.eye(4)
    pose[:3, 3] = -5e-4 * np.array(SHAPE[::-1])
    return VolumeBox.from_arrays(density, axis, 1e-3, 400.0, kinds, material if len(kinds) > 1 else None, pose=pose)


def light_of(box: VolumeBox, differentiable: bool = False) -> np.ndarray:
    """Light along rays through the middle of a box."""
    camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, 0.0, -1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = hg.Scene(camera, (Lamp(to_lamp=(0.6, -0.4, -0.7)),), (box,))
    u, v = np.meshgrid(np.linspace(-0.01, 0.01, 83), np.linspace(-0.01, 0.01, 79), indexing="ij")
    origins = np.stack([u.ravel(), v.ravel(), np.full(u.size, -0.05)], axis=1)
    rays = hg.RayMarch(scene, hg.Settings(shadows="none"), differentiable=differentiable)
    return rays(origins, np.broadcast_to((0.1, 0.02, 1.0), origins.shape)).weights.sum(axis=1)


@pytest.mark.parametrize("differentiable", [False, True], ids=("packed", "plain"))
@pytest.mark.parametrize("which", [("cylinder",), ("cylinder", "plane")], ids=("cylinders", "cylinders and planes"))
def test_the_sign_of_a_tangent_does_not_matter(which, differentiable):
    """1e-3: an axis and its opposite have bits of their own, 0.05° apart. Opposite signs that cancel make 4 %."""
    one, other = (light_of(rope(turned, which), differentiable) for turned in (None, 1))
    assert np.sqrt(np.mean((other - one) ** 2)) < 1e-3 * one.mean()


def test_the_sign_of_a_normal_does():
    """A plane shines to its own side alone."""
    box = rope(None, ("plane",))
    density, axis = box.bricks.dense()
    behind = VolumeBox.from_arrays(density, -axis, box.voxel_size, box.tau, box.materials, pose=box.pose)
    assert light_of(behind).mean() < 0.5 * light_of(box).mean()


@pytest.mark.parametrize("other", ["cylinder", "sphere"])
def test_normals_beside_other_axes_keep_their_direction(other):
    """Between a voxel of planes and one of cylinders the axis is that of the one whose material counts."""
    density, axis = np.ones((3, 3, 4)), np.zeros((3, 3, 4, 3))
    axis[..., :2, 2], axis[..., 2:, 0] = -1.0, 1.0
    material = np.broadcast_to(np.array([0, 0, 1, 1], np.uint8), density.shape)
    kinds = [Reflectance(0.2, 0.0, 0.25, 1.5, WHITE, element=element) for element in ("plane", other)]
    medium, jit = Medium([VolumeBox.from_arrays(density, axis, 1.0, 1e-3, kinds, material)]), arrays()
    x = jit.Float([1.5, 1.9, 2.1, 2.4])  # the voxels' centres are at 1.5 and 2.5
    crossing = medium.cross(jit.Array3f(x, 1.5, -1.0), jit.Array3f(0, 0, 1), jit.Float(0), jit.Float(dr.inf))
    step = medium.next(crossing, crossing.start())
    found = np.array(medium.axis(step)).T
    assert np.allclose(np.abs(found), [(0, 0, 1), (0, 0, 1), (1, 0, 0), (1, 0, 0)], atol=2e-3)
