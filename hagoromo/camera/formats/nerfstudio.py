"""Cameras in nerfstudio's `transforms.json` (and instant-ngp's, and NeRF's).

Intrinsics stand for all frames or per frame; poses are camera-to-world with OpenGL axes; image points count from the
image's corner, as ours do. A lens with k4, k5 or k6 is COLMAP's FULL_OPENCV: nerfstudio means another thing by k4.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.camera.pose import opencv_from_opengl, opengl_from_opencv, rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.picture import picture_size
from hagoromo.files.record import (
    anything,
    inside,
    list_of,
    number,
    one_of,
    positive,
    read_json,
    table,
    take,
    text,
    write_json,
)

POSE_TOLERANCE = 1e-3  # largest entry of R Rᵀ − I in foreign poses, often written with few digits
RATIONAL = ("k4", "k5", "k6")
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE", "FULL_OPENCV")
INTRINSICS = {
    **dict.fromkeys(("w", "h", "fl_x", "fl_y"), (positive, None)),
    **dict.fromkeys(("cx", "cy", "camera_angle_x", "camera_angle_y"), (number, None)),
    **dict.fromkeys(COEFFICIENTS, (number, 0.0)),
    "camera_model": (one_of(*PINHOLES), "OPENCV"),
    "camera": (text, ""),
}


def read_transforms(path: str | Path) -> dict[str, Camera]:
    """The frames of a transforms file: `file_path` → camera; the images need not exist where the file tells their size.

    `InputError` for what makes no camera, two frames of one image, or a frame of unknown size.
    """
    record = read_json(path)
    frames = take(record, {"frames": list_of(table)}, str(path), strict=False)["frames"]
    views: dict[str, Camera] = {}
    for i, frame in enumerate(frames):
        where = f"{path} frame {i}"
        name = take(frame, {"file_path": text}, where, strict=False)["file_path"]
        if name in views:
            raise InputError(f"{where} and another are both of {name}: keep one")
        settings = {**record, **frame}
        image = inside(Path(path).parent, name)
        size = None if settings.get("w") and settings.get("h") else picture_size(image)
        views[name] = camera_from_record(settings, size, where)
    return views


def write_transforms(path: str | Path, views: Mapping[str, Camera]) -> None:
    """Write views, image file → camera, so that `read_transforms` gives them back."""
    frames = [{"file_path": name, **record_from_camera(camera)} for name, camera in views.items()]
    write_json(path, {"frames": frames})


def camera_from_record(record: Mapping[str, Any], size: tuple[int, int] | None, where: str) -> Camera:
    """Camera of a frame (its keys over the top level's); what is missing follows from the image's (height, width).

    size: None where there is no image. `InputError` for another lens than OpenCV's, another size than the image's or
    a matrix that is no pose.
    """
    k = take(record, INTRINSICS, where, strict=False)
    if record.get("is_fisheye") or (k["camera_model"] != "FULL_OPENCV" and any(k[name] for name in RATIONAL)):
        raise InputError(f"{where} has a fisheye lens (or k4, k5, k6 without FULL_OPENCV): undistort its images first")
    height, width = size or (int(k["h"]), int(k["w"]))
    told = k["w"] or width, k["h"] or height
    if told != (width, height):
        raise InputError(f"{where} is {width} × {height} px and must be {told[0]:g} × {told[1]:g}: mend w and h")
    fl_x = k["fl_x"] or _focal(k["camera_angle_x"], width, where)
    fl_y = k["fl_y"] or (_focal(k["camera_angle_y"], height, where) if k["camera_angle_y"] else fl_x)
    matrix = take(record, {"transform_matrix": anything}, where, strict=False)["transform_matrix"]
    pose = rigid_pose(matrix, f"{where}: transform_matrix", POSE_TOLERANCE)
    return Camera(
        width,
        height,
        (fl_x, fl_y),
        (width / 2 if k["cx"] is None else k["cx"], height / 2 if k["cy"] is None else k["cy"]),
        tuple(k[name] for name in COEFFICIENTS),
        name=k["camera"],
    ).with_pose(np.linalg.inv(opencv_from_opengl(pose)))


def record_from_camera(camera: Camera) -> dict[str, Any]:
    """The intrinsics and pose of a frame."""
    k = dict(zip(COEFFICIENTS, camera.distortion, strict=True))
    rational = any(k[name] for name in RATIONAL)
    return {
        "camera": camera.name,
        "camera_model": "FULL_OPENCV" if rational else "OPENCV",
        **dict(zip(("w", "h"), (camera.width, camera.height), strict=True)),
        **dict(zip(("fl_x", "fl_y", "cx", "cy"), camera.focal + camera.principal, strict=True)),
        **{name: value for name, value in k.items() if rational or name not in RATIONAL},
        "transform_matrix": opengl_from_opencv(camera.camera_to_world).tolist(),
    }


def _focal(angle: float | None, pixels: int, where: str) -> float:
    """Focal length [px] of the full field of view `angle` [rad] over `pixels`."""
    if angle is None or not 0.0 < angle < np.pi:
        raise InputError(f"{where} has no focal length: give fl_x [px], or camera_angle_x between 0 and π [rad]")
    return pixels / 2.0 / float(np.tan(angle / 2.0))
