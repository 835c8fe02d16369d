"""Solve: the light of all orders in the cells, sweep by sweep, accelerated.

x = T (K x + s), with x the incident light of orders ≥ 1, s the light of the lamps that is scattered once, K scattering
and T a sweep. What light a cell gets back from itself is solved for at once (accelerated lambda iteration, Olson, Auer
& Buchler 1986), and the steps of the last sweeps are combined so that the residual is least (Anderson 1965).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.files.memory import require
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cells import Cells, grid_over, matter_bounds
from hagoromo.transport.field.directions import few_directions, many_directions, turn
from hagoromo.transport.field.fit import FINER, averaged, fitted
from hagoromo.transport.field.matter_samples import MatterSamples, sample_bytes, sampled
from hagoromo.transport.field.scattering import Scattering
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_light import Numbers, added, nothing, sent_again, sent_from_lamps
from hagoromo.transport.field.sweep import Sight, Ways, sweep
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.medium import Medium

RESIDUAL = 2e-3  # largest change of the light by a sweep at the end, root mean square over all light
MOST_SWEEPS = 60
HISTORY = 6  # sweeps that are combined
LARGEST_OWN = 1.0 - 1e-5  # share of its own light that a cell is taken to get back at most
MOST_SIDE = 4  # samples of matter along the edge of a cell: one a voxel up to here
MOST_BYTES = float(2 << 30)  # of the samples of a grid, beyond which there are fewer; twice that while they are sorted
Grid = tuple[Cells, MatterSamples]
Directions = Callable[[], tuple[NDArray[np.float64], NDArray[np.float64]]]
REGULAR = 1e-10  # of the normal equations of the combined sweeps


class Solver:
    """Sweeps over the cells of a medium, of `bands` in every group of lamps.

    Light of the lamps that is scattered once falls off within a mean free path of the surface, so it is sent by cells
    of a finer grid; light of higher orders is smooth.
    """

    def __init__(
        self, medium: Medium, lighting: Lighting, colours: BandColours, scattering: Scattering, size: float
    ) -> None:
        """`size`: edge of a cell [m]. `scattering`: of the materials of all boxes, in order."""
        self.scattering, self.bands = scattering, colours.count
        self.sight: Sight | None = None
        low, touched = grid_over([matter_bounds(box) for box in medium.boxes], size)
        voxel = min(float(box.texel.edges[0]) if box.texel else box.voxel_size for box in medium.boxes)

        each = sample_bytes(colours, len(lighting.lamps))

        def grid(parts: int, held: float) -> tuple[Grid, float]:
            """A grid, of whose cells about `held` hold matter; and how much of the cells of its samples does."""
            fine, finer = size / parts, touched
            for axis in range(3):
                finer = np.repeat(finer, parts, axis)
            side = samples_along(fine / voxel, held, each)
            require(2.0 * each * held * side**3, "the samples of matter of mode full")
            found = sampled(medium, lighting, low, fine, finer, side, colours)
            return found, found[1].count / side**3

        self.grid, held = grid(1, float(np.count_nonzero(touched)))
        (self.fine_cells, self.fine_samples), _ = grid(FINER, held * FINER**3)
        self.cells, self.samples = self.grid
        self.single = sent_from_lamps(self.fine_samples, scattering, lighting, self.bands, self.fine_cells.filled)

    def again(self, incident: Numbers) -> Numbers:
        """What filled cells send on of incident light."""
        return sent_again(self.samples, self.scattering, incident, self.bands, self.cells.filled)

    def ways(self, random: np.random.Generator, of: Grid, directions: Directions = few_directions) -> Ways:
        """The directions of a sweep, turned at random, through the cells of a grid."""
        cells, samples = of
        towards, weights = directions()
        return Ways(samples, cells, towards @ turn(random).T, weights)

    def solved(self, seed: int, orders: int | None) -> Solution:
        """The light of orders 1 … `orders` − 1 (None: of all) that arrives in every stored cell."""
        random, residual, sweeps, cells, fine = np.random.default_rng(seed), 0.0, 0, self.cells, self.fine_cells
        if orders == 1:
            return Solution(nothing(len(self.single), cells.count), 0.0, 0)
        light = once = self.gathered_finely(random, (fine, self.fine_samples), self.single)
        settled = None
        if orders is None or orders > 2:
            start = averaged(cells, fine, once)
            incident, residual, sweeps = self.accelerated(random, start) if orders is None else (start, 0.0, 1)
            for _ in range((orders or 2) - 3):
                incident, sweeps = added(start, self._again(incident, self.ways(random, self.grid))), sweeps + 1
            light, settled = added(once, self.gathered_finely(random, self.grid, self.again(incident))), incident
        warn_if_unsettled(residual, sweeps)
        light, known = fitted(cells, fine, light)
        cells.without(~known)
        return Solution(light, residual, sweeps + 1, settled)

    def gathered_finely(self, random: np.random.Generator, grid: Grid, sent: Numbers) -> Numbers:
        """Light sent by the cells of a grid that arrives in the filled fine cells.

        The eight fine cells of a cell have other directions each: together it has eight times as many.
        """
        groups, fine = self.fine_groups(), self.fine_cells
        numbers = [lookup(arrays().UInt, group.astype(np.uint32)) for group in groups]
        each = [sweep(grid[0], sent, self.ways(random, grid), fine, group, self.sight)[0] for group in numbers]
        order = lookup(arrays().UInt, np.argsort(np.concatenate(groups)).astype(np.uint32))
        return [[_joined(columns, order) for columns in zip(*c, strict=True)] for c in zip(*each, strict=True)]

    def fine_groups(self) -> list[NDArray[np.intp]]:
        """Numbers of the filled fine cells in each of the eight parts of a cell, where there are any."""
        parts = self.fine_cells.places[: self.fine_cells.filled] % FINER
        groups = [np.flatnonzero((parts == part).all(axis=1)) for part in np.indices((FINER,) * 3).reshape(3, -1).T]
        return [group for group in groups if group.size]

    def _again(self, incident: Numbers, ways: Ways) -> Numbers:
        """What arrives in the cells of `incident` light that they send on."""
        return sweep(self.cells, self.again(incident), ways, self.cells, sight=self.sight)[0]

    def accelerated(self, random: np.random.Generator, once: Numbers) -> tuple[Numbers, float, int]:
        """Incident light of all orders in filled cells, its residual, and the number of sweeps; once: of the first."""
        ways = self.ways(random, self.grid, many_directions)
        new, own = sweep(self.cells, self.again(once), ways, self.cells)
        return accelerated(once, new, self.own_gain(own, ways), lambda light: self._again(light, ways))

    def own_gain(self, own: Float, ways: Ways) -> list[Float]:
        """1 / (1 − albedo · own) of every channel: what a unit of light becomes with what it gets back from itself."""
        unit = nothing(len(self.single), self.cells.filled)
        for numbers in unit:
            numbers[0] = dr.full(arrays().Float, 1.0, self.cells.filled)
        sigma = ways.mean_sigma()
        return [dr.rcp(1.0 - dr.fmin(s[0] / sigma, 1.0) * dr.fmin(own, LARGEST_OWN)) for s in self.again(unit)]


def samples_along(voxels: float, cells: float, each: float) -> int:
    """How many samples of matter there are along the edge of a cell `voxels` wide: one a voxel up to MOST_SIDE, fewer
    where those of all `cells` would take more than MOST_BYTES at `each` byte.
    """
    side = min(math.ceil(voxels - 1e-6), MOST_SIDE)
    while side > 1 and cells * side**3 * each > MOST_BYTES:
        side -= 1
    return max(side, 1)


@dataclass
class Solution:
    """incident: nine numbers of every channel and stored cell. residual: of the last accelerated sweep. sweeps: all.

    settled: the light in filled cells that the last sweep sent on, where there is more than one.
    """

    incident: Numbers
    residual: float
    sweeps: int
    settled: Numbers | None = None


def accelerated(
    once: Numbers, new: Numbers, gain: list[Float], swept: Callable[[Numbers], Numbers]
) -> tuple[Numbers, float, int]:
    """Light of all orders, the fixed point of once + swept(light), its residual, and the number of sweeps.

    once: of the first order that is solved. new: swept(once). gain: of every channel, see `Solver.own_gain`.
    """
    light, steps, residual, count = once, [Anderson() for _ in once], 1.0, 2
    while count < MOST_SWEEPS:
        new = added(once, new)
        change = [[a - b for a, b in zip(one, other, strict=True)] for one, other in zip(new, light, strict=True)]
        change = [[g * c[0], *c[1:]] for g, c in zip(gain, change, strict=True)]
        residual = max(norm(c) / max(norm(x), 1e-30) for c, x in zip(change, new, strict=True))
        light = [step(x, c) for step, x, c in zip(steps, light, change, strict=True)]
        dr.eval(light)
        if residual <= RESIDUAL:
            break
        new, count = swept(light), count + 1
    return light, residual, count


def warn_if_unsettled(residual: float, sweeps: int) -> None:
    """Warn of light that still changes more than RESIDUAL."""
    if residual > RESIDUAL:
        warnings.warn(
            f"light of higher orders still changes by {residual:.1%} after {sweeps} sweeps: the picture may be too "
            "dark; compare it with mode path",
            stacklevel=3,
        )


class Anderson:
    """Steps of one channel."""

    def __init__(self) -> None:
        self.lights: list[Float] = []
        self.changes: list[Float] = []
        self.products = np.zeros((0, 0))  # of the changes with each other

    def __call__(self, light: list[Float], change: list[Float]) -> list[Float]:
        """The next light from the last one and its change by a sweep."""
        self.lights, self.changes = (
            [*old, dr.concat(list(new))][-HISTORY:] for old, new in ((self.lights, light), (self.changes, change))
        )
        dr.eval(self.lights, self.changes)
        shares = self._shares()
        mixed = sum(float(w) * (x + c) for w, x, c in zip(shares, self.lights, self.changes, strict=True))
        cells = dr.width(mixed) // NUMBERS
        lane = dr.arange(arrays().UInt, cells)
        return [dr.gather(type(mixed), mixed, lane + dr.opaque(arrays().UInt, k * cells)) for k in range(NUMBERS)]

    def _shares(self) -> np.ndarray:
        """Shares, whose sum is 1, of the last changes that together are least."""
        count, last = len(self.changes), self.changes[-1]
        gram = np.zeros((count, count))
        gram[:-1, :-1] = self.products[-(count - 1) :, -(count - 1) :] if count > 1 else 0.0
        gram[-1] = gram[:, -1] = [_dot(change, last) for change in self.changes]
        self.products, size = gram, np.trace(gram)
        if not size > 0.0:
            return np.eye(count)[-1]
        raw = np.linalg.solve(gram / size + REGULAR * np.eye(count), np.ones(count))
        return raw / raw.sum()


def _joined(parts: Sequence[Float], order: UInt) -> Float:
    """The parts one after the other, in `order`."""
    return dr.gather(arrays().Float, dr.concat(list(parts)), order)


def norm(numbers: list[Float]) -> float:
    """Root of the sum of squares of the mean light."""
    return float(np.sqrt(_dot(numbers[0], numbers[0])))


def _dot(a: Float, b: Float) -> float:
    return float(np.dot(np.asarray(a, np.float64), np.asarray(b, np.float64)))
