"""Hanging: a piece of cloth in folds, gathered at its upper edge, from its geometry alone. Lengths in mm."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo_matter.drape.sheet import BYTES_PER_POINT, Sheet

UPPER_WIDTH_SHARE = 0.8  # width at the upper edge, as a share of that at the hem
SWAY = 0.1  # shift of the folds to the side between upper edge and hem, as a share of the width
HANGING_SPACING_MM = 1.5  # [mm] between the points of the sheet
LENGTH_POINTS = 4096  # points from which lengths are measured
CLOSER = 30  # bisections of the range of a row's width
SHALLOWEST = 0.45  # depth of the shallowest fold, relative to the deepest


def flat(size_mm: tuple[float, float]) -> Sheet:
    """A flat piece, width × height, that stands on z = 0 around x = 0 and faces −y."""
    u, v = _grid(size_mm)
    return Sheet(np.stack([u, np.zeros_like(u), v], axis=-1), u, v)


def hanging(size_mm: tuple[float, float], folds: int, depth_mm: float, seed: int = 0) -> Sheet:
    """A piece, width × height of the cloth, that hangs in `folds`, the deepest `depth_mm` at the hem.

    Its lower edge is at z = 0 around x = 0, and it faces −y. Every row has the length of the cloth: where it is
    gathered the folds are deeper. `InputError` where the folds need more cloth than there is.
    """
    (width, height), draw = size_mm, np.random.default_rng((seed, 77))
    if folds < 1 or not 0 <= depth_mm < 0.45 * width / folds:
        raise InputError(
            f"{folds} folds {depth_mm:g} mm deep do not fit {width:g} mm of cloth: give folds of at most "
            f"{0.45 * width / max(folds, 1):.3g} mm, or fewer"
        )
    depths = SHALLOWEST + (1.0 - SHALLOWEST) * draw.random(folds + 2)
    leans = 0.55 * (2.0 * draw.random(folds + 2) - 1.0)
    u, v = _grid(size_mm)
    points = np.zeros((*u.shape, 3))
    share = np.linspace(0.0, 1.0, LENGTH_POINTS)
    hem = _width(depth_mm * _folds(share * folds, depths, leans), width)
    for row, z in enumerate(v[:, 0]):
        fall = 1.0 - z / height
        wave = _folds(share * folds + SWAY * folds * np.sin(2.2 * fall), depths, leans)
        across = hem * (UPPER_WIDTH_SHARE + (1.0 - UPPER_WIDTH_SHARE) * fall)
        deep = _depth(wave, across, width) if depth_mm > 0 else 0.0
        across = across if depth_mm > 0 else width
        length = _lengths(share * across, deep * wave)
        at = np.interp((u[row] / width + 0.5) * length[-1], length, share)
        points[row] = np.stack([(at - 0.5) * across, -deep * (np.interp(at, share, wave) - 0.5), 0 * at + z], axis=-1)
    return Sheet(points, u, v)


def _grid(size_mm: tuple[float, float]) -> tuple[NDArray, NDArray]:
    """u and v of the points of a piece."""
    count = math.prod(max(8.0, edge / HANGING_SPACING_MM) for edge in size_mm)
    require(BYTES_PER_POINT * count, f"a cloth of {size_mm[0]:g} × {size_mm[1]:g} mm")
    along = [np.linspace(0.0, edge, max(8, round(edge / HANGING_SPACING_MM))) for edge in size_mm]
    u, v = np.meshgrid(along[0] - 0.5 * size_mm[0], along[1])
    return u, v


def _folds(turn: NDArray, depths: NDArray, leans: NDArray) -> NDArray:
    """Round folds, one for every whole step of `turn`, each with a depth and a lean of its own: 0…1."""
    index = np.floor(turn).astype(int) % len(depths)
    part = 2.0 * np.pi * (turn - np.floor(turn))
    return (0.5 - 0.5 * np.cos(part + leans[index] * np.sin(part))) * depths[index]


def _lengths(x: NDArray, y: NDArray) -> NDArray:
    """Length of a curve from its start to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])


def _width(profile: NDArray, length: float) -> float:
    """How wide a profile of given depth lies when the cloth in it is `length` long."""
    share, low, high = np.linspace(0.0, 1.0, len(profile)), 0.0, length
    for _ in range(CLOSER):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _lengths(share * middle, profile)[-1] < length else (low, middle)
    return low


def _depth(wave: NDArray, width: float, length: float) -> float:
    """How deep folds of a given shape are when cloth of `length` lies in `width`."""
    share, low, high = np.linspace(0.0, 1.0, len(wave)), 0.0, length
    for _ in range(CLOSER):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _lengths(share * width, middle * wave)[-1] < length else (low, middle)
    return low
