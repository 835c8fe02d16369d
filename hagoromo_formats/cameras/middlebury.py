"""Cameras in the `_par.txt` of Middlebury's multi-view sets: per image a line of name, K (9), R (9), t (3).

K and [R t] (world to camera, OpenCV's axes, metres) are row by row. The set does not say where in a pixel it counts
from; as the users of its files do, we take the centre of the first pixel, as OpenCV.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import pose_of, rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes
from hagoromo.files.format import start_of
from hagoromo.files.picture import picture_size
from hagoromo.files.whole import write_text

NUMBERS_PER_VIEW = 21
COUNT_LINE = re.compile(rb"\d+[ \t]*\r?(\n|$)")  # how files begin
GROWTH = 40.0  # memory of the words of a file, in its sizes
MIDDLEBURY_POSE_TOLERANCE = 1e-5  # largest entry of R Rᵀ − I: the sets are written with 12 digits or more
HALF = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])  # centre of the first pixel


def is_middlebury(path: Path) -> bool:
    """Whether a file begins with the number of its images."""
    if path.is_dir() or path.suffix.lower() not in ("", ".txt"):
        return False
    return COUNT_LINE.match(start_of(path).lstrip()) is not None


def read_middlebury(path: str | Path, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Views, image file → camera.

    size: (width, height) [px] of the images; None takes it from the first of them that lies beside the file, as the
    format does not state it. `InputError` for damage, a skewed K, or a size that nothing states.
    """
    try:
        lines = read_bytes(path, GROWTH).decode("utf-8").split("\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text: {error}") from error
    rows = [line.split() for line in lines if line.strip()]
    if not rows or len(rows[0]) != 1 or rows[0][0] != str(len(rows) - 1):
        raise InputError(f"{path} does not begin with the number of its {max(len(rows) - 1, 0)} other lines")
    if size is None:
        height, width = picture_size(_first_image(Path(path), [row[0] for row in rows[1:]]))
        size = (width, height)
    views: dict[str, Camera] = {}
    for words in rows[1:]:
        if words[0] in views:
            raise InputError(f"{path} lists {words[0]} twice: keep one")
        views[words[0]] = _camera(words, size, f"{path} image {words[0]}")
    return views


def write_middlebury(path: str | Path, views: Mapping[str, Camera]) -> None:
    """Write views so that `read_middlebury` gives them back; `InputError` for distortion or a name with spaces."""
    lines = [str(len(views))]
    for name, camera in views.items():
        if any(camera.distortion):
            raise InputError(f"{name} has a distorted lens, which a _par.txt does not hold: undistort its images first")
        if not name or name.split() != [name]:
            raise InputError(f"a _par.txt does not hold the name {name!r}: rename the image")
        (ax, ay), (x0, y0) = camera.focal, camera.principal
        k = np.array([[ax, 0.0, x0], [0.0, ay, y0], [0.0, 0.0, 1.0]]) - HALF
        pose = camera.world_to_camera
        numbers = [*k.ravel(), *pose[:3, :3].ravel(), *pose[:3, 3]]
        lines.append(" ".join([name, *(f"{number:.17g}" for number in numbers)]))
    write_text(path, "\n".join(lines) + "\n")


def _camera(words: list[str], size: tuple[int, int], where: str) -> Camera:
    try:
        numbers = np.array([float(word) for word in words[1:]])
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
    if numbers.size != NUMBERS_PER_VIEW or not np.isfinite(numbers).all():
        raise InputError(f"{where} has {numbers.size} numbers: K, R and t are {NUMBERS_PER_VIEW} finite ones")
    k, pose = numbers[:9].reshape(3, 3), pose_of(numbers[9:18].reshape(3, 3), numbers[18:])
    if k[0, 1] or k[1, 0] or (k[2] != (0.0, 0.0, 1.0)).any():
        raise InputError(f"{where} has a skewed K: only one with 0 beside the diagonal is a camera here")
    k = k + HALF
    return Camera(*size, (k[0, 0], k[1, 1]), (k[0, 2], k[1, 2])).with_pose(
        rigid_pose(pose, where, MIDDLEBURY_POSE_TOLERANCE)
    )


def _first_image(path: Path, names: list[str]) -> Path:
    for name in names:
        image = inside(path.parent, name)
        if image.is_file():
            return image
    raise InputError(f"{path} does not state the size of its images and none lies beside it: give their size")
