"""Simulate: scene → Capture. The scene's camera photographs it under one lamp after another, noise and all.

The truth lies beside the photographs: the scene's own record, and the point and normal of the surface that the centre
of each pixel meets (0 where it meets none, or matter in a volume box first).
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.image.expose import photograph
from hagoromo.image.prepared.traced_surfaces import Surfaces
from hagoromo.image.render import render
from hagoromo.image.scene.given_scene import scene_and_settings
from hagoromo.image.scene.origin import camera_from, origin_of
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.photograph.capture import BYTES_PER_VALUE, Capture
from hagoromo.progress import Progress, part_of, silent

HIDDEN_SHARE = 1e-3  # share of a pixel's light from volume boxes above which its surface counts as hidden


class VisibleShape(NamedTuple):
    """points (height, width, 3) [m], normals (height, width, 3) unit, world, both 0 where no surface is hit.

    surface: (height, width), index into the scene's surfaces, −1 where no surface is hit.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float32]
    surface: NDArray[np.int64]


def simulate(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    name: str = "",
    progress: Progress = silent,
    percentile: float = 99.5,
) -> Capture:
    """One photograph per lamp of `scene`, by its camera's response and sensor, with the true surface beside them.

    scene: a `Scene`, or the path of a scene TOML, which is then rendered as it states unless `settings` are given.
    `settings.seed` seeds the noise; lamp k takes seed + k. percentile: of the light, what is metered, see `photograph`.
    `InputError` when the camera has no response or sensor, and for area lamps or an environment.
    """
    scene, settings = scene_and_settings(scene, settings)
    if scene.has_wide_lights:
        raise InputError("photographs are simulated under one lamp each: leave area lamps and the environment out")
    if scene.camera.response is None or scene.camera.sensor is None:
        raise InputError(f"camera {scene.camera.name!r} has no response or no sensor: a photograph needs both")
    pixels = float(len(scene.lamps)) * scene.camera.width * scene.camera.height
    require(BYTES_PER_VALUE * len(scene.camera.response.channels) * pixels, f"{len(scene.lamps)} photographs")
    photographs = []
    for k, lamp in enumerate(scene.lamps):
        lit, count = scene.with_lamps(lamp), len(scene.lamps)
        image = render(lit, settings, part_of(progress, k / count, 1.0 / count, f"lamp {k + 1} of {count}"))
        photographs.append(photograph(image, lit, settings.seed + k, lamp.name or f"lamp {k + 1}", percentile))
    shape = visible_shape(scene) if scene.surfaces else None
    points, normals = (None, None) if shape is None else shape[:2]
    stated = {key: value for key, value in asdict(settings).items() if value is not None and key != "seed"}
    stated["percentile"] = percentile
    return Capture(tuple(photographs), name, None, scene.record(), points, normals, stated, settings.seed)


def visible_shape(scene: Scene) -> VisibleShape:
    """The shape of the scene's surfaces, of which there is one at least, as its camera sees it."""
    jit, origin = arrays(), origin_of(scene.surfaces, scene.camera)
    camera = camera_from(scene.camera, origin)
    number = dr.arange(jit.UInt, camera.width * camera.height)
    x, y = jit.Float(number % camera.width) + 0.5, jit.Float(number // camera.width) + 0.5
    begin, direction = camera.rays(x, y)
    surfaces = Surfaces(scene.surfaces, origin)  # must outlive the evaluation of the rays
    distance, _, normal, surface = surfaces.intersect(begin, direction)
    visible = dr.isfinite(distance) & jit.Bool(_in_the_open(scene).ravel())
    point = np.array(begin + direction * dr.select(visible, distance, 0.0), np.float32).T
    point = np.where(np.array(visible)[:, None], point + origin, 0.0)
    normal = dr.select(visible, normal, 0.0)
    size = (camera.height, camera.width)
    return VisibleShape(
        point.reshape(*size, 3),
        np.array(normal, np.float32).T.reshape(*size, 3),
        np.where(np.array(visible), np.array(surface, np.int64), -1).reshape(size),
    )


def _in_the_open(scene: Scene) -> NDArray[np.bool_]:
    """Pixels (height, width) whose light no volume box adds to or takes from."""
    if not scene.boxes:
        return np.ones((scene.camera.height, scene.camera.width), np.bool_)
    boxes_alone = render(replace(scene, surfaces=()), Settings(shadows="none"))
    return boxes_alone.alpha < HIDDEN_SHARE
