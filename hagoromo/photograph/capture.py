"""Capture: a folder of photographs of one object, with `transforms.json` beside them.

`load_capture` reads captures of this package, nerfstudio, instant-ngp and NeRF. `save_capture` writes sensor numbers
(PNG) where they represent the photograph exactly, else linear values with their variance (EXR).
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from hagoromo.camera.formats.nerfstudio import camera_from_record, record_from_camera
from hagoromo.camera.response import Response
from hagoromo.camera.sensor import Demosaic
from hagoromo.errors import InputError
from hagoromo.files.checks import inside, of_folder
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.memory import require
from hagoromo.files.png import png_bytes, write_png
from hagoromo.files.record import ForeignRecord, decode, read_json, write_json, written_by
from hagoromo.files.whole import whole_folder
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import (
    SUFFIXES,
    default_channels,
    read_mask,
    read_pixels,
    read_points,
    write_pixels,
    write_points,
)
from hagoromo.photograph.transforms import (
    CaptureRecord,
    FrameRecord,
    ImageSettings,
    lamp_from_record,
    lamps_of_frame,
    record_from_lamp,
    record_from_sensor,
    response_from_record,
)

TRANSFORMS = "transforms.json"
# keys at the top of the file that frames do not inherit; a frame's sensor overrides single keys of the file's
OF_THE_FILE = {*CaptureRecord.__struct_fields__, "pl_pos"} - {*ImageSettings.__struct_fields__} | {"sensor"}
OF_ONE_FRAME = ("file_path", "name", "mask_path", "transform_matrix", "lamps")
NORMALS = ("N.X", "N.Y", "N.Z")  # EXR channels
SHEET_COLUMNS, SHEET_WIDTH = 4, 800  # picture in a notebook: photographs per row, and width of a row [px]
BYTES_PER_VALUE = 9  # of a photograph: float32 value, float32 variance and boolean `native`


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs of one object.

    folder: where it was read from. truth: ground truth of a simulation, as in its file. points: (height, width, 3) [m]
    and normals: (height, width, 3), unit vectors, world axes, 0 where unknown: the shape, if it is known; all
    photographs then share one camera and view. Raises `InputError` without a photograph, or if the parts do not match.
    settings, seed: those that a simulation was made with. assumptions: what is taken for given, such as the transfer
    curve of 8-bit files, and from where.
    """

    photographs: tuple[Photograph, ...]
    name: str = ""
    folder: Path | None = None
    truth: dict[str, Any] | None = None
    points: NDArray[np.floating] | None = None
    normals: NDArray[np.float32] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    assumptions: Mapping[str, str] = field(default_factory=dict)

    @property
    def own_name(self) -> str:
        """The name that it states; "" where that is only its folder's, which says where the files are."""
        return "" if self.folder is not None and self.name == self.folder.resolve().name else self.name

    @property
    def one_response(self) -> bool:
        """Whether all photographs have equal camera responses, or none has one."""
        first = self.photographs[0].camera.response
        others = [photograph.camera.response for photograph in self.photographs[1:]]
        return all(other is None if first is None else first.equals(other) for other in others)

    def __post_init__(self) -> None:
        """Check that the parts match."""
        object.__setattr__(self, "photographs", tuple(self.photographs))
        if not self.photographs:
            raise InputError(f"capture {self.name!r} has no photograph: give at least one")
        cameras = [photograph.camera for photograph in self.photographs]
        size = (cameras[0].height, cameras[0].width, 3)
        for what, vectors in (("points", self.points), ("normals", self.normals)):
            if vectors is not None and vectors.shape != size:
                raise InputError(f"{what} have shape {vectors.shape} and the photographs need {size}: resize them")
            if vectors is not None and not all(np.allclose(c.matrix, cameras[0].matrix, rtol=1e-6) for c in cameras):
                raise InputError(f"{what} are of one view and the photographs of several: leave {what} out")

    def __repr__(self) -> str:
        """The name, the photographs and whether the shape is known."""
        height, width = self.photographs[0].values.shape[:2]
        shape = "unknown shape" if self.points is None or self.normals is None else "known shape"
        return f"Capture({self.name!r}, {len(self.photographs)} photographs of {width} × {height} px, {shape})"

    def _repr_png_(self) -> bytes:
        """All photographs, reduced, side by side, in a notebook."""
        import cv2

        columns = min(len(self.photographs), SHEET_COLUMNS)
        width = SHEET_WIDTH // columns
        tiles = []
        for photograph in self.photographs:
            picture = photograph.display()
            height = max(round(width * picture.shape[0] / picture.shape[1]), 1)
            tiles.append(np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8))
        tall = max(tile.shape[0] for tile in tiles)
        rows = -(-len(tiles) // columns)
        sheet = np.full((rows * tall, columns * width, 3), 255, np.uint8)
        for k, tile in enumerate(tiles):
            top, left = k // columns * tall, k % columns * width
            sheet[top : top + tile.shape[0], left : left + width] = tile
        return png_bytes(sheet)

    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write the capture to `folder`; see `save_capture`."""
        return save_capture(self, folder, force)


def capture_file(folder: str | Path) -> Path:
    """The transforms file of the capture in `folder`, or `folder` itself where it is a .json; `InputError` for none."""
    if Path(folder).suffix == ".json":
        return Path(folder)
    return of_folder(folder, TRANSFORMS, "a capture, as `hagoromo capture` makes them")


def load_capture(folder: str | Path, frames: slice | None = None, demosaic: Demosaic = "bilinear") -> Capture:
    """The capture in `folder` (or in a transforms file of another name), or a slice of its frames.

    Values are in units of ρ where the sensor's `exposure` is known, else (DN − black)/(white − black) per second of
    exposure at ISO 100; RAW files state both. PNG, TIFF and JPEG are read as linear unless `transfer` is "srgb". A
    pixel is invalid if it is saturated, not opaque, or black in the mask. If the file does not describe the sensor, the
    variance is that of a typical one (`transforms.ASSUMED_FULL_WELL`). A frame with neither `lamps` nor `pl_pos` has no
    lamps. Frames without an image are omitted with a warning; `InputError` for other missing or contradictory data.
    """
    file = capture_file(folder)
    record, home = read_json(file), file.parent
    top = decode(record, CaptureRecord, str(file))
    lamps = [lamp_from_record(lamp, home, f"{file} lamp {i}") for i, lamp in enumerate(top.lamps)]
    response = response_from_record(top.sensor, home, str(file))
    shared = {key: value for key, value in record.items() if key not in OF_THE_FILE}
    photographs: list[Photograph] = []
    chosen = _present(file, list(enumerate(top.frames))[frames or slice(None)])
    for i, stated, path in chosen:
        where = f"{file} frame {i} ({path.name})"
        frame = decode({**shared, **stated}, FrameRecord, where)
        frame = structs.replace(frame, sensor={**top.sensor, **frame.sensor})
        photograph = _photograph(frame, path, home, response.channels if response else (), demosaic, where)
        lit = lamps_of_frame(frame, lamps, where)
        if not photographs:
            require(float(BYTES_PER_VALUE) * photograph.values.size * len(chosen), str(file))
        photographs.append(replace(photograph, camera=replace(photograph.camera, response=response), lamps=lit))
    return Capture(
        tuple(photographs),
        home.resolve().name if top.name is None else top.name,
        home,
        top.truth,
        None if top.points_path is None else read_points(inside(home, top.points_path)),
        None if top.normals_path is None else _read_normals(inside(home, top.normals_path)),
        top.hagoromo.settings,
        top.hagoromo.seed,
        top.assumptions,
    )


def save_capture(capture: Capture, folder: str | Path, force: bool = False) -> Path:
    """Write `capture` to `folder`, completely or not at all; `load_capture` returns the same photographs.

    `InputError` if the folder exists without `force`, or the photographs have different responses.
    """
    response = capture.photographs[0].camera.response
    if not capture.one_response:
        raise InputError(f"capture {capture.name!r} has several camera responses: save one capture for each")
    lamps: dict[str, int] = {}
    with whole_folder(folder, force) as home:
        frames = [_write_frame(photograph, i, home, lamps) for i, photograph in enumerate(capture.photographs)]
        shared = shared_keys(frames)
        if response:
            shared["sensor"] = {**shared.get("sensor", {}), "response": write_response(response, home)}
        if capture.points is not None:
            write_points(home / "points.exr", capture.points)
            shared["points_path"] = "points.exr"
        if capture.normals is not None:
            known = np.isfinite(capture.normals).all(axis=2, keepdims=True)
            normals = np.moveaxis(np.where(known, capture.normals, 0.0), 2, 0)
            write_exr(home / "normals.exr", dict(zip(NORMALS, normals, strict=True)))
            shared["normals_path"] = "normals.exr"
        if capture.truth is not None:
            shared["truth"] = capture.truth
        if capture.assumptions:
            shared["assumptions"] = dict(capture.assumptions)
        own = [{k: v for k, v in frame.items() if k not in shared or shared[k] != v} for frame in frames]
        listed = [json.loads(lamp) for lamp in lamps]
        named = {"name": capture.own_name} if capture.own_name else {}
        top = {"hagoromo": written_by(capture.settings, capture.seed), **named, **shared}
        write_json(home / TRANSFORMS, {**top, "lamps": listed, "frames": own})
    return Path(folder)


def shared_keys(frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The keys that all frames have with one value, which stand at the top of the file."""
    return {
        key: value
        for key, value in frames[0].items()
        if key not in OF_ONE_FRAME and all(frame.get(key) == value for frame in frames)
    }


def write_response(response: Response, home: Path) -> str:
    """Write the response to the capture's folder; the name of its file."""
    name = re.sub(r"[^\w .()-]", "_", response.name or "response") + ".csv"
    response.write_table(home / name)
    return name


def count_absent(file: Path, frames: Sequence[Any]) -> int:
    """Number of frames of a transforms file without an image, including frames that name none."""
    named = [frame.get("file_path") if isinstance(frame, dict) else None for frame in frames]
    return sum(
        not (isinstance(name, str) and _image_path(file, i, {"file_path": name}).exists())
        for i, name in enumerate(named)
    )


class _Image(ForeignRecord, frozen=True):
    file_path: str


def _present(file: Path, frames: list[tuple[int, dict[str, Any]]]) -> list[tuple[int, dict[str, Any], Path]]:
    """(index, frame, path of its image) of the frames whose image exists."""
    located = [(i, frame, _image_path(file, i, frame)) for i, frame in frames]
    present = [entry for entry in located if entry[2].exists()]
    if not present:
        raise InputError(f"{file}: none of the {len(located)} frames has an image: check the folder of the images")
    if len(present) < len(located):
        absent = len(located) - len(present)
        warnings.warn(f"{file}: {absent} of {len(located)} frames have no image and are left out", stacklevel=3)
    return present


def _image_path(file: Path, index: int, frame: Mapping[str, Any]) -> Path:
    """The image of a frame; NeRF's files omit its suffix."""
    name = decode(frame, _Image, f"{file} frame {index}").file_path
    path = inside(file.parent, name)
    if path.suffix.lower() in SUFFIXES:
        return path
    if path.is_file():
        raise InputError(f"{path} is not an image of a known format: give one of {', '.join(SUFFIXES)}")
    named = [inside(file.parent, name + suffix) for suffix in SUFFIXES]
    return next((candidate for candidate in named if candidate.exists()), named[0])


def _photograph(
    frame: FrameRecord, path: Path, home: Path, channels: tuple[str, ...], demosaic: Demosaic, where: str
) -> Photograph:
    pixels = read_pixels(path, frame, channels or default_channels(3), demosaic, where)
    height, width = pixels.values.shape[:2]
    camera = replace(camera_from_record(frame, (height, width), where), sensor=pixels.sensor)
    valid, silhouette = pixels.valid, pixels.opaque
    if frame.mask_path is not None:
        mask = read_mask(inside(home, frame.mask_path), (height, width))
        valid, silhouette = valid & mask, mask if silhouette is None else silhouette & mask
    name = path.stem if frame.name is None else frame.name
    return Photograph(pixels.values, pixels.variance, valid, camera, (), name, pixels.native, silhouette)


def _write_frame(photograph: Photograph, index: int, home: Path, lamps: dict[str, int]) -> dict[str, Any]:
    """Write the images of a photograph and return its frame. lamps: lamps listed so far, JSON text → index."""
    (home / "images").mkdir(exist_ok=True)
    image = write_pixels(photograph, home / "images" / f"{index:04d}")
    lit = [json.dumps(record_from_lamp(lamp)) for lamp in photograph.lamps]
    frame = {
        "file_path": image.relative_to(home).as_posix(),
        "name": photograph.name,
        **record_from_camera(photograph.camera),
        "lamps": [lamps.setdefault(lamp, len(lamps)) for lamp in lit],
    }
    if photograph.camera.sensor:
        frame["sensor"] = record_from_sensor(photograph.camera.sensor)
    mask = photograph.mask if photograph.silhouette is None else photograph.silhouette  # the image says what is clipped
    if not mask.all():
        (home / "masks").mkdir(exist_ok=True)
        frame["mask_path"] = f"masks/{index:04d}.png"
        write_png(home / frame["mask_path"], mask.astype(np.uint8) * 255)
    return frame


def _read_normals(path: Path) -> NDArray[np.float32]:
    layers, _ = read_exr(path)
    lacking = [name for name in NORMALS if name not in layers]
    if lacking:
        raise InputError(f"{path} lacks the channel {lacking[0]}: normals have {', '.join(NORMALS)}")
    return np.stack([layers[name] for name in NORMALS], axis=2)
