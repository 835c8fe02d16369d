"""Cameras in OpenCV's FileStorage, YAML or JSON, as its calibration programs write them.

`camera_matrix`, `distortion_coefficients`, `image_width`, `image_height`; where there are poses, a row of
`extrinsic_parameters` for each view, (rotation vector, translation) from world to camera [m]. OpenCV counts image
points from the centre of the first pixel: the principal point moves by ½ px.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import begins, only_lens
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.camera.pose import pose_of
from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import sized_file
from hagoromo.files.memory import require
from hagoromo.files.names import reason
from hagoromo.files.record import read_json, read_json_table
from hagoromo.files.whole import write_text

START = 64  # bytes of a file that show whether it is JSON
LARGEST = 64 * 2**20  # bytes; cameras take far less
GROWTH = 30.0  # memory of the nodes of a file, in its sizes
MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K")
POSES, NAMES = ("extrinsic_parameters",), "image_names"
NUMBERS = ("fisheye_model", "image_width", "image_height")
DISTORTION = ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D")
NO_NUMBER = 1e300  # OpenCV reads a text as the largest double
MOST_COEFFICIENTS = 14  # OpenCV's; those behind the eighth are thin prisms and a tilted sensor


def read_opencv(path: str | Path, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Views, image file (or index) → camera; one named "" where the file has intrinsics only.

    Parsed in a process apart. size: (width, height) [px], for a file that does not state it. `InputError` for a file
    that is no FileStorage, lacks the camera or has a lens that the eight coefficients do not hold.
    """
    source = sized_file(path, LARGEST, "a file of cameras")
    require(GROWTH * source.stat().st_size, str(source))
    _check_json(source)
    return _views(read_apart(nodes_by_opencv, source, "OpenCV's YAML or JSON"), size, str(path))


def _check_json(source: Path) -> None:
    """`InputError` where a file of JSON has true or false for a number: OpenCV takes them for 1 and 0."""
    with source.open("rb") as file:
        if not file.read(START).lstrip().startswith(b"{"):
            return
    record = read_json_table(source)
    for key in (*MATRIX, *DISTORTION, *POSES, *NUMBERS):
        table = record.get(key)
        held = [table, *table.values()] if isinstance(table, dict) else [table]
        if any(isinstance(value, bool) for each in held for value in (each if isinstance(each, list) else [each])):
            raise InputError(f"{source}: {key} has true or false where a number must be: correct it")


def nodes_by_opencv(path: Path) -> dict[str, NDArray[Any]]:
    """The matrices, numbers and texts of a camera that a file has, by key; run by `read_apart`."""
    import cv2

    try:
        text = path.read_text(encoding="utf-8")  # OpenCV takes what follows a question mark in a name for options
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root, where = storage.root(), str(path)
        held = {key: _matrix(root, keys, where) for key, keys in (("k", MATRIX), ("d", DISTORTION), ("p", POSES))}
        held |= {key: np.array(root.getNode(key).real(), np.float64) for key in NUMBERS}
        names = root.getNode(NAMES)
        held[NAMES] = np.array([names.at(i).string() for i in range(names.size())], str) if names.isSeq() else None
        return {key: array for key, array in held.items() if array is not None}
    except (cv2.error, SystemError, UnicodeDecodeError) as error:
        said = reason(error, 80)
        raise InputError(f"{path} cannot be read as OpenCV's YAML or JSON, it may be damaged: {said}") from error


def write_opencv(path: str | Path, views: Mapping[str, Camera]) -> None:
    """Write views of one lens so that `read_opencv` gives them back; the path's suffix chooses YAML or JSON."""
    import cv2

    lens = only_lens(views, "OpenCV's file")
    (ax, ay), (x0, y0) = lens.focal, lens.principal
    poses = [
        np.concatenate([cv2.Rodrigues(camera.world_to_camera[:3, :3])[0].ravel(), camera.world_to_camera[:3, 3]])
        for camera in views.values()
    ]
    # into memory: to a full disk OpenCV writes less, and says nothing
    storage = cv2.FileStorage(Path(path).name, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", lens.width)
    storage.write("image_height", lens.height)
    storage.write("camera_matrix", np.array([[ax, 0.0, x0 - 0.5], [0.0, ay, y0 - 0.5], [0.0, 0.0, 1.0]]))
    storage.write("distortion_coefficients", np.array(lens.distortion)[:, None])
    if len(views) > 1 or any(views):
        storage.write("extrinsic_parameters", np.stack(poses))
        storage.startWriteStruct("image_names", cv2.FileNode_SEQ)
        for name in views:
            storage.write("", name)
        storage.endWriteStruct()
    write_text(path, storage.releaseAndGetString())


def is_opencv(path: Path) -> bool:
    """Whether a file is OpenCV's: YAML, or JSON with a camera matrix."""
    suffix = path.suffix.lower()
    if path.is_dir() or suffix not in ("", ".yml", ".yaml", ".json"):
        return False
    if suffix in (".yml", ".yaml") or (suffix == "" and begins(path, b"%YAML")):
        return True
    record = read_json(path) if begins(path, b"{") else None
    return isinstance(record, dict) and any(key in record for key in MATRIX)


def _views(held: Mapping[str, NDArray[Any]], size: tuple[int, int] | None, where: str) -> dict[str, Camera]:
    matrix, k = held.get("k"), held.get("d", np.zeros(0)).ravel()
    if matrix is None or matrix.shape != (3, 3):
        raise InputError(f"{where} has no camera_matrix of 3 × 3 numbers: it is no camera of OpenCV's")
    if k.size > MOST_COEFFICIENTS or k[len(COEFFICIENTS) :].any() or held["fisheye_model"]:
        raise InputError(
            f"{where} has a lens of another model than k1 k2 p1 p2 k3 k4 k5 k6: undistort its images first"
        )
    if matrix[0, 1] or matrix[1, 0] or (matrix[2] != (0.0, 0.0, 1.0)).any():
        raise InputError(f"{where} has a skewed camera_matrix: only one with 0 beside the diagonal is a camera here")
    stated_size = [float(held[key]) for key in ("image_width", "image_height")]
    width, height = stated_size if all(stated_size) else size or (0, 0)
    if not 0 < width < NO_NUMBER or not 0 < height < NO_NUMBER:
        raise InputError(f"{where} does not state image_width and image_height: add them")
    coefficients = tuple(map(float, k[: len(COEFFICIENTS)])) + (0.0,) * max(len(COEFFICIENTS) - k.size, 0)
    focal, principal = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2] + 0.5, matrix[1, 2] + 0.5)
    lens = Camera(int(width), int(height), focal, principal, coefficients)
    if "p" not in held:
        return {"": lens}
    poses = held["p"]
    names = held[NAMES].tolist() if NAMES in held else [f"{i}" for i in range(len(poses))]
    if len(names) != len(poses) or len(set(names)) != len(poses):
        raise InputError(f"{where} has {len(poses)} poses and {len(set(names))} different image_names: it is damaged")
    return {name: lens.with_pose(_pose(pose, where)) for name, pose in zip(names, poses, strict=True)}


def _matrix(root: Any, keys: Sequence[str], where: str) -> NDArray[np.float64] | None:
    """The first matrix of these keys, read number by number: OpenCV would take its stated size on trust."""
    node = next((candidate for candidate in map(root.getNode, keys) if not candidate.empty()), None)
    if node is None:
        return None
    stated = [node.getNode(key).real() if node.isMap() else 0.0 for key in ("rows", "cols")]
    rows, columns = (int(number) if 0.0 < number < LARGEST else 0 for number in stated)
    data = node.getNode("data") if node.isMap() else node
    if rows < 1 or columns < 1 or data.size() != rows * columns:
        raise InputError(f"{where}: {keys[0]} states {rows} × {columns} numbers and does not hold them: it is damaged")
    numbers = np.array([data.at(i).real() for i in range(data.size())], np.float64)
    if not (np.abs(numbers) < NO_NUMBER).all():
        raise InputError(f"{where}: {keys[0]} holds what is no finite number: mend it")
    return numbers.reshape(rows, columns)


def _pose(row: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    import cv2

    if row.size != 6:
        raise InputError(f"{where}: a row of extrinsic_parameters has {row.size} numbers: it must have 6")
    return pose_of(cv2.Rodrigues(row[:3])[0], row[3:])
