"""A black level that was left in all channels: how likely the readings make it, and intervals of the curves with it.

Lights that all have one mean say little of it: the same added to all readings is a curve that is a little larger
everywhere. One channel alone does not tell it then; together they tell more, as a camera has one black level. Where it
is not certain, the curves stay as they are, and their intervals are those of both possibilities: without it, and with
it, each as likely as the readings make it (averaging of models, Hoeting et al. 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import expit

from hagoromo.calibration.response.positive_curve import HALF_INTERVAL, PositiveCurve
from hagoromo.calibration.response.reading_equations import Array
from hagoromo.calibration.response.reading_transfer import TRANSFER_PRIOR

REPORTED = 0.95  # probability from which a black level is reported


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
    """The black level of channels with these mean readings (C,); None where none of them tells one.

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
