"""Prepared scene: what every mode makes of a scene on the device, before the first ray.

It knows no mode. A cache keeps what the next scene may use again.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays, evaluate
from hagoromo.files.cache import Cache
from hagoromo.image.prepared.traced_surfaces import Surfaces
from hagoromo.image.scene.cut import CutRays
from hagoromo.image.scene.gloss_texture import gloss_rows
from hagoromo.image.scene.origin import Origin, depth_of_matter, origin_of, scene_from, scene_origin
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import palette_of_scene, reflectances_of
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.texture_tables import key_of_textures, surface_colours
from hagoromo.light.lamp import by_place
from hagoromo.light.lamp_light import LampInTurn
from hagoromo.transport.differentiable_medium import differentiable_attenuation
from hagoromo.transport.film import tile_order as tile_order
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.lighting import Attenuation, AttenuationOfAll, Lighting, ShadowRay, WayToLamp
from hagoromo.transport.march import march
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import Palette
from hagoromo.transport.shadow import (
    brute_attenuation,
    map_resolution,
    mapped_attenuation,
    marching_is_quicker,
    too_wide_for_maps,
)
from hagoromo.transport.surface_colours import SurfaceColours, surface_element
from hagoromo.volume.box import VolumeBox

COARSEST_MAP = 32  # texels along a side of a shadow map at least

Value = TypeVar("Value")


class SceneCache:
    """One value per name with the key that it was built from. The old value is released before the new one is built.

    shared: where light of higher orders is kept for other processes, see `solved_light`; None: nowhere.
    """

    def __init__(self, shared: Cache | None = None) -> None:
        self.shared = shared
        self._entries: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def key(self, name: str) -> tuple[Any, ...]:
        """The key that the value `name` was built from; () where there is none."""
        return self._entries[name][0] if name in self._entries else ()

    def get(self, name: str, key: tuple[Any, ...], build: Callable[[], Value]) -> Value:
        """The value `name`, built now unless it was built from the same `key`."""
        if self.key(name) != key:
            self._entries.pop(name, None)
            self._entries[name] = key, build()
        return self._entries[name][1]


class PreparedScene:
    """A scene on the device, ready for rays: medium, surfaces, materials, lamps and shadow maps.

    All places count from `origin` (3,) [m], world, see `origin_of`: those of `camera`, the scene's own, and of rays.
    ahead: depth at which the camera's rays begin, in front of all matter [m].
    cache: what an earlier scene left on the device; values that did not change are used again.
    stride: camera pixels along a side of one of the picture; a coarse one needs no more texels of shadow maps.
    together: see `Lighting`; where there are shadow maps, lamps at one place always are.
    medium: class of the medium.
    by_camera: whether nothing but the rays of the camera looks up shadows; see `marching_is_quicker`.
    """

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        cache: SceneCache | None = None,
        stride: int = 1,
        together: bool = True,
        medium: type[Medium] = Medium,
        by_camera: bool = True,
    ) -> None:
        cache, world, self.origin = cache or SceneCache(), scene, scene_origin(scene)
        scene = scene_from(world, self.origin)
        self.camera = camera = scene.camera
        self.ahead = depth_of_matter(scene)
        self.cut = None if settings.cut is None else CutRays(settings.cut, self.origin)
        texels = None if stride == 1 else math.isqrt(camera.width * camera.height) // stride
        width = stride / (max(camera.focal) * math.sqrt(settings.samples if stride == 1 else 1))
        self.spread = dr.opaque(arrays().Float, width)  # of a ray, per metre
        self.first_width = dr.opaque(arrays().Float, width * self.ahead)  # of a camera ray, where it begins [m]
        reflectances, bases = reflectances_of(scene), [box.basis for box in scene.boxes]
        self.palette = palette_of_scene(scene, settings)
        self.channels = self.palette.channels
        self.medium = _medium(scene, settings, cache, medium)
        self.first_on_surface = dr.opaque(arrays().UInt, len(reflectances) - len(scene.surfaces))
        self.surfaces = _surfaces(world, cache, self.origin)
        sheets = any(surface.reflectance.transmits for surface in scene.surfaces)
        self.thickness = 2.0 * self.surfaces.shadow_bias if self.surfaces and sheets else None  # see `surface_element`
        self.surface_colours = _surface_colours(scene, self.palette, cache)
        rays = camera.width * camera.height * settings.samples if by_camera and stride == 1 else None
        boxes_shade: Attenuation | None = None
        attenuation: Attenuation | AttenuationOfAll | None = None
        if medium.differentiable and settings.shadows != "none":
            attenuation = _attenuation_of_all(self.medium, self.surfaces)
        elif self.medium and (
            settings.shadows == "march" or (settings.shadows == "map" and _marched(self.medium, settings, rays))
        ):
            boxes_shade = brute_attenuation(self.medium)
        elif self.medium and settings.shadows == "map":
            boxes_shade = _maps(scene, settings, self.medium, cache, texels)
        if settings.shadows != "none":
            attenuation = attenuation or _attenuation(boxes_shade, self.surfaces)
        materials = Materials(reflectances, self.palette)
        self.lighting = Lighting(scene.lamps, materials, attenuation, bases, together, medium.differentiable)

    def camera_radiance(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """`radiance` along rays of the camera, which begin `ahead` of it.

        Of many lamps it is the sum of what parts of them give, each by a kernel of its own: one for all would take long
        to compile, and to run, as what it holds of a ray grows with their number.
        """
        parts = self.lighting.in_parts()
        if len(parts) == 1:
            return self._camera_radiance(self.lighting, origin, direction, phase)
        channels: list[Float] = []
        evaluate(origin, direction)
        for part in parts:
            more, alpha = self._camera_radiance(part, origin, direction, phase)
            evaluate(more, alpha)  # apart from the sum, so that parts may have one kernel
            channels = [*map(operator.add, channels, more), *channels[len(more) :]] if channels else more
        return channels, alpha

    def _camera_radiance(
        self, lighting: Lighting, origin: Array3f, direction: Array3f, phase: Float
    ) -> tuple[list[Float], Float]:
        if self.cut is None:
            return self.radiance(origin, direction, phase, self.first_width, lighting=lighting)
        begin, length = self.cut.span(origin, direction)
        width = dr.fma(begin, self.spread, self.first_width)
        return self.radiance(dr.fma(direction, begin, origin), direction, phase, width, length, lighting)

    def radiance(
        self,
        origin: Array3f,
        direction: Array3f,
        phase: Float = 0.0,
        width: Float = 0.0,
        length: Float | None = None,
        lighting: Lighting | None = None,
    ) -> tuple[list[Float], Float]:
        """Weights of the radiance towards `origin` along rays, one Float per channel, and their alpha 0…1 (opacity).

        origin: counted from that of the scene, `self.origin`. width: of the rays there [m]. length: of the rays [m],
        default infinite. lighting: a part of that of the scene, default all.
        """
        lighting = lighting or self.lighting
        behind, far = self.behind(origin, direction, length, lighting)
        if self.medium is None:
            return behind, dr.select(dr.isfinite(far), 1.0, arrays().Float(0))
        smooth = lighting.field is not None  # which is that of texels at their finest level
        cone = (0.0, 0.0) if smooth else (arrays().Float(width), self.spread)
        end = far if length is None else dr.minimum(far, length)
        near = arrays().Float(0)
        channels, passed = march(self.medium, lighting, origin, direction, near, end, phase, cone=cone)
        channels = [dr.fma(passed, back, front) for front, back in zip(channels, behind, strict=True)]
        return channels, 1.0 - dr.select(dr.isfinite(far), 0.0, passed)

    def behind(
        self, origin: Array3f, direction: Array3f, length: Float | None = None, lighting: Lighting | None = None
    ) -> tuple[list[Float], Float]:
        """What rays see of surfaces, without matter in front of them, and the distance to these [m], infinite without.

        See `radiance`.
        """
        jit, far, lighting = arrays(), arrays().Float(dr.inf), lighting or self.lighting
        if not self.surfaces:
            return [jit.Float(0)] * lighting.channels, far
        hit = self.surfaces.hit(origin, direction)
        if lighting.surface_light:
            evaluate(hit)  # else its rays would be traced once more after those of the patches
        far = hit.distance if length is None else dr.select(hit.distance < length, hit.distance, dr.inf)
        materials, textures = lighting.materials, self.surface_colours
        element = surface_element(materials, self.first_on_surface, hit, textures, self.thickness)
        coefficients = materials.coefficients(element.material)
        if textures is not None:
            coefficients = textures.with_textures(coefficients, hit)
        light, _ = lighting.reflected_radiance(hit.point, -direction, [element], [coefficients])
        channels = lighting.in_groups(light)
        if lighting.surface_light:
            there = dr.isfinite(far)
            channels += lighting.surface_light.radiance(hit.point, element, coefficients, -direction, there)
        return [dr.select(dr.isfinite(far), channel, 0.0) for channel in channels], far


def shadow_casters(scene: Scene, settings: Settings) -> tuple[tuple, tuple]:
    """Keys of the medium and of its shadow maps: equal for scenes, counted from their origins, that may share them."""
    boxes = tuple((*_matter(box), box.pose.tobytes()) for box in scene.boxes)
    lamps = tuple((lamp.near, lamp.place.tobytes()) for lamp in scene.lamps)
    return (boxes, settings.tolerance), lamps


def _matter(box: VolumeBox) -> tuple:
    """What the medium takes from a box but its pose."""
    elements = tuple(material.element for material in box.materials)
    return box.bricks, box.voxel_size, box.tau, elements, box.shadow_bias, box.extinction


def _medium(scene: Scene, settings: Settings, cache: SceneCache, kind: type[Medium]) -> Medium | None:
    """The scene's boxes on the device; None without boxes."""
    if not scene.boxes:
        return None
    boxes, _ = shadow_casters(scene, settings)
    if scene.moving is not None:
        return Medium(scene.boxes, settings.tolerance, scene.moving.boxes)
    return cache.get("medium", (kind, *boxes), lambda: kind(scene.boxes, settings.tolerance))


def _surfaces(scene: Scene, cache: SceneCache, origin: Origin) -> Surfaces | None:
    """The scene's surfaces as Mitsuba holds them, for rays counted from `origin`; None without surfaces.

    Mitsuba counts from an origin of their own: a box that moves does not build its trees anew.
    """
    if not scene.surfaces:
        return None
    own = origin_of(scene.surfaces, scene.camera)
    if scene.moving is not None and scene.moving.surfaces:
        return Surfaces(scene.surfaces, own, scene.moving.surfaces).seen_from(origin)
    figures = (own.tobytes(), *(surface.figure for surface in scene.surfaces))
    return cache.get("surfaces", figures, lambda: Surfaces(scene.surfaces, own)).seen_from(origin)


def _surface_colours(scene: Scene, palette: Palette, cache: SceneCache) -> SurfaceColours | None:
    """The textures of the surfaces of a scene on the device; None where there are none."""
    if not any(texture for surface in scene.surfaces for texture in surface.textures):
        return None
    key = key_of_textures(scene.surfaces, palette)
    return cache.get("textures", key, lambda: surface_colours(scene.surfaces, palette))


def gamma_rows_of(scene: Scene) -> GammaRows | None:
    """Rows of materials whose γ differs from place to place; None where no surface has a texture of it."""
    reflectances = reflectances_of(scene)
    first = len(reflectances) - len(scene.surfaces)
    further = {
        first + k: [(row.of(brightest), row.factor) for row in gloss_rows(gamma, s.beta_texture)]
        for k, s in enumerate(scene.surfaces)
        for gamma, brightest in ([(s.gamma_texture, s.brightest)] if s.gamma_texture is not None else [])
    }
    return GammaRows(reflectances, further) if further else None


def _attenuation(boxes_shade: Attenuation | None, surfaces: Surfaces | None) -> Attenuation:
    """Transmittance from a lamp to a point through all boxes, 0 behind a surface."""

    def share(lamp: int | LampInTurn, way: WayToLamp) -> Float:
        passed = boxes_shade(lamp, way) if boxes_shade else arrays().Float(1)
        return dr.select(surfaces.visible(way.origin, way.to_lamp, way.distance), passed, 0.0) if surfaces else passed

    return share


def _attenuation_of_all(medium: Medium | None, surfaces: Surfaces | None) -> AttenuationOfAll:
    """The same with derivatives."""
    boxes_shade = differentiable_attenuation(medium) if medium else None

    def shares(rays: list[ShadowRay]) -> list[Float]:
        passed = boxes_shade(rays) if boxes_shade else [arrays().Float(1)] * len(rays)
        if not surfaces:
            return passed
        return [dr.select(surfaces.visible(*ray), each, 0.0) for ray, each in zip(rays, passed, strict=True)]

    return shares


def _marched(medium: Medium, settings: Settings, rays: int | None) -> bool:
    """Whether shadows are marched in place of maps; rays: all that look them up, None where they are not counted."""
    if too_wide_for_maps(medium):
        return True
    if rays is None or settings.shadow_resolution:
        return False
    return marching_is_quicker(medium, map_resolution(medium, settings.tolerance), rays)


def _maps(scene: Scene, settings: Settings, medium: Medium, cache: SceneCache, texels: int | None) -> Any:
    """Shadow maps of the lamps: with at most `texels` a side, if given, unless finer ones are there already."""
    casters, resolution = shadow_casters(scene, settings), settings.shadow_resolution
    lamps = [scene.lamps[numbers[0]] for numbers in by_place(scene.lamps)]
    resolution = resolution or map_resolution(medium, settings.tolerance)
    if texels:
        resolution = min(resolution, max(texels, COARSEST_MAP))
        if cache.key("maps")[:1] == (casters,):
            resolution = max(resolution, *cache.key("maps")[1:])
    return cache.get(
        "maps", (casters, resolution), lambda: mapped_attenuation(medium, lamps, resolution, settings.tolerance)
    )
