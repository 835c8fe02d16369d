"""Scenes whose noise is hard to state: many pixels show little of granules, threads and a feather; a lamp is small."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

import hagoromo as hg

PIXELS = 40  # a side of the pictures
VOXELS = 48  # a side of the boxes
VOXEL = 0.01  # [m]
GREY = hg.Spectrum.constant(0.7)


class NoisyScene(NamedTuple):
    """A scene, and the errors that its pictures are asked for."""

    name: str
    scene: hg.Scene
    errors: tuple[float, ...]


def noisy_scenes(recipes: Path) -> list[NoisyScene]:
    """All of them; recipes: the folder of those of the gallery."""
    return [
        NoisyScene("granules", granules(), (0.2, 0.1)),
        NoisyScene("rims of threads", threads(), (0.2,)),
        NoisyScene("feather, lit from behind", feather(recipes), (0.3, 0.2)),
        NoisyScene("small lamp over spheres", small_lamp(), (0.1, 0.04)),
    ]


def granules() -> hg.Scene:
    """Sixty balls of four voxels, apart from each other."""
    random, density = np.random.default_rng(3), np.zeros((VOXELS,) * 3)
    z, y, x = np.mgrid[:VOXELS, :VOXELS, :VOXELS]
    for middle in random.uniform(4, VOXELS - 4, (60, 3)):
        radius = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
        density = np.maximum(density, np.clip(2.2 - radius, 0.0, 1.0))
    matter = hg.Reflectance(0.3, 0.2, 0.3, 1.4, GREY, element="sphere")
    return _of_box(density, np.zeros((*density.shape, 3)), matter, (0.5, -0.6, 0.7))


def threads() -> hg.Scene:
    """Fourteen threads of three voxels that go all ways, lit along the edge of the picture."""
    random, density = np.random.default_rng(5), np.zeros((VOXELS,) * 3)
    axis = np.zeros((*density.shape, 3))
    place = np.moveaxis(np.mgrid[:VOXELS, :VOXELS, :VOXELS][::-1], 0, -1)
    for _ in range(14):
        along = random.normal(size=3)
        along /= np.linalg.norm(along)
        offset = place - random.uniform(8, VOXELS - 8, 3)
        offset -= (offset @ along)[..., None] * along
        core = np.clip(1.4 - np.linalg.norm(offset, axis=-1), 0.0, 1.0)
        axis[core > density] = along
        density = np.maximum(density, core)
    return _of_box(density, axis, hg.Reflectance(0.3, 0.0, 0.2, 1.5, GREY, element="cylinder"), (0.9, 0.1, 0.3))


def feather(recipes: Path) -> hg.Scene:
    """Four millimetres of a primary feather; the lamp is behind it."""
    record = hg.read_toml(recipes / "primary.toml") | {"patch_mm": [4.0, 4.0], "extinction": "projected"}
    record["material"] = record["material"] | {"alpha": 0.22, "beta": 0.1, "transmission": 0.15}
    box = hg.build(record)
    corners = box.matter_corners()
    middle, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    view = _camera(2.2).look_at(middle + 1.8 * size * np.array([0.2, -0.3, 1.0]), middle)
    return hg.Scene(view, (hg.Lamp(to_lamp=(0.3, 0.2, -0.9)),), (box,))


def small_lamp() -> hg.Scene:
    """A matte and a glossy sphere on a third, so large that it is a floor, under a lamp of 2 cm in the picture."""
    matte = hg.Reflectance(0.3, 0.0, 0.2, 1.5, GREY)
    glossy = hg.Reflectance(0.05, 0.4, 0.1, 1.5, GREY)
    spheres = (((0.0, 0.0, 0.0), 0.3, matte), ((0.5, 0.0, 0.1), 0.25, glossy), ((0.0, 0.0, -20.4), 20.0, matte))
    lamp = hg.AreaLamp((0.2, -0.2, 0.7), radius=0.02, radiance=100.0, visible=True)
    view = _camera(1.6).look_at((0.2, -2.0, 0.8), (0.2, 0.0, 0.1))
    return hg.Scene(view, (), surfaces=tuple(hg.Surface.sphere(*each) for each in spheres), area_lamps=(lamp,))


def _of_box(density: np.ndarray, axis: np.ndarray, matter: hg.Reflectance, to_lamp: tuple[float, ...]) -> hg.Scene:
    box = hg.VolumeBox.from_arrays(density, axis, VOXEL, 500.0, [matter], extinction="projected")
    middle = 0.5 * VOXELS * VOXEL
    view = _camera(2.1).look_at((middle, -1.0, 0.5), (middle, middle, middle))
    return hg.Scene(view, (hg.Lamp(to_lamp=to_lamp),), (box,))


def _camera(length: float) -> hg.Camera:
    """A camera whose focal length is so many widths of its picture."""
    return hg.Camera(PIXELS, PIXELS, (length * PIXELS, length * PIXELS), (0.5 * PIXELS, 0.5 * PIXELS))
