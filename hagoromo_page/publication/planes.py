"""Planes: maps of whole numbers as the text of a page, and back.

A plane is (h, w) uint16. Each value is predicted from its neighbours on the left and above, so that smooth maps become
small differences; these are folded to whole numbers from 0 (0, −1, 1, −2 …), split into low and high bytes, deflated
and written in base64. A browser undoes it exactly, without any management of colours.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

PREDICTORS = ("left", "mean", "slope", "middle")  # from left a, above b and diagonal c: a; (a + b) / 2; a + b − c; 2¹⁵
LEVELS = 1 << 16
MASK = "label"  # the plane that says where the others are known
Plane = NDArray[np.uint16]


@dataclass(frozen=True)
class PackedPlanes:
    """Planes of one size. header: what a page needs to unpack them. text: base64."""

    header: dict[str, Any]
    text: str


def pack_planes(planes: Mapping[str, Plane], known: NDArray[np.bool_], level: int = 9) -> PackedPlanes:
    """Planes by name, each (h, w); values outside `known` are replaced by what costs least, except those of MASK.

    level: effort of the compression, 1 … 9.
    """
    listed, streams = [], []
    nearest = _nearest_known(known)
    for name, plane in planes.items():
        filled = plane if name == MASK else plane.ravel()[nearest].reshape(plane.shape)
        folded = [_folded(filled, kind) for kind in PREDICTORS]
        sizes = [len(zlib.compress(one.astype("<u2").tobytes(), 1)) for one in folded]
        best = int(np.argmin(sizes))
        high = folded[best] >> 8
        listed.append({"name": name, "predictor": PREDICTORS[best], "high": bool(high.any())})
        streams.append((folded[best] & 255).astype(np.uint8).tobytes())
        if high.any():
            streams.append(high.astype(np.uint8).tobytes())
    height, width = known.shape
    header = {"width": width, "height": height, "planes": listed}
    return PackedPlanes(header, base64.b64encode(zlib.compress(b"".join(streams), level)).decode())


def unpack_planes(packed: PackedPlanes) -> dict[str, Plane]:
    """The planes that `pack_planes` packed, as the page's script unpacks them.

    >>> ramp = np.arange(15, dtype=np.uint16).reshape(3, 5)
    >>> bool((unpack_planes(pack_planes({"a": ramp}, ramp >= 0))["a"] == ramp).all())
    True
    """
    data = np.frombuffer(zlib.decompress(base64.b64decode(packed.text)), np.uint8).astype(np.int64)
    shape = packed.header["height"], packed.header["width"]
    size, at, planes = shape[0] * shape[1], 0, {}
    for one in packed.header["planes"]:
        folded = data[at : at + size]
        at += size
        if one["high"]:
            folded = folded + (data[at : at + size] << 8)
            at += size
        planes[one["name"]] = _unfolded(folded.reshape(shape), one["predictor"])
    return planes


def _nearest_known(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index (h·w) of the known pixel before each pixel in the order of rows; of the first one before all of them."""
    flat = known.ravel()
    if not flat.any():
        return np.zeros(flat.size, np.int64)
    index = np.where(flat, np.arange(flat.size), -1)
    return np.where((last := np.maximum.accumulate(index)) < 0, np.flatnonzero(flat)[0], last)


def _folded(plane: Plane, predictor: str) -> NDArray[np.int64]:
    """Differences from the prediction, as whole numbers from 0."""
    values = plane.astype(np.int64)
    left, above, diagonal = _neighbours(values)
    middle = np.full_like(left, LEVELS // 2)
    guess = {"left": left, "mean": (left + above) >> 1, "slope": left + above - diagonal, "middle": middle}[predictor]
    difference = (values - guess + LEVELS // 2) % LEVELS - LEVELS // 2
    return np.where(difference < 0, -2 * difference - 1, 2 * difference)


def _neighbours(values: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Values on the left, above and diagonal; in the first row all are the left one, in the first column that above."""
    left, above, diagonal = (np.zeros_like(values) for _ in range(3))
    left[:, 1:] = values[:, :-1]
    above[1:] = values[:-1]
    diagonal[1:, 1:] = values[:-1, :-1]
    above[0], diagonal[0] = left[0], left[0]
    left[1:, 0] = diagonal[1:, 0] = above[1:, 0]
    return left, above, diagonal


def _unfolded(folded: NDArray[np.int64], predictor: str) -> Plane:
    """The inverse of `_folded`."""
    difference = np.where(folded & 1, -(folded + 1) // 2, folded // 2)
    values = np.zeros_like(difference)
    for r in range(values.shape[0]):
        for c in range(values.shape[1]):
            left = values[r, c - 1] if c else (values[r - 1, 0] if r else 0)
            above = values[r - 1, c] if r else left
            diagonal = values[r - 1, c - 1] if r and c else (above if r else left)
            slope = left + above - diagonal
            guess = {"left": left, "mean": (left + above) >> 1, "slope": slope, "middle": LEVELS // 2}[predictor]
            values[r, c] = (guess + difference[r, c]) % LEVELS
    return values.astype(np.uint16)
