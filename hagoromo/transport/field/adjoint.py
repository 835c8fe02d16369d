"""Adjoint: the derivative of light looked up in the solved field, by the colours of matter, by sweeps in reverse.

The field is linear in what cells send: with x = start + T K x, the derivative λ by x solves λ = ∂ + Kᵀ Tᵀ λ, once for
all colours. Each sweep back follows the rays of a sweep. What scales the light of a sweep (`Balance`) depends on the
light itself: its change is a product of two vectors beside T.
"""

from __future__ import annotations

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.fit import LEAST_SHARE, ROUNDS, Columns, interpolated, restricted
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_back import ByColour, colours_again, colours_from_lamps, incident_back
from hagoromo.transport.field.sent_light import Numbers
from hagoromo.transport.field.solve import FieldSolution, Solver, accelerated, warn_if_unsettled
from hagoromo.transport.field.sweep import Ways, sweep
from hagoromo.transport.field.swept_back import BalanceByCells, by_incident, swept_back
from hagoromo.transport.lighting import Lighting


class Adjoint:
    """Sweeps in reverse of those of a solution for light of all orders, with the same directions."""

    def __init__(
        self, solver: Solver, solution: FieldSolution, lighting: Lighting, by_colour: ByColour, seed: int
    ) -> None:
        assert solution.settled is not None
        self.solver, self.settled, self.lighting, self.by_colour = solver, solution.settled, lighting, by_colour
        self.ways = Ways(solver.samples, solver.cells, np.random.default_rng(seed))
        sent = solver.again(self.settled)
        self.balance = BalanceByCells(sent)
        light, own = sweep(self.ways, sent, balance=self.balance)
        self.scaled, self.gain = self.balance.scaled(light), solver.own_gain(own, self.ways)
        self._intercepted_by = swept_back(self.ways, self._by_intercepted, 1)[0]

    def by_colours(self, by_field: Numbers) -> NDArray[np.float64]:
        """The derivative by every colour of the palette in every band (colours, bands), from that by the nine numbers
        of the field in stored cells.
        """
        solver = self.solver
        by_light = fitted_back(solver.stored, solver.cells, by_field)
        settled, residual, sweeps = accelerated(by_light, self._back(by_light), self.gain, self._back)
        warn_if_unsettled(residual, sweeps)
        by_single, by_sent = self._swept_back(settled)
        again = colours_again(solver.samples, solver.scattering, by_sent, self.settled, self.by_colour)
        once = colours_from_lamps(solver.samples, solver.scattering, self.lighting, by_single, self.by_colour)
        return (_totals(again) + _totals(once)).reshape(-1, self.by_colour.bands)

    def _back(self, by_incident_light: Numbers) -> Numbers:
        """Kᵀ Tᵀ."""
        _, by_sent = self._swept_back(by_incident_light)
        return incident_back(self.solver.samples, self.solver.scattering, by_sent, self.solver.bands)

    def _swept_back(self, by_arrived: Numbers) -> tuple[Numbers, Numbers]:
        """The transpose of a sweep, and of one at the solution, with that of its scale."""
        balance = self.balance
        plain = swept_back(self.ways, by_incident(self.ways, by_arrived), len(by_arrived))
        result = []
        for c, numbers in enumerate(plain):
            scale, taken, stays = (float(each[c]) for each in (balance.scales, balance.intercepted, balance.stays))
            through = _inner(by_arrived[c], self.scaled[c]) / scale if balance.free[c] else 0.0
            of_stays, of_taken = (through / taken, -through * stays / taken**2) if taken > 0.0 else (0.0, 0.0)
            kind = arrays().Float
            factors = [dr.opaque(kind, value) for value in (scale, of_stays, of_taken)]
            by_stays = [lookup(kind, row.astype(np.float32)) for row in balance.stays_by]
            each = zip(numbers, by_stays, self._intercepted_by, strict=True)
            result.append([factors[0] * n + factors[1] * a + factors[2] * m for n, a, m in each])
        dr.eval(result)
        return plain, result

    def _by_intercepted(self, cell: UInt, way: UInt) -> list[Float]:
        """What matter intercepts, by the light of each ray."""
        return [self.ways.at(way)[1] * self.ways.along(way, cell)]


def fitted_back(cells: Cells, fine: Cells, by_field: Numbers) -> Numbers:
    """The transpose of `fitted`: from the stored cells to the filled fine ones."""
    ones = [dr.full(arrays().Float, 1.0, fine.filled)]
    share = restricted(cells, fine, Columns(ones))[0]
    inverse = dr.select(share > LEAST_SHARE, dr.rcp(dr.fmax(share, LEAST_SHARE)), 0.0)
    rest = [number for numbers in by_field for number in numbers]
    total = [arrays().Float(0)] * len(rest)
    for k in range(ROUNDS + 1):
        weighted = [inverse * one for one in rest]
        dr.eval(weighted)
        finely = interpolated(cells, fine, Columns(weighted))
        total = [old + new for old, new in zip(total, finely, strict=True)]
        dr.eval(total, finely)
        if k < ROUNDS:
            rest = [old - new for old, new in zip(rest, restricted(cells, fine, Columns(finely)), strict=True)]
            dr.eval(rest)
    return [total[k : k + NUMBERS] for k in range(0, len(total), NUMBERS)]


def _totals(sums: list) -> NDArray[np.float64]:
    return np.array([np.sum(np.array(one), dtype=np.float64) for one in sums])


def _inner(a: list, b: list) -> float:
    return float(sum(np.dot(np.array(x, np.float64), np.array(y, np.float64)) for x, y in zip(a, b, strict=True)))
