"""Transfer: the numbers of a display picture → light, from a stated curve or one estimated from a bracket.

A table gives for every number the light that makes it, per channel, scaled so that the largest number keeps its value.
Its slope tells how coarse the rounding of a number is in light.
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
SAMPLES = 300  # pixels per photograph that the curve is fitted to
FEWEST_SHOTS = 3  # of a bracket; two leave most of the curve to its smoothness


@dataclass(frozen=True, eq=False)
class Transfer:
    """table: (levels, 1 or 3), light of every number, never falling, the last as large as its number."""

    table: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the table once."""
        rises = np.diff(self.table, axis=0)
        if self.table.ndim != 2 or not np.isfinite(self.table).all() or (rises < 0.0).any() or not rises.any():
            raise InputError("a transfer curve must rise from its first number to its last: mend it")

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
            raise InputError(f"{source} must have increasing numbers in `number` and their light in `light` or R, G, B")
        light = np.stack([np.interp(number, table["number"], table[name]) for name in names[0]], axis=1)
        return _scaled(light)

    def light(self, numbers: NDArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Light of `numbers` (height, width[, channels]) and the variance of their rounding, of the same shape."""
        at = np.arange(len(self.table) + 1.0) - 0.5
        place = np.clip(at, 0.0, len(self.table) - 1.0)
        columns = [self.table[:, c] for c in range(self.table.shape[1])]
        edges = np.stack([np.interp(place, at[:-1] + 0.5, column) for column in columns], axis=1)
        light, rounding = self.table.astype(np.float32), (np.diff(edges, axis=0) ** 2 / 12.0).astype(np.float32)
        if self.table.shape[1] == 1:
            return light[numbers, 0], rounding[numbers, 0]
        channel = np.arange(3)
        return light[numbers, channel], rounding[numbers, channel]


def estimate_transfer(photographs: Sequence[NDArray], exposures_s: Sequence[float]) -> Transfer:
    """The curve of 8-bit photographs (height, width, 3) of one scene at several exposures [s].

    Debevec and Malik (1997), "Recovering high dynamic range radiance maps from photographs", by OpenCV. `InputError`
    for fewer than three exposures or pictures of other shape.
    """
    import cv2

    different = len(set(exposures_s))
    if different < FEWEST_SHOTS:
        raise InputError(f"a response is estimated from {FEWEST_SHOTS} exposures or more: given {different} different")
    if any(p.dtype != np.uint8 or p.ndim != 3 or p.shape != photographs[0].shape for p in photographs):
        raise InputError("a response is estimated from 8-bit colour photographs of one size: state it instead")
    debevec = cv2.createCalibrateDebevec(samples=SAMPLES, lambda_=SMOOTHNESS)
    curve = debevec.process(list(photographs), np.asarray(exposures_s, np.float32))
    return _scaled(np.maximum.accumulate(np.asarray(curve, np.float64).reshape(256, 3), axis=0))


def _scaled(light: NDArray[np.float64]) -> Transfer:
    last = light[-1:]
    if not (np.isfinite(last) & (last > 0.0)).all():
        raise InputError("a transfer curve must end above 0: mend it")
    return Transfer(light / last * (len(light) - 1.0))
