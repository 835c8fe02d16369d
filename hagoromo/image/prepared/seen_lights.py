"""Seen lights: the lights that the camera sees themselves, in pictures of the march and of full.

A light is seen where it is `visible`, through the matter in front of it. Its light has the spectrum of the lamp: it is
kept in the bands of higher orders, as in mode path, or in one band for all wavelengths.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.scene.origin import depth_of_matter, scene_from
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import grouped_lights, palette_of_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.light.wide_light import LightHit
from hagoromo.transport.film import Film
from hagoromo.transport.march import optical_depth
from hagoromo.transport.path.lights import front_of


def camera_sees_lights(scene: Scene) -> bool:
    """Whether a light of a scene may be seen itself."""
    return any(light.visible for light in scene.wide_lights)


def with_seen_lights(
    image: Image, scene: Scene, settings: Settings, cache: SceneCache, points: Iterable[NDArray], stride: int = 1
) -> Image:
    """The picture of a scene by rays through `points` of every pixel, with the lights that its camera sees."""
    if not camera_sees_lights(scene):
        return image
    lights = SeenLights(scene, settings, cache, stride)
    for point in points:
        lights.film.add(lights.radiance, point)
    return with_light(image, lights.film.mean()[0])


def with_light(image: Image, seen: NDArray[np.float32]) -> Image:
    """A picture with further light (height, width, groups of lamps) of the spectrum of each group."""
    palette, groups = image.palette, len(image.palette.lamps)
    weights = image.weights.reshape(*image.alpha.shape, groups, -1)
    if palette.bands:
        weights = weights.copy()
        weights[..., -len(palette.bands) :] += seen[..., None]  # bands together are 1 at every wavelength
    else:
        weights = np.concatenate([weights, seen[..., None]], axis=-1)
        palette = replace(palette, bands=(Spectrum.constant(1.0),))
    return replace(image, weights=weights.reshape(*image.alpha.shape, -1), palette=palette)


class _RayEnd(NamedTuple):
    """See `RayEnd`."""

    distance: Float
    face: Array3f
    front: UInt


class SeenLights:
    """The lights of a scene that its camera sees, along its rays; `film` is theirs.

    stride, rays: see `Film`. The medium and the surfaces are those of `cache`.
    """

    def __init__(
        self, scene: Scene, settings: Settings, cache: SceneCache, stride: int = 1, rays: range | None = None
    ) -> None:
        unlit = scene.with_lamps(Lamp(to_lamp=(0.0, 0.0, 1.0)))
        self.prepared = PreparedScene(unlit, replace(settings, shadows="none"), cache, stride)
        palette = palette_of_scene(scene, replace(settings, separate_lamps=False))
        placed, self.groups = scene_from(scene, self.prepared.origin), len(palette.lamps)
        self.lights = [
            (light.seen_on_device(), groups) for light, groups in grouped_lights(placed, palette) if light.visible
        ]
        self.film = Film(self.prepared.camera, self.groups, stride, depth_of_matter(placed), rays)

    def radiance(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """Radiance of every group of lamps along rays of the camera, and 0 for alpha."""
        jit, prepared = arrays(), self.prepared
        end = dr.full(jit.Float, dr.inf, dr.width(direction))
        if prepared.cut is not None:
            begin, end = prepared.cut.span(origin, direction)
            origin = dr.fma(direction, begin, origin)
        ray_end = _RayEnd(end, jit.Array3f(0.0), jit.UInt(0))
        if prepared.surfaces:
            hit = prepared.surfaces.hit(origin, direction)
            front = dr.select(hit.distance < end, front_of(hit), jit.UInt(0))
            ray_end = _RayEnd(dr.minimum(end, hit.distance), hit.flat, front)
        light = [dr.zeros(jit.Float, dr.width(direction)) for _ in range(self.groups)]
        hits = [(*pair, pair[0].hit(origin, direction, ray_end)) for pair in self.lights]
        for source, groups, one in hits:
            if one is not None and one.distance is None:
                _add(light, groups, source.radiance, one)
        passed = self._passed(origin, direction, ray_end.distance)
        light = [each * passed for each in light]
        for source, groups, one in hits:
            if one is not None and one.distance is not None:
                passed = self._passed(origin, direction, dr.select(one.there, one.distance, 0.0))
                _add(light, groups, source.radiance * passed, one)
        return light, dr.zeros(jit.Float, dr.width(direction))

    def _passed(self, origin: Array3f, direction: Array3f, distance: Float) -> Float:
        """Transmittance of the matter up to a distance."""
        if self.prepared.medium is None:
            return arrays().Float(1)
        return dr.exp(-optical_depth(self.prepared.medium, origin, direction, arrays().Float(0), distance))


def _add(light: list[Float], groups: Sequence[int], radiance: Float, hit: LightHit) -> None:
    """Add what is hit of a light to the radiance of its groups; radiance: of a tint of 1, as it arrives."""
    for group, tint in zip(groups, hit.tints, strict=True):
        light[group] = light[group] + dr.select(hit.there, radiance * tint, 0.0)
