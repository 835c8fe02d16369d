"""A COLMAP model as text: `cameras.txt`, `images.txt` (two lines an image), `points3D.txt`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes
from hagoromo.files.memory import require
from hagoromo.files.whole import write_text
from hagoromo_formats.cameras.colmap_model import ColmapCamera, ColmapImage

BYTES_PER_LINE = 400  # memory of the record of a line beside its text


def read_cameras(path: Path) -> list[ColmapCamera]:
    """Rows `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`."""
    cameras = []
    for where, line in _lines(path):
        words = line.split()
        if len(words) < 5:
            raise InputError(f"{where} is no camera: CAMERA_ID, MODEL, WIDTH, HEIGHT and parameters are wanted")
        number, width, height = _whole([words[0], *words[2:4]], where)
        cameras.append(ColmapCamera(number, words[1], width, height, _numbers(words[4:], where)))
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """Pairs of lines: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, and the visible points, which are not stored."""
    lines = _lines(path, blank=True)
    while lines and not lines[-1][1].strip():
        lines.pop()  # blank lines at the end: an image that saw no point has one too
    images = []
    for where, line in lines[::2]:
        words = line.split(maxsplit=9)
        if len(words) < 10:
            raise InputError(f"{where} is no image: IMAGE_ID, four, three numbers, CAMERA_ID and NAME are wanted")
        pose = _numbers(words[1:8], where)
        images.append(ColmapImage(words[9].strip(), _whole(words[8:9], where)[0], pose[:4], pose[4:]))
    return images


def read_points(path: Path) -> NDArray[np.float64]:
    """(n, 7): X Y Z R G B ERROR of rows `POINT3D_ID X Y Z R G B ERROR TRACK[]`."""
    rows = [_numbers(line.split()[1:8], where) for where, line in _lines(path)]
    if any(len(row) != 7 for row in rows):
        raise InputError(f"{path} has a point of fewer than 8 numbers: it may be cut off")
    return np.array(rows, np.float64).reshape(-1, 7)


def write(folder: Path, cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage]) -> None:
    """Write the three files into `folder`."""
    rows = [(one.number, one.model, one.width, one.height, *map(repr, map(float, one.parameters))) for one in cameras]
    _write(folder / "cameras.txt", "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]", rows)
    rows = [
        (i, *map(repr, map(float, (*one.quaternion, *one.translation))), one.camera, f"{one.name}\n")
        for i, one in enumerate(images, 1)
    ]
    _write(folder / "images.txt", "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then X Y POINT3D_ID of each", rows)
    _write(folder / "points3D.txt", "POINT3D_ID X Y Z R G B ERROR TRACK[]", [])


def _write(path: Path, header: str, rows: Sequence[tuple]) -> None:
    lines = [f"# {header}", *(" ".join(map(str, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def _lines(path: Path, blank: bool = False) -> list[tuple[str, str]]:
    """(where, line) of the lines that are no comments; blank ones too where they count."""
    try:
        text = read_bytes(path, 6.0).decode("utf-8").replace("\r\n", "\n").removesuffix("\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text: {error}") from error
    require((BYTES_PER_LINE + len(str(path))) * text.count("\n"), f"{path}, of {text.count(chr(10))} lines,")
    lines = [(f"{path} line {i}", line) for i, line in enumerate(text.split("\n"), 1) if not line.startswith("#")]
    return [(where, line) for where, line in lines if blank or line.strip()]


def _numbers(words: Sequence[str], where: str) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
    if not np.isfinite(numbers).all():
        raise InputError(f"{where} has a number that is not finite: mend it")
    return numbers


def _whole(words: Sequence[str], where: str) -> list[int]:
    try:
        return [int(word) for word in words]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from error
