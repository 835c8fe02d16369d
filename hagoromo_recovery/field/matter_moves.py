"""Matter moves: how the numbers of a field follow their gradients, by Adam; body colours do so in every law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo_recovery.field.matter_field import COLOURS

LEAST_COLOUR = 1e-4  # of a body colour
EVENNESS = 30.0  # of the differences of body colours of neighbours, in units of a pixel's squared error: it decides
# where pixels say nothing


class Adam:
    """Steps of Adam (Kingma & Ba 2015) for some numbers."""

    def __init__(self, count: int) -> None:
        jit = arrays()
        self.first, self.second = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
        dr.make_opaque(self.first, self.second)
        self.steps = 0

    def step(self, slope: Float, rate: float) -> Float:
        """What is to be subtracted."""
        self.steps += 1
        self.first = 0.9 * self.first + 0.1 * slope
        self.second = 0.98 * self.second + 0.02 * slope * slope
        one, two = 1.0 - 0.9**self.steps, 1.0 - 0.98**self.steps
        scale = dr.opaque(arrays().Float, rate / one)
        change = scale * self.first / (dr.sqrt(self.second / dr.opaque(arrays().Float, two)) + 1e-12)
        dr.eval(self.first, self.second, change)
        return change


class MatterMoves(ABC):
    """The nodes of a field that move, and their steps. rates: of its values in the first step of the first level, which
    starts from the hull, and of others. colour_rates: of body colours in the first step of a coarse level under known
    lamps, and of others; colour_rate: that of this level. `choose` comes first.
    """

    rates: tuple[float, float]
    colour_rates = 0.06, 0.06

    def __init__(self, field: Any) -> None:
        self.field, self.colour_rate = field, self.colour_rates[1]

    def choose(self) -> None:
        """Choose the nodes that move; their steps begin anew."""
        inner = np.zeros(self.field.shape, bool)
        inner[1:-1, 1:-1, 1:-1] = True  # neighbours have neighbours
        held = np.flatnonzero(self.held() & inner)
        self.nodes = lookup(arrays().UInt, held.astype(np.uint32))
        self.by_colours = [Adam(len(held)) for _ in range(COLOURS)]

    @abstractmethod
    def held(self) -> NDArray[np.bool_]:
        """(nz, ny, nx), the nodes that are to move; those at the edge of the lattice do not."""

    @abstractmethod
    def move_values(self, rate: float, fall: float) -> None:
        """Move values and axes against their gradients. rate: of values. fall: factor on the other rates."""

    def move(self, rate: float, fall: float) -> None:
        """Move the field against its gradients."""
        jit, field = arrays(), self.field
        by_colours = field.by_colours
        dr.eval(by_colours)
        self.move_values(rate, fall)
        for c in range(COLOURS):
            index = self.nodes * COLOURS + c
            slope = dr.gather(jit.Float, by_colours, index) + self.unevenness(field.colours, COLOURS, c, EVENNESS)
            change = self.by_colours[c].step(slope, self.colour_rate * fall)
            new = dr.fmax(dr.gather(jit.Float, field.colours, index) - change, LEAST_COLOUR)
            dr.scatter(field.colours, new, index, mode=dr.ReduceMode.NoConflicts)
        dr.eval(field.colours)

    def unevenness(self, values: Float, each: int, which: int, weight: float) -> Float:
        """Slope, at the nodes that move, of half the mean squared difference of neighbours, times a weight.

        each: numbers of a node in `values`. which: of them.
        """
        jit = arrays()

        def at(node: UInt) -> Float:
            return dr.gather(jit.Float, values, node * each + which)

        around = sum(at(self.nodes - row) + at(self.nodes + row) for row in self.field.rows)
        return (weight / dr.width(self.nodes)) * (6.0 * at(self.nodes) - around)
