"""Layers: what a picture is made of: its body and interface light, its opacity, its shadows, and its matter.

Layers of matter (density, normals, axes, materials) come from the march itself, in which every sample sends a colour of
its own in place of light: the colour of a pixel is the mean over what is seen there, as opaque as the matter is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, lookup
from hagoromo.image.march_picture import picture
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.preview import strides
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.colour import srgb_encode
from hagoromo.transport.film import Film, pixel_points
from hagoromo.transport.sample import Element

OF_LIGHT = ("picture", "body", "interface", "opacity")  # made of the weights of one picture
OF_MATTER = ("density", "normals", "axes", "material")
LAYERS = (*OF_LIGHT, "shadow", *OF_MATTER)
# linear sRGB of materials 0, 1, 2, …, apart for eyes of all kinds (Okabe and Ito 2008, "Color Universal Design")
MATERIAL_COLOURS = (
    (0.791, 0.347, 0.0), (0.093, 0.456, 0.807), (0.0, 0.342, 0.171), (0.871, 0.776, 0.054),
    (0.0, 0.168, 0.445), (0.665, 0.112, 0.0), (0.604, 0.191, 0.386), (0.6, 0.6, 0.6),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class LayerPicture:
    """A layer (height, width, 3), display values uint8; share: of the work done, 0…1."""

    picture: NDArray[np.uint8]
    share: float


class MatterColours:
    """Takes the place of `Lighting` in a march: every sample has a colour for what it is, and nothing shades it."""

    def __init__(self, layer: str, materials: int, densest: float = 1.0) -> None:
        """`densest`: extinction that the layer "density" shows white [1/m]."""
        jit = arrays()
        self.densest = dr.opaque(jit.Float, densest)
        self.layer, self.lamps, self.channels, self.voxel_bases = layer, (None,), 3, ()
        self.field, self.surface_light, self.tracked = None, None, False
        palette = SimpleNamespace(colours=range(3), channels=3)
        self.materials = SimpleNamespace(palette=palette, coefficients=lambda material: [])
        colours = [MATERIAL_COLOURS[k % len(MATERIAL_COLOURS)] for k in range(max(materials, 1))]
        self.table = lookup(jit.Float, np.ravel(colours).astype(np.float32))

    def in_parts(self) -> list[MatterColours]:
        """One part: there are no lamps."""
        return [self]

    def in_groups(self, light: list[Float]) -> list[Float]:
        """The channels as they are."""
        return light

    def reflected_radiance(
        self, point: Array3f, to_eye: Array3f, elements: list[Element], coefficients: Any, *of_matter: Any
    ) -> tuple[list[Float], list[Float]]:
        """The colour of a sample, linear, in place of the light that it sends; as if every lamp reached it.

        of_matter: whether a texel was hit, and the extinction there [1/m]; nothing of a surface, which is white.
        """
        jit, total = arrays(), [arrays().Float(0)] * 3
        if self.layer == "density":
            return [jit.Float(of_matter[1]) / self.densest if of_matter else jit.Float(1)] * 3, [jit.Float(1)]
        for element in elements:
            colour = self._colour(element, to_eye)
            total = [dr.fma(one, element.share, before) for one, before in zip(colour, total, strict=True)]
        return total, [jit.Float(1)]

    def _colour(self, element: Element, to_eye: Array3f) -> list[Float]:
        if self.layer == "material":
            return [dr.gather(arrays().Float, self.table, element.material * 3 + k) for k in range(3)]
        if self.layer == "axes":
            return [dr.abs(one) for one in element.axis]
        facing = dr.select(dr.dot(element.axis, to_eye) < 0.0, -element.axis, element.axis)
        return [dr.fma(one, 0.5, 0.5) for one in facing]


def matter_pictures(
    scene: Scene, settings: Settings, cache: SceneCache, layer: str, rays: int
) -> Iterator[LayerPicture]:
    """Pictures of a layer of OF_MATTER, each finer than the last; `rays`: of the first."""
    coarse = strides(scene.camera.width * scene.camera.height, rays)
    unshaded, materials = replace(settings, shadows="none"), sum(len(box.materials) for box in scene.boxes)
    densest = max((box.tau * box.bricks.densest for box in scene.boxes), default=1.0)
    for number, stride in enumerate([*coarse, 1]):
        prepared: Any = PreparedScene(scene, unshaded, cache, stride)
        prepared.lighting = MatterColours(layer, materials + len(scene.surfaces), densest)
        film = Film(prepared.camera, 3, stride, prepared.ahead)
        for point in pixel_points(1, 0) if stride > 1 else pixel_points(settings.samples, settings.seed):
            film.add(prepared.camera_radiance, point)
        values, _ = film.mean()
        encode = srgb_encode if layer == "material" else _coded
        yield LayerPicture(encode(values), (number + 1) / (len(coarse) + 1))


def shadow_pictures(
    images: Iterator[Image], scene: Scene, settings: Settings, cache: SceneCache
) -> Iterator[LayerPicture]:
    """Share of the lamps' light that arrives, of what is seen in each pixel: of `images` over those without shadows."""
    unshaded = replace(settings, shadows="none")
    bright: dict[int, Image] = {}
    for image in images:
        level = image.metadata["preview"]
        stride = level["stride"]
        if stride not in bright:
            points = pixel_points(1, 0) if stride > 1 else pixel_points(settings.samples, settings.seed)
            bright = {stride: picture(scene, unshaded, cache, points, stride)}
        shaded, lit = image.xyz()[..., 1], bright[stride].xyz()[..., 1]
        share = np.divide(shaded, lit, out=np.zeros_like(lit), where=lit > 0.0)
        yield LayerPicture(np.repeat(_coded(share)[..., None], 3, axis=2), level["share"])


def light_layer(image: Image, layer: str) -> Image:
    """An image with the body or the interface light alone."""
    return image.part(layer)


def opacity_layer(image: Image) -> NDArray[np.uint8]:
    """The coverage, 0…255."""
    return np.repeat(_coded(image.alpha)[..., None], 3, axis=2)


def _coded(values: NDArray[Any]) -> NDArray[np.uint8]:
    """0…1 as 0…255, without a tone curve: what is read off a picture is the value."""
    return np.round(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
