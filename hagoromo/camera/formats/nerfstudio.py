"""Cameras in nerfstudio's `transforms.json` (and instant-ngp's, and NeRF's).

Intrinsics stand for all frames or per frame; poses are camera-to-world with OpenGL axes; image points count from the
image's corner, as ours do. A lens with k4, k5 or k6 is COLMAP's FULL_OPENCV: nerfstudio means another thing by k4.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import UNSET, Meta

from hagoromo.camera.camera import Camera, unplaced_camera
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.camera.pose import opencv_from_opengl, opengl_from_opencv, rigid_pose
from hagoromo.errors import InputError
from hagoromo.files.picture import named_picture, picture_size
from hagoromo.files.record import (
    ForeignRecord,
    Positive,
    about,
    decode,
    one_of,
    read_json,
    write_json,
    written_by,
)

FOREIGN_POSE_TOLERANCE = 1e-3  # largest entry of R Rᵀ − I in foreign poses, often written with few digits
RATIONAL = ("k4", "k5", "k6")
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE", "FULL_OPENCV")
ORTHOGRAPHIC = "ORTHOGRAPHIC"  # needs neither a focal length nor a pose: `unplaced_camera` has both
POSE = Meta(
    extra_json_schema={
        "type": "array",
        "minItems": 4,
        "maxItems": 4,
        "items": {"type": "array", "minItems": 4, "maxItems": 4, "items": {"type": "number"}},
    }
)


class ViewRecord(ForeignRecord, frozen=True, kw_only=True):
    """The camera of a frame, by nerfstudio's keys."""

    w: Annotated[Positive | None, about("width of the image [px]")] = None
    h: Annotated[Positive | None, about("height of the image [px]")] = None
    fl_x: Annotated[Positive | None, about("focal length along x [px]")] = None
    fl_y: Annotated[Positive | None, about("focal length along y [px]; default: fl_x")] = None
    cx: Annotated[float | None, about("principal point, from the left edge [px]; default: the middle")] = None
    cy: Annotated[float | None, about("principal point, from the upper edge [px]; default: the middle")] = None
    camera_angle_x: Annotated[float | None, about("horizontal field of view, in place of fl_x [rad]")] = None
    camera_angle_y: Annotated[float | None, about("vertical field of view, in place of fl_y [rad]")] = None
    k1: Annotated[float, about("radial distortion of OpenCV, r²")] = 0.0
    k2: Annotated[float, about("radial distortion, r⁴")] = 0.0
    p1: Annotated[float, about("tangential distortion")] = 0.0
    p2: Annotated[float, about("tangential distortion")] = 0.0
    k3: Annotated[float, about("radial distortion, r⁶")] = 0.0
    k4: Annotated[float, about("radial distortion, denominator, r²; FULL_OPENCV only")] = 0.0
    k5: Annotated[float, about("radial distortion, denominator, r⁴; FULL_OPENCV only")] = 0.0
    k6: Annotated[float, about("radial distortion, denominator, r⁶; FULL_OPENCV only")] = 0.0
    camera_model: Annotated[str, one_of(*PINHOLES, ORTHOGRAPHIC), about("model of the lens")] = "OPENCV"
    camera: Annotated[str, about("name of the camera")] = ""
    is_fisheye: Annotated[Any, about("true for a fisheye lens, which is refused")] = False
    transform_matrix: Annotated[Any, POSE, about("camera to world, OpenGL axes, by rows [m]")] = UNSET

    @property
    def distortion(self) -> tuple[float, ...]:
        """OpenCV's coefficients in its order."""
        return tuple(getattr(self, name) for name in COEFFICIENTS)


class ImageView(ViewRecord, frozen=True, kw_only=True):
    """A frame of a file of cameras."""

    file_path: Annotated[str, about("image file")]


class ViewsRecord(ForeignRecord, frozen=True, kw_only=True):
    """A file of cameras."""

    version_key = "hagoromo.format_version"

    frames: list[dict[str, Any]]


def read_transforms(path: str | Path) -> dict[str, Camera]:
    """The frames of a transforms file: `file_path` → camera; images need not exist where the file states their size.

    `InputError` for what makes no camera, two frames of one image, or a frame of unknown size.
    """
    record = read_json(path)
    frames = decode(record, ViewsRecord, str(path)).frames
    views: dict[str, Camera] = {}
    for i, frame in enumerate(frames):
        where = f"{path} frame {i}"
        if "file_path" not in frame:
            raise InputError(f"{where} lacks the key 'file_path': add it")
        view = decode({**record, **frame}, ImageView, where)
        name = view.file_path
        if name in views:
            raise InputError(f"{where} and another are both of {name}: keep one")
        image = named_picture(Path(path).parent, name)
        views[name] = camera_from_record(view, None if view.w and view.h else picture_size(image), where)
    return views


def write_transforms(path: str | Path, views: Mapping[str, Camera]) -> None:
    """Write views, image file → camera, so that `read_transforms` gives them back."""
    frames = [{"file_path": name, **record_from_camera(camera)} for name, camera in views.items()]
    write_json(path, {"hagoromo": written_by(), "frames": frames})


def camera_from_record(view: ViewRecord, size: tuple[int, int] | None, where: str) -> Camera:
    """Camera of a frame (its keys over the top level's); what is missing follows from the image's (height, width).

    size: None where there is no image. `InputError` for another lens than OpenCV's, another size than the image's or
    a matrix that is no pose.
    """
    if view.is_fisheye or (view.camera_model != "FULL_OPENCV" and any(getattr(view, name) for name in RATIONAL)):
        raise InputError(f"{where} has a fisheye lens (or k4, k5, k6 without FULL_OPENCV): undistort its images first")
    height, width = size or (int(view.h or 0), int(view.w or 0))
    stated = view.w or width, view.h or height
    if stated != (width, height):
        raise InputError(f"{where} is {width} × {height} px and must be {stated[0]:g} × {stated[1]:g}: mend w and h")
    orthographic = view.camera_model == ORTHOGRAPHIC
    stand_in = unplaced_camera(width, height, None) if orthographic else None
    fl_x = view.fl_x or (stand_in.focal[0] if stand_in else _focal(view.camera_angle_x, width, where))
    fl_y = view.fl_y or (_focal(view.camera_angle_y, height, where) if view.camera_angle_y else fl_x)
    if view.transform_matrix is not UNSET:
        pose = opencv_from_opengl(
            rigid_pose(view.transform_matrix, f"{where}: transform_matrix", FOREIGN_POSE_TOLERANCE)
        )
    elif stand_in:
        pose = unplaced_camera(width, height, fl_x).camera_to_world
    else:
        raise InputError(f"{where} lacks the key 'transform_matrix': add it")
    return Camera(
        width,
        height,
        (fl_x, fl_y),
        (width / 2 if view.cx is None else view.cx, height / 2 if view.cy is None else view.cy),
        view.distortion,
        name=view.camera,
        orthographic=orthographic,
    ).with_pose(np.linalg.inv(pose))


def record_from_camera(camera: Camera) -> dict[str, Any]:
    """The intrinsics and pose of a frame."""
    k = dict(zip(COEFFICIENTS, camera.distortion, strict=True))
    rational = any(k[name] for name in RATIONAL)
    return {
        "camera": camera.name,
        "camera_model": ORTHOGRAPHIC if camera.orthographic else "FULL_OPENCV" if rational else "OPENCV",
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
