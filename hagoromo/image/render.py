"""Render: scene → Image. Camera rays march through the boxes to the first surface (MODEL §3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import drjit as dr
import numpy as np

from hagoromo import __version__
from hagoromo.backend import arrays, name
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.door import check_memory
from hagoromo.image.image import Image
from hagoromo.image.lighting import Lighting, Materials, palette_of
from hagoromo.image.march import march
from hagoromo.image.scene import Scene
from hagoromo.image.shadow import brute_attenuation, mapped_attenuation
from hagoromo.image.surface import Surfaces
from hagoromo.volume.medium import STEPS_PER_VOXEL, Medium

SHADOWS = ("map", "march", "none")
RAYS = 1 << 20  # rays marched at once; progress is told, and an interrupt heard, between
TILE = (4, 2)  # neighbouring rays share lanes: columns, rows
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Settings:
    """How to render: samples are rays a pixel, shadow_resolution is texels a side of a map (None: fitting)."""

    samples: int = 1
    shadows: str = "map"
    shadow_resolution: int | None = None
    steps_per_voxel: float = STEPS_PER_VOXEL
    seed: int = 0

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise InputError(f"samples is {self.samples}: give 1 or more rays a pixel")
        if self.shadows not in SHADOWS:
            raise InputError(f"shadows is {self.shadows!r}: give one of {', '.join(SHADOWS)}")
        if not 0.25 <= self.steps_per_voxel <= 64:
            raise InputError(f"steps_per_voxel is {self.steps_per_voxel}: give a number from 0.25 to 64")
        if self.shadow_resolution is not None and not 2 <= self.shadow_resolution <= 16384:
            raise InputError(f"shadow_resolution is {self.shadow_resolution}: give 2 to 16384 texels")


def render(scene: Scene, settings: Settings | None = None, progress: Progress | None = None) -> Image:
    """The image that the scene's camera would see, as weights; `progress` is told the share done, 0…1."""
    settings = settings or Settings()
    camera = scene.camera
    light = Light(scene, settings)
    channels = light.lighting.materials.palette.channels
    check_memory(
        8 * camera.width * camera.height * (channels + 1), f"an image of {camera.width} × {camera.height} pixels"
    )
    sums = np.zeros((camera.height * camera.width, channels + 1), np.float64)
    order = tile_order(camera.width, camera.height)
    for sample, point in enumerate(pixel_points(settings.samples, settings.seed)):
        for start in range(0, order.size, RAYS):
            pixels = order[start : start + RAYS]
            sums[pixels] += _trace(light, camera, pixels, point)
            if progress:
                progress((sample + (start + pixels.size) / order.size) / settings.samples)
    mean = (sums / settings.samples).reshape(camera.height, camera.width, -1).astype(np.float32)
    metadata = {"version": __version__, "backend": name(), "settings": asdict(settings), "scene": scene.record()}
    return Image(mean[..., :-1], mean[..., -1], light.lighting.materials.palette, metadata)


class Light:
    """A scene made ready for rays: its medium, surfaces, materials, lamps and shadow maps."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        reflectances = [m for box in scene.boxes for m in box.materials] + [s.reflectance for s in scene.surfaces]
        bases = [box.basis for box in scene.boxes]
        palette = palette_of(reflectances, [s for b in bases for s in b], [lamp.spectrum for lamp in scene.lamps])
        self.medium = Medium(scene.boxes, settings.steps_per_voxel) if scene.boxes else None
        first = len(reflectances) - len(scene.surfaces)
        self.surfaces = Surfaces(scene.surfaces, first) if scene.surfaces else None
        self.boxes_shade: Any = None
        if self.medium and settings.shadows == "map":
            self.boxes_shade = mapped_attenuation(self.medium, scene.lamps, settings.shadow_resolution)
        elif self.medium and settings.shadows == "march":
            self.boxes_shade = brute_attenuation(self.medium)
        attenuation = self.attenuation if settings.shadows != "none" else None
        self.lighting = Lighting(scene.lamps, Materials(reflectances, palette), attenuation, bases)

    def attenuation(self, lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        """Share of a lamp's light that passes all boxes and surfaces on its way to `point`."""
        share = self.boxes_shade(lamp, point, to_lamp, distance) if self.boxes_shade else arrays().Float(1)
        if self.surfaces:
            share = dr.select(self.surfaces.visible(point, to_lamp, distance), share, 0.0)
        return share

    def along(self, origin: Any, direction: Any, phase: Any = 0.0) -> tuple[list[Any], Any]:
        """Weights of the radiance towards `origin` along rays, and the share of them that ends on matter."""
        kinds, far = arrays(), arrays().Float(dr.inf)
        behind: list[Any] = [kinds.Float(0)] * self.lighting.materials.palette.channels
        if self.surfaces:
            far, point, normal, material = self.surfaces.meet(origin, direction)
            coefficients = self.lighting.materials.coefficients(material)
            light = self.lighting.reflected(point, -direction, normal, material, coefficients)
            behind = [dr.select(dr.isfinite(far), channel, 0.0) for channel in light]
        if self.medium is None:
            return behind, dr.select(dr.isfinite(far), 1.0, kinds.Float(0))
        channels, passed = march(self.medium, self.lighting, origin, direction, kinds.Float(0), far, phase)
        channels = [dr.fma(passed, back, front) for front, back in zip(channels, behind, strict=True)]
        return channels, 1.0 - dr.select(dr.isfinite(far), 0.0, passed)


def tile_order(width: int, height: int) -> np.ndarray:
    """Pixel numbers (row · width + column) so that TILE neighbours follow one another."""
    rows, columns = np.mgrid[0:height, 0:width]
    inside = (rows % TILE[1]) * TILE[0] + columns % TILE[0]
    tile = (rows // TILE[1]) * (-(-width // TILE[0])) + columns // TILE[0]
    return np.argsort((tile * (TILE[0] * TILE[1]) + inside).ravel(), kind="stable").astype(np.uint32)


def pixel_points(samples: int, seed: int) -> np.ndarray:
    """Points of a pixel and phases of the march, (samples, 3) in 0…1: the middle, or one in each of `samples` equal
    strips along each axis, in the order of the R3 sequence (Roberts 2018).

    Their mean is the middle of the pixel exactly: another one would shift the picture.
    """
    if samples == 1:
        return np.array([[0.5, 0.5, 0.0]])
    steps = np.outer(np.arange(samples), (0.8191725133961645, 0.6710436067037893, 0.5497004779019703))
    order = np.argsort((np.random.default_rng(seed).random(3) + steps) % 1.0, axis=0)
    return (np.argsort(order, axis=0) + 0.5) / samples


def _trace(light: Light, camera: Camera, pixels: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Weights and alpha (pixels, channels + 1) of one ray a pixel, through the `point` (dx, dy, phase) of each."""
    dx, dy, phase = point
    kinds = arrays()
    number = kinds.UInt(pixels)
    across = dr.opaque(kinds.UInt, camera.width)
    x = kinds.Float(number % across) + dr.opaque(kinds.Float, float(dx))
    y = kinds.Float(number // across) + dr.opaque(kinds.Float, float(dy))
    channels, alpha = light.along(*camera.rays(x, y), dr.opaque(kinds.Float, float(phase)))
    dr.eval(channels, alpha)
    return np.stack([np.array(channel) for channel in (*channels, alpha)], axis=-1)
