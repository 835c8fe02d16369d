"""Walks of mode path on many workers: each walks through some pixels, their sums are put together here.

Sums are in the order of the walks of a pixel, and a walk follows from the scene, its pixel and its number: the picture
has the bits of a single machine. When to stop is decided here, by the sums of all pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.cluster.cluster import Cluster
from hagoromo.image.path_picture import WalkStream, batches_and_bands, walks_at_once
from hagoromo.image.scene import Scene
from hagoromo.image.scene_on_worker import HeldScene, SceneOrder, held_scene, task_size
from hagoromo.image.walk_sums import PixelSums, Stop, WalkSums
from hagoromo.progress import Progress

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
