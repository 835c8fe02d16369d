"""Pictures of all orders of light: walks through every pixel, their mean and its variance.

Enters: a scene. Leaves: an `Image` whose palette has bands for light that was scattered more than once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.image.path.unfinished import RenderInterrupted, sums_of, with_sums
from hagoromo.image.path.walk_sums import PixelSums, Stop, WalkSums
from hagoromo.image.path.walked import Spans, Walked
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.higher_orders import albedos_of, check_matter, warn_of_few_bands
from hagoromo.image.prepared.lamp_batches import Batch, lamp_batches, under_batches
from hagoromo.image.prepared.nesting import Glass
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache, gamma_rows_of
from hagoromo.image.scene.moving import MovingCamera, instants
from hagoromo.image.scene.origin import scene_from
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import grouped_lights, palette_of_scene, reflectances_of
from hagoromo.image.scene.settings import Settings, metadata
from hagoromo.light.spectrum import Spectrum
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.palette import distinct
from hagoromo.transport.path.bands import Bands, bands_of
from hagoromo.transport.path.free_flight import Matter
from hagoromo.transport.path.lights import Lights
from hagoromo.transport.path.optics import Optics
from hagoromo.transport.path.path import Queue, Walks, light_of_walks, random_numbers
from hagoromo.transport.path.scatter import Scattering

WALKS_AT_ONCE = 1 << 18  # of one launch; progress is reported, and an interrupt taken, between launches
ON_GPU = 1 << 22  # the same on a GPU, which walks as many in a tenth of a second, or as bring NUMBERS
NUMBERS = 1 << 26  # 256 MiB
ALL_ORDERS = 1 << 16  # events after which a walk ends
FIRST_LOOK = 64  # walks that are tried before all others
ENDLESS = 0.5  # share of walks with ALL_ORDERS events above which a picture is refused
NO_SAMPLE = (1 << 32) - 1  # number of no walk: its random numbers are of the pixel
LONG = 64.0  # events of a walk above which fewer are launched at once


# Walks until all that a picture wants are in its sums: number of the batch of lamps, the scene under them, the sums,
# the share of the time that the picture may take, progress.
WalkBatch = Callable[[int, Scene, WalkSums, float, Progress], None]


def path_picture(
    scene: Scene,
    settings: Settings,
    progress: Progress = silent,
    unfinished: Image | None = None,
    cache: SceneCache | None = None,
    walk: WalkBatch | None = None,
) -> Image:
    """The image of a scene by `settings.samples` walks through each pixel; see `render`.

    unfinished: of an interrupted run, to go on from. walk: who walks; default: this process. `InputError` for a box
    whose matter would send on more light than it takes, and for light that never leaves nor is absorbed. An interrupt
    raises `RenderInterrupted`.
    """
    batches, bands = batches_and_bands(scene)
    warn_of_few_bands(bands)
    walk = walk or partial(_walk, settings, cache or SceneCache(), bands)
    lit, white = [scene.under(batch) for batch in batches], scene.lights[0].spectrum
    sums = [_sums(each, settings, bands, white) for each in lit]
    if unfinished is not None:
        sums_of(unfinished, metadata(scene, settings), sums)

    def picture(number: int, part: Scene, _: Progress) -> Image:
        own = sums[number]
        walks = float(own.walks.mean())
        record = {"mode": "path", "bands_error": bands.error, "walks": int(walks) if walks.is_integer() else walks}
        record |= {"noise": own.error()} if own.variance() is not None and len(lit) == 1 else {}
        return Image(*own.mean(), own.palette, metadata(part, settings) | record, own.variance())

    try:
        for number, part in enumerate(lit):
            of_batch = part_of(progress, number / len(batches), 1.0 / len(batches))
            walk(number, part, sums[number], 1.0 / len(batches), of_batch)
    except KeyboardInterrupt as interrupt:
        if not any(own.walks.any() for own in sums):
            raise
        image = under_batches(scene, batches, settings.separate_lamps, picture)
        raise RenderInterrupted(with_sums(image, sums)) from interrupt
    return under_batches(scene, batches, settings.separate_lamps, picture)


def batches_and_bands(scene: Scene) -> tuple[list[Batch], Bands]:
    """The lights of a scene in batches, as numbers of `Scene.lights`, and bands that all of them have in common.

    `InputError` for a box whose matter would send on more light than it takes.
    """
    for box in scene.boxes:
        check_matter(box)
    batches = lamp_batches(scene.lamps)
    batches[0] += range(len(scene.lamps), len(scene.lights))
    return batches, bands_of(albedos_of(scene), distinct([light.spectrum for light in scene.lights]))


def _sums(scene: Scene, settings: Settings, bands: Bands, white: Spectrum) -> WalkSums:
    """No walks yet. white: the lamp that Y is counted from."""
    palette = replace(palette_of_scene(scene, settings), bands=bands.spectra)
    return WalkSums(scene.camera.height, scene.camera.width, palette, white)


def _walk(
    settings: Settings,
    cache: SceneCache,
    bands: Bands,
    number: int,
    scene: Scene,
    sums: WalkSums,
    share: float,
    progress: Progress,
) -> None:
    """A `WalkBatch` of this process."""
    stream = WalkStream(scene, settings, cache, bands, number)
    stop, at_once = Stop(settings, share), walks_at_once(stream, sums.pixels)
    while stop.goes_on(sums):
        for pixels, counts in sums.launches(at_once):
            stream.add(sums, pixels, pixels, counts)
            progress(stop.progress(sums))


def walks_of(scene: Scene, prepared: PreparedScene, bands: Bands) -> Walks:
    """A prepared scene as walks need it."""
    reflectances, rows = reflectances_of(scene), gamma_rows_of(scene)
    scattering = Scattering(reflectances, prepared.lighting.materials, rows)
    matter = Matter(prepared.medium) if prepared.medium is not None else None
    first, lights = prepared.first_on_surface, lights_of(scene, prepared, rows)
    optics = optics_of(scene, prepared, bands)
    colours, thickness = prepared.surface_colours, prepared.thickness
    return Walks(
        matter, prepared.surfaces, first, prepared.lighting, scattering, bands, lights, optics, colours, thickness
    )


def optics_of(scene: Scene, prepared: PreparedScene, bands: Bands) -> Optics | None:
    """The mirrors and glasses of a scene for walks; None without. `InputError` for a lamp or camera within glass."""
    if prepared.surfaces is None or not any(surface.optics for surface in scene.surfaces):
        return None
    glass = Glass(scene.surfaces, prepared.origin)
    things = [("the camera", scene.camera.position)]
    lights = (*scene.lamps, *scene.wide_lights)
    things += [(f"lamp {light.name!r}", place) for light in lights for place in light.stands_at]
    for (what, _), holding in zip(things, glass.holding(np.array([place for _, place in things])), strict=True):
        if holding is not None:
            raise InputError(f"{what} stands within the glass of surface {holding.name!r}: move it out")
    others = sum(len(box.materials) for box in scene.boxes)
    kinds = [""] * others + [surface.optics for surface in scene.surfaces]
    around = np.zeros(len(kinds), np.uint32)
    for one, outer in glass.around.items():
        around[others + one] = 0 if outer is None else 1 + others + outer
    absorption = None
    if any(surface.absorption is not None for surface in scene.surfaces):
        absorption = np.zeros((len(kinds), bands.count))
        for number, surface in enumerate(scene.surfaces):
            if surface.absorption is not None:
                absorption[others + number] = surface.absorption.at(bands.wavelengths)
    return Optics(kinds, prepared.lighting.materials, prepared.surfaces.shadow_bias, around, absorption)


def lights_of(scene: Scene, prepared: PreparedScene, rows: GammaRows | None) -> Lights | None:
    """The lights of a scene for walks; None where it has none but lamps."""
    placed = grouped_lights(scene_from(scene, prepared.origin), prepared.palette)
    if not placed:
        return None
    wide = [(light.on_device(), groups) for light, groups in placed]
    return Lights(prepared.lighting.lamps, wide, reflectances_of(scene), rows)


def walks_at_once(stream: WalkStream, pixels: int) -> int:
    """Walks of one launch: fewer where they are long. `InputError` where they have no end."""
    some = np.unique(np.linspace(0, pixels - 1, FIRST_LOOK).astype(np.int64))
    events = np.array(stream.walk(some, np.zeros(len(some)), np.ones(len(some), np.int64)).events)
    if stream.settings.orders is None and (events >= ALL_ORDERS).mean() > ENDLESS:
        raise InputError(
            f"light has no end here: most walks were scattered {ALL_ORDERS} times, so that no number of them gives a "
            "picture; open the space that encloses the light, lower its albedos, or give orders"
        )
    most = launch_size(stream.walks.channels)
    return max(int(most * min(LONG / max(float(events.mean()), 1e-9), 1.0)), min(most, FIRST_LOOK))


def launch_size(channels: int) -> int:
    """Walks of one launch at most; channels: numbers that a walk brings."""
    if dr.backend_v(arrays().Float) == dr.JitBackend.LLVM:
        return WALKS_AT_ONCE
    return max(min(NUMBERS // channels, ON_GPU), WALKS_AT_ONCE)


class WalkStream:
    """Walks through pixels of the camera's picture of a scene, which is made ready for it.

    number: of the batch of its lamps: each has random numbers of its own.
    """

    def __init__(self, scene: Scene, settings: Settings, cache: SceneCache, bands: Bands, number: int) -> None:
        self.prepared = PreparedScene(scene, replace(settings, shadows="none"), cache, together=False)
        self.walks, self.settings, self.batch = walks_of(scene, self.prepared, bands), settings, number
        moving = scene.moving and scene.moving.moved(-self.prepared.origin)
        self.moving = MovingCamera(moving, self.prepared.ahead) if moving else None

    def add(
        self, sums: PixelSums, rows: NDArray[np.int64], pixels: NDArray[np.int64], counts: NDArray[np.int64]
    ) -> None:
        """Add the next walks through some pixels, `counts` of each, to their rows in `sums`."""
        walks = self.walk(pixels, sums.walks[rows], counts)
        covered = dr.select(walks.events > 0, arrays().Float(1), 0.0)
        sums.add(rows, Walked(walks.light, covered), counts)

    def walk(self, pixels: NDArray[np.int64], samples: NDArray[np.float64], counts: NDArray[np.int64]) -> Queue:
        """Walks through some pixels, `counts` of each, pixel after pixel, from number `samples` on."""
        jit, camera = arrays(), self.prepared.camera
        width, (place, number) = dr.opaque(jit.UInt, camera.width), Spans(counts).pixels()
        pixel = dr.gather(jit.UInt, lookup(jit.UInt, pixels.astype(np.uint32)), place)
        sample = dr.gather(jit.UInt, lookup(jit.UInt, samples.astype(np.uint32)), place) + number
        random = random_numbers(pixel, sample, self.settings.seed + (self.batch << 32))
        x = jit.Float(pixel % width) + random.next_float32()
        y = jit.Float(pixel // width) + random.next_float32()
        lens = (random.next_float32(), random.next_float32()) if camera.aperture > 0.0 else None
        instant = axes = None
        if self.moving is not None:
            start = random_numbers(pixel, dr.opaque(jit.UInt, NO_SAMPLE), self.settings.seed).next_float32()
            instant = instants(sample, start, self.moving.count)
            axes = self.moving.axes(instant)
        origin, direction = camera.rays(x, y, self.prepared.ahead, lens, axes)
        most = dr.opaque(jit.UInt, self.settings.orders or ALL_ORDERS)
        walks = light_of_walks(self.walks, origin, direction, random, most, instant)
        dr.eval(walks.light, walks.events)
        return walks
