"""Stretch: colours of a surface whose faint differences are made as strong as the others.

Decorrelation stretch (Gillespie, Kahle & Walker 1986): body colours x are turned into their principal components,
each of these is divided by its standard deviation, and turned back. With mean m and covariance C = S V Λ Vᵀ S,

    y = V Λ^(−½) Vᵀ S⁻¹ (x − m),

whose channels are uncorrelated, of mean 0 and standard deviation 1. S holds the standard deviations of the channels
("correlation": the channels count alike, and y is most alike to x) or is 1 ("covariance").

It shows that colours differ, not which they are: hues are no longer true, and what is amplified most may be noise. The
share of noise in each component is stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

Array = NDArray[np.float64]
By = Literal["correlation", "covariance"]
LEAST_SPREAD = 1e-6  # of the largest component, that each has
SHOWN_DEVIATIONS = 3.0  # standard deviations at which a display value is 0 or 1
ALIKE = "the colours differ in fewer ways than there are channels: there is nothing to pull apart"


@dataclass(frozen=True, eq=False)
class Stretch:
    """value: (h, w, C) uncorrelated colours, of mean 0 and standard deviation 1, NaN where unknown.

    matrix: (C, C) from colours less their `mean` (C,). deviations: (C,) of the principal components, the largest first.
    noise: (C,) share of each one's variance that is error of the body colours; None where they state none.
    """

    value: Array
    matrix: Array
    mean: Array
    deviations: Array
    noise: Array | None
    by: By

    @property
    def shown_channels(self) -> list[int]:
        """The three channels that are shown as red, green and blue: of more, the first, the middle and the last."""
        count = self.value.shape[2]
        return [0, count // 2, count - 1]

    @property
    def shown(self) -> NDArray[np.uint8]:
        """(h, w, 3) a picture: 0.5 at the mean, full at SHOWN_DEVIATIONS; black where unknown."""
        return _shown(self.value[..., self.shown_channels])

    def picture(self, colours: Array, known: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """`shown` of other colours (h, w, C) of the same surface, such as a part of it."""
        value = (colours - self.mean) @ self.matrix[self.shown_channels].T
        return _shown(np.where(known[..., None], value, np.nan))


def _shown(value: Array) -> NDArray[np.uint8]:
    """Standard deviations (h, w, 3) as display values."""
    level = 0.5 + 0.5 * np.nan_to_num(value, nan=-2 * SHOWN_DEVIATIONS) / SHOWN_DEVIATIONS
    return np.rint(255.0 * np.clip(level, 0.0, 1.0)).astype(np.uint8)


def decorrelation_stretch(
    colours: Array, known: NDArray[np.bool_], by: By = "correlation", error: Array | None = None
) -> Stretch:
    """The stretch of `colours` (h, w, C) by the statistics of the `known` (h, w). error: (h, w, C) of the colours.

    `InputError` for one channel, for colours that do not differ, or whose channels are not independent.
    """
    if by not in get_args(By):
        raise InputError(f"a stretch by {by!r}: give {' or '.join(get_args(By))}")
    count = colours.shape[2]
    if count < 2:
        raise InputError("one channel has no colours to pull apart: measure colour photographs")
    inside = known & np.isfinite(colours).all(axis=2)
    samples = colours[inside].astype(np.float64)
    if len(samples) <= count:
        raise InputError(f"{len(samples)} pixels are too few for a stretch of {count} channels")
    mean, spread = samples.mean(axis=0), samples.std(axis=0)
    if not spread.min() > LEAST_SPREAD * np.abs(mean).max():
        raise InputError(ALIKE)
    scale = spread if by == "correlation" else np.ones(count)
    covariance = np.cov(samples / scale, rowvar=False, bias=True)
    sizes, axes = np.linalg.eigh(covariance)
    if sizes[0] < LEAST_SPREAD**2 * sizes[-1]:
        raise InputError(ALIKE)
    matrix = (axes / np.sqrt(sizes)) @ axes.T / scale
    noise = None
    if error is not None:
        of_channel = np.mean(error[inside].astype(np.float64) ** 2, axis=0) / scale**2
        noise = ((axes**2 * of_channel[:, None]).sum(axis=0) / sizes)[::-1]
    value = np.where(inside[..., None], (colours - mean) @ matrix.T, np.nan)
    return Stretch(value, matrix, mean, np.sqrt(sizes[::-1]), noise, by)
