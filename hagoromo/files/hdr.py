"""Radiance's HDR pictures (.hdr, RGBE): three linear channels of 8 bits with a common exponent, by OpenCV.

The lines EXPOSURE and PRIMARIES of the header are not applied; colours are taken for linear sRGB.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import check_density, existing_file, read_bytes
from hagoromo.files.finite import check_finite
from hagoromo.files.memory import require
from hagoromo.files.reading import opencv_silenced, reading
from hagoromo.files.whole import write_bytes

STARTS = (b"#?RADIANCE", b"#?RGBE")
SIZE = re.compile(rb"\n\n([-+])Y (\d{1,7}) ([-+])X (\d{1,7})\n")
LARGEST_HEADER = 1 << 16  # bytes
MOST_PIXELS_PER_BYTE = 32.0  # a run of 127 takes two bytes in each of four channels: 16
BYTES = 40.0  # memory of a pixel
LARGEST_SIDE = 1 << 20  # px


def read_hdr(path: str | Path) -> NDArray[np.float32]:
    """The picture: (height, width, 3), linear R, G, B, decoded in a process apart.

    `InputError` for what is damaged, turned or no such file.
    """
    height, width = hdr_size(path)
    require(BYTES * height * width, str(path))
    image = read_apart(pixels_by_opencv, path, "HDR", stated=BYTES * height * width)["pixels"]
    if image.shape != (height, width, 3):
        raise InputError(f"{path} is cut off or damaged: copy it again")
    return image


def hdr_size(path: str | Path) -> tuple[int, int]:
    """(height, width) [px] of a picture that is not turned, from its header; `InputError` for other files."""
    file = existing_file(path)
    with file.open("rb") as opened:
        start = opened.read(LARGEST_HEADER)
    size = SIZE.search(start) if start.startswith(STARTS) else None
    if size is None:
        raise InputError(f"{path} is no picture of Radiance, or it is damaged: give a .hdr")
    height, width = int(size[2]), int(size[4])
    if (size[1], size[3]) != (b"-", b"+") or not 0 < height < LARGEST_SIDE or not 0 < width < LARGEST_SIDE:
        raise InputError(f"{path} is turned or has {width} × {height} px: write it anew, from above and from the left")
    check_density(height * width, file, MOST_PIXELS_PER_BYTE, f"{width} × {height} pixels")
    return height, width


def pixels_by_opencv(path: Path) -> Mapping[str, NDArray[np.float32]]:
    """pixels, as of `read_hdr`, by which it is run apart."""
    import cv2

    with reading(path, "HDR"), opencv_silenced():
        image = cv2.imdecode(np.frombuffer(read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3:
        raise InputError(f"{path} is cut off or damaged: copy it again")
    return {"pixels": np.ascontiguousarray(image[..., ::-1], np.float32)}


def write_hdr(path: str | Path, image: NDArray) -> None:
    """Write linear R, G, B (height, width, 3); what is below 0 becomes 0, the rest keeps 8 bits of the brightest."""
    import cv2

    values = np.maximum(np.asarray(image, np.float32), 0.0)
    if values.ndim != 3 or values.shape[2] != 3:
        raise InputError(f"a .hdr holds three channels: given an array of {values.shape}")
    check_finite({"the picture": values}, Path(path).name)
    done, encoded = cv2.imencode(".hdr", values[..., ::-1])
    if not done:
        raise OSError(f"an image of shape {values.shape} could not be encoded as HDR")
    write_bytes(path, encoded.tobytes())
