"""Layers of a picture beside its light: depth, normal, albedo and material of what its pixels show.

Each is of the first event of LOOKS walks through a pixel: the surface or the element of matter that a ray meets first.
Enters: a scene. Leaves: named channels, see `Image.layers`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, opaque_vector
from hagoromo.image.path.picture import walks_of
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.scene.scene import Scene, check_still
from hagoromo.image.scene.scene_palette import palette_of_scene, reflectances_of
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.path.bands import Bands
from hagoromo.transport.path.path import Walks, five_of, random_numbers

LOOKS = 16  # walks a pixel
PIXELS_AT_ONCE = 1 << 18
STREAM = 1 << 40  # added to the seed: other random numbers than those of the picture
Array = NDArray[np.float32]


# Of a run of pixels: sums (pixels, 5 + bodies) of 1, depth, normal and albedo over the walks that hit something, and
# how many hit each material (pixels, materials + 1), from column 1 on.
Looked = tuple[NDArray[np.float64], NDArray[np.uint16]]
LookAt = Callable[[int], Iterable[Looked]]  # of so many pixels, all of them, in order


def layers_of(scene: Scene, settings: Settings, look: LookAt | None = None) -> dict[str, Array]:
    """Channels (height, width) of a scene, 0 where a pixel shows nothing.

    depth.Z: along the camera's axis [m]. normal.X, .Y, .Z: unit, world, to the eye. albedo.R, .G, .B: of the bodies,
    linear sRGB under the first lamp. material.id: the one that most rays hit; from 1 on, those of the boxes and
    then the surfaces, as `names_of_materials` has them. look: who looks; default: this process.
    """
    camera, palette = scene.camera, palette_of_scene(scene, settings)
    pixels, bodies = camera.width * camera.height, len(palette.bodies)
    parts = zip(*(look or partial(_look_here, scene, settings))(pixels), strict=True)
    sums, materials = (np.concatenate(part) for part in parts)
    count, depth, *normal = sums[:, :5].T
    length = np.maximum(np.linalg.norm(normal, axis=0), 1e-30)
    layers = {"depth.Z": depth / np.maximum(count, 1.0)}
    layers |= {f"normal.{name}": each / length for name, each in zip("XYZ", normal, strict=True)}
    colours = np.zeros((*sums.shape[:1], 1, palette.channels), np.float32)
    colours[:, 0, :bodies] = sums[:, 5:] / np.maximum(count, 1.0)[:, None]
    albedo = Image(colours, np.ones((pixels, 1), np.float32), palette).linear_srgb()
    layers |= {f"albedo.{name}": albedo[:, 0, k] for k, name in enumerate("RGB")}
    layers["material.id"] = np.where(count > 0, 1 + materials[:, 1:].argmax(axis=1), 0)
    return {name: np.float32(values).reshape(camera.height, camera.width) for name, values in layers.items()}


def with_layers(image: Image, scene: Scene, settings: Settings, look: LookAt | None = None) -> Image:
    """A picture of a scene with the layers of what it shows. look: who looks; default: this process.

    `InputError` for a scene that moves while the shutter is open.
    """
    check_still(scene, "a layer")
    record = image.metadata | {"materials": names_of_materials(scene)}
    return replace(image, layers=layers_of(scene, settings, look), metadata=record)


def names_of_materials(scene: Scene) -> list[str]:
    """Names of the materials, in the order of their numbers in material.id."""
    boxes = [f"{box.name}: {material.name}" for box in scene.boxes for material in box.materials]
    return boxes + [f"{surface.name}: {surface.reflectance.name}" for surface in scene.surfaces]


def _look_here(scene: Scene, settings: Settings, pixels: int) -> Iterator[Looked]:
    looked = looked_at(scene, settings)
    for first in range(0, pixels, PIXELS_AT_ONCE):
        yield looked(range(first, min(first + PIXELS_AT_ONCE, pixels)))


def looked_at(scene: Scene, settings: Settings) -> Callable[[range], Looked]:
    """A function that gives the sums of a run of pixels of a scene, which is made ready for it."""
    prepared = PreparedScene(scene, replace(settings, shadows="none"))
    walks = walks_of(scene, prepared, Bands(np.array([550.0]), 0.0))
    kinds, bodies = len(reflectances_of(scene)) + 1, len(prepared.palette.bodies)

    def looked(pixels: range) -> Looked:
        sums, materials = np.zeros((len(pixels), 5 + bodies)), np.zeros((len(pixels), kinds), np.uint16)
        for look in range(LOOKS):
            values, material = _look(walks, prepared, settings.seed + STREAM, look, pixels)
            sums += values
            materials[np.arange(len(pixels)), material] += 1
        return sums, materials

    return looked


def _look(
    walks: Walks, prepared: PreparedScene, seed: int, look: int, pixels: range
) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """(pixels, 5 + bodies) of 1, depth, normal and albedo, and number of the material from 1 on; 0 where no ray hits
    anything.
    """
    jit, camera, count = arrays(), prepared.camera, len(pixels)
    pose = camera.world_to_camera
    axis, ahead = opaque_vector(pose[2, :3]), dr.opaque(jit.Float, float(pose[2, 3]))
    pixel, width = dr.arange(jit.UInt, count) + dr.opaque(jit.UInt, pixels.start), dr.opaque(jit.UInt, camera.width)
    random = random_numbers(pixel, dr.opaque(jit.UInt, look), seed)
    x, y = (jit.Float(each) + random.next_float32() for each in (pixel % width, pixel // width))
    origin, direction = camera.rays(x, y, prepared.ahead)
    event, random = walks.event(origin, direction, random)
    normal, _ = walks.scattering.visible_normal(event.material, event.axis, -direction, *five_of(random)[:2])
    normal = dr.select(dr.dot(normal, direction) > 0.0, -normal, normal)
    alpha = math.pi * prepared.lighting.materials.read(event.material, "alpha")
    albedo = [alpha * share for share in event.coefficients[: len(prepared.palette.bodies)]]
    columns = [jit.Float(1), dr.dot(axis, event.point) + ahead, *normal, *albedo]
    there = [dr.select(event.there, column, jit.Float(0)) + dr.zeros(jit.Float, count) for column in columns]
    material = dr.select(event.there, event.material + 1, jit.UInt(0)) + dr.zeros(jit.UInt, count)
    dr.eval(there, material)
    return np.stack([np.array(column, np.float64) for column in there], axis=1), np.array(material)
