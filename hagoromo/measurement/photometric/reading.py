"""Reading: the value of a pixel over the irradiance of its lamp, Tanaka eq. (2), for every fit.

    value_c = a_c B + e_c I

a_c = α c_b is the body colour, e_c the colour of the interface; B and I are what the geometry of pixel, lamp and eye
gives for a body and an interface of 1, times the light. The value is linear in (B, I): so its slope by anything that
they depend on (normal, lamp, width of the lobe) is the same expression of their slopes.

Pixel bodies: body colours of pixels that follow from all else, by weighted least squares in a closed form.

For a given interface the body colour of a pixel has a closed form, so it is eliminated (variable projection, Golub &
Pereyra 1973). Samples are pixels in photographs, in any order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def reading(body: Any, lit: Any, colour: Any, interface: Any) -> Any:
    """a B + e I; or its slope, for slopes of `lit` B and `interface` I. colour: e, None for 1.

    All are floats, NumPy or Dr.Jit arrays alike, of shapes that broadcast. Value per irradiance [1/sr], or in the unit
    of the light that B and I are times.
    """
    return body * lit + (interface if colour is None else colour * interface)


@dataclass(frozen=True, eq=False)
class PixelBodies:
    """P pixels in N samples of C channels. pixel: (N,) row of each sample's pixel. lit: (N, C) value of a body of 1.
    weight: (N, C) robust weight over variance, 0 where a value is not used.
    """

    pixel: NDArray[np.intp]
    lit: Array
    weight: Array

    @cached_property
    def power(self) -> Array:
        """(P, C) Σ w B²: the inverse variance of a body at a given interface; 0 where a channel was not measured."""
        return self.sums(self.weight * self.lit**2)

    @cached_property
    def variance(self) -> Array:
        """(P, C) that of a body at a given interface; 0 where a channel was not measured."""
        return np.divide(1.0, self.power, out=np.zeros_like(self.power), where=self.power > 0.0)

    def of(self, values: Array) -> Array:
        """(P, C) the bodies that fit values (N, C) best, 0 where a channel was not measured."""
        return self.sums(self.weight * self.lit * values) * self.variance

    def light(self, values: Array) -> Array:
        """(N, C) what the bodies of values (N, C) give: their projection on changes of the bodies."""
        return self.lit * self.of(values)[self.pixel]

    def leverage(self) -> Array:
        """(N, C) of a value in the body of its pixel."""
        return self.weight * self.lit**2 * self.variance[self.pixel]

    def sums(self, values: Array) -> Array:
        """Values (N,) or (N, C) summed over the samples of each pixel."""
        if values.ndim == 1:
            return np.bincount(self.pixel, values, self.count).astype(np.float64)
        return np.stack([self.sums(column) for column in values.T], axis=1)

    @cached_property
    def count(self) -> int:
        """P, the number of pixels."""
        return int(self.pixel.max(initial=-1)) + 1
