"""Doubtful readings: those that are clipped, and those that are given twice, are found before a response is fitted.

A black level that was left in all channels: how likely the readings make it, and intervals of the curves with it.

Lights that all have one mean say little of it: the same added to all readings is a curve that is a little larger
everywhere. One channel alone does not fix it then; together they show more, as a camera has one black level. Where it
is not certain, the curves stay as they are, and their intervals are those of both possibilities: without it, and with
it, each as likely as the readings make it (averaging of models, Hoeting et al. 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.positive_curve import HALF_INTERVAL, PositiveCurve, typical_curve
from hagoromo.calibration.response.reading_equations import Array
from hagoromo.calibration.response.reading_transfer import TRANSFER_PRIOR
from hagoromo.errors import listed

NEAR_TOP = 0.98  # readings above this share of the largest may be clipped
FEWEST_AT_TOP = 3  # that many pile up there, if any is
LEAST_LOSS = 0.01  # share by which clipped readings fall short of what the others predict, in the median
LARGEST_REPEATED_ERROR = 0.1  # relative error of a repeated reading that may stay
SAME = 1e-9  # largest relative difference of equal readings or spectra
LEAST_LEFT = 0.5  # share of the pairs that must be left: a camera that reads all alike is not clipped
REPORTED = 0.95  # probability from which a black level is reported


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


def _listed(rows: NDArray[np.intp], names: Sequence[str]) -> str:
    return listed([str(names[row]) if names else f"pair {row + 1}" for row in rows.tolist()], 8)


class BlackLevel(NamedTuple):
    """A black level of C channels: offsets and their standard errors [mean reading of the channel], and how probable.

    It is one number of all channels, or one share of their mean readings if these were balanced: what is likelier.
    """

    offsets: tuple[float, ...]
    errors: tuple[float, ...]
    probability: float

    def remark(self) -> str | None:
        """One line if it is probable."""
        if self.probability < REPORTED:
            return None
        offsets = ", ".join(f"{100 * b:+.1f} ± {100 * e:.1f}" for b, e in zip(self.offsets, self.errors, strict=True))
        return (
            f"a black level was probably left in all readings ({100 * self.probability:.0f} %), {offsets} % of the "
            "mean of each channel: the intervals have it, the curves do not; subtract that of a photograph with the "
            "lens covered"
        )


def black_level(curves: Sequence[PositiveCurve], means: Array) -> BlackLevel | None:
    """The black level of channels with these mean readings (C,); None where none of them shows one.

    Even odds before the readings; a level that is there is normal, of the standard deviation of `TRANSFER_PRIOR`.
    """
    known = [curve.transfer is not None for curve in curves]
    if not any(known):
        return None
    offsets, errors = np.array([(t.offset, t.errors[1]) for curve in curves if (t := curve.transfer) is not None]).T
    found = []
    for units in (means.mean() / means, np.ones(len(means))):  # offset of each channel for a level of 1
        unit = units[known]
        precision = float(np.sum((unit / errors) ** 2))
        value, variance = float(np.sum(unit * offsets / errors**2)) / precision, 1.0 / precision
        wide = variance + TRANSFER_PRIOR[1] ** 2
        misfit = float(np.sum(((offsets - value * unit) / errors) ** 2))
        nothing = float(np.sum((offsets / errors) ** 2))
        log_odds = 0.5 * (np.log(variance / wide) + nothing - misfit - value**2 / wide)
        found.append((log_odds, value * units, variance**0.5 * units))
    log_odds, value, error = max(found, key=lambda one: one[0])
    both = np.logaddexp(found[0][0], found[1][0]) - np.log(2.0)
    return BlackLevel(tuple(value.tolist()), tuple(error.tolist()), float(expit(both)))


def with_black_level(curve: PositiveCurve, black: BlackLevel, channel: int) -> PositiveCurve:
    """`curve` of a channel with the errors that `black` makes.

    A curve whose own transfer is certain is that of readings without it, and stays.
    """
    if curve.transfer is None or curve.transfer.certain:
        return curve
    p, offset, known_to = black.probability, black.offsets[channel], black.errors[channel]
    slope = curve.unit * curve.transfer.effect[:, 1]
    spread = HALF_INTERVAL * np.abs(slope) * np.sqrt(p * known_to**2 + p * (1.0 - p) * offset**2)
    low, high = curve.interval_95.T
    middle = curve.values + p * offset * slope
    low = np.where(low > 0.0, middle - np.hypot(curve.values - low, spread), np.minimum(low, middle))
    high = middle + np.hypot(high - curve.values, spread)
    interval = np.stack([np.clip(low, 0.0, curve.values), np.maximum(high, curve.values)], axis=1)
    error = np.hypot(curve.standard_error, slope * np.sqrt(p * (offset**2 + known_to**2)))
    return replace(curve, interval_95=interval, standard_error=error)
