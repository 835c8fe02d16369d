"""Files of cameras in any format of the table of formats: image file → camera."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.nerfstudio import read_transforms
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, inside
from hagoromo.files.format import Format, formats_of
from hagoromo.files.record import Count, ForeignRecord, WrittenBy, about, decode, read_json
from hagoromo.files.whole import whole_file, whole_folder

TRANSFORMS = ("transforms.json", "transforms_train.json")


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
    form = format_of_cameras(path if path.is_dir() else existing_file(path))
    if form is not None:
        return form.read(path, size)
    if path.suffix.lower() == ".json":
        return {"": _calibrated(path)}
    if path.is_dir():
        raise InputError(f"{path} holds no cameras: give a folder with transforms.json, or a COLMAP model")
    raise InputError(
        f"{path} is no file of cameras: give .json, .yml, a _par.txt (the number of images, then a line of 22 words "
        f"each) or a folder of COLMAP's"
    )


def format_of_cameras(path: Path) -> Format | None:
    """The format of cameras that the file or folder at `path` has; None where it is none."""
    known = (form for form in formats_of("cameras") if form.key and form.sniff)
    return next((form for form in known if form.is_sniffed(path)), None)


def read_transforms_or_folder(path: str | Path, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """The views in nerfstudio's list, or in the folder that has it; size: is not used, the file holds it."""
    path = Path(path)
    return read_transforms((transforms_in(path) or path) if path.is_dir() else path)


def has_transforms(path: Path) -> bool:
    """Whether a folder has nerfstudio's list of views, or a file is one."""
    if path.is_dir():
        return transforms_in(path) is not None
    if path.suffix.lower() not in ("", ".json") or not begins(path, b"{"):
        return False
    record = read_json(path)
    return isinstance(record, dict) and "frames" in record


def begins(path: Path, start: bytes) -> bool:
    """Whether a file begins so, after white space."""
    with path.open("rb") as file:
        return file.read(4096).lstrip().startswith(start)


def transforms_in(folder: Path) -> Path | None:
    """The list of views of nerfstudio in a folder, or that for training where NeRF's are split; None without both."""
    return next((file for name in TRANSFORMS if (file := inside(folder, name)).is_file()), None)


def read_camera(path: str | Path) -> Camera:
    """The one camera in the file or folder `path`, moved to the world's origin: its lens and its size [px].

    path: as of `read_views`. `InputError` where its views were taken with several lenses.
    """
    lens = only_lens(read_views(path), str(path))
    return Camera(lens.width, lens.height, lens.focal, lens.principal, lens.distortion, name=Path(path).stem)


def write_views(path: str | Path, views: Mapping[str, Camera], kind: str | None = None, force: bool = False) -> None:
    """Write views (name of the image → camera) in another program's format, whole or not at all.

    path: file, or folder for COLMAP. kind: the format, as `convert --to` calls it; None takes that of the suffix (no
    suffix is a folder of COLMAP's). force: replace what is there. `InputError` where it exists, or where the format
    cannot hold the lens.
    """
    known = [form for form in formats_of("cameras") if form.key and form.writer]
    suffix = Path(path).suffix.lower()
    form = next((form for form in known if (form.key == kind if kind else suffix in form.suffixes)), None)
    if form is None:
        names = dict.fromkeys(each for form in known for each in form.suffixes if each)
        raise InputError(
            f"{path} has no suffix of a format of cameras: give one of {', '.join(names)}"
            if kind is None
            else f"{kind!r} is no format of cameras: give one of {', '.join(form.key for form in known)}"
        )
    with (whole_folder if form.folder else whole_file)(path, force) as partial:
        form.write(partial, views)


def only_lens(views: Mapping[str, Camera], what: str) -> Camera:
    """The camera, at the world's origin, that all views share; `InputError` when they differ or there is none."""
    lenses = {(c.width, c.height, c.focal, c.principal, c.distortion): c for c in views.values()}
    if len(lenses) != 1:
        raise InputError(f"{what} holds one lens and there are {len(lenses)}: give the views of one camera")
    return next(iter(lenses.values())).with_pose(np.eye(4))


def _calibrated(path: Path) -> Camera:
    """The camera of a record as `Calibration.record` makes it, of which the last coefficients may be left out."""
    lens = decode(read_json(path), CameraRecord, str(path))
    distortion = tuple(getattr(lens, name) for name in COEFFICIENTS)
    return Camera(lens.w, lens.h, (lens.fl_x, lens.fl_y), (lens.cx, lens.cy), distortion).with_pose(np.eye(4))
