"""Adjoint: the derivative of light looked up in the solved field, by the colours of matter, by sweeps in reverse.

The field is linear in what cells send: with x = start + T K x, the derivative λ by x solves λ = ∂ + Kᵀ Tᵀ λ, once for
all colours. Each sweep back follows the rays of a sweep. What scales the light of a sweep (`Balance`) depends on the
light itself: its change is a product of two vectors beside T.
"""

from __future__ import annotations

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import UInt, arrays, lookup
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.directions import few_directions, many_directions, turn
from hagoromo.transport.field.fit import FINER, LEAST_SHARE, ROUNDS, Columns, inner_sums, interpolated, restricted
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_back import ByColour, colours_again, colours_from_lamps, incident_back
from hagoromo.transport.field.sent_light import Numbers, added, nothing
from hagoromo.transport.field.solve import Grid, Solution, Solver, accelerated, warn_if_unsettled
from hagoromo.transport.field.sweep import Ways, sweep
from hagoromo.transport.field.swept_back import BalanceByCells, by_incident, swept_back
from hagoromo.transport.lighting import Lighting


class Adjoint:
    """Sweeps in reverse of those of a solution for light of all orders, with the same directions."""

    def __init__(self, solver: Solver, solution: Solution, lighting: Lighting, by_colour: ByColour, seed: int) -> None:
        assert solution.settled is not None
        self.solver, self.settled, self.lighting, self.by_colour = solver, solution.settled, lighting, by_colour
        self.groups, random = solver.fine_groups(), np.random.default_rng(seed)
        self.turns = [turn(random) for _ in range(2 * len(self.groups) + 1)]
        self.sent = solver.again(self.settled)
        self.ways = self._ways(solver.grid, len(self.groups), many_directions)
        self.balance = BalanceByCells(self.sent)
        self.scaled, own = sweep(solver.cells, self.sent, self.ways, solver.cells, balance=self.balance)
        self.gain = solver.own_gain(own, self.ways)
        self._met_by = swept_back(solver.cells, self.ways, solver.cells, None, self._by_met, 1)[0]

    def by_colours(self, by_field: Numbers) -> NDArray[np.float64]:
        """The derivative by every colour of the palette in every band (colours, bands), from that by the nine numbers
        of the field in stored cells.
        """
        solver, cells, fine = self.solver, self.solver.cells, self.solver.fine_cells
        by_light, first = fitted_back(cells, fine, by_field), len(self.groups) + 1
        by_sent = self._finely_back(solver.grid, by_light, first)
        total = self._again(by_sent)
        start = incident_back(solver.samples, solver.scattering, by_sent, solver.bands)
        settled, residual, sweeps = accelerated(start, self._back(start), self.gain, self._back)
        warn_if_unsettled(residual, sweeps)
        total += self._again(self._swept_back(settled))
        by_once = added(by_light, averaged_back(cells, fine, settled))
        by_single = self._finely_back((fine, solver.fine_samples), by_once, 0)
        sums = colours_from_lamps(solver.fine_samples, solver.scattering, self.lighting, by_single, self.by_colour)
        return (total + _totals(sums)).reshape(-1, self.by_colour.bands)

    def _back(self, by_incident_light: Numbers) -> Numbers:
        """Kᵀ Tᵀ."""
        by_sent = self._swept_back(by_incident_light)
        return incident_back(self.solver.samples, self.solver.scattering, by_sent, self.solver.bands)

    def _again(self, by_sent: Numbers) -> NDArray[np.float64]:
        sums = colours_again(self.solver.samples, self.solver.scattering, by_sent, self.settled, self.by_colour)
        return _totals(sums)

    def _swept_back(self, by_arrived: Numbers) -> Numbers:
        """The transpose of a sweep at the solution, with that of its scale."""
        cells, balance = self.solver.cells, self.balance
        plain = swept_back(cells, self.ways, cells, None, by_incident(self.ways, by_arrived), len(by_arrived))
        result = []
        for c, numbers in enumerate(plain):
            scale, taken, stays = (float(each[c]) for each in (balance.scales, balance.intercepted, balance.stays))
            through = _inner(by_arrived[c], self.scaled[c]) / scale if balance.free[c] else 0.0
            of_stays, of_taken = (through / taken, -through * stays / taken**2) if taken > 0.0 else (0.0, 0.0)
            kind = arrays().Float
            factors = [dr.opaque(kind, value) for value in (scale, of_stays, of_taken)]
            by_stays = [lookup(kind, row.astype(np.float32)) for row in balance.stays_by]
            each = zip(numbers, by_stays, self._met_by, strict=True)
            result.append([factors[0] * n + factors[1] * a + factors[2] * m for n, a, m in each])
        dr.eval(result)
        return result

    def _by_met(self, receiver: UInt, way: UInt) -> list:
        """What matter intercepts, by the light of each ray."""
        place = way * self.solver.cells.matter_count + receiver
        return [self.ways.at(way)[1] * dr.gather(arrays().Float, self.ways.sigma, place)]

    def _finely_back(self, grid: Grid, by_light: Numbers, first: int) -> Numbers:
        """The transpose of `Solver.gathered_finely`; first: number of the turn of its first group."""
        solver, parts = self.solver, nothing(len(by_light), grid[0].filled)
        for number, group in enumerate(self.groups):
            places = lookup(arrays().UInt, group.astype(np.uint32))
            of_group = [[dr.gather(arrays().Float, n, places) for n in numbers] for numbers in by_light]
            ways = self._ways(grid, first + number, few_directions)
            by_ray = by_incident(ways, of_group)
            parts = added(parts, swept_back(grid[0], ways, solver.fine_cells, places, by_ray, len(by_light)))
            dr.eval(parts)
        return parts

    def _ways(self, grid: Grid, number: int, directions: object) -> Ways:
        towards, weights = directions()  # type: ignore[operator]
        return Ways(grid[1], grid[0], towards @ self.turns[number].T, weights)


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


def averaged_back(cells: Cells, fine: Cells, by_mean: Numbers) -> Numbers:
    """The transpose of `averaged`: from the filled cells to the filled fine ones."""
    jit = arrays()
    count = inner_sums(cells, fine, Columns([dr.full(jit.Float, 1.0, fine.filled)]))[0]
    dr.eval(count)
    middle = fine.centre(dr.arange(jit.UInt, fine.filled)) * (1.0 / FINER)
    parent = cells.find(jit.Array3i(dr.floor(middle)))
    there = cells.holds(parent)
    share = dr.rcp(dr.fmax(dr.gather(jit.Float, count, jit.UInt(parent), there), 1.0))
    back = [[share * dr.gather(jit.Float, n, jit.UInt(parent), there) for n in numbers] for numbers in by_mean]
    dr.eval(back)
    return back


def _totals(sums: list) -> NDArray[np.float64]:
    return np.array([np.sum(np.array(one), dtype=np.float64) for one in sums])


def _inner(a: list, b: list) -> float:
    return float(sum(np.dot(np.array(x, np.float64), np.array(y, np.float64)) for x, y in zip(a, b, strict=True)))
