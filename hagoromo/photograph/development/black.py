"""Black: what a camera subtracted too much from each frame of a bracket, found by the frames' proportion.

Cameras measure their black level anew for each frame, on covered samples, and are off by −0.2 to 1 DN. With the black δ
of both frames added, signals l and h of a pair are proportional at every level: h + δ_j = ρ (l + δ_i). This leaves one
number open, a δ in proportion to the exposure, as constant light has it. It is bounded by the darkest level, which has
no light below 0, and else by what is usual: the frames of one camera have similar blacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from hagoromo.photograph.development.bracket import BracketExposure
from hagoromo.photograph.development.linearity import Array, SignalLevels, levels_of
from hagoromo.photograph.development.noise import Noise

BLACK_RANGE = (-0.2, 1.0)  # [DN] cameras over-subtract by up to 1 DN; more is a wrong level, not this
COMMON_SPREAD, FRAME_SPREAD = 0.5, 0.35  # [DN] expected: of the mean of all frames about 0, of a frame about the mean
LEAST_LIGHT = 2.0  # [DN] of the brightest level of a frame that has light: more than a black
CHANCE = 6e-5  # largest probability that frames without an offset have one: four standard errors


class Blacks(NamedTuple):
    """Offsets to add to the signals of each frame, and their standard errors [DN]; 0 where none is evident."""

    offsets: list[float]
    errors: list[float]


def no_blacks(frames: int) -> Blacks:
    """Of so many frames without an offset."""
    return Blacks([0.0] * frames, [0.0] * frames)


def frame_blacks(shots: Sequence[BracketExposure], noise: Noise, mosaic: str) -> Blacks:
    """Offset [DN] to add to the signals of each of the `shots`, from the shortest on, so that they are proportional.

    ρ is free for each colour of each pair of successive exposures; the black is that of all colours of a frame, within
    `BLACK_RANGE`. All are 0 unless the misfit without them is significant.
    """
    from scipy.optimize import least_squares

    pairs = [
        (number, other.seconds / one.seconds, levels)
        for number, (one, other) in enumerate(pairwise(shots))
        for levels in _lit(levels_of(one, other, noise, mosaic))
    ]
    nothing = np.zeros(len(shots) + 1)  # the blacks, and their mean
    if not pairs:
        return no_blacks(len(shots))

    def off(at: Array) -> Array:
        return np.concatenate([_off(levels, stated, at[n], at[n + 1]) for n, stated, levels in pairs])

    def usual(at: Array) -> Array:
        return np.r_[(at[:-1] - at[-1]) / FRAME_SPREAD, at[-1] / COMMON_SPREAD]

    solved = least_squares(lambda at: np.r_[off(at), usual(at)], nothing, bounds=BLACK_RANGE, x_scale=0.1)
    left, without = (float(np.sum(off(at) ** 2)) for at in (solved.x, nothing))
    misfit = max(left / max(sum(len(levels.low) - 1 for *_, levels in pairs) - len(shots), 1), 1.0)
    if without - left <= float(chi2.isf(CHANCE, len(shots))) * misfit:
        return no_blacks(len(shots))
    errors = np.sqrt(misfit * np.diag(np.linalg.inv(solved.jac.T @ solved.jac)))
    return Blacks(solved.x[:-1].tolist(), errors[:-1].tolist())


def _lit(colours: list[SignalLevels]) -> list[SignalLevels]:
    """The levels of a pair if any colour has light in both frames: with none, a black is all that they would show."""
    return colours if max((float(of.low.max()) for of in colours), default=0.0) > LEAST_LIGHT else []


def _off(levels: SignalLevels, stated: float, first: float, second: float) -> Array:
    """Misfit in standard errors of one colour of a pair with the blacks added: of its ratio, fitted, and light below 0.

    stated: ratio of the exposure times, for the weights.
    """
    low, high = levels.low + first, levels.high + second
    weight = 1.0 / (levels.high_variance + stated**2 * levels.low_variance)
    ratio = (weight * high * low).sum() / (weight * low**2).sum()
    below = np.minimum(low, 0.0) / np.sqrt(levels.low_variance), np.minimum(high, 0.0) / np.sqrt(levels.high_variance)
    return np.concatenate([np.sqrt(weight) * (high - ratio * low), *below])
