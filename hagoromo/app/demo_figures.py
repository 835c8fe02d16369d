"""The scenes of the paper's figures 6, 7 and 8: measured matter in a small studio, before the paper's camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip
from hagoromo.camera.camera import Camera
from hagoromo.image.scene import Scene
from hagoromo.image.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

FIGURES = {
    "figure_6_drape": "Drape: cloth of cylinders.",
    "figure_6_feather": "Feather: rachis, barbs and barbules of cylinders.",
    "figure_7_skin": "Skin: granules.",
    "figure_8_whole": "The whole figure: skin, drape and wings.",
}


def scene_of(figure: str, measured: Mapping[str, Reflectance], camera: Camera, resolution: int, seed: int) -> Scene:
    """The scene of one of FIGURES, of `measured` reflectances (skin, cloth, feather, dielectric)."""
    skin = measured["skin"].with_element("sphere")
    cloth, feather = (measured[name].with_element("cylinder") for name in ("cloth", "feather"))
    box = _stand_in(
        {"figure_6_drape": cloth, "figure_6_feather": feather, "figure_7_skin": skin, "figure_8_whole": cloth}[figure],
        resolution,
    )
    boxes = (box,)
    upright = figure == "figure_8_whole"
    camera = turned_upright(camera) if upright else camera
    camera = framed(camera, boxes, towards=(0.25, -1.0, 0.12))
    middle, extent = _ball_around(boxes)
    return Scene(camera, studio_lamps(middle, extent), boxes, (sweep(extent, measured["dielectric"]),))


def turned_upright(camera: Camera) -> Camera:
    """The camera turned on its side, its picture shown upright."""
    (ax, ay), (x0, y0) = camera.focal, camera.principal
    return replace(camera, width=camera.height, height=camera.width, focal=(ay, ax), principal=(y0, x0))


def framed(camera: Camera, boxes: Sequence[VolumeBox], towards: Sequence[float], margin: float = 1.04) -> Camera:
    """The camera in the direction `towards` from the boxes, as near as they all fit into the picture with `margin`."""
    corners = np.concatenate([box.corners() for box in boxes])
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    direction = np.asarray(towards, float) / np.linalg.norm(towards)
    near, far = 0.1, 100.0
    for _ in range(40):
        distance = 0.5 * (near + far)
        placed = camera.look_at(middle + direction * distance, middle)
        x, y = placed.project(corners).T
        half = np.array([camera.width, camera.height]) / 2
        reach = np.abs(np.stack([x - half[0], y - half[1]], axis=1)) * margin
        fits = bool(np.isfinite(x).all() and (reach <= half).all())
        near, far = (near, distance) if fits else (distance, far)
    return camera.look_at(middle + direction * far, middle)


def studio_lamps(middle: np.ndarray, extent: float, spectrum: str = "D65") -> tuple[Lamp, ...]:
    """Three white point lamps: key high from the left, weak fill from the right, rim from behind; `extent` [m] sets scale."""
    places = {"key": ((-1.3, -1.6, 1.9), 1.0), "fill": ((1.9, -1.8, 0.5), 0.22), "rim": ((0.9, 1.5, 1.7), 0.7)}
    return tuple(
        Lamp(
            position=middle + extent * np.array(place),
            intensity=share * float(np.dot(place, place)) * extent**2,
            spectrum=Spectrum.named(spectrum),
            name=name,
        )
        for name, (place, share) in places.items()
    )


def sweep(extent: float, reflectance: Reflectance) -> Surface:
    """A photographer's background: floor at z = 0 that bends up into a wall behind, without an edge."""
    depth, radius, half, height = 1.8 * extent, 1.2 * extent, 8.0 * extent, 7.0 * extent
    turn = np.linspace(0.0, np.pi / 2, 49)
    y = np.concatenate([[-8.0 * extent], depth + radius * np.sin(turn), [depth + radius]])
    z = np.concatenate([[0.0], radius * (1.0 - np.cos(turn)), [height]])
    profile = np.stack([y, z], axis=1)
    vertices = np.array([(x, *row) for x in (-half, half) for row in profile])
    count, k = len(profile), np.arange(len(profile) - 1)
    faces = np.concatenate([np.stack(f, axis=1) for f in ((k, k + count, k + 1), (k + 1, k + count, k + count + 1))])
    return Surface(reflectance, vertices=vertices, faces=faces, name="sweep")


def _ball_around(boxes: Sequence[VolumeBox]) -> tuple[np.ndarray, float]:
    """Middle [m] and half diagonal [m] of what the boxes span."""
    corners = np.concatenate([box.corners() for box in boxes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def _stand_in(material: Reflectance, resolution: int) -> VolumeBox:
    """A folded column, until matter is there."""
    kinds, size = arrays(), 0.12
    voxel = size / resolution
    pose = np.eye(4)
    pose[:3, 3] = (-size / 2, -size / 2, 0.0)

    def field(p):
        x, y, z = p.x - size / 2, p.y - size / 2, p.z
        angle, r = dr.atan2(y, x), dr.sqrt(x * x + y * y + 1e-12)
        radius = 0.035 * (1.0 - 0.5 * z / 0.18) + 0.004 * dr.cos(9.0 * angle)
        density = clip((radius - r) / voxel, 0.0, 1.0)
        density = dr.select((z > 0) & (z < 0.17), density, 0.0)
        return density, kinds.Array3f(-y / r, x / r, 0.0 * z)

    return VolumeBox.from_field(
        field, (resolution, resolution, int(1.5 * resolution)), voxel, 3.0 / voxel, [material], pose=pose
    )
