"""Facts about pictures and volumes: from their headers alone, and from their decoded pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files import jpeg, png
from hagoromo.files.exif import read_exif
from hagoromo.files.exr import exr_header, read_exr
from hagoromo.files.hdr import hdr_size, read_hdr
from hagoromo.files.picture import picture_size, read_picture
from hagoromo.files.raw import raw_size, read_raw
from hagoromo.files.record import json_value
from hagoromo.files.tiff import read_tiff, tiff_page
from hagoromo.files.volume_file import look_at_volume, read_volume
from hagoromo.image.picture.full_error import FullError
from hagoromo.image.picture.image import lamp_names_in
from hagoromo.image.picture.sums_channels import NAME as CHANNEL_OF_SUMS

Facts = dict[str, Any]
LONGEST_TEXT = 200  # characters that are shown
PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 4, 6: 4}  # of each colour type, as they are decoded, without a clear colour


def volume(path: Path) -> Facts:
    """Of a volume in any format."""
    held = look_at_volume(path)
    place = {} if held.matrix is None else {"matrix": held.matrix.tolist()}
    return {
        "kind": "volume",
        "voxels": list(held.shape[2::-1]),
        "components": 1 if len(held.shape) == 3 else held.shape[3],
        "type": str(held.dtype),
        "voxel_size": None if held.edges is None else held.edges.tolist(),
        **place,
    }


def exr(path: Path) -> Facts:
    """Of an EXR: its channels and texts; of a picture of ours the names of its lamps."""
    part = exr_header(path)
    lamps = {"lamps": list(lamp_names_in(part.texts["palette"], path))} if "palette" in part.texts else {}
    record = json_value(part.texts.get("hagoromo", "{}"), f"{path}: hagoromo")
    error = FullError.of(record if isinstance(record, dict) else {})
    stated = {"error": error.line()} if error else {}
    shown = [name for name in part.channels if not CHANNEL_OF_SUMS.fullmatch(name)]
    texts = {k: v if len(v) <= LONGEST_TEXT else f"{len(v)} characters" for k, v in part.texts.items()}
    return {"kind": "EXR image", "size": [part.width, part.height], "channels": shown, **lamps, **stated, **texts}


def picture(path: Path) -> Facts:
    """Of a PNG or JPEG, known by its first bytes."""
    height, width = picture_size(path)
    with path.open("rb") as file:
        is_png = file.read(len(png.SIGNATURE)).startswith(png.SIGNATURE)
    if is_png:
        header = png.png_header(path)
        channels, bits = PNG_CHANNELS[header.colour], header.depth
    else:
        channels, bits = jpeg.frame_header(path).channels, 8
    return {"kind": "picture", "size": [width, height], "channels": channels, "bits": bits, **_exposure(path)}


def tiff(path: Path) -> Facts:
    """Of a TIFF: its first image."""
    page = tiff_page(path)
    channels = page.shape[2] if len(page.shape) == 3 else 1
    size = [page.shape[1], page.shape[0]]
    return {"kind": "TIFF", "size": size, "channels": channels, "bits": 8 * page.kind.itemsize, **_exposure(path)}


def hdr(path: Path) -> Facts:
    """Of a picture of Radiance."""
    height, width = hdr_size(path)
    return {"kind": "HDR image", "size": [width, height], "channels": 3}


def raw(path: Path) -> Facts:
    """Of a camera's RAW file: its size and its settings."""
    height, width = raw_size(path)
    return {"kind": "camera RAW", "size": [width, height], **_exposure(path)}


def _exposure(path: Path) -> Facts:
    """The EXIF settings of the exposure."""
    return {key: value for key, value in asdict(read_exif(path)).items() if value}


def _range(values: Any) -> list[float]:
    return [float(np.nanmin(values)), float(np.nanmax(values))]


def _decoded_exr(path: Path) -> Facts:
    channels = read_exr(path)[0]
    return {name: _range(values) for name, values in channels.items() if not CHANNEL_OF_SUMS.fullmatch(name)}


def _decoded_picture(path: Path) -> Facts:
    image = read_picture(path)
    return {"range": [int(image.min()), int(image.max())]}


def _decoded_raw(path: Path) -> Facts:
    shot = read_raw(path)
    exif = {key: value for key, value in asdict(shot.exif).items() if value}  # also what LibRaw alone knows
    return {"mosaic": shot.mosaic, "black": np.unique(shot.black).tolist(), "white": shot.white, **exif}


DECODED: dict[str, Callable[[Path], Facts]] = {
    "OpenEXR": _decoded_exr, "PNG": _decoded_picture, "JPEG": _decoded_picture, "camera RAW": _decoded_raw,
    "TIFF": lambda path: {"range": _range(read_tiff(path))},
    "Radiance HDR": lambda path: {"range": _range(read_hdr(path))},
}  # fmt: skip


def decoded(name: str, holds: str, path: Path) -> Facts:
    """What only the pixels or the voxels of a file show; `InputError` for a format that has none.

    name, holds: of its format.
    """
    if holds == "volume":
        return {"range": _range(read_volume(path).values)}
    if name not in DECODED:
        raise InputError(f"{path} has no pixels to decode: leave out --decode")
    return DECODED[name](path)
