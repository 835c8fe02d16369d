"""Files of cameras in any known format, recognised by name and keys: image file → camera."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.colmap import read_colmap, write_colmap
from hagoromo.camera.formats.middlebury import read_middlebury, write_middlebury
from hagoromo.camera.formats.nerfstudio import read_transforms, write_transforms
from hagoromo.camera.formats.opencv_file import MATRIX, only_lens, read_opencv, write_opencv
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, inside
from hagoromo.files.record import Count, ForeignRecord, WrittenBy, about, decode, read_json
from hagoromo.files.whole import whole_file, whole_folder

Format = Literal["opencv", "colmap", "colmap-text", "nerfstudio", "middlebury"]
BY_SUFFIX: dict[str, Format] = {
    "": "colmap",
    ".yml": "opencv",
    ".yaml": "opencv",
    ".json": "nerfstudio",
    ".txt": "middlebury",
}


NERFSTUDIO, OPENCV, COLMAP = "nerfstudio, instant-ngp, NeRF", "OpenCV YAML or JSON", "COLMAP"
MIDDLEBURY = "Middlebury _par.txt"
TRANSFORMS = ("transforms.json", "transforms_train.json")
START = 4096  # bytes of a file that tell its format
COUNT_LINE = re.compile(rb"\d+[ \t]*\r?(\n|$)")  # how Middlebury's files begin


class CameraRecord(ForeignRecord, frozen=True, kw_only=True):
    """camera.json, as `calibrate camera` writes it: nerfstudio's keys of a lens, then what is known about them."""

    version_key = "hagoromo.format_version"

    w: Annotated[Count, about("width of the image [px]")]
    h: Annotated[Count, about("height of the image [px]")]
    fl_x: Annotated[float, about("focal length along x [px]")]
    fl_y: Annotated[float, about("focal length along y [px]")]
    cx: Annotated[float, about("principal point, from the left edge [px]")]
    cy: Annotated[float, about("principal point, from the upper edge [px]")]
    k1: Annotated[float, about("radial distortion of OpenCV, r²")]
    k2: Annotated[float, about("radial distortion, r⁴")]
    p1: Annotated[float, about("tangential distortion")]
    p2: Annotated[float, about("tangential distortion")]
    k3: Annotated[float, about("radial distortion, r⁶")] = 0.0
    k4: Annotated[float, about("radial distortion, denominator, r²")] = 0.0
    k5: Annotated[float, about("radial distortion, denominator, r⁴")] = 0.0
    k6: Annotated[float, about("radial distortion, denominator, r⁶")] = 0.0
    standard_deviation: Annotated[dict[str, float], about("standard deviation of each figure, in its unit")] = {}
    rms_px: Annotated[float | None, about("root mean square distance of corners from their prediction [px]")] = None
    boards_rms_px: Annotated[dict[str, float], about("the same for each photograph [px]")] = {}
    skipped: Annotated[tuple[str, ...], about("photographs in which no board was found")] = ()
    outliers: Annotated[tuple[str, ...], about("photographs whose rms is far above the others'")] = ()
    hagoromo: Annotated[WrittenBy, about("what wrote the file")] = WrittenBy()


def read_views(path: str | Path, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """The views in a file or folder: name of the image → its camera, posed in the world [m].

    path: OpenCV's YAML or JSON, a folder of COLMAP's, nerfstudio's transforms.json or its folder, Middlebury's
    _par.txt, or the camera.json of `calibrate camera`. size: (width, height) [px] of the images, for a format
    that does not hold it. A camera without an image is named "". `InputError` for a file of no such format, or a
    damaged one.
    """
    path = Path(path)
    if path.is_dir():
        transforms = transforms_in(path)
        return read_colmap(path) if transforms is None else read_transforms(transforms)
    kind = cameras_within(path)
    if kind == COLMAP:
        return read_colmap(path.parent)
    if kind == MIDDLEBURY:
        return read_middlebury(path, size)
    if kind == OPENCV:
        return read_opencv(path, size)
    if kind == NERFSTUDIO:
        return read_transforms(path)
    if path.suffix.lower() == ".json":
        return {"": _calibrated(path)}
    raise InputError(
        f"{path} is no file of cameras: give .json, .yml, a _par.txt (the number of images, then a line of 22 words "
        f"each) or a folder of COLMAP's"
    )


def transforms_in(folder: Path) -> Path | None:
    """The list of views of nerfstudio in a folder, or that for training where NeRF's are split; None without both."""
    return next((file for name in TRANSFORMS if (file := inside(folder, name)).is_file()), None)


def cameras_within(path: str | Path) -> str:
    """The format of a file of cameras, as the table of formats names it; "" where it is none.

    A file whose suffix may mean anything (.txt, .json, none) is known by what it holds.
    """
    path = existing_file(path)
    suffix = path.suffix.lower()
    if suffix in (".bin", ".txt") and path.stem in ("cameras", "images", "points3D"):
        return COLMAP
    if suffix in (".yml", ".yaml"):
        return OPENCV
    if suffix not in ("", ".json", ".txt"):
        return ""
    with path.open("rb") as file:
        start = file.read(START).lstrip()
    if suffix != ".json" and COUNT_LINE.match(start):
        return MIDDLEBURY
    if suffix != ".json" and start.startswith(b"%YAML"):
        return OPENCV
    if suffix == ".txt" or not start.startswith(b"{"):
        return ""
    record = read_json(path)
    if isinstance(record, dict) and any(key in record for key in MATRIX):
        return OPENCV
    return NERFSTUDIO if isinstance(record, dict) and "frames" in record else ""


def read_camera(path: str | Path) -> Camera:
    """The one camera in the file or folder `path`, moved to the world's origin: its lens and its size [px].

    path: as of `read_views`. `InputError` where its views were taken with several lenses.
    """
    lens = only_lens(read_views(path), str(path))
    return Camera(lens.width, lens.height, lens.focal, lens.principal, lens.distortion, name=Path(path).stem)


def write_views(path: str | Path, views: Mapping[str, Camera], kind: Format | None = None, force: bool = False) -> None:
    """Write views (name of the image → camera) in another program's format, whole or not at all.

    path: file, or folder for COLMAP. kind: the format; None takes that of the suffix (`BY_SUFFIX`; no suffix is a
    folder of COLMAP's). force: replace what is there. `InputError` where it exists, or where the format cannot hold
    the lens.
    """
    kind = kind or BY_SUFFIX.get(Path(path).suffix.lower())
    if kind is None:
        raise InputError(
            f"{path} has no suffix of a format of cameras: give one of {', '.join(filter(None, BY_SUFFIX))}"
        )
    if kind in ("colmap", "colmap-text"):
        with whole_folder(path, force) as folder:
            write_colmap(folder, views, text=kind == "colmap-text")
        return
    write = {"opencv": write_opencv, "nerfstudio": write_transforms, "middlebury": write_middlebury}[kind]
    with whole_file(path, force) as partial:
        write(partial, views)


def _calibrated(path: Path) -> Camera:
    """The camera of a record as `Calibration.record` makes it, of which the last coefficients may be left out."""
    lens = decode(read_json(path), CameraRecord, str(path))
    distortion = tuple(getattr(lens, name) for name in COEFFICIENTS)
    return Camera(lens.w, lens.h, (lens.fl_x, lens.fl_y), (lens.cx, lens.cy), distortion).with_pose(np.eye(4))
