"""Balls together: far lamps of which several balls of unknown size or place show the directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hagoromo.calibration.lamps.reading import LampReading
from hagoromo.errors import InputError

DISAGREE_DEG, SIGNIFICANT = 3.0, 4.0  # median angle between balls, and in standard errors, above which lamps are near


def far_lamps_of_balls(together: Sequence[Sequence[LampReading]]) -> list[LampReading]:
    """One reading per lamp from those of all balls: the mean direction by their errors, on the first ball.

    Its standard error holds half of what the balls differ by. `InputError` where they differ as near lamps do.
    """
    found, apart, expected = [], [], []
    for readings in together:
        weight = np.array([1.0 / one.standard_error_deg**2 for one in readings])
        mean = np.asarray(weight @ np.stack([one.to_lamp for one in readings]))
        mean = mean / np.linalg.norm(mean)
        off = [_degrees(mean, one.to_lamp) for one in readings]
        apart.append(max(_degrees(one.to_lamp, other.to_lamp) for one in readings for other in readings))
        expected.append(float(np.hypot.reduce([one.standard_error_deg for one in readings])))
        scatter = float(np.sqrt(np.mean(np.square(off)) / max(len(off) - 1, 1)))
        error = max(float(weight.sum() ** -0.5), scatter)
        found.append(replace(readings[0], to_lamp=mean, standard_error_deg=error))
    middle = float(np.median(apart))
    if middle > DISAGREE_DEG and middle > SIGNIFICANT * float(np.median(expected)):
        raise InputError(
            f"the balls disagree about the lamps by {middle:.1f}° (median), as they do about near lamps: give their "
            "radius (--radius) [m] and a calibrated camera (--camera), or one ball beside the object"
        )
    return found


def _degrees(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ other, -1.0, 1.0))))
