"""A COLMAP model in binary, little-endian: `cameras.bin`, `images.bin`, `points3D.bin`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes
from hagoromo.files.whole import write_bytes
from hagoromo_formats.cameras.colmap_model import ColmapCamera, ColmapImage

# number of a model → its name and how many parameters it has (COLMAP's sensor/models.h)
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
}
GROWTH = 12.0  # memory of the records of a file, in its sizes
MODEL_NUMBERS = {name: number for number, (name, _) in MODELS.items()}
POINT_2D, TRACK = 24, 8  # bytes of a point seen in an image, and of an image that saw a point


class _Bytes:
    """Bytes read one after the other; `InputError` when they end too early."""

    def __init__(self, path: Path) -> None:
        self.data, self.at, self.path = read_bytes(path, GROWTH), 0, path

    def take(self, kinds: str) -> tuple:
        self.skip(size := struct.calcsize(f"<{kinds}"))
        return struct.unpack_from(f"<{kinds}", self.data, self.at - size)

    def skip(self, size: int) -> None:
        self.at += size
        if self.at > len(self.data):
            raise InputError(f"{self.path} is cut off or damaged: copy it again")

    def name(self) -> str:
        end = self.data.find(b"\0", self.at)
        start, self.at = self.at, end + 1
        if end < 0:
            raise InputError(f"{self.path} is cut off or damaged: copy it again")
        try:
            return self.data[start:end].decode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(f"{self.path} has a name that is no text: {error}") from error


def read_cameras(path: Path) -> list[ColmapCamera]:
    """The cameras of `cameras.bin`."""
    file, cameras = _Bytes(path), []
    for _ in range(file.take("Q")[0]):
        number, model, width, height = file.take("iiQQ")
        name, count = MODELS.get(model, (f"number {model}", 0))
        if not count:
            raise InputError(f"{path}: camera {number} is of a model that is not known here ({name})")
        cameras.append(ColmapCamera(number, name, width, height, file.take(f"{count}d")))
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """The images of `images.bin`; the points they saw are not kept."""
    file, images = _Bytes(path), []
    for _ in range(file.take("Q")[0]):
        _, *pose, camera = file.take("i7di")
        images.append(ColmapImage(file.name(), camera, pose[:4], pose[4:]))
        file.skip(POINT_2D * file.take("Q")[0])
    return images


def read_points(path: Path) -> NDArray[np.float64]:
    """(n, 7): X Y Z R G B ERROR of `points3D.bin`."""
    file, rows = _Bytes(path), []
    for _ in range(file.take("Q")[0]):
        rows.append(file.take("Q3d3Bd")[1:])
        file.skip(TRACK * file.take("Q")[0])
    return np.array(rows, np.float64).reshape(-1, 7)


def write(folder: Path, cameras: Sequence[ColmapCamera], images: Sequence[ColmapImage]) -> None:
    """Write the three files into `folder`."""
    rows = [
        struct.pack(f"<iiQQ{len(c.parameters)}d", c.number, MODEL_NUMBERS[c.model], c.width, c.height, *c.parameters)
        for c in cameras
    ]
    write_bytes(folder / "cameras.bin", struct.pack("<Q", len(rows)) + b"".join(rows))
    rows = [
        struct.pack("<i7di", i, *image.quaternion, *image.translation, image.camera)
        + image.name.encode("utf-8")
        + struct.pack("<xQ", 0)
        for i, image in enumerate(images, 1)
    ]
    write_bytes(folder / "images.bin", struct.pack("<Q", len(rows)) + b"".join(rows))
    write_bytes(folder / "points3D.bin", struct.pack("<Q", 0))
