"""Fit: the light in the cells by which its interpolation is nearest to that at all cells of a grid twice as fine.

Light changes within a mean free path of a surface. Values at the middles of cells, with straight lines in
between, would miss it on one side; the least squares do not.
"""

from __future__ import annotations

import drjit as dr

from hagoromo.backend import Bool, Float, UInt, arrays
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_light import Numbers

ROUNDS = 4  # of the iteration towards least squares
FINER = 2  # fine cells along the edge of a cell
REACH = 2 * FINER  # fine cells along an axis that a cell has a share in
LEAST_SHARE = 1e-3  # a cell with less of all fine cells together is not known


def fitted(cells: Cells, fine: Cells, light: Numbers) -> tuple[Numbers, Bool]:
    """Light in the stored cells of that in the filled `fine` cells; and whether a cell is near any of them."""
    ones = [dr.full(arrays().Float, 1.0, fine.filled)]
    share = restricted(cells, fine, Columns(ones))[0]
    known = share > LEAST_SHARE
    inverse = dr.select(known, dr.rcp(dr.fmax(share, LEAST_SHARE)), 0.0)
    columns = [number for numbers in light for number in numbers]
    values = [inverse * new for new in restricted(cells, fine, Columns(columns))]
    for _ in range(ROUNDS):
        dr.eval(values)
        rest = [old - new for old, new in zip(columns, interpolated(cells, fine, Columns(values)), strict=True)]
        dr.eval(rest)
        steps = restricted(cells, fine, Columns(rest))
        values = [dr.fma(inverse, step, value) for step, value in zip(steps, values, strict=True)]
    dr.eval(values)
    return [values[k : k + NUMBERS] for k in range(0, len(values), NUMBERS)], known


class Columns:
    """Numbers of cells. A plain object: loops do not take them into their state."""

    def __init__(self, values: list[Float]) -> None:
        self.values = values

    def added(self, total: list[Float], weight: Float, cell: UInt, active: Bool) -> list[Float]:
        """total + weight · the numbers of a cell."""
        kind = arrays().Float
        return [dr.fma(weight, dr.gather(kind, v, cell, active), t) for v, t in zip(self.values, total, strict=True)]


def interpolated(cells: Cells, fine: Cells, values: Columns) -> list[Float]:
    """At the middles of the filled fine cells, between the cells around each."""
    jit = arrays()
    place = fine.centre(dr.arange(jit.UInt, fine.filled)) * (1.0 / FINER)
    total = [jit.Float(0)] * len(values.values)
    for cell, weight in zip(*cells.around(place), strict=True):
        total = values.added(total, weight, jit.UInt(cell), cell >= 0)
    return total


@dr.syntax
def restricted(cells: Cells, fine: Cells, values: Columns) -> list[Float]:
    """The transpose of `interpolated`: to every stored cell, from the filled fine cells that it has a share in."""
    jit = arrays()
    centre = cells.centre(dr.arange(jit.UInt, cells.count))
    first = jit.Array3i(dr.floor(centre)) * FINER - FINER // 2
    total = [dr.zeros(jit.Float, cells.count) for _ in values.values]
    k = jit.UInt(0)
    while k < REACH**3:
        cell = first + jit.Array3i(k % REACH, k // REACH % REACH, k // REACH**2)
        number = fine.find(cell, fine.inside(cell))
        there = fine.inside(cell) & fine.holds(number)
        apart = dr.abs((jit.Array3f(cell) + 0.5) * (1.0 / FINER) - centre)
        total = values.added(total, (1.0 - apart.x) * (1.0 - apart.y) * (1.0 - apart.z), jit.UInt(number), there)
        k += 1
    return total
