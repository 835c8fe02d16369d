"""Cameras in a folder of COLMAP's: `cameras`, `images` and `points3D`, as text or binary.

Poses are world-to-camera with OpenCV's axes and image points count from the image's corner, both as ours. Format:
https://colmap.github.io/format.html. Of its lenses those are read that OpenCV's eight coefficients hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import pose_of, rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo_formats.cameras import colmap_binary, colmap_text
from hagoromo_formats.cameras.colmap_model import ColmapCamera, ColmapImage

MODEL_FOLDERS = ("", "sparse/0", "sparse", "0", "colmap/sparse/0")  # where programs keep the model within a folder
# COLMAP's parameters in their order; f stands for both focal lengths, k for k1.
LENSES = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
QUATERNION_TOLERANCE = 1e-3  # how far the length of a quaternion may be from 1


class Points(NamedTuple):
    """Points of a reconstruction: positions (n, 3) [world units], colours (n, 3) uint8, error (n,) [px]."""

    positions: NDArray[np.float64]
    colours: NDArray[np.uint8]
    error: NDArray[np.float64]


def find_colmap(folder: str | Path) -> tuple[Path, str] | None:
    """The folder that holds the model, in or below `folder`, and the suffix of its files; None when there is none."""
    for place in MODEL_FOLDERS:
        for suffix in (".bin", ".txt"):
            home = Path(folder) / place
            if all(inside(folder, f"{place or '.'}/{part}{suffix}").is_file() for part in ("cameras", "images")):
                return home, suffix
    return None


def is_colmap(path: Path) -> bool:
    """Whether a folder holds a model, or a file is a part of one."""
    if path.is_dir():
        return find_colmap(path) is not None
    return path.suffix.lower() in (".bin", ".txt") and path.stem in ("cameras", "images", "points3D")


def read_colmap(folder: str | Path, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Views, image file → camera, of a folder, or of the one that a part of a model lies in. size: is not used.

    `InputError` for a folder without a model, damage, or a lens of another kind.
    """
    folder = Path(folder)
    home, suffix = _model(folder if folder.is_dir() else folder.parent)
    reader = colmap_binary if suffix == ".bin" else colmap_text
    cameras = reader.read_cameras(home / f"cameras{suffix}")
    lenses = {one.number: _lens(one, f"{home / 'cameras'}{suffix}") for one in cameras}
    views: dict[str, Camera] = {}
    for image in reader.read_images(home / f"images{suffix}"):
        where = f"{home / 'images'}{suffix} image {image.name!r}"
        if image.camera not in lenses:
            raise InputError(f"{where} is of camera {image.camera}, which is not listed: the model is damaged")
        if image.name in views:
            raise InputError(f"{where} is listed twice: the model is damaged")
        views[image.name] = lenses[image.camera].with_pose(_pose(image, where))
    if not views:
        raise InputError(f"{home} lists no image: it has no poses")
    return views


def read_points(folder: str | Path) -> Points:
    """The points of the model (`points3D`)."""
    home, suffix = _model(folder)
    rows = (colmap_binary if suffix == ".bin" else colmap_text).read_points(inside(home, f"points3D{suffix}"))
    return Points(rows[:, :3].copy(), np.clip(rows[:, 3:6], 0, 255).astype(np.uint8), rows[:, 6].copy())


def write_colmap(folder: str | Path, views: Mapping[str, Camera], text: bool = False) -> None:
    """Write views into an existing folder so that `read_colmap` gives them back; `points3D` is left empty.

    `InputError` for a name that the format does not hold.
    """
    lenses: dict[tuple, ColmapCamera] = {}
    images = []
    for name, camera in views.items():
        if not name or "\0" in name or "\n" in name or (text and " " in name):
            raise InputError(f"COLMAP's format does not hold the name {name!r}: rename the image")
        key = (camera.width, camera.height, camera.focal, camera.principal, camera.distortion)
        lens = lenses.setdefault(key, _colmap_camera(camera, len(lenses) + 1))
        pose = camera.world_to_camera
        images.append(ColmapImage(name, lens.number, _quaternion(pose[:3, :3]), tuple(pose[:3, 3].tolist())))
    (colmap_text if text else colmap_binary).write(Path(folder), list(lenses.values()), images)


def write_colmap_text(folder: str | Path, views: Mapping[str, Camera]) -> None:
    """As `write_colmap`, as text."""
    write_colmap(folder, views, text=True)


def _model(folder: str | Path) -> tuple[Path, str]:
    model = find_colmap(folder)
    if model is None:
        raise InputError(f"{folder} holds no COLMAP model: it needs cameras and images, .bin or .txt, both of one kind")
    return model


def _lens(one: ColmapCamera, where: str) -> Camera:
    if one.model not in LENSES:
        raise InputError(f"{where}: camera {one.number} is of model {one.model}: read are {', '.join(LENSES)}")
    if len(one.parameters) != len(LENSES[one.model]):
        raise InputError(f"{where}: camera {one.number} has {len(one.parameters)} parameters: {one.model} takes others")
    k = dict(zip(LENSES[one.model], one.parameters, strict=True))
    focal = (k["f"], k["f"]) if "f" in k else (k["fx"], k["fy"])
    distortion = tuple(k.get(name, 0.0) for name in LENSES["FULL_OPENCV"][4:])
    return Camera(one.width, one.height, focal, (k["cx"], k["cy"]), distortion, name=str(one.number))


def _colmap_camera(camera: Camera, number: int) -> ColmapCamera:
    held = 0 if not any(camera.distortion) else 4 if not any(camera.distortion[4:]) else 8
    model = {0: "PINHOLE", 4: "OPENCV", 8: "FULL_OPENCV"}[held]
    parameters = camera.focal + camera.principal + camera.distortion[:held]
    return ColmapCamera(number, model, camera.width, camera.height, parameters)


def _pose(image: ColmapImage, where: str) -> NDArray[np.float64]:
    from scipy.spatial.transform import Rotation

    length = math.hypot(*image.quaternion)  # which does not overflow
    if not abs(length - 1.0) < QUATERNION_TOLERANCE:
        raise InputError(f"{where} has a quaternion of length {length:.4g}: it must be 1")
    w, x, y, z = image.quaternion
    return rigid_pose(pose_of(Rotation.from_quat([x, y, z, w]).as_matrix(), image.translation), where)


def _quaternion(rotation: NDArray[np.float64]) -> Sequence[float]:
    """(w, x, y, z), w not negative."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True).tolist()
    return w, x, y, z
