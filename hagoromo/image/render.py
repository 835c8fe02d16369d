"""Render: scene → Image. Camera rays march through the boxes to the first surface (MODEL §3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo import __version__
from hagoromo.backend import Array3f, Float, arrays, name
from hagoromo.errors import InputError
from hagoromo.image.cut import CutRays
from hagoromo.image.gloss_texture import gloss_rows
from hagoromo.image.image import Image
from hagoromo.image.lamp_batches import lamp_batches, under_batches
from hagoromo.image.lit_by_points import lit_by_points
from hagoromo.image.modes import MODES, Mode
from hagoromo.image.origin import Origin, depth_of_matter, origin_of, scene_from, scene_origin
from hagoromo.image.scene import Scene
from hagoromo.image.settings import Settings
from hagoromo.image.surface import Same, Surface, Surfaces
from hagoromo.image.surface_texture import SurfaceTexture
from hagoromo.light.lamp import by_place
from hagoromo.light.spectrum import Spectrum
from hagoromo.progress import Progress, part_of, silent
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.differentiable_medium import differentiable_attenuation
from hagoromo.transport.film import R3, Film
from hagoromo.transport.film import tile_order as tile_order
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.lighting import Attenuation, AttenuationOfAll, Lighting, ShadowRay
from hagoromo.transport.march import march
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import Palette, palette_of, position_of
from hagoromo.transport.sample import TexelHit
from hagoromo.transport.shadow import brute_attenuation, fitting_resolution, mapped_attenuation, too_wide_for_maps
from hagoromo.transport.surface_colours import SurfaceColours, TextureOfSurface, surface_element
from hagoromo.volume.box import VolumeBox

LOADING = 0.2  # of the work of a scene file, when its boxes are there
COARSEST_MAP = 32  # texels along a side of a shadow map at least

Value = TypeVar("Value")


def render(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    progress: Progress = silent,
    scheduler: str | int | None = None,
    mode: Mode = "march",
    unfinished: Image | None = None,
    layers: bool = False,
) -> Image:
    """The image that the scene's camera would see, as weights.

    scene: a `Scene`, or the path of a scene TOML, which is then rendered as it states unless `settings` are given.
    scheduler: a number of processes, "local", or the address of a Dask scheduler ("tls://host:8786", or a
    `TrustedScheduler`), whose workers render the tiles of a scene file; the bits are the same. `InputError` for a file
    that describes no scene, and a scheduler that does not answer or that nobody vouches for.
    mode: of MODES. "march": light that is scattered once, without noise. "full": light of all
    orders, solved once on a coarse grid, without noise. "path": light of all orders, estimated without
    bias by `settings.samples` random walks through each pixel; it has noise, see `Image.variance`. An interrupt of it
    raises `RenderInterrupted`, a `KeyboardInterrupt`, with the picture so far.
    unfinished: such a picture, to go on from to the bits of an uninterrupted run; mode path only.
    layers: whether the image has depth, normals, albedo and materials, too, see `Image.layers`.

    A matte ball under a far lamp behind the camera: its middle reflects E α = 2 · 0.25 of the lamp's spectrum.

    >>> matte = hg.Reflectance(alpha=0.25, beta=0.0, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(1.0))
    >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
    >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
    >>> image = hg.render(hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0), intensity=2.0),), surfaces=(ball,)))
    >>> image.weights.shape, round(float(image.weights[3, 4].sum()), 4)
    ((7, 9, 2), 0.5)
    """
    if mode not in MODES:
        raise InputError(f"mode is {mode!r}: give one of {', '.join(MODES)}")
    if settings is not None:
        check_mode(settings, mode)
    if unfinished is not None and mode != "path":
        raise InputError(f"mode is {mode!r}: only pictures of mode path are resumed")
    if scheduler is not None:
        from hagoromo.image.render_tiles import render_on  # Dask is an extra

        return render_on(scheduler, scene, settings, progress, mode, unfinished, layers)
    if not isinstance(scene, Scene):
        # only a file needs the readers of boxes and cameras; light of higher orders comes from all of a box
        from hagoromo.image.scene_file import load_for_picture, load_scene

        loading, progress = part_of(progress, 0.0, LOADING), part_of(progress, LOADING, 1.0 - LOADING)
        loaded, stated = load_for_picture(scene, settings, loading) if mode == "march" else load_scene(scene, loading)
        scene, settings = loaded, settings or stated
    settings = settings or Settings()
    image = picture_of_mode(mode, scene, settings, SceneCache(), progress, unfinished)
    return with_layers(image, scene, settings) if layers else image


def picture_of_mode(
    mode: Mode,
    scene: Scene,
    settings: Settings,
    cache: SceneCache,
    progress: Progress = silent,
    unfinished: Image | None = None,
) -> Image:
    """What `render` gives, without layers; what did not change since the last scene of `cache` is used again."""
    if mode == "path":
        from hagoromo.image.path_picture import path_picture  # the march does without

        return path_picture(scene, settings, progress, unfinished, cache)
    points = pixel_points(settings.samples, settings.seed)
    if mode == "full":
        from hagoromo.image.full_picture import full_picture

        return full_picture(scene, settings, points, cache, progress)
    return picture(scene, settings, cache, points, progress=progress)


def with_layers(image: Image, scene: Scene, settings: Settings, look: Any = None) -> Image:
    """A picture of a scene with the layers of what it shows. look: who looks, a `LookAt`; default: this process."""
    from hagoromo.image.layers import layers_of, names_of_materials

    record = image.metadata | {"materials": names_of_materials(scene)}
    return replace(image, layers=layers_of(scene, settings, look), metadata=record)


def check_mode(settings: Settings, mode: Mode) -> None:
    """`InputError` for settings that the mode does not heed."""
    if settings.cut is not None and mode != "march":
        raise InputError(f"a cut is for mode march, and the mode is {mode}: leave the cut out, or render by march")
    heeded = {"march": (), "full": ("orders",), "path": ("orders", "error", "seconds")}[mode]
    given = [key for key in ("orders", "error", "seconds") if getattr(settings, key) is not None and key not in heeded]
    if given:
        raise InputError(f"{given[0]} is for mode path, and the mode is {mode}: leave it out, or render by path")


def picture(
    scene: Scene,
    settings: Settings,
    cache: SceneCache,
    points: NDArray[np.float64],
    stride: int = 1,
    progress: Progress = silent,
) -> Image:
    """The image of a scene, by rays through `points` of every pixel; stride: see `Film`.

    Under many lamps it is the sum of those under batches of them; the coverage is that of the last. Area lamps and an
    environment are many lamps, see `lit_by_points`.
    """
    lit, points_of_light = lit_by_points(scene, settings)
    if points_of_light:
        from hagoromo.image.seen_lights import with_seen_lights  # it prepares scenes, too

        image = picture(lit, settings, cache, points, stride, progress)
        image = with_seen_lights(image, scene, settings, cache, points, stride)
        return replace(image, metadata=metadata(scene, settings) | points_of_light)

    def under(number: int, lit: Scene, part: Progress) -> Image:
        return _under_one_batch(lit, settings, cache, points, stride, part)

    return under_batches(scene, lamp_batches(scene.lamps), settings.separate_lamps, under, progress)


def _under_one_batch(
    scene: Scene,
    settings: Settings,
    cache: SceneCache,
    points: NDArray[np.float64],
    stride: int,
    progress: Progress,
) -> Image:
    prepared = PreparedScene(scene, settings, cache, stride)
    film = Film(prepared.camera, prepared.channels, stride, prepared.ahead)
    for sample, point in enumerate(points):
        film.add(prepared.camera_radiance, point, part_of(progress, sample / len(points), 1.0 / len(points)))
    return Image(*film.mean(), prepared.palette, metadata(scene, settings))


def metadata(scene: Scene, settings: Settings) -> dict[str, Any]:
    """Metadata of an image: version, backend, settings and scene, as plain values."""
    return {"version": __version__, "backend": name(), "settings": asdict(settings), "scene": scene.record()}


def reflectances_of(scene: Scene) -> list[Reflectance]:
    """Those of all boxes, then of all surfaces, as materials are numbered."""
    return [m for box in scene.boxes for m in box.materials] + [s.reflectance for s in scene.surfaces]


def bases_of(scene: Scene) -> list[Spectrum]:
    """The spectra of which body colours of single voxels and places of surfaces are sums."""
    textures = [surface.body_texture for surface in scene.surfaces if surface.body_texture is not None]
    return [
        spectrum
        for thing in (*(box.basis for box in scene.boxes), *(t.spectra for t in textures))
        for spectrum in thing
    ]


def palette_of_scene(scene: Scene, settings: Settings) -> Palette:
    """The colours that the weights of a scene's picture are of, without bands of higher orders."""
    colours = palette_of(reflectances_of(scene), bases_of(scene), [])
    return colours.with_lamps(scene.lights, settings.separate_lamps)


class SceneCache:
    """One value per name with the key that it was built from. The old value is released before the new one is built."""

    def __init__(self) -> None:
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
    """

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        cache: SceneCache | None = None,
        stride: int = 1,
        together: bool = True,
        medium: type[Medium] = Medium,
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
        self.surface_colours = surface_colours_of(scene, self.palette, cache)
        boxes_shade: Attenuation | None = None
        attenuation: Attenuation | AttenuationOfAll | None = None
        if medium.differentiable and settings.shadows != "none":
            attenuation = _attenuation_of_all(self.medium, self.surfaces)
        elif self.medium and (
            settings.shadows == "march" or (settings.shadows == "map" and too_wide_for_maps(self.medium))
        ):
            boxes_shade = brute_attenuation(self.medium)
        elif self.medium and settings.shadows == "map":
            boxes_shade = _maps(scene, settings, self.medium, cache, texels)
        if settings.shadows != "none":
            attenuation = attenuation or _attenuation(boxes_shade, self.surfaces)
        materials = Materials(reflectances, self.palette)
        self.lighting = Lighting(scene.lamps, materials, attenuation, bases, together, medium.differentiable)

    def camera_radiance(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """`radiance` along rays of the camera, which begin `ahead` of it."""
        if self.cut is None:
            return self.radiance(origin, direction, phase, self.first_width)
        begin, length = self.cut.span(origin, direction)
        width = dr.fma(begin, self.spread, self.first_width)
        return self.radiance(dr.fma(direction, begin, origin), direction, phase, width, length)

    def radiance(
        self,
        origin: Array3f,
        direction: Array3f,
        phase: Float = 0.0,
        width: Float = 0.0,
        length: Float | None = None,
    ) -> tuple[list[Float], Float]:
        """Weights of the radiance towards `origin` along rays, one Float per channel, and their alpha 0…1 (opacity).

        origin: counted from that of the scene, `self.origin`. width: of the rays there [m]. length: of the rays [m],
        default infinite.
        """
        jit, far = arrays(), arrays().Float(dr.inf)
        behind: list[Any] = [jit.Float(0)] * self.lighting.channels
        if self.surfaces:
            hit = self.surfaces.hit(origin, direction)
            if self.lighting.surface_light:
                dr.eval(hit)  # else its rays would be traced once more after those of the patches
            far = hit.distance if length is None else dr.select(hit.distance < length, hit.distance, dr.inf)
            materials, textures = self.lighting.materials, self.surface_colours
            element = surface_element(materials, self.first_on_surface, hit, textures, self.thickness)
            coefficients = materials.coefficients(element.material)
            if textures is not None:
                coefficients = textures.with_textures(coefficients, hit)
            light, _ = self.lighting.reflected_radiance(hit.point, -direction, [element], [coefficients])
            channels = self.lighting.in_groups(light)
            if self.lighting.surface_light:
                there = dr.isfinite(far)
                channels += self.lighting.surface_light.radiance(hit.point, element, coefficients, -direction, there)
            behind = [dr.select(dr.isfinite(far), channel, 0.0) for channel in channels]
        if self.medium is None:
            return behind, dr.select(dr.isfinite(far), 1.0, jit.Float(0))
        smooth = self.lighting.field is not None  # which is that of texels at their finest level
        cone = (0.0, 0.0) if smooth else (jit.Float(width), self.spread)
        end = far if length is None else dr.minimum(far, length)
        channels, passed = march(self.medium, self.lighting, origin, direction, jit.Float(0), end, phase, cone=cone)
        channels = [dr.fma(passed, back, front) for front, back in zip(channels, behind, strict=True)]
        return channels, 1.0 - dr.select(dr.isfinite(far), 0.0, passed)


def pixel_points(samples: int, seed: int) -> np.ndarray:
    """Points of a pixel and phases of the march, (samples, 3) in 0…1: the middle, or one in each of `samples` equal
    strips along each axis, in the order of the R3 sequence (Roberts 2018).

    Their mean is the middle of the pixel exactly: another one would shift the picture.
    """
    if samples == 1:
        return np.array([[0.5, 0.5, 0.0]])
    steps = np.outer(np.arange(samples), R3)
    order = np.argsort((np.random.default_rng(seed).random(3) + steps) % 1.0, axis=0)
    return (np.argsort(order, axis=0) + 0.5) / samples


def shadow_casters(scene: Scene, settings: Settings) -> tuple[tuple, tuple]:
    """Keys of the medium and of its shadow maps: equal for scenes, counted from their origins, that may share them."""
    boxes = tuple((*_matter(box), box.pose.tobytes()) for box in scene.boxes)
    places = ((lamp.position is None, lamp.to_lamp if lamp.position is None else lamp.position) for lamp in scene.lamps)
    lamps = tuple((far, np.asarray(place).tobytes()) for far, place in places)
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
    return cache.get("medium", (kind, *boxes), lambda: kind(scene.boxes, settings.tolerance))


def _surfaces(scene: Scene, cache: SceneCache, origin: Origin) -> Surfaces | None:
    """The scene's surfaces as Mitsuba holds them, for rays counted from `origin`; None without surfaces.

    Mitsuba counts from an origin of their own: a box that moves does not build its trees anew.
    """
    if not scene.surfaces:
        return None
    own = origin_of(scene.surfaces, scene.camera)
    figures = (own.tobytes(), *(surface.figure for surface in scene.surfaces))
    return cache.get("surfaces", figures, lambda: Surfaces(scene.surfaces, own)).seen_from(origin)


def surface_colours_of(scene: Scene, palette: Palette, cache: SceneCache) -> SurfaceColours | None:
    """The textures of the surfaces of a scene on the device; None where there are none."""
    if not any(texture for surface in scene.surfaces for texture in surface.textures):
        return None
    colours = len(palette.colours)
    bodies, factors, widths, key = [], [], [], []
    for surface in scene.surfaces:
        places = [position_of(s, palette.bodies) for s in surface.body_texture.spectra] if surface.body_texture else []
        bodies.append(_texture(surface, surface.body_texture, np.eye(len(palette.bodies), dtype=np.float32)[places]))
        factors.append(_texture(surface, surface.beta_texture, np.ones((1, 1), np.float32)))
        widths.append(_texture(surface, surface.gamma_texture, np.ones((1, 1), np.float32)))
        key.append((surface.figure, Same(surface.uv), *surface.textures, tuple(places)))
    first = len(palette.bodies)
    places = range(first, first + len(palette.interfaces))
    return cache.get("textures", (colours, *key), lambda: SurfaceColours(bodies, factors, widths, places))


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


def _texture(
    surface: Surface, texture: SurfaceTexture | None, on_palette: NDArray[np.float32]
) -> TextureOfSurface | None:
    """A texture of a surface as kernels take it."""
    if texture is None:
        return None
    if texture.of == "image" and surface.uv is not None:
        assert surface.faces is not None
        return TextureOfSurface(texture.values, texture.smooth, on_palette, surface.faces, surface.uv)
    corners = surface.faces if texture.of == "vertices" else None
    return TextureOfSurface(texture.values, texture.smooth, on_palette, corners)


def _attenuation(boxes_shade: Attenuation | None, surfaces: Surfaces | None) -> Attenuation:
    """Transmittance from a lamp to a point through all boxes, 0 behind a surface."""

    def share(
        lamp: int, point: Array3f, to_lamp: Array3f, distance: Float, extinction: Float, texel_hit: TexelHit | None
    ) -> Float:
        passed = arrays().Float(1)
        if boxes_shade:
            passed = boxes_shade(lamp, point, to_lamp, distance, extinction, texel_hit)
        return dr.select(surfaces.visible(point, to_lamp, distance), passed, 0.0) if surfaces else passed

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


def _maps(scene: Scene, settings: Settings, medium: Medium, cache: SceneCache, texels: int | None) -> Any:
    """Shadow maps of the lamps: with at most `texels` a side, if given, unless finer ones are there already."""
    casters, resolution = shadow_casters(scene, settings), settings.shadow_resolution
    lamps = [scene.lamps[numbers[0]] for numbers in by_place(scene.lamps)]
    resolution = resolution or fitting_resolution(medium.boxes, settings.tolerance)
    if texels:
        resolution = min(resolution, max(texels, COARSEST_MAP))
        if cache.key("maps")[:1] == (casters,):
            resolution = max(resolution, *cache.key("maps")[1:])
    return cache.get(
        "maps", (casters, resolution), lambda: mapped_attenuation(medium, lamps, resolution, settings.tolerance)
    )
