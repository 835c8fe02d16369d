"""Transfer curve: numbers of a display-encoded picture → linear light, stated or estimated from a bracket.

A table holds the light of every number, per channel, scaled so that the largest number keeps its value. The slope
determines the quantisation error in light; an estimated curve also has a standard error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.table import read_table
from hagoromo.light.colour import srgb_decode

SMOOTHNESS = 50.0  # weight of the curve's second difference (Debevec and Malik's λ), for 8-bit noise of about 1 DN
CURVE_PIXELS = 300  # pixels per photograph in one fit
CURVE_DRAWS = 6  # random draws of such pixels; the curve is the mean of their fits
SMOOTHER = 4.0  # factor on SMOOTHNESS of a second fit, whose difference estimates the bias by smoothing
RIDGE = 1e-6  # added to the diagonal of the normal equations, whose other entries are 1 to 4e7
FEWEST_SHOTS = 3  # least number of exposures; with two, the smoothness determines most of the curve


@dataclass(frozen=True, eq=False)
class Transfer:
    """table: (levels, 1 or 3), light of every number, not decreasing; the last entry equals its number.

    error: (levels, 1 or 3), standard error of that light; None if the curve is exact.
    """

    table: NDArray[np.float64]
    error: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check the tables once."""
        rises = np.diff(self.table, axis=0)
        if self.table.ndim != 2 or not np.isfinite(self.table).all() or (rises < 0.0).any() or not rises.any():
            raise InputError("a transfer curve must rise from its first number to its last: correct it")
        if self.error is not None and (self.error.shape != self.table.shape or not (self.error >= 0.0).all()):
            raise InputError("the error of a transfer curve must be 0 or more for every number: correct it")

    @staticmethod
    def load(source: str | Path, largest: int) -> Transfer:
        """ "linear", "srgb" (IEC 61966-2-1), or a CSV of `number` (0 … largest) and `light`, or `R`, `G`, `B`."""
        number = np.arange(largest + 1.0)
        if source == "linear":
            return Transfer(number[:, None])
        if source == "srgb":
            return Transfer(largest * srgb_decode(255.0 * number / largest)[:, None])
        if not str(source).endswith(".csv"):
            raise InputError(f"no transfer curve is called {source!r}: give linear, srgb, estimate or a CSV file")
        table = read_table(source)
        names = [name for name in (("light",), ("R", "G", "B")) if set(name) <= set(table)]
        if "number" not in table or not names or (np.diff(table["number"]) <= 0.0).any():
            raise InputError(
                f"{source} must have increasing numbers in the column `number` and their light in `light` or R, G, B"
            )
        light = np.stack([np.interp(number, table["number"], table[name]) for name in names[0]], axis=1)
        return Transfer(_scaled(light))

    def light(self, numbers: NDArray) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | float]:
        """Light of `numbers` (height, width[, channels]), and its variances by rounding and by the curve, same shape.

        The error of the curve is common to all samples of one number: averaging does not reduce it.
        """
        bounds = np.arange(len(self.table) + 1.0) - 0.5
        place = np.clip(bounds, 0.0, len(self.table) - 1.0)
        columns = [self.table[:, c] for c in range(self.table.shape[1])]
        edges = np.stack([np.interp(place, bounds[:-1] + 0.5, column) for column in columns], axis=1)
        light, rounding = self.table.astype(np.float32), (np.diff(edges, axis=0) ** 2 / 12.0).astype(np.float32)
        channel = 0 if self.table.shape[1] == 1 else np.arange(3)
        curve = 0.0 if self.error is None else (self.error**2).astype(np.float32)[numbers, channel]
        return light[numbers, channel], rounding[numbers, channel], curve


def estimate_transfer(photographs: Sequence[NDArray], exposures_s: Sequence[float], seed: int = 0) -> Transfer:
    """The curve of 8-bit photographs of one scene at several exposures [s], with its error.

    photographs: (height, width, 3) for a curve per channel; (height, width), also behind a mosaic, for one curve.

    Method of Debevec and Malik (1997), "Recovering high dynamic range radiance maps from photographs" (doi
    10.1145/258734.258884), for several random draws of pixels. Their scatter is the random error; the difference to a
    smoother fit estimates the error by smoothing.
    `InputError` for fewer than three exposures or pictures of different shapes.
    """
    different = len(set(exposures_s))
    if different < FEWEST_SHOTS:
        raise InputError(f"a response is estimated from {FEWEST_SHOTS} exposures or more: given {different} different")
    if any(p.dtype != np.uint8 or p.ndim not in (2, 3) or p.shape != photographs[0].shape for p in photographs):
        raise InputError("a response is estimated from 8-bit photographs of one size only: state it instead")
    channels = 1 if photographs[0].ndim == 2 else photographs[0].shape[2]
    random, times = np.random.default_rng(seed), np.asarray(exposures_s, np.float64)
    fits: list[NDArray[np.float64]] = []
    smoother: list[NDArray[np.float64]] = []
    for _ in range(CURVE_DRAWS):
        pick = random.integers(photographs[0].size // channels, size=CURVE_PIXELS)
        chosen = [photograph.reshape(-1, channels)[pick] for photograph in photographs]
        fits.append(_fitted(chosen, times, SMOOTHNESS))
        smoother.append(_fitted(chosen, times, SMOOTHER * SMOOTHNESS))
    table = np.mean(fits, axis=0)
    chance, smoothness = np.std(fits, axis=0, ddof=1), np.mean(smoother, axis=0) - table
    return Transfer(table, np.hypot(chance, smoothness))


def _fitted(photographs: Sequence[NDArray], times: NDArray[np.float64], smoothness: float) -> NDArray[np.float64]:
    """Light of every number (256, channels), from pixels (pixels, channels) of the photographs: Debevec & Malik (3)."""
    channels = photographs[0].shape[1]
    curves = [_debevec(np.stack([p[:, c] for p in photographs], axis=1), times, smoothness) for c in range(channels)]
    return _scaled(np.maximum.accumulate(np.exp(np.stack(curves, axis=1)), axis=0))


def _debevec(numbers: NDArray, times: NDArray[np.float64], smoothness: float) -> NDArray[np.float64]:
    """g (256,), the logarithm of the light of every number, from the numbers (pixels, photographs) of one channel.

    Minimises Σ (w(Z) (g(Z) − ln E − ln t))² + Σ (λ w(z) g''(z))² with g(128) = 0 over g and the pixels' ln E, with the
    triangle of weights w, 0 at both ends, by the sparse normal equations. OpenCV solves the same by a dense SVD in
    single precision, which takes ten times as long; RIDGE replaces its minimum norm where no pixel has weight.
    """
    from scipy.sparse import coo_array, eye_array
    from scipy.sparse.linalg import spsolve

    pixels, shots = numbers.shape
    levels = np.arange(256)
    weight = np.minimum(levels, 255.0 - levels)
    number, pixel = numbers.ravel().astype(int), np.repeat(np.arange(pixels), shots)
    reading, smooth = np.arange(number.size), number.size + 1 + np.arange(254)
    bend = smoothness * weight[1:-1]
    rows = np.concatenate([reading, reading, [number.size], smooth, smooth, smooth])
    columns = np.concatenate([number, 256 + pixel, [128], levels[:-2], levels[1:-1], levels[2:]])
    values = np.concatenate([weight[number], -weight[number], [1.0], bend, -2.0 * bend, bend])
    matrix = coo_array((values, (rows, columns)), shape=(number.size + 255, 256 + pixels)).tocsc()
    right = np.zeros(number.size + 255)
    right[reading] = weight[number] * np.tile(np.log(times), pixels)
    normal = matrix.T @ matrix + RIDGE * eye_array(256 + pixels)
    return np.asarray(spsolve(normal.tocsc(), matrix.T @ right))[:256]


def _scaled(light: NDArray[np.float64]) -> NDArray[np.float64]:
    last = light[-1:]
    if not (np.isfinite(last) & (last > 0.0)).all():
        raise InputError("a transfer curve must end above 0: correct it")
    return light / last * (len(light) - 1.0)
