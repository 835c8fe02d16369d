"""Pictures of light that is scattered once, without noise: camera rays march to the first surface (MODEL §3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import lamp_batches, under_batches
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.prepared.seen_lights import with_seen_lights
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings, metadata
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.film import Film
from hagoromo.transport.film import tile_order as tile_order


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
