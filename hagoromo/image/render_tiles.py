"""Tiles of a picture on many workers: each traces runs of rays of a scene file, the pixels are put together here.

A ray's bits follow from the scene and its number alone, so that the picture is the one of a single machine. A worker
keeps the scene that it has made ready until it is asked for another one. The file, and what it names, must lie where
all workers find the same: a worker whose files differ refuses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.cluster.cluster import Cluster, workers_of
from hagoromo.errors import InputError
from hagoromo.files.content import content_with_named
from hagoromo.files.memory import require
from hagoromo.image.image import Image
from hagoromo.image.render import PreparedScene, metadata, pixel_points
from hagoromo.image.scene import Scene
from hagoromo.image.scene_file import camera_and_settings, load_scene
from hagoromo.image.settings import Settings
from hagoromo.progress import Progress, silent
from hagoromo.transport.film import RAYS_AT_ONCE, TILE, Film, pixels_of, tiled
from hagoromo.transport.lighting import Palette

TASKS_PER_WORKER = 8  # of a picture, so that none waits long for the last
FEWEST_RAYS = 1 << 14  # of a task: fewer are traced faster than they are sent


@dataclass(frozen=True)
class SceneOrder:
    """A scene file as a worker is to render it. digest: of the file and what it names."""

    path: str
    digest: str
    settings: Settings


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """What the picture of a scene needs beside its pixels."""

    camera: Camera
    palette: Palette
    metadata: dict[str, Any]


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
    camera, channels = facts.camera, facts.palette.channels
    require(4 * camera.width * camera.height * (channels + 1), "the picture")
    values = np.zeros((camera.height, camera.width, channels + 1), np.float32)
    spans = ray_spans(tiled(camera.width, camera.height), cluster.workers)
    for done, (number, traced) in enumerate(cluster.results(trace, ((order, span) for span in spans)), 1):
        column, row, inside = pixels_of(spans[number], camera.width, camera.height)
        values[row[inside], column[inside]] = traced[inside]
        progress(done / len(spans), "tiles")
    return Image(values[..., :-1], values[..., -1], facts.palette, facts.metadata)


def ray_spans(rays: int, workers: int) -> list[range]:
    """Numbers of all rays in runs: whole tiles, TASKS_PER_WORKER or more a worker, no longer than one launch."""
    whole = TILE[0] * TILE[1]
    size = min(max(-(-rays // (TASKS_PER_WORKER * max(workers, 1))), FEWEST_RAYS), RAYS_AT_ONCE)
    size = -(-size // whole) * whole
    return [range(first, min(first + size, rays)) for first in range(0, rays, size)]


def scene_facts(order: SceneOrder) -> SceneFacts:
    """On a worker: what the picture needs of a scene."""
    return _ready(order)[1]


def trace(order: SceneOrder, rays: range) -> NDArray[np.float32]:
    """On a worker: means over the samples of weights and alpha along rays of a scene, (rays, channels + 1)."""
    prepared, _ = _ready(order)
    film = Film(prepared.camera, prepared.channels, ahead=prepared.ahead, rays=rays)
    for point in pixel_points(order.settings.samples, order.settings.seed):
        film.add(prepared.camera_radiance, point)
    weights, alpha = film.mean()
    return np.concatenate([weights, alpha[:, None]], axis=1)


_held: dict[SceneOrder, tuple[PreparedScene, SceneFacts]] = {}  # the scene that this worker has made ready


def _ready(order: SceneOrder) -> tuple[PreparedScene, SceneFacts]:
    if order not in _held:
        _held.clear()  # before another one takes memory
        if content_with_named(order.path, quick=True) != order.digest:
            raise InputError(
                f"{order.path}, or a file that it names, is another one on a worker: put them where all find the same"
            )
        scene, _ = load_scene(order.path)
        prepared = PreparedScene(scene, order.settings)
        _held[order] = prepared, SceneFacts(scene.camera, prepared.palette, metadata(scene, order.settings))
    return _held[order]
