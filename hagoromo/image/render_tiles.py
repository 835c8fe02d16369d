"""Tiles of a picture on many workers: each traces runs of rays of a scene file, the pixels are put together here.

A ray's bits follow from the scene and its number alone, so that the picture is the one of a single machine. So do
those of a walk of mode path, see `walk_tiles`. In mode full the first worker that needs the light of higher orders
solves it, and the others read it, see `solved_light`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.cluster.cluster import Cluster, workers_of
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.image.full.picture import SolvedScene, batches_and_bands, full_picture
from hagoromo.image.layers import PIXELS_AT_ONCE, Looked, looked_at, with_layers
from hagoromo.image.path.picture import path_picture
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import Batch, WeightsOfLamps, lamp_batches
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.image.prepared.seen_lights import SeenLights, camera_sees_lights, with_light
from hagoromo.image.scene.modes import Mode
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import camera_and_settings, load_scene
from hagoromo.image.scene.settings import Settings, metadata
from hagoromo.image.scene_on_worker import HeldScene, SceneOrder, held_scene, task_size
from hagoromo.image.walk_tiles import walk_on, walks_on
from hagoromo.light.lamp import Lamp
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.film import RAYS_AT_ONCE, TILE, Film, pixel_points, pixels_of, tiled
from hagoromo.transport.palette import Palette

SEEN = -1  # stands for a batch: of the lights that the camera sees
FEWEST_RAYS = 1 << 14  # of a task: fewer are traced faster than they are sent
Array = NDArray[np.float32]


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
    scheduler: str | int,
    scene: Scene | str | Path,
    settings: Settings | None,
    progress: Progress = silent,
    mode: Mode = "march",
    unfinished: Image | None = None,
    layers: bool = False,
) -> Image:
    """`render_tiles` on the workers of `scheduler`, see `workers_of`."""
    if isinstance(scene, Scene):
        raise InputError("a scheduler renders a scene file, which its workers read: give the path of one")
    _, stated = camera_and_settings(scene)
    with workers_of(scheduler) as cluster:
        return render_tiles(scene, settings or stated, cluster, progress, mode, unfinished, layers)


def render_tiles(
    scene: str | Path,
    settings: Settings,
    cluster: Cluster,
    progress: Progress = silent,
    mode: Mode = "march",
    unfinished: Image | None = None,
    layers: bool = False,
) -> Image:
    """The image of the scene in a TOML file, by the workers of `cluster`; see `render`.

    `InputError` for a file that describes no scene, also where a worker finds another file at its path.
    """
    order = SceneOrder.of(scene, settings, mode)
    progress(0.0, "scene")
    if mode == "march" and not layers:
        return _march_on(order, cluster, progress)
    read = load_scene(order.path)[0] if mode == "march" else order.scene()
    if mode == "path":
        image = path_picture(read, settings, progress, unfinished, walk=partial(walk_on, order, cluster))
    elif mode == "full":
        points = pixel_points(settings.samples, settings.seed)
        trace, walk = partial(_solve_and_trace, order, cluster), walks_on(order, cluster, read)
        image = full_picture(read, settings, points, progress=progress, trace=trace, walk=walk)
    else:
        image = _march_on(order, cluster, progress)
    return with_layers(image, read, settings, partial(_look_on, order, cluster)) if layers else image


def _march_on(order: SceneOrder, cluster: Cluster, progress: Progress) -> Image:
    facts = cluster.run(scene_facts, order)
    size = facts.camera.height, facts.camera.width
    total = WeightsOfLamps(facts.palette, size)
    for number, batch in enumerate(facts.batches):
        of_batch = part_of(progress, number / len(facts.batches), 1.0 / len(facts.batches))
        palette = facts.palette.with_lamps([facts.lamps[lamp] for lamp in batch], order.settings.separate_lamps)
        values = _traced(order, number, size, cluster, of_batch)
        total.add(batch, palette, values[..., :-1])
    image = Image(total.values, values[..., -1], facts.palette, facts.metadata)
    if not facts.sees_lights:
        return image
    return with_light(image, _traced(order, SEEN, size, cluster, silent)[..., :-1])


def _solve_and_trace(
    order: SceneOrder, cluster: Cluster, number: int, scene: Scene, progress: Progress
) -> tuple[Array, Array, dict[str, Any]]:
    """A `TraceBatch` of mode full on workers."""
    size = scene.camera.height, scene.camera.width
    values = _traced(order, number, size, cluster, progress)
    return values[..., :-1], values[..., -1], cluster.run(solved_record, order, number)


def _traced(order: SceneOrder, batch: int, size: tuple[int, int], cluster: Cluster, progress: Progress) -> Array:
    """Weights and alpha (height, width, channels + 1) of a picture under one batch of lamps."""
    (height, width), values = size, np.zeros((0, 0, 0), np.float32)
    spans = ray_spans(tiled(width, height), cluster.workers)
    for done, (number, traced) in enumerate(cluster.results(trace, ((order, batch, span) for span in spans)), 1):
        if done == 1:
            require(4 * width * height * traced.shape[1], "the picture")
            values = np.zeros((height, width, traced.shape[1]), np.float32)
        column, row, inside = pixels_of(spans[number], width, height)
        values[row[inside], column[inside]] = traced[inside]
        progress(done / len(spans), "tiles")
    return values


def _look_on(order: SceneOrder, cluster: Cluster, pixels: int) -> list[Looked]:
    """A `LookAt` of workers."""
    size = task_size(pixels, cluster.workers, FEWEST_RAYS, PIXELS_AT_ONCE)
    spans = [range(first, min(first + size, pixels)) for first in range(0, pixels, size)]
    found = dict(cluster.results(look, ((order, span) for span in spans)))
    return [found[number] for number in range(len(spans))]


def ray_spans(rays: int, workers: int) -> list[range]:
    """Numbers of all rays in runs: whole tiles, TASKS_PER_WORKER or more a worker, no longer than one launch."""
    whole = TILE[0] * TILE[1]
    size = -(-task_size(rays, workers, FEWEST_RAYS, RAYS_AT_ONCE) // whole) * whole
    return [range(first, min(first + size, rays)) for first in range(0, rays, size)]


def scene_facts(order: SceneOrder) -> SceneFacts:
    """On a worker: what the picture of the march needs of a scene."""
    held = held_scene(order)
    lit, points = held.lit_by_points
    palette = _marched(held, 0).palette.with_lamps(lit.lamps, order.settings.separate_lamps)
    batches, seen = lamp_batches(lit.lamps), camera_sees_lights(held.scene)
    record = metadata(held.scene, order.settings) | points
    return SceneFacts(lit.camera, lit.lamps, palette, record, batches, seen)


def trace(order: SceneOrder, batch: int, rays: range) -> Array:
    """On a worker: means over the samples of weights and alpha along rays of a scene, (rays, channels + 1).

    batch: number of the batch of its lamps; SEEN: of the lights that the camera sees themselves.
    """
    held = held_scene(order)
    if batch == SEEN:
        lights = SeenLights(held.scene, order.settings, held.cache, rays=rays)
        return _means(order, lights.film, lights.radiance)
    if order.mode == "full":
        solved = _solved(held, batch)
        prepared, in_groups = solved.prepared, solved.in_groups
    else:
        prepared, in_groups = _marched(held, batch), np.asarray
    film = Film(prepared.camera, prepared.lighting.channels, ahead=prepared.ahead, rays=rays)
    means = _means(order, film, prepared.camera_radiance)
    return np.concatenate([in_groups(means[:, :-1]), means[:, -1:]], axis=1)


def _means(order: SceneOrder, film: Film, radiance: Callable[..., Any]) -> Array:
    for point in pixel_points(order.settings.samples, order.settings.seed):
        film.add(radiance, point)
    weights, alpha = film.mean()
    return np.concatenate([weights, alpha[:, None]], axis=1)


def solved_record(order: SceneOrder, batch: int) -> dict[str, Any]:
    """On a worker: what metadata say of the light of higher orders under a batch of lamps."""
    return _solved(held_scene(order), batch).record


def look(order: SceneOrder, pixels: range) -> Looked:
    """On a worker: sums for the layers of some pixels."""
    held = held_scene(order)
    return held.ready("layers", lambda: looked_at(held.scene, order.settings))(pixels)


def _marched(held: HeldScene, batch: int) -> PreparedScene:
    def make() -> PreparedScene:
        lit, _ = held.lit_by_points
        return PreparedScene(_under(lit, lamp_batches(lit.lamps), batch), held.order.settings, held.cache)

    return held.ready(("march", batch), make)


def _solved(held: HeldScene, batch: int) -> SolvedScene:
    def make() -> SolvedScene:
        settings, (lit, _) = held.order.settings, held.lit_by_points
        batches, bands = batches_and_bands(lit, settings)
        return SolvedScene(_under(lit, batches, batch), settings, bands, held.cache)

    return held.ready(("full", batch), make)


def _under(lit: Scene, batches: Sequence[Batch], batch: int) -> Scene:
    return lit.with_lamps(*(lit.lamps[lamp] for lamp in batches[batch]))
