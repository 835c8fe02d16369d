"""Look-up back: the derivative of a picture by the nine numbers of every cell of the field, gathered by the march.

Stands in place of a `Field`. At each sample it hands on, in place of light, what the sample multiplies the field with;
once the march knows how much of the sample's light reaches the eye, this is added to the cells around it.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.transport.field.field import Field
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_light import Numbers
from hagoromo.transport.field.whole_sums import WholeSums
from hagoromo.transport.sample import Element

LARGEST_FACTOR = 64.0  # bound of ∫ f ω_i ω_j dω times a share: no element sends on more than it takes


class LookUpBack:
    """`by_ray`: the derivative by the radiance of every channel along the present rays; set before each march.

    channels: those that the march accumulates: the radiance's derivative by every colour and channel is the last of
    them, `of_colours`; the others have no meaning. A plain object: loops do not take it into their state.
    """

    def __init__(self, field: Field, of_part: Sequence[int], most: float) -> None:
        self.field, self.of_part, self.bands = field, tuple(of_part), field.colours.count
        self.by_ray: list[Float] = []
        self.of_colours = len(self.of_part) * field.channels
        self.channels = 3 + field.channels + NUMBERS * self.bands + self.of_colours
        self.sums = WholeSums(field.cells.count * field.channels * NUMBERS, most * LARGEST_FACTOR)

    def scattered(
        self, point: Array3f, to_eye: Array3f, elements: Sequence[Element], coefficients: Sequence[Sequence[Float]]
    ) -> list[Float]:
        """Place, whether channels have light, factors on the nine numbers in each band; the derivative by colours."""
        field, kind = self.field, arrays().Float
        incident = field.incident(point)
        factors = [[kind(0)] * NUMBERS for _ in range(self.bands)]
        by_colour = [[kind(0)] * field.channels for _ in self.of_part]
        for element, own in zip(elements, coefficients, strict=True):
            colours = field.colours.of(own)
            for part in range(field.scattering.parts):
                towards = field.scattering.towards(element.material, part, element.axis, to_eye)
                for band, old in enumerate(factors):
                    each = colours[part * self.bands + band] * element.share
                    factors[band] = [dr.fma(each, new, sofar) for new, sofar in zip(towards, old, strict=True)]
                light = [element.share * _dot(towards, numbers) for numbers in incident]
                for j in [j for j, of in enumerate(self.of_part) if of == part]:
                    by_colour[j] = [dr.fma(own[j], new, old) for new, old in zip(light, by_colour[j], strict=True)]
        lit = [_dot(factors[k % self.bands], n) > 0.0 for k, n in enumerate(incident)]
        shown = [dr.select(on, kind(1), 0.0) for on in lit]
        derivative = [dr.select(on, one, 0.0) for row in by_colour for on, one in zip(lit, row, strict=True)]
        return [point.x, point.y, point.z, *shown, *(f for row in factors for f in row), *derivative]

    def taken(self, gain: Float, smooth: Sequence[Float]) -> None:
        """Add what one sample, `scattered`, gives to the derivative by the cells around it; gain: its share that is
        seen.
        """
        jit, field = arrays(), self.field
        point, shown = jit.Array3f(*smooth[:3]), smooth[3 : 3 + field.channels]
        flat = smooth[3 + field.channels :]
        factors = [flat[NUMBERS * band : NUMBERS * (band + 1)] for band in range(self.bands)]
        cells, weights = field.cells.around(field.cells.place(point))
        known = sum(dr.select(cell >= 0, weight, 0.0) for cell, weight in zip(cells, weights, strict=True))
        share = gain * dr.rcp(dr.fmax(known, 1e-6))
        for cell, weight in zip(cells, weights, strict=True):
            place = jit.UInt(cell) * (field.channels * NUMBERS)
            for c in range(field.channels):
                each = self.by_ray[c] * shown[c] * share * weight
                values = [each * factor for factor in factors[c % self.bands]]
                self.sums.add(place + c * NUMBERS, values, (cell >= 0) & (gain > 0.0))

    def by_field(self) -> Numbers:
        """The derivative by the nine numbers of every channel, of all stored cells."""
        lane = dr.arange(arrays().UInt, self.field.cells.count) * (self.field.channels * NUMBERS)
        numbers = [[self.sums.at(lane + (c * NUMBERS + k)) for k in range(NUMBERS)] for c in range(self.field.channels)]
        dr.eval(numbers)
        return numbers


def _dot(a: Sequence[Float], b: Sequence[Float]) -> Float:
    return sum(one * other for one, other in zip(a, b, strict=True))
