"""Doubtful readings: those that are clipped, and those that are given twice, are found before a response is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.positive_curve import typical_curve

NEAR_TOP = 0.98  # readings above this share of the largest may be clipped
FEWEST_AT_TOP = 3  # that many pile up there, if any is
LEAST_LOSS = 0.01  # share by which clipped readings fall short of what the others predict, in the median
LARGEST_REPEATED_ERROR = 0.1  # relative error of a repeated reading that may stay
SAME = 1e-9  # largest relative difference of equal readings or spectra
LEAST_LEFT = 0.5  # share of the pairs that must be left: a camera that reads all alike is not clipped
Array = NDArray[np.float64]


class Doubtful(NamedTuple):
    """clipped, repeated: channel → rows of the pairs, from 0, that are left out; repeated ones of every channel."""

    clipped: dict[str, NDArray[np.intp]]
    repeated: NDArray[np.intp]

    def sound(self, channel: str, count: int) -> NDArray[np.bool_]:
        """(pairs,): the readings of a channel that are used."""
        used = np.ones(count, np.bool_)
        used[self.clipped[channel]] = used[self.repeated] = False
        return used

    def remarks(self, names: Sequence[str] = ()) -> list[str]:
        """What was left out, in sentences; names: of the pairs (default: "pair 1", …)."""
        said = [
            f"channel {channel}: {len(rows)} readings are clipped and left out ({_listed(rows, names)})"
            for channel, rows in self.clipped.items()
            if len(rows)
        ]
        if len(self.repeated):
            said.append(
                f"{len(self.repeated)} pairs repeat the readings of another and are left out "
                f"({_listed(self.repeated, names)})"
            )
        return said


def doubtful_readings(
    wavelengths: Array, matrix: Array, readings: dict[str, Array], priors: dict[str, CurvePrior]
) -> Doubtful:
    """The readings that cannot be what the camera saw.

    Repeated: all channels equal those of another pair. Of pairs with one spectrum the first stays; of different spectra
    (a photograph that was saved twice) those stay that agree with the other pairs. Clipped: three or more within 2 % of
    the largest, if the other readings predict more than that.
    """
    repeated = _repeated(wavelengths, matrix, readings, priors)
    clipped = {}
    for name, reading in readings.items():
        finite = np.isfinite(reading)
        top = np.flatnonzero(finite & (reading >= NEAR_TOP * np.nanmax(reading)))
        clipped[name] = np.zeros(0, np.intp)
        if not FEWEST_AT_TOP <= len(top) <= (1.0 - LEAST_LEFT) * len(reading):
            continue
        rest = finite.copy()
        rest[top] = rest[repeated] = False
        expected = matrix @ typical_curve(wavelengths, matrix[rest], reading[rest], priors[name])
        short = expected[top] / reading[top] - 1.0
        scatter = np.median(np.abs(expected[rest] / np.maximum(reading[rest], 1e-3 * np.nanmax(reading)) - 1.0))
        if np.median(short) > LEAST_LOSS + scatter / np.sqrt(len(top)):
            clipped[name] = top
    return Doubtful(clipped, repeated)


def _repeated(
    wavelengths: Array, matrix: Array, readings: dict[str, Array], priors: dict[str, CurvePrior]
) -> NDArray[np.intp]:
    every = np.stack(list(readings.values()), axis=1)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(every).all(axis=1))
    scale = np.maximum(np.abs(every[finite]).max(axis=0, initial=0.0), 1e-300)
    every = np.where(finite[:, None], every, 0.0)
    _, group = np.unique(np.rint(every / scale / SAME), axis=0, return_inverse=True)
    group = np.ravel(group)
    black, full = every <= 0.0, every >= scale * (1.0 - SAME)
    lit = ~(black.all(axis=1) | full.all(axis=1))  # neither black nor clipped in all
    often = np.bincount(group)[group]
    suspects = np.flatnonzero((often > 1) & lit)
    if not len(suspects) or len(suspects) > (1.0 - LEAST_LEFT) * len(every):
        return np.zeros(0, np.intp)
    rest = np.setdiff1d(np.flatnonzero(finite), suspects)
    worst = np.zeros(len(every))
    for name, reading in readings.items():
        curve = typical_curve(wavelengths, matrix[rest], reading[rest], priors[name])
        worst = np.maximum(worst, np.abs(matrix @ curve - reading) / np.maximum(reading, 0.05 * np.nanmean(reading)))
    dropped = []
    for k in np.unique(group[suspects]):
        rows = suspects[group[suspects] == k]
        kept: list[int] = []
        for row in rows:
            same = any(np.allclose(matrix[row], matrix[one], rtol=SAME, atol=0.0) for one in kept)
            if same or worst[row] > LARGEST_REPEATED_ERROR:
                dropped.append(row)
            else:
                kept.append(int(row))
    return np.sort(np.array(dropped, np.intp))


def _listed(rows: NDArray[np.intp], names: Sequence[str], most: int = 8) -> str:
    said = [str(names[row]) if names else f"pair {row + 1}" for row in rows[:most].tolist()]
    return ", ".join(said) + (f" and {len(rows) - most} more" if len(rows) > most else "")
