"""Swept back: the transpose of a sweep, which takes light that cells send to light that arrives in cells.

The transpose takes a derivative by the latter to the derivative by the former.

It follows the same rays through the same cells, and adds to each cell what its source had a share in.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays
from hagoromo.transport.field.balance import Balance
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.second_order import projected
from hagoromo.transport.field.sent_light import Numbers, nothing
from hagoromo.transport.field.sweep import (
    LANES_AT_ONCE,
    LEAST_DEPTH,
    LEAST_PASSED,
    PARTS,
    Path,
    Ways,
    chord_through,
    ramp,
)
from hagoromo.transport.field.whole_sums import WholeSums
from hagoromo.transport.step_elements import mean_of_decay

# receiver (its cell), way → the derivative by the light that arrives there, of every channel
ByRay = Callable[[UInt, UInt], list[Float]]


def swept_back(ways: Ways, by_ray: ByRay, channels: int) -> Numbers:
    """The derivative by what the filled cells send of each channel, nine numbers a cell; see `sweep`."""
    jit, cells, filled = arrays(), ways.cells, ways.cells.filled
    by_sent = nothing(channels, filled)
    together = max(min(LANES_AT_ONCE // (PARTS * filled * channels), ways.count), 1)
    for first in range(0, ways.count, together):
        count = min(together, ways.count - first)
        lane, begin = dr.arange(jit.UInt, filled * count), dr.opaque(jit.UInt, first)
        cell = lane % cells.matter_count
        way = ways.of(begin + lane // cells.matter_count, cell)
        place, towards, by_light = ways.place(way, cell), ways.at(way)[0], by_ray(cell, way)
        dr.eval(by_light)
        most = max(float(dr.max(dr.abs(one))[0]) for one in by_light)
        sums = WholeSums(PARTS * count * filled * channels, most)
        sources = SourcesBack(ways, way - PARTS * begin, channels, sums)
        followed_back(cells, sources, place, chord_through(place, towards), way, towards, by_light)
        dr.eval(sources.sums.sums)
        by_sent = _together(sources, by_sent, PARTS * begin, PARTS * count)
        dr.eval(by_sent)
    return by_sent


class SourcesBack:
    """Sums of the derivative by the source S of every cell along some ways; σ as in `Sources`. A plain object."""

    def __init__(self, ways: Ways, own_way: UInt, channels: int, sums: WholeSums) -> None:
        self.cells, self.ways, self.own_way, self.channels, self.sums = ways.cells, ways, own_way, channels, sums

    def sigma(self, way: UInt, cell: Int) -> Float:
        """σ [1/m] of a cell along a way."""
        place = way * self.cells.matter_count + arrays().UInt(cell)
        return dr.gather(arrays().Float, self.ways.sigma, place, self.cells.holds(cell))

    def add(self, share: Float, cell: Int, by_light: list[Float]) -> None:
        """Add the derivative of light of which a `share` is the source of a cell."""
        place = (self.own_way * self.cells.matter_count + arrays().UInt(cell)) * self.channels
        self.sums.add(place, [share * one for one in by_light], self.cells.holds(cell) & (share != 0.0))

    def summed(self, k: UInt, way: UInt, cell: UInt, by_sent: Numbers) -> Numbers:
        """`by_sent` of every cell with what came along a way, the one of number k among the present ones."""
        inverse = dr.rcp(dr.fmax(self.ways.smooth_along(way, cell), 1e-30))
        place = (k * self.cells.matter_count + cell) * self.channels
        factors = along(-self.ways.at(way)[0])
        each = [self.sums.at(place + c) * inverse for c in range(self.channels)]
        return [
            [dr.fma(one, factor, old) for factor, old in zip(factors, numbers, strict=True)]
            for one, numbers in zip(each, by_sent, strict=True)
        ]


@dr.syntax
def _together(sources: SourcesBack, by_sent: Numbers, first: UInt, count: int) -> Numbers:
    jit = arrays()
    k, cell = jit.UInt(0), dr.arange(jit.UInt, sources.cells.filled)
    ways = dr.opaque(jit.UInt, count)
    while k < ways:
        by_sent = sources.summed(k, first + k, cell, by_sent)
        k += 1
    return by_sent


@dr.syntax
def followed_back(
    cells: Cells,
    sources: SourcesBack,
    place: Array3f,
    chord: tuple[Float, Float],
    way: UInt,
    towards: Array3f,
    by_light: list[Float],
) -> None:
    """`gathered`, with the source of each cell in place of light: its share of what arrives is added to its sum."""
    jit, count = arrays(), dr.width(way)
    path = Path(cells, place, towards)
    distance, whole = chord[0], chord[0] + chord[1]
    last = cells.find(jit.Array3i(dr.floor(place)))
    passed = mean_of_decay(sources.sigma(way, last) * whole * cells.edge)
    sources.add(1.0 - passed, last, by_light)
    open_depth = dr.zeros(jit.Float, count)
    cell = path.cell_behind(distance)
    inside = cells.inside(cell)
    while inside & (passed > LEAST_PASSED):
        number = cells.find(cell)
        end = path.end(cell, number, distance)
        half = 0.5 * sources.sigma(way, number) * (end - distance) * cells.edge
        matter, before = half > LEAST_DEPTH, open_depth > LEAST_DEPTH
        between = open_depth + half
        near, far, rest = ramp(between)
        back = dr.select(matter, number, last)
        sources.add(passed * near, dr.select(before, last, number), by_light)
        sources.add(passed * far, back, by_light)
        last = back
        passed *= rest
        open_depth = dr.select(matter, half, 0.0)
        distance = end
        cell = path.cell_behind(distance)
        inside = cells.inside(cell)
    rest = dr.select(passed > LEAST_PASSED, 1.0 - dr.exp(-open_depth), 1.0)
    sources.add(passed * rest, last, by_light)


def along(way: Array3f) -> list[Float]:
    """Factors on the nine numbers of F whose sum is F(way)."""
    x, y, z = way
    return [arrays().Float(1), x, y, z, x * x - z * z, y * y - z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z]


def by_incident(ways: Ways, by_numbers: Numbers) -> ByRay:
    """The derivative by the light of each ray, from that by the nine numbers of every filled cell."""

    def by_ray(cell: UInt, way: UInt) -> list[Float]:
        towards, weight = ways.at(way)
        factors = [weight * factor for factor in projected(towards)]
        return [
            sum(f * dr.gather(arrays().Float, n, cell) for f, n in zip(factors, numbers, strict=True))
            for numbers in by_numbers
        ]

    return by_ray


class BalanceByCells(Balance):
    """A balance that keeps how what stays depends on the light that every cell sends: `stays_by` (9, cells)."""

    def __init__(self, sent: Numbers) -> None:
        super().__init__(sent)
        self.stays_by = np.zeros((9, dr.width(sent[0][0])))

    def add(self, cell: UInt, towards: Array3f, weight: Float, sigma: Float, light: list[Float], leaves: Float) -> None:
        """As that of `Balance`."""
        super().add(cell, towards, weight, sigma, light, leaves)
        number = np.array(cell)
        for sums, factor in zip(self.stays_by, along(towards), strict=True):
            sums += np.bincount(number, np.array(weight * factor * (1.0 - leaves)), len(sums))

    @property
    def free(self) -> Bool:
        """Of each channel, whether its light is scaled by what stays, not by the largest change there may be."""
        return (self.intercepted > 0.0) & (self.scales == self.stays / np.maximum(self.intercepted, 1e-30))
