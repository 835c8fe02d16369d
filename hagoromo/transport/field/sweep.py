"""Sweep: light sent by the cells, gathered at the middles of cells along a set of directions.

Along a ray the source S = (light sent per metre) / σ is that of a cell at the middle of the ray's way through it, and
in between linear in the optical depth. At the edge of matter it goes on as it is. What arrives in a cell is the
mean over the ray's way through it.

Enters: σ and S of every cell and direction. Leaves: the incident light, nine numbers a cell and channel (see
`second_order`), and the share of its own light that a cell gets back.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, lookup
from hagoromo.transport.field.balance import Balance
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.matter_samples import MatterSamples
from hagoromo.transport.field.second_order import MEAN, NUMBERS, projected, second_order

DEEPEST = 9.0  # a ray ends beyond this optical depth, exp(−9) = 1e-4; its last source stands for all behind it
LEAST_DEPTH = 1e-6  # a way through a cell with less counts as empty
NUDGE = 1e-4  # [cell] behind its begin where the next cell is looked up
LANES_AT_ONCE = 1 << 22  # rays of one launch
FARTHEST = 1e9  # [cell] beyond all grids
LEAST_STEP = 5e-4  # [cell] so that rays go on whatever the rounding
Sight = Callable[[Cells, Array3f, Array3f], Float]  # place on the grid, direction → distance to a surface [cell]


class Ways:
    """Directions of a sweep, towards the light, as kernels read them, and σ of every filled cell along each."""

    def __init__(self, samples: MatterSamples, cells: Cells, towards: NDArray[np.float64], weights: NDArray) -> None:
        """`towards`: unit (n, 3). `weights`: (n,) [sr]."""
        jit, self.count, self.filled = arrays(), len(weights), cells.filled
        self.table = lookup(jit.Float, np.column_stack([towards, weights]).astype(np.float32))
        lane = dr.arange(jit.UInt, self.count * cells.filled)
        self.sigma = extinction(samples, lane % cells.matter_count, self.at(lane // cells.matter_count)[0])
        dr.eval(self.sigma)

    def at(self, number: UInt) -> tuple[Array3f, Float]:
        """Direction and weight."""
        x, y, z, weight = dr.gather(arrays().Array4f, self.table, number)
        return arrays().Array3f(x, y, z), weight

    def mean_sigma(self) -> Float:
        """Mean of σ over all directions."""
        cell = dr.arange(arrays().UInt, self.filled)
        sigma = dr.zeros(arrays().Float, self.filled)
        for k in range(self.count):
            there = dr.gather(arrays().Float, self.sigma, cell + dr.opaque(arrays().UInt, k * self.filled))
            sigma = dr.fma(there, self.at(arrays().UInt(k))[1] * MEAN, sigma)
        dr.eval(sigma)
        return sigma


class Sources:
    """σ and S of every cell along every direction. A plain object: loops do not take its arrays into their state."""

    def __init__(self, cells: Cells, ways: Ways, sent: list[list[Float]]) -> None:
        jit, self.cells, self.sigma = arrays(), cells, ways.sigma
        lane = dr.arange(jit.UInt, ways.count * cells.filled)
        number, cell = lane // cells.matter_count, lane % cells.matter_count
        away, inverse = -ways.at(number)[0], dr.rcp(dr.fmax(ways.sigma, 1e-30))
        self.sources = [
            second_order([dr.gather(jit.Float, n, cell) for n in numbers]).at(away) * inverse for numbers in sent
        ]
        dr.eval(self.sources)

    def at(self, way: UInt, cell: Int) -> tuple[Float, list[Float]]:
        """σ [1/m] and S of a cell along a way; 0 where it holds no matter."""
        kind, holds = arrays().Float, self.cells.holds(cell)
        place = way * self.cells.matter_count + arrays().UInt(cell)
        return dr.gather(kind, self.sigma, place, holds), [dr.gather(kind, s, place, holds) for s in self.sources]


def sweep(
    cells: Cells,
    sent: list[list[Float]],
    ways: Ways,
    where: Cells,
    places: UInt | None = None,
    sight: Sight | None = None,
    balance: Balance | None = None,
) -> tuple[list[list[Float]], Float]:
    """Incident light of each channel at cells of the grid `where`, which has the corner of `cells`; and the share of
    their own light that they get back, 0…1.

    sent: per channel the nine numbers of the light that the filled `cells` send per metre. places: numbers of the cells
    of `where`; by default all that hold matter. sight: how far rays go before a surface ends them; None: without end.
    balance: what keeps the sums by which the light is scaled; by default one where all filled `cells` receive light.
    """
    jit, sources = arrays(), Sources(cells, ways, sent)
    places = dr.arange(jit.UInt, where.filled) if places is None else places
    receivers = dr.width(places)
    incident, own = [[dr.zeros(jit.Float, receivers)] * NUMBERS for _ in sent], dr.zeros(jit.Float, receivers)
    scale = dr.opaque(jit.Float, where.size / cells.size)
    if balance is None and where is cells and receivers == cells.filled:
        balance = Balance(sent)
    together = max(min(LANES_AT_ONCE // receivers, ways.count), 1)
    for first in range(0, ways.count, together):
        count = min(together, ways.count - first)
        lane, each = dr.arange(jit.UInt, receivers * count), dr.opaque(jit.UInt, receivers)
        way = lane // each + dr.opaque(jit.UInt, first)
        place, towards = where.centroid(dr.gather(jit.UInt, places, lane % each)), ways.at(way)[0]
        chord = tuple(length * scale for length in chord_through(place, towards))
        place = place * scale
        far = sight(cells, place, towards) if sight else dr.opaque(jit.Float, FARTHEST)
        light, back, leaves = gathered(cells, sources, place, chord, way, towards, far)
        dr.eval(light, back, leaves)
        if balance:
            sigma, weight = dr.gather(jit.Float, ways.sigma, way * each + lane % each), ways.at(way)[1]
            balance.add(lane % each, towards, weight, sigma, light, leaves)
        incident, own = collected(Light(light, back, ways, first, receivers), incident, own, count)
        dr.eval(incident, own)
    return balance.scaled(incident) if balance else incident, own


class Light:
    """Light that arrived along some ways. A plain object: loops do not take its arrays into their state."""

    def __init__(self, light: list[Float], own: Float, ways: Ways, first: int, receivers: int) -> None:
        self.light, self.own, self.ways = light, own, ways
        self.first, self.receivers = (dr.opaque(arrays().UInt, n) for n in (first, receivers))

    def added(self, k: UInt, cell: UInt, incident: list[list[Float]], own: Float) -> tuple[list[list[Float]], Float]:
        """`incident` and `own` of every cell with the light of one way."""
        kind, place = arrays().Float, k * self.receivers + cell
        towards, weight = self.ways.at(self.first + k)
        factors = [weight * factor for factor in projected(towards)]
        arrived = [dr.gather(kind, light, place) for light in self.light]
        incident = [
            [dr.fma(factor, new, old) for factor, old in zip(factors, numbers, strict=True)]
            for numbers, new in zip(incident, arrived, strict=True)
        ]
        return incident, dr.fma(weight * MEAN, dr.gather(kind, self.own, place), own)


@dr.syntax
def collected(light: Light, incident: list[list[Float]], own: Float, count: int) -> tuple[list[list[Float]], Float]:
    """`incident` and `own` with the light of `count` ways, one after the other: the sum has the same bits always."""
    jit = arrays()
    k, cell = jit.UInt(0), dr.arange(jit.UInt, dr.width(own))
    ways = dr.opaque(jit.UInt, count)
    while k < ways:
        incident, own = light.added(k, cell, incident, own)
        k += 1
    return incident, own


@dr.syntax
def extinction(samples: MatterSamples, cell: UInt, towards: Array3f) -> Float:
    """σ of cells along directions [1/m]: the sum of share · projected area over their samples."""
    jit = arrays()
    k, end = samples.of_cell(cell)
    sigma = dr.zeros(jit.Float, dr.width(cell))
    while k < end:
        sigma += samples.extinction(k, towards)
        k += 1
    return sigma


@dr.syntax
def gathered(
    cells: Cells,
    sources: Sources,
    place: Array3f,
    chord: tuple[Float, Float],
    way: UInt,
    towards: Array3f,
    farthest: Float,
) -> tuple[list[Float], Float, Float]:
    """Light that arrives along ways, of every channel, as its mean over the chord of a cell through `place` (on the
    grid); the share of own light; and the share of light sent along the way that leaves all matter, or meets a surface
    at the distance `farthest`. chord: length before and behind the place, along the way.
    """
    jit, count = arrays(), dr.width(way)
    path = Path(cells, place, towards)
    distance, whole = chord[0], chord[0] + chord[1]
    sigma, last = sources.at(way, cells.find(jit.Array3i(dr.floor(place))))
    depth = -dr.log(mean_of_decay(sigma * whole * cells.edge))  # light that enters a chord, less its mean over it
    own = 1.0 - dr.exp(-depth)
    light = with_ramp([dr.zeros(jit.Float, count) for _ in last], own, last, 0.0, last)
    open_depth = dr.zeros(jit.Float, count)
    cell = path.cell_behind(distance)
    inside = cells.inside(cell) & (distance < farthest)
    while inside & (depth < DEEPEST):
        number = cells.find(cell)
        end = dr.fmin(path.end(cell, number, distance), farthest)
        sigma, here = sources.at(way, number)
        half = 0.5 * sigma * (end - distance) * cells.edge
        matter, before = half > LEAST_DEPTH, open_depth > LEAST_DEPTH
        between = open_depth + half
        near, far = ramp(between)
        passed = dr.exp(-depth)
        back = selected(matter, here, last)
        light = with_ramp(light, passed * near, selected(before, last, here), passed * far, back)
        last = back
        depth += between
        open_depth = dr.select(matter, half, 0.0)
        distance = end
        cell = path.cell_behind(distance)
        inside = cells.inside(cell) & (distance < farthest)
    rest = dr.select(depth < DEEPEST, 1.0 - dr.exp(-open_depth), 1.0)
    passed = dr.exp(-depth)
    return with_ramp(light, passed * rest, last, 0.0, last), own, passed * (1.0 - rest)


def chord_through(place: Array3f, towards: Array3f) -> tuple[Float, Float]:
    """Lengths from a place on a grid to the sides of its cell, along a direction and against it [cell]."""
    cell = dr.floor(place)
    inverse = dr.rcp(dr.select(dr.abs(towards) < 1e-9, 1e-9, towards))
    low, high = (cell - place) * inverse, (cell + 1.0 - place) * inverse
    return dr.min(dr.maximum(low, high)), -dr.max(dr.minimum(low, high))


class Path:
    """Straight ways on the grid from `place`, all in one direction. Distances are in cells."""

    def __init__(self, cells: Cells, place: Array3f, towards: Array3f) -> None:
        self.cells, self.place, self.towards, self.ahead = cells, place, towards, towards > 0.0
        self.inverse = dr.rcp(dr.select(dr.abs(towards) < 1e-9, 1e-9, towards))

    def end(self, cell: Array3f, number: Int, begin: Float) -> Float:
        """Where the way leaves a cell that it enters at `begin`, or the empty cells around it; see `Cells.find`."""
        reach = dr.select(number < 0, -number - 1, 0)
        faces = arrays().Array3f(dr.select(self.ahead, cell + 1 + reach, cell - reach))
        return dr.fmax(dr.min((faces - self.place) * self.inverse), begin + LEAST_STEP)

    def entry(self) -> Float:
        """Where the way enters the grid; 0 from inside."""
        return dr.fmax(dr.max(dr.minimum(*self._faces())), 0.0)

    def exit(self) -> Float:
        """Where the way leaves the grid; before its entry, where it misses it."""
        return dr.min(dr.maximum(*self._faces()))

    def _faces(self) -> tuple[Array3f, Array3f]:
        last = self.cells.last + 1.0
        return -self.place * self.inverse, (last - self.place) * self.inverse

    def cell_behind(self, distance: Float) -> Array3f:
        """The cell behind a distance."""
        return arrays().Array3i(dr.floor(dr.fma(self.towards, distance + NUDGE, self.place)))


def selected(mask: Bool, yes: list[Float], no: list[Float]) -> list[Float]:
    """`dr.select` of every channel."""
    return [dr.select(mask, y, n) for y, n in zip(yes, no, strict=True)]


def with_ramp(light: list[Float], near: Float, front: list[Float], far: Float, back: list[Float]) -> list[Float]:
    """light + near · front + far · back, of every channel."""
    return [dr.fma(near, f, dr.fma(far, b, old)) for old, f, b in zip(light, front, back, strict=True)]


def mean_of_decay(depth: Float) -> Float:
    """∫ exp(−D x) dx over 0…1."""
    thin = depth < 0.02
    safe = dr.select(thin, 1.0, depth)
    return dr.select(thin, 1.0 - depth * (0.5 - depth * (1.0 / 6.0)), (1.0 - dr.exp(-safe)) / safe)


def ramp(depth: Float) -> tuple[Float, Float]:
    """∫ exp(−t) (1 − t/D) dt and ∫ exp(−t) t/D dt over 0…D: weights of the sources at the ends of a linear ramp."""
    mean = mean_of_decay(depth)
    return 1.0 - mean, mean - dr.exp(-depth)
