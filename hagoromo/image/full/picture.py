"""Pictures of all orders of light: the light of higher orders is solved once, marched through, and mended by walks.

Enters: a scene. Leaves: an `Image` whose palette has bands for light that was scattered more than once. The solved
field knows no camera: with the same `cache` another camera costs a march.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.image.full.refine import mended
from hagoromo.image.full.solved_light import SolvedLight, StoredLight, content_of_light, solved_once
from hagoromo.image.full.walks import WalkThrough, walks_here
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.higher_orders import albedos_of, check_matter, warn_of_few_bands
from hagoromo.image.prepared.lamp_batches import Batch, lamp_batches, under_batches
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache, gamma_rows_of, shadow_casters
from hagoromo.image.prepared.seen_lights import with_seen_lights
from hagoromo.image.scene.origin import scene_from
from hagoromo.image.scene.patch_meshes import patch_meshes
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import palette_of_scene, reflectances_of
from hagoromo.image.scene.settings import Settings, metadata
from hagoromo.image.scene.surface import Same
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cell_size import DEEP_CELL, cell_size, densest_extinction
from hagoromo.transport.field.field import Field
from hagoromo.transport.field.joint import Joint, SurfaceLight
from hagoromo.transport.field.links import LitSurfaces
from hagoromo.transport.field.patches import Patches
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.field.solve import Solver, warn_if_unsettled
from hagoromo.transport.film import Film
from hagoromo.transport.palette import Palette, distinct, position_of
from hagoromo.transport.path.bands import Bands, bands_of
from hagoromo.volume.box import VolumeBox

BANDS_TOLERANCE = 0.01  # of the light of a camera's channel: the field itself is no nearer
MOST_BANDS = 7  # each is nine numbers a cell, and a part of every kernel
MOST_CHANNELS = 8  # bands of all groups of lamps that are solved together
WALKING = 0.2  # share of the time of a picture, as progress counts it
SOLVING = 0.5  # share of the time of a batch, likewise


# Weights (height, width, channels), coverage, and what metadata say, of a scene under one batch of lamps: number of the
# batch, the scene under them, progress.
TraceBatch = Callable[[int, Scene, Progress], tuple[NDArray[np.float32], NDArray[np.float32], dict[str, Any]]]


def full_picture(
    scene: Scene,
    settings: Settings,
    points: NDArray[np.float64],
    cache: SceneCache | None = None,
    progress: Progress = silent,
    trace: TraceBatch | None = None,
    walk: WalkThrough | None = None,
) -> Image:
    """The image of a scene by rays through `points` of every pixel; see `render`.

    trace: who solves and traces, walk: who walks; default: this process. `InputError` for a box whose matter would send
    on more light than it takes.
    """
    cache = cache or SceneCache()
    lit, points_of_light = lit_by_points(scene, settings)
    walks = settings.walks != 0
    image, bands = _solved(lit, settings, points, cache, part_of(progress, 0.0, 1.0 - WALKING * walks), trace)
    if walks:

        def walk_here() -> WalkThrough:
            return walk or walks_here(scene, settings, cache, bands)

        part = part_of(progress, 1.0 - WALKING, WALKING)
        image = mended(image, walk_here, partial(_name_of, scene, settings), settings, part)
    if points_of_light:
        image = with_seen_lights(image, scene, settings, cache, points)
    return replace(image, metadata=image.metadata | metadata(scene, settings) | points_of_light)


def _solved(
    scene: Scene,
    settings: Settings,
    points: NDArray[np.float64],
    cache: SceneCache,
    progress: Progress,
    trace: TraceBatch | None,
) -> tuple[Image, Bands]:
    """The image of a scene under lamps alone as it is solved, and its bands."""
    batches, bands = batches_and_bands(scene, settings)
    warn_of_few_bands(bands)
    traced = trace or partial(_traced, settings, points, bands, cache)

    def under(number: int, lit: Scene, part: Progress) -> Image:
        weights, alpha, record = traced(number, lit, part)
        palette = replace(palette_of_scene(lit, settings), bands=bands.spectra)
        return Image(weights, alpha, palette, metadata(lit, settings) | record)

    return under_batches(scene, batches, settings.separate_lamps, under, progress), bands


def _name_of(scene: Scene, settings: Settings, pixel: int) -> str:
    """Words for the matter of a pixel; none where it shows none."""
    from hagoromo.image.layers import looked_at, names_of_materials  # layers are of any mode

    seen = looked_at(scene, settings)(range(pixel, pixel + 1))[1][0]
    return f", which show {names_of_materials(scene)[int(seen[1:].argmax())]}" if seen[1:].any() else ""


def batches_and_bands(scene: Scene, settings: Settings) -> tuple[list[Batch], Bands]:
    """The lamps of a scene in batches, and bands that all of them have in common.

    `InputError` for a box whose matter would send on more light than it takes.
    """
    for box in scene.boxes:
        check_matter(box)
    bands = bands_of_scene(scene, distinct([lamp.spectrum for lamp in scene.lamps]))
    return batches_of(scene.lamps, bands.count, settings.separate_lamps), bands


def batches_of(lamps: Sequence[Lamp], bands: int, separate: bool) -> list[list[int]]:
    """The lamps in batches of MOST_CHANNELS at most, or of one group each."""
    spectra = [lamp.spectrum for lamp in lamps]
    groups = list(range(len(lamps))) if separate else [position_of(one, distinct(spectra)) for one in spectra]
    each = max(MOST_CHANNELS // bands, 1)
    batches = []
    for first in range(0, max(groups) + 1, each):
        some = [lamp for lamp, group in enumerate(groups) if first <= group < first + each]
        batches += [[some[k] for k in batch] for batch in lamp_batches([lamps[lamp] for lamp in some])]
    return batches


def _traced(
    settings: Settings, points: NDArray[np.float64], bands: Bands, cache: SceneCache, _: int, scene: Scene,
    progress: Progress,
) -> tuple[NDArray[np.float32], NDArray[np.float32], dict[str, Any]]:  # fmt: skip
    """A `TraceBatch` of this process."""
    solved = SolvedScene(scene, settings, bands, cache)
    progress(SOLVING)
    film = Film(solved.prepared.camera, solved.prepared.lighting.channels, 1, solved.prepared.ahead)
    for sample, point in enumerate(points):
        share = (1.0 - SOLVING) / len(points)
        film.add(solved.prepared.camera_radiance, point, part_of(progress, SOLVING + sample * share, share))
    weights, alpha = film.mean()
    return solved.in_groups(weights), alpha, solved.record


class SolvedScene:
    """A scene under one batch of lamps that is ready for rays, with the light of higher orders in it.

    prepared: its `camera_radiance` has that light. record: what metadata say of it.
    """

    def __init__(self, scene: Scene, settings: Settings, bands: Bands, cache: SceneCache) -> None:
        self.prepared, self.bands = PreparedScene(scene, settings, cache, by_camera=False), bands
        field, surface_light = light_of(scene, self.prepared, settings, bands, cache)
        self.prepared.lighting.field, self.prepared.lighting.surface_light = field, surface_light
        self.record: dict[str, Any] = {"mode": "full", "bands_error": bands.error}
        self.record |= {"field": field.record()} if field else {}
        self.record |= {"patches": surface_light.lit.patches.count} if surface_light else {}

    def in_groups(self, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """Channels of the march, as those of a picture."""
        return in_groups(weights, self.prepared.palette, self.bands.count)


def bands_of_scene(scene: Scene, lamps: Sequence[Spectrum]) -> Bands:
    """The bands of a scene; one where all that its matter sends on is the same at every wavelength."""
    colours = albedos_of(scene)
    bands = bands_of(colours, lamps, BANDS_TOLERANCE, MOST_BANDS)
    grey = bool((np.ptp(bands.of(colours), axis=1) == 0.0).all())
    return Bands(bands.wavelengths[:1], 0.0) if grey else bands


def light_of(scene: Scene, prepared: PreparedScene, settings: Settings, bands: Bands, cache: SceneCache) -> SolvedLight:
    """The light of higher orders in a prepared scene, and on its surfaces, solved unless `cache` holds it, or another
    process that shares its folder has solved it.
    """
    lamps = json.dumps([record_from_lamp(lamp) for lamp in scene.lamps], default=float)
    materials = tuple(material for box in scene.boxes for material in box.materials)
    surfaces = tuple((s.figure, s.reflectance, *s.textures, Same(s.uv)) for s in scene.surfaces)
    figures = (
        materials,
        surfaces,
        lamps,
        bands.wavelengths.tobytes(),
        prepared.palette.lamp_groups,
        settings.seed,
        settings.orders,
        prepared.origin.tobytes(),
    )

    def build() -> SolvedLight:
        unsolved = _Unsolved(scene, prepared, settings, bands)
        if cache.shared is None or not cache.shared.used:
            return unsolved.solved()
        digest = content_of_light(scene, prepared, settings, bands)
        return solved_once(cache.shared, digest, unsolved.solved, unsolved.again)

    return cache.get("field", (shadow_casters(scene, settings), figures), build)


class _Unsolved:
    """A prepared scene whose light of higher orders is solved, or made again of what another process solved."""

    def __init__(self, scene: Scene, prepared: PreparedScene, settings: Settings, bands: Bands) -> None:
        self.prepared, self.settings = prepared, settings
        self.colours = BandColours(bands, prepared.palette)
        self.scattering = ScatteringTables(reflectances_of(scene), gamma_rows_of(scene))
        self.channels = len(prepared.palette.lamps) * bands.count
        self.size, self.lit = 0.0, None
        if prepared.medium is not None:
            self.size = cell_size(prepared.medium.boxes, self.channels)
            if settings.walks == 0:
                warn_if_deep(self.size, prepared.medium.boxes)
        if prepared.surfaces is not None:
            patches = Patches(patch_meshes(scene_from(scene, prepared.origin)))
            self.lit = LitSurfaces(
                prepared.surfaces, patches, prepared.lighting, self.colours, self.scattering,
                prepared.first_on_surface, prepared.surface_colours, prepared.thickness,
            )  # fmt: skip

    def solved(self) -> SolvedLight:
        """Its light, solved here."""
        prepared, settings, solver = self.prepared, self.settings, None
        if prepared.medium is not None:
            solver = Solver(prepared.medium, prepared.lighting, self.colours, self.scattering, self.size)
        if self.lit is None:
            assert solver is not None
            solution = solver.solved(settings.seed, settings.orders)
            return SolvedLight(Field.solved(solver, solution, self.colours), None)
        solution, at_surfaces = Joint(solver, self.lit, settings.seed).solved(settings.orders)
        return SolvedLight(Field.solved(solver, solution, self.colours) if solver and solution else None, at_surfaces)

    def again(self, stored: StoredLight) -> SolvedLight:
        """Its light, of what is stored; `InputError` where that is not of this scene."""
        parts = (self.prepared.medium, stored.field), (self.lit, stored.at_surfaces)
        if any((there is None) != (light is None) for there, light in parts):
            raise InputError("stored light is not that of the boxes and surfaces of this scene")
        for part in (stored.field, stored.at_surfaces):
            if part is not None:
                warn_if_unsettled(part.residual, part.sweeps)
        field = Field.of(stored.field, self.scattering, self.colours, self.channels) if stored.field else None
        at_surfaces = SurfaceLight(self.lit, stored.at_surfaces) if self.lit and stored.at_surfaces else None
        return SolvedLight(field, at_surfaces)


def warn_if_deep(size: float, boxes: Sequence[VolumeBox]) -> None:
    """Warn of cells of edge `size` [m] that are many mean free paths deep where matter is densest."""
    depth = size * densest_extinction(boxes)
    if depth > DEEP_CELL:
        warnings.warn(
            f"the matter is {depth:.2g} mean free paths deep in a cell of light: where bright matter has hard faces "
            "the picture may be off by more than 5 %; compare it with mode path",
            stacklevel=3,
        )


def in_groups(weights: NDArray[np.float32], palette: Palette, bands: int) -> NDArray[np.float32]:
    """Channels of the march, (…, colours of every group of lamps, then bands of every one), group after group."""
    groups, colours = len(palette.lamps), len(palette.colours)
    first = weights[..., : groups * colours].reshape(*weights.shape[:-1], groups, colours)
    higher = weights[..., groups * colours :].reshape(*weights.shape[:-1], groups, bands)
    return np.concatenate([first, higher], axis=-1).reshape(*weights.shape[:-1], -1)
