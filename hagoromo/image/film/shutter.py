"""Shutter: a scene that moves while the shutter is open, as one scene of mode path, or as pictures at several times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError, described
from hagoromo.files.record import decode
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.render import picture_of_mode
from hagoromo.image.scene.modes import Mode
from hagoromo.image.scene.motion import Motion, Tables, read_motion
from hagoromo.image.scene.moving import INSTANTS, MovingScene
from hagoromo.image.scene.read_once import read_once
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import SceneBox, scene_from_tables
from hagoromo.image.scene.scene_surface import NOWHERE, Placement, SceneSurface, pose_of
from hagoromo.image.scene.settings import Settings, check_mode, metadata
from hagoromo.progress import Progress, part_of, silent

MOST_TIMES = 1024  # pictures of a mean
UP = (0.0, 0.0, 1.0)


def moving_at(motion: Motion, time: float, tables: Tables, scene: Scene) -> MovingScene | None:
    """How `scene`, which is that of `tables`, moves while the shutter of a picture at `time` [s] is open.

    None where the motion has no shutter. `InputError` for a lamp that moves or changes meanwhile.
    """
    if motion.shutter is None:
        return None
    every = [motion.at(time + part) for part in motion.times(INSTANTS)]
    if any(each.get("lamp") != every[0].get("lamp") for each in every[1:]):
        raise InputError(
            f"{motion.where}: a lamp moves or changes while the shutter is open, and walks draw instants of camera, "
            f"boxes and surfaces: leave its keyframes out, or render the mean of pictures at several times (--times 16)"
        )
    with described(motion.where):
        cameras = np.array([camera_pose(each["camera"], scene) for each in every])
        still = np.reshape(np.array([box.pose for box in scene.boxes]), (1, len(scene.boxes), 4, 4))
        boxes = np.repeat(still, INSTANTS, axis=0)
        for number in motion.boxes:
            boxes[:, number] = _places(every, tables, "box", number, SceneBox, scene.boxes[number].pose)
        surfaces = {
            number: _places(every, tables, "surface", number, SceneSurface, scene.surfaces[number].pose)
            for number in motion.surfaces
        }
    return MovingScene(cameras, boxes, surfaces)


def scene_with_shutter(path: str | Path, motion: Motion, progress: Progress = silent) -> tuple[Scene, Settings]:
    """The scene in a TOML file while the shutter of a picture at time 0 is open, and its settings."""
    path, (first, last) = Path(path), motion.shutter or (0.0, 0.0)
    tables = motion.at(0.5 * (first + last))
    progress(0.0, "loading")
    scene, settings = scene_from_tables(tables, path.parent, path, read_once())
    return replace(scene, moving=moving_at(motion, 0.0, tables, scene)), settings


def mean_over_times(
    path: str | Path, settings: Settings | None, times: int, mode: Mode, progress: Progress = silent
) -> Image:
    """The mean of `times` pictures of the scene in a TOML file, evenly over the time that its shutter is open.

    It is that of a picture of all instants but for steps along what moves by more than `times` pixels. `InputError` for
    a scene without a shutter, and where the spectrum of a lamp changes meanwhile.
    """
    if not 1 <= times <= MOST_TIMES:
        raise InputError(f"the mean of pictures at {times} times: give 1 to {MOST_TIMES}")
    path, motion = Path(path), read_motion(path)
    if motion.shutter is None:
        raise InputError(f"{path} has no shutter: give [motion] shutter_close, and keyframes of what moves")
    read, cache, images = read_once(), SceneCache(), list[Image]()
    for number, time in enumerate(motion.times(times)):
        scene, stated = scene_from_tables(motion.at(time), path.parent, path, read)
        own = settings or stated
        check_mode(own, mode)
        part = part_of(progress, number / times, 1.0 / times, f"time {number + 1} of {times}")
        images.append(picture_of_mode(mode, scene, replace(own, seed=own.seed + number), cache, part))
        if not _alike(images[-1], images[0]):
            raise InputError(f"{path}: the spectrum of a lamp changes while the shutter is open: leave that out")
        record: dict[str, Any] = metadata(scene, own) | {"mode": mode, "times": times}
    noise = [image.variance for image in images if image.variance is not None]
    weights, alpha = _mean([image.weights for image in images]), _mean([image.alpha for image in images])
    variance = np.asarray(_mean(noise) / np.float32(times)) if noise else None
    return Image(weights, alpha, images[0].palette, record, variance)


def _mean(arrays: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.asarray(np.mean(np.stack(arrays), axis=0, dtype=np.float64), np.float32)


def camera_pose(table: Tables, scene: Scene) -> np.ndarray:
    """World to camera (4, 4) of the table [camera] of a scene at a time; scene: that of other tables."""
    if "eye" in table:
        return scene.camera.look_at(table["eye"], table.get("target", NOWHERE), table.get("up", UP)).world_to_camera
    return np.reshape(np.array(table["world_to_camera"], float), (4, 4))


def _places(
    every: Sequence[Tables], tables: Tables, what: str, number: int, kind: type[Placement], pose: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(instants, 4, 4): poses of a box or a surface, whose pose is that of `tables`, in each of `every` tables."""

    def place(of: Tables) -> NDArray[np.float64]:
        return pose_of(decode(of[what][number], kind, f"{what} {number + 1}"), f"{what} {number + 1}")

    own = np.linalg.inv(place(tables)) @ pose
    return np.array([place(each) @ own for each in every])


def _alike(one: Image, other: Image) -> bool:
    spectra = [(*image.palette.colours, *image.palette.lamps) for image in (one, other)]
    return one.weights.shape == other.weights.shape and all(a.equals(b) for a, b in zip(*spectra, strict=True))
