"""Solve: the light of all orders in the cells, sweep by sweep, accelerated.

x = T (K x + s), with x the incident light of orders ≥ 1, s the light of the lamps that is scattered once, K scattering
and T a sweep. It is solved in cells of half the edge of those in which it is kept: within a mean free path of a surface
it changes much, and too much would leave coarser cells. What light a cell gets back from itself is solved for at once
(accelerated lambda iteration, Olson, Auer & Buchler 1986), and the steps of the last sweeps are combined so that the
residual is least (Anderson 1965).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays
from hagoromo.files.memory import require
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cells import bounds_of, grid_over
from hagoromo.transport.field.fit import FINER, fitted
from hagoromo.transport.field.matter_samples import held_share, sample_bytes, sampled
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.field.sent_light import Numbers, added, nothing, sent_again, sent_from_lamps
from hagoromo.transport.field.sweep import Ways, balanced, sweep
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.medium import Medium

RESIDUAL = 2e-3  # largest change of the light by a sweep at the end, root mean square over all light
MOST_SWEEPS = 60
HISTORY = 4  # sweeps that are combined: each takes as much memory as the light
LARGEST_OWN = 1.0 - 1e-5  # share of its own light that a cell is taken to get back at most
LEAST_SIDE, MOST_SIDE = 2, 4  # samples of matter along the edge of a cell: one a voxel within these
MOST_BYTES = float(2 << 30)  # of the samples of a grid, beyond which there are fewer
SORTING = 24.0  # memory that each sample takes besides while they are sorted [byte]
REGULAR = 1e-10  # of the normal equations of the combined sweeps


class Solver:
    """The light of a medium, of `bands` in every group of lamps, in cells of half the edge of those that keep it.

    cells: in which it is solved. stored: those of twice their edge, between which it is looked up.
    """

    def __init__(
        self, medium: Medium, lighting: Lighting, colours: BandColours, scattering: ScatteringTables, size: float
    ) -> None:
        """`size`: edge of a stored cell [m]. `scattering`: of the materials of all boxes, in order."""
        self.scattering, self.bands = scattering, colours.count
        low, touched = grid_over(bounds_of(medium.boxes), size)
        voxel = min(float(box.texel.edges[0]) if box.texel else box.voxel_size for box in medium.boxes)
        fine, each = size / FINER, sample_bytes(colours, lighting)
        held = held_share(medium, low, size, touched) * float(np.count_nonzero(touched)) * FINER**3
        side = samples_along(fine / voxel, held, each)
        require((each + SORTING) * held * side**3, "the samples of matter of mode full")
        self.cells, self.samples = sampled(medium, lighting, low, fine, finer(touched), side, colours)
        self.stored = self.cells.coarser(FINER)
        self.single = sent_from_lamps(self.samples, scattering, lighting, self.bands, self.cells.filled)

    def again(self, incident: Numbers) -> Numbers:
        """Light that filled cells scatter again, of the light that reaches them."""
        return sent_again(self.samples, self.scattering, incident, self.bands, self.cells.filled)

    def solved(self, seed: int, orders: int | None) -> FieldSolution:
        """The light of orders 1 … `orders` − 1 (None: of all) that arrives in every stored cell."""
        if orders == 1:
            return FieldSolution(nothing(len(self.single), self.stored.count), 0.0, 0)
        ways = Ways(self.samples, self.cells, np.random.default_rng(seed))
        once, own = sweep(ways, self.single)

        def swept(light: Numbers) -> Numbers:
            return balanced(ways, self.again(light))

        light, residual, count = once, 0.0, (orders or 2) - 1
        if orders is None:
            light, residual, count = accelerated(once, swept(once), self.own_gain(own, ways), swept)
        for _ in range(count - 1 if orders else 0):
            light = added(once, swept(light))
        warn_if_unsettled(residual, count)
        return self.kept(light, residual, count)

    def kept(self, light: Numbers, residual: float, sweeps: int) -> FieldSolution:
        """The solution of the `light` in filled cells."""
        stored, known = fitted(self.stored, self.cells, light)
        self.stored.without(~known)
        return FieldSolution(stored, residual, sweeps, light)

    def own_gain(self, own: Float, ways: Ways) -> list[Float]:
        """1 / (1 − albedo · own) of every channel: what a unit of light becomes with what it gets back from itself."""
        unit = nothing(len(self.single), self.cells.filled)
        for numbers in unit:
            numbers[0] = dr.full(arrays().Float, 1.0, self.cells.filled)
        sigma = ways.mean_sigma()
        return [dr.rcp(1.0 - dr.fmin(s[0] / sigma, 1.0) * dr.fmin(own, LARGEST_OWN)) for s in self.again(unit)]


def finer(touched: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells of a grid, FINER times as fine, that are parts of some (nz, ny, nx)."""
    for axis in range(3):
        touched = np.repeat(touched, FINER, axis)
    return touched


def samples_along(voxels: float, cells: float, each: float) -> int:
    """How many samples of matter there are along the edge of a cell `voxels` wide: one a voxel from LEAST_SIDE to
    MOST_SIDE, fewer where those of all `cells` would take more than MOST_BYTES at `each` byte.
    """
    side = min(max(math.ceil(voxels - 1e-6), LEAST_SIDE), MOST_SIDE)
    while side > 1 and cells * side**3 * each > MOST_BYTES:
        side -= 1
    return max(side, 1)


@dataclass
class FieldSolution:
    """incident: nine numbers of every channel and stored cell. residual: of the last accelerated sweep. sweeps: all.

    settled: the light in filled cells.
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
        dr.flush_malloc_cache()  # keeps memory of every size that a sweep has used
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
    """Steps of one channel.

    last: the last light with its change by a sweep. steps: what this had changed by since the one before, of the last
    ones. changes: by these sweeps. What is kept as halves gets smaller from sweep to sweep, and so does their error.
    """

    def __init__(self) -> None:
        self.last: list[Float] = []
        self.steps: list[Halves] = []
        self.changes: list[Halves] = []
        self.products = np.zeros((0, 0))  # of the changes with each other

    def __call__(self, light: list[Float], change: list[Float]) -> list[Float]:
        """The next light from the last one and its change by a sweep."""
        new = [x + c for x, c in zip(light, change, strict=True)]
        dr.eval(new, change)
        if self.last:
            step = Halves([a - b for a, b in zip(new, self.last, strict=True)])
            self.steps = [*self.steps, step][1 - HISTORY :]
        back = np.cumsum(self._shares(change))[:-1]  # of each step, how much is taken back
        shares = [dr.opaque(arrays().Float, float(share)) for share in back]
        steps = [one.numbers() for one in self.steps]
        result = [
            sum((-share * one[k] for share, one in zip(shares, steps, strict=True)), new[k]) for k in range(len(new))
        ]
        dr.eval(result)
        self.last, self.changes = new, [*self.changes, Halves(change)][1 - HISTORY :]
        return result

    def _shares(self, change: list[Float]) -> np.ndarray:
        """Shares, whose sum is 1, of the last changes that together are least; that of `change` is the last."""
        count = len(self.changes) + 1
        gram = np.zeros((count, count))
        gram[:-1, :-1] = self.products[-(count - 1) :, -(count - 1) :] if count > 1 else 0.0
        gram[-1] = gram[:, -1] = [
            *(_product(kept.numbers(), change) for kept in self.changes),
            _product(change, change),
        ]
        self.products, size = gram, np.trace(gram)
        if not size > 0.0:
            return np.eye(count)[-1]
        raw = np.linalg.solve(gram / size + REGULAR * np.eye(count), np.ones(count))
        return raw / raw.sum()


class Halves:
    """Numbers of cells as halves, in parts of the largest: half the memory of the light."""

    def __init__(self, numbers: list[Float]) -> None:
        kind = arrays()
        self.scales = [dr.opaque(kind.Float, float(dr.max(dr.abs(number))[0]) or 1.0) for number in numbers]
        self.parts = [kind.Float16(n / scale) for n, scale in zip(numbers, self.scales, strict=True)]
        dr.eval(self.parts)

    def numbers(self) -> list[Float]:
        """The numbers again, each with an error of 5e-4 of itself."""
        return [arrays().Float(part) * scale for part, scale in zip(self.parts, self.scales, strict=True)]


def norm(numbers: list[Float]) -> float:
    """Root of the sum of squares of the mean light."""
    return math.sqrt(_product(numbers[:1], numbers[:1]))


def _product(a: list[Float], b: list[Float]) -> float:
    """Σ a b over numbers and cells in double precision, with the same bits always."""
    double = arrays().Float64
    return float(np.sum(np.array(sum(double(x) * double(y) for x, y in zip(a, b, strict=True)))))
