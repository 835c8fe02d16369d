"""Walks on many workers: each walks through some pixels, what they bring is put together here.

Sums are in the order of the walks of a pixel, and a walk follows from the scene, its pixel and its number: the picture
has the bits of a single machine. When to stop is decided here, by the sums of all pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.cluster.cluster import Cluster
from hagoromo.image.full.picture import batches_and_bands as bands_of_full
from hagoromo.image.full.walks import LampWalks, WalkThrough, in_channels, lamps_in_batches
from hagoromo.image.path.picture import WalkStream, batches_and_bands, walks_at_once
from hagoromo.image.path.walk_sums import PixelSums, Stop, WalkSums
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene_on_worker import HeldScene, SceneOrder, held_scene, task_size
from hagoromo.progress import Progress
from hagoromo.transport.palette import Palette

PIXELS = 1 << 10, 1 << 16  # of a task, at least and at most
Array = NDArray[np.float64]


def walk_on(
    order: SceneOrder, cluster: Cluster, number: int, _: Scene, sums: WalkSums, share: float, progress: Progress
) -> None:
    """A `WalkBatch` of workers. An interrupt keeps the walks of all tasks that are done."""
    stop = Stop(order.settings, share)
    while stop.goes_on(sums):
        lacking = sums.lacking()
        size = task_size(lacking.size, cluster.workers, *PIXELS)
        parts = [lacking[first : first + size] for first in range(0, lacking.size, size)]
        tasks = ((order, number, part, sums.table[part], sums.luminance) for part in parts)
        for done, rows in cluster.results(walked, tasks):
            sums.table[parts[done]] = rows
            progress(stop.progress(sums))


def walked(order: SceneOrder, batch: int, pixels: NDArray[np.int64], rows: Array, luminance: Array) -> Array:
    """On a worker: the rows of some pixels with all the walks that are wanted, see `PixelSums`."""
    held = held_scene(order)
    stream, at_once = held.ready(("path", batch), lambda: _stream(held, batch))
    sums = PixelSums(rows.copy(), luminance)
    for some, counts in sums.launches(at_once):
        stream.add(sums, some, pixels[some], counts)
    return sums.table


def _stream(held: HeldScene, batch: int) -> tuple[WalkStream, int]:
    """Walks under a batch of lamps, and how many there are of one launch."""
    batches, bands = batches_and_bands(held.scene)
    stream = WalkStream(held.scene.under(batches[batch]), held.order.settings, held.cache, bands, batch)
    return stream, walks_at_once(stream, held.scene.camera.width * held.scene.camera.height)


def walks_on(order: SceneOrder, cluster: Cluster, scene: Scene) -> WalkThrough:
    """Walks of workers through the pixels of a picture of mode full."""

    def through(pixels: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.float32]:
        size = task_size(pixels.size, cluster.workers, *PIXELS)
        spans = [slice(first, first + size) for first in range(0, pixels.size, size)]
        parts = []
        for batch in range(len(lamps_in_batches(scene))):
            tasks = ((order, batch, pixels[span], numbers[span]) for span in spans)
            found = dict(cluster.results(brought, tasks))
            parts.append((found[0][0], np.concatenate([found[k][1] for k in range(len(spans))])))
        return in_channels(scene, order.settings, parts)

    return through


def brought(
    order: SceneOrder, batch: int, pixels: NDArray[np.int64], numbers: NDArray[np.int64]
) -> tuple[Palette, NDArray[np.float32]]:
    """On a worker: what walks through pixels bring under a batch of lamps, see `LampWalks`."""
    held, settings = held_scene(order), order.settings

    def make() -> LampWalks:
        bands = bands_of_full(held.lit_by_points[0], settings)[1]
        under = held.scene.under(lamps_in_batches(held.scene)[batch])
        return LampWalks(under, settings, held.cache, bands, batch)

    walks = held.ready(("full walks", batch), make)
    return walks.palette, walks.light(pixels, numbers)
