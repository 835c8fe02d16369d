"""Points of the pixels of a picture as EXR: channels P.X, P.Y, P.Z in single precision [m], world, 0 where unknown.

Single precision keeps 1 mm at 10 km. So points that lie far out are counted from a place beside them, which the text
`points_origin` in the header of the file states, as three numbers [m].
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr

CHANNELS = ("P.X", "P.Y", "P.Z")
ORIGIN = "points_origin"  # key of the header
FAR = 16.0  # sizes of the surface, from which on its points are counted from a place beside it


def write_points(path: str | Path, points: NDArray[np.floating]) -> None:
    """Write `points` (height, width, 3) [m], 0 or not finite where unknown."""
    known = _known(points)
    origin = _beside(points[known].astype(np.float64)) if known.any() else np.zeros(3)
    counted = np.where(known[..., None], points - origin, 0.0)
    header = {ORIGIN: " ".join(map(repr, origin.tolist()))} if origin.any() else None
    write_exr(path, dict(zip(CHANNELS, np.moveaxis(counted, 2, 0), strict=True)), header)


def read_points(path: str | Path) -> NDArray[np.floating]:
    """Points (height, width, 3) [m]; in double precision where the file states an origin. `InputError` if damaged."""
    layers, header = read_exr(path)
    lacking = [name for name in CHANNELS if name not in layers]
    if lacking:
        raise InputError(f"{path} lacks the channel {lacking[0]}: points have {', '.join(CHANNELS)}")
    points = np.stack([layers[name] for name in CHANNELS], axis=2)
    if ORIGIN not in header:
        return points
    origin = _numbers(header[ORIGIN])
    if origin is None:
        raise InputError(f"{path}: {ORIGIN} is {header[ORIGIN]!r:.60}: give three finite numbers [m]")
    known = _known(points)
    placed = np.zeros(points.shape)
    placed[known] = points[known] + origin
    return placed


def _known(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    return np.isfinite(points).all(axis=2) & (points != 0.0).any(axis=2)


def _beside(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """A place one size beside `places` (n, 3), so that none of them is 0 seen from it; 0 where they are not far out."""
    low, size = places.min(axis=0), float(np.linalg.norm(np.ptp(places, axis=0)))
    return low - size if np.abs(places).max() > FAR * size > 0.0 else np.zeros(3)


def _numbers(text: str) -> NDArray[np.float64] | None:
    """Three finite numbers; None for anything else."""
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        return None
    return numbers if numbers.shape == (3,) and np.isfinite(numbers).all() else None
