"""Seen lights: the lights that the camera sees themselves, in pictures of the march and of full.

Area lamps and environments are seen where they are `visible`, surfaces that give off light always, through the matter
in front of them. Their light has the spectrum of the lamp: it is kept in the bands of higher orders, as in mode path,
or in one band for all wavelengths.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.image.emitter_mesh import emitters_of
from hagoromo.image.image import Image
from hagoromo.image.origin import depth_of_matter, scene_from
from hagoromo.image.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.scene import Scene
from hagoromo.image.scene_palette import palette_of_scene
from hagoromo.image.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.film import Film
from hagoromo.transport.march import optical_depth
from hagoromo.transport.path.environment_light import EnvironmentLight


def camera_sees_lights(scene: Scene) -> bool:
    """Whether a light of a scene may be seen itself."""
    visible = any(lamp.visible for lamp in scene.area_lamps) or any(surface.emission for surface in scene.surfaces)
    return visible or (scene.environment is not None and scene.environment.visible)


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
        placed, groups = scene_from(scene, self.prepared.origin), list(palette.lamp_groups[len(scene.lamps) :])
        self.groups, areas = len(palette.lamps), zip(placed.area_lamps, groups, strict=False)
        self.areas = [(lamp.on_device(), group) for lamp, group in areas if lamp.visible]
        groups = groups[len(scene.area_lamps) :]
        seen = scene.environment is not None and scene.environment.visible
        self.environment = EnvironmentLight(scene.environment) if scene.environment and seen else None
        parts = len(scene.environment.parts) if scene.environment else 0
        self.parts = groups[:parts]
        self.emitters = [
            (emitter.surface, dr.opaque(arrays().Float, emitter.emission.radiance), group)
            for emitter, group in zip(emitters_of(placed.surfaces), groups[parts:], strict=True)
        ]
        self.film = Film(self.prepared.camera, self.groups, stride, depth_of_matter(placed), rays)

    def radiance(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """Radiance of every group of lamps along rays of the camera, and 0 for alpha."""
        jit, prepared = arrays(), self.prepared
        end = dr.full(jit.Float, dr.inf, dr.width(direction))
        if prepared.cut is not None:
            begin, end = prepared.cut.span(origin, direction)
            origin = dr.fma(direction, begin, origin)
        light = [dr.zeros(jit.Float, dr.width(direction)) for _ in range(self.groups)]
        hit = prepared.surfaces.hit(origin, direction) if prepared.surfaces else None
        if hit is not None:
            seen = hit.distance < end
            end = dr.minimum(end, hit.distance)
            for surface, radiance, group in self.emitters:
                here = seen & hit.front & (hit.surface == surface)
                light[group] = light[group] + dr.select(here, radiance, 0.0)
        if self.environment is not None:
            parts = self.environment.radiance_of(self.environment.pixel(direction))
            for radiance, group in zip(parts, self.parts, strict=True):
                light[group] = light[group] + dr.select(dr.isinf(end), radiance, 0.0)
        passed = self._passed(origin, direction, end)
        light = [each * passed for each in light]
        for area, group in self.areas:
            there, distance, _ = area.seen(origin, direction)
            there &= distance < end
            passed = self._passed(origin, direction, dr.select(there, distance, 0.0))
            light[group] = light[group] + dr.select(there, area.radiance * passed, 0.0)
        return light, dr.zeros(jit.Float, dr.width(direction))

    def _passed(self, origin: Array3f, direction: Array3f, distance: Float) -> Float:
        """Transmittance of the matter up to a distance."""
        if self.prepared.medium is None:
            return arrays().Float(1)
        return dr.exp(-optical_depth(self.prepared.medium, origin, direction, arrays().Float(0), distance))
