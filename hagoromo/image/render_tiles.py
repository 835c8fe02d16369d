"""Tiles of a picture on many workers: each traces runs of rays of a scene file, the pixels are put together here.

A ray's bits follow from the scene and its number alone, so that the picture is the one of a single machine. A worker
keeps the scene that it has made ready until it is asked for another one. The file, and what it names, must lie where
all workers find the same: a worker whose files differ refuses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.cluster.cluster import Cluster, workers_of
from hagoromo.errors import InputError
from hagoromo.files.content import content_with_named
from hagoromo.files.memory import require
from hagoromo.image.image import Image
from hagoromo.image.lamp_batches import Batch, WeightsOfLamps, lamp_batches
from hagoromo.image.lit_by_points import lit_by_points
from hagoromo.image.render import PreparedScene, SceneCache, metadata, pixel_points
from hagoromo.image.scene import Scene
from hagoromo.image.scene_file import camera_and_settings, load_for_picture
from hagoromo.image.seen_lights import SeenLights, camera_sees_lights, with_light
from hagoromo.image.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.film import RAYS_AT_ONCE, TILE, Film, pixels_of, tiled
from hagoromo.transport.palette import Palette

TASKS_PER_WORKER = 8  # of a picture, so that none waits long for the last
SEEN = -1  # stands for a batch: of the lights that the camera sees
FEWEST_RAYS = 1 << 14  # of a task: fewer are traced faster than they are sent


@dataclass(frozen=True)
class SceneOrder:
    """A scene file as a worker is to render it. digest: of the file and what it names."""

    path: str
    digest: str
    settings: Settings


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """What the picture of a scene needs beside its pixels. batches: of its lamps. sees_lights: see `SeenLights`."""

    camera: Camera
    lamps: tuple[Lamp, ...]
    palette: Palette
    metadata: dict[str, Any]
    batches: list[Batch]
    sees_lights: bool


def render_on(
    scheduler: str | int, scene: Scene | str | Path, settings: Settings | None, progress: Progress = silent
) -> Image:
    """`render_tiles` on the workers of `scheduler`, see `workers_of`."""
    if isinstance(scene, Scene):
        raise InputError("a scheduler renders a scene file, which its workers read: give the path of one")
    _, stated = camera_and_settings(scene)
    with workers_of(scheduler) as cluster:
        return render_tiles(scene, settings or stated, cluster, progress)


def render_tiles(scene: str | Path, settings: Settings, cluster: Cluster, progress: Progress = silent) -> Image:
    """The image of the scene in a TOML file, traced by the workers of `cluster`.

    `InputError` for a file that describes no scene, also where a worker finds another file at its path.
    """
    path = Path(scene).absolute()
    order = SceneOrder(str(path), content_with_named(path, quick=True), settings)
    progress(0.0, "scene")
    facts = cluster.run(scene_facts, order)
    size = facts.camera.height, facts.camera.width
    total = WeightsOfLamps(facts.palette, size)
    for number, batch in enumerate(facts.batches):
        of_batch = part_of(progress, number / len(facts.batches), 1.0 / len(facts.batches))
        palette = facts.palette.with_lamps([facts.lamps[lamp] for lamp in batch], settings.separate_lamps)
        values = _traced(order, number, size, palette.channels, cluster, of_batch)
        total.add(batch, palette, values[..., :-1])
    image = Image(total.values, values[..., -1], facts.palette, facts.metadata)
    if not facts.sees_lights:
        return image
    return with_light(image, _traced(order, SEEN, size, len(facts.palette.lamps), cluster, silent)[..., :-1])


def _traced(
    order: SceneOrder, batch: int, size: tuple[int, int], channels: int, cluster: Cluster, progress: Progress
) -> NDArray[np.float32]:
    """Weights and alpha (height, width, channels + 1) of a picture under one batch of lamps."""
    height, width = size
    require(4 * width * height * (channels + 1), "the picture")
    values = np.zeros((height, width, channels + 1), np.float32)
    spans = ray_spans(tiled(width, height), cluster.workers)
    for done, (number, traced) in enumerate(cluster.results(trace, ((order, batch, span) for span in spans)), 1):
        column, row, inside = pixels_of(spans[number], width, height)
        values[row[inside], column[inside]] = traced[inside]
        progress(done / len(spans), "tiles")
    return values


def ray_spans(rays: int, workers: int) -> list[range]:
    """Numbers of all rays in runs: whole tiles, TASKS_PER_WORKER or more a worker, no longer than one launch."""
    whole = TILE[0] * TILE[1]
    size = min(max(-(-rays // (TASKS_PER_WORKER * max(workers, 1))), FEWEST_RAYS), RAYS_AT_ONCE)
    size = -(-size // whole) * whole
    return [range(first, min(first + size, rays)) for first in range(0, rays, size)]


def scene_facts(order: SceneOrder) -> SceneFacts:
    """On a worker: what the picture needs of a scene."""
    scene, prepared = _ready(order, 0)
    palette = prepared.palette.with_lamps(scene.lamps, order.settings.separate_lamps)
    batches, seen = lamp_batches(scene.lamps), camera_sees_lights(_held[order].scene)
    return SceneFacts(scene.camera, scene.lamps, palette, metadata(scene, order.settings), batches, seen)


def trace(order: SceneOrder, batch: int, rays: range) -> NDArray[np.float32]:
    """On a worker: means over the samples of weights and alpha along rays of a scene, (rays, channels + 1).

    batch: number of the batch of its lamps; SEEN: of the lights that the camera sees themselves.
    """
    _, prepared = _ready(order, max(batch, 0))
    film, radiance = Film(prepared.camera, prepared.channels, ahead=prepared.ahead, rays=rays), prepared.camera_radiance
    if batch == SEEN:
        lights = SeenLights(_held[order].scene, order.settings, _held[order].cache, rays=rays)
        film, radiance = lights.film, lights.radiance
    for point in pixel_points(order.settings.samples, order.settings.seed):
        film.add(radiance, point)
    weights, alpha = film.mean()
    return np.concatenate([weights, alpha[:, None]], axis=1)


class Held(NamedTuple):
    """A scene that a worker has read, the same under lamps only, and what of it is on the device."""

    scene: Scene
    lit: Scene
    cache: SceneCache


_held: dict[SceneOrder, Held] = {}  # the scene that this worker has read
_lit: dict[int, PreparedScene] = {}  # under the batch of its lamps for which it is ready


def _ready(order: SceneOrder, batch: int) -> tuple[Scene, PreparedScene]:
    if order not in _held:
        _lit.clear()  # before another one takes memory
        _held.clear()
        if content_with_named(order.path, quick=True) != order.digest:
            raise InputError(
                f"{order.path}, or a file that it names, is another one on a worker: put them where all find the same"
            )
        read = load_for_picture(order.path, order.settings)[0]
        _held[order] = Held(read, lit_by_points(read, order.settings)[0], SceneCache())
    _, scene, cache = _held[order]
    if batch not in _lit:
        _lit.clear()
        lamps = lamp_batches(scene.lamps)[batch]
        _lit[batch] = PreparedScene(scene.with_lamps(*(scene.lamps[lamp] for lamp in lamps)), order.settings, cache)
    return scene, _lit[batch]
