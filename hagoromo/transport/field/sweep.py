"""Sweep: light sent by the cells, gathered at the cells along a set of directions.

Each cell looks along each direction from a place of its own in its matter, drawn at random: from the middles of cells
alone the ways through them would be too long, and less light would leave the faces of matter than does. Along a ray the
source S = (light sent per metre) / σ, both of the second order in direction, is that of a cell at the middle of the
ray's way through it, and in between linear in the optical depth. At the edge of matter it goes on as it is. What
arrives in a cell is the mean over the ray's way through it.

Enters: σ and S of every cell and direction. Leaves: the incident light, nine numbers a cell and channel (see
`second_order`), and the share of its own light that a cell gets back.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, Int, UInt, arrays, lookup
from hagoromo.files.memory import require
from hagoromo.transport.field.balance import Balance
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.directions import directions, turn
from hagoromo.transport.field.fit import FINER
from hagoromo.transport.field.matter_samples import MatterSamples
from hagoromo.transport.field.second_order import MEAN, NUMBERS, projected, second_order
from hagoromo.transport.film import scrambled
from hagoromo.transport.step_elements import mean_of_decay

LEAST_PASSED = 1e-4  # of light along a ray, below which the ray ends; its last source stands for all behind it
LEAST_DEPTH = 1e-6  # a way through a cell with less counts as empty
NUDGE = 1e-4  # [cell] behind its begin where the next cell is looked up
LANES_AT_ONCE = 1 << 22  # cells and ways whose sources are known together
PARTS = FINER**3  # cells of a block, which have directions of their own
BYTES_PER_WAY = 4.0  # of a cell
FARTHEST = 1e9  # [cell] beyond all grids
WITHIN = 0.4999  # [cell] of the middle of a cell, whatever the rounding
LEAST_STEP = 5e-4  # [cell] so that rays go on whatever the rounding
LEAST_SHARE = 2.0**-22  # of the distance, two steps of its float: rays that come from far go on, too
Sight = Callable[[Cells, Array3f, Array3f], Float]  # place on the grid, direction → distance to a surface [cell]


class Ways:
    """Directions of sweeps, towards the light, as kernels read them, and σ of every filled cell along each.

    The eight cells of every block have other directions each, turned at random: together a block has eight times as
    many. Each cell has `count` of them; that of number k of a cell in part p of its block is way k · PARTS + p.
    """

    def __init__(self, samples: MatterSamples, cells: Cells, random: np.random.Generator) -> None:
        (towards, weights), jit, self.cells, self.samples = directions(), arrays(), cells, samples
        self.count, filled = len(weights), cells.filled
        require(BYTES_PER_WAY * self.count * PARTS * filled, "the directions of mode full")
        turned = np.stack([towards @ turn(random).T for _ in range(PARTS)], axis=1)
        table = np.concatenate([turned, np.broadcast_to(weights[:, None, None], (self.count, PARTS, 1))], axis=-1)
        self.table = lookup(jit.Float, table.astype(np.float32))
        place = cells.places[:filled] % FINER
        self.part = lookup(jit.UInt, (place @ (1, FINER, FINER**2)).astype(np.uint32))
        lane = dr.arange(jit.UInt, self.count * PARTS * filled)
        self.sigma = extinction(samples, lane % cells.matter_count, self.at(lane // cells.matter_count)[0])
        dr.eval(self.sigma)
        self.smooth = smooth_extinction(self)

    def at(self, way: UInt) -> tuple[Array3f, Float]:
        """Direction and weight."""
        x, y, z, weight = dr.gather(arrays().Array4f, self.table, way)
        return arrays().Array3f(x, y, z), weight

    def of(self, number: UInt, cell: UInt) -> UInt:
        """The way of a number of a cell."""
        return number * PARTS + dr.gather(arrays().UInt, self.part, cell)

    def along(self, way: UInt, cell: UInt) -> Float:
        """σ of a cell [1/m]."""
        return dr.gather(arrays().Float, self.sigma, way * self.cells.matter_count + cell)

    def smooth_along(self, way: UInt, cell: UInt) -> Float:
        """σ of a cell along a way [1/m], of the second order in direction, as the light that it sends is.

        Planes send nothing along themselves, but their light of the second order is not 0 there. σ itself is, and
        light over it would have no bounds.
        """
        return second_order([dr.gather(arrays().Float, n, cell) for n in self.smooth]).at(self.at(way)[0])

    def with_sigma(self, numbers: list[Float], way: UInt, cell: UInt) -> list[Float]:
        """Nine numbers with what σ along a way adds to them."""
        towards, weight = self.at(way)
        value = self.along(way, cell) * weight * (1.0 / PARTS)
        return [dr.fma(value, factor, old) for factor, old in zip(projected(towards), numbers, strict=True)]

    def place(self, way: UInt, cell: UInt) -> Array3f:
        """Where a cell looks along a way: at one of its samples of matter, on the grid; each way at another, if it
        can.
        """
        cells, (first, end) = self.cells, self.samples.of_cell(cell)
        drawn = first + (scrambled(cell) % 65536 + way // PARTS) % dr.maximum(end - first, 1)
        middle = cells.centre(cell)
        offset = cells.place(self.samples.point(drawn)) - middle
        return middle + dr.minimum(dr.maximum(offset, -WITHIN), WITHIN)

    def sigma_of_all(self) -> list[tuple[Array3f, Float, Float]]:
        """Directions, the same for all cells, their weights, and σ of every cell along each."""
        cell, ways = dr.arange(arrays().UInt, self.cells.filled), range(0, self.count * PARTS, PARTS)
        return [(*self.at(way), self.along(way, cell)) for way in (dr.opaque(arrays().UInt, way) for way in ways)]

    def mean_sigma(self) -> Float:
        """Mean of σ over all directions."""
        sigma = dr.zeros(arrays().Float, self.cells.filled)
        for _, weight, along in self.sigma_of_all():
            sigma = dr.fma(along, weight * MEAN, sigma)
        dr.eval(sigma)
        return sigma


class Sources:
    """σ and S of every cell along `count` ways from `first` on. A plain object: loops do not take its arrays into their
    state.
    """

    def __init__(self, ways: Ways, sent: list[list[Float]], first: int, count: int) -> None:
        jit, self.cells, self.ways, self.first = arrays(), ways.cells, ways, dr.opaque(arrays().UInt, first)
        lane = dr.arange(jit.UInt, count * ways.cells.filled)
        way, cell = self.first + lane // self.cells.matter_count, lane % self.cells.matter_count
        away, inverse = -ways.at(way)[0], dr.rcp(dr.fmax(ways.smooth_along(way, cell), 1e-30))
        self.sources = [
            second_order([dr.gather(jit.Float, n, cell) for n in numbers]).at(away) * inverse for numbers in sent
        ]
        dr.eval(self.sources)

    def at(self, way: UInt, cell: Int) -> tuple[Float, list[Float]]:
        """σ [1/m] and S of a cell along a way; 0 where it holds no matter."""
        kind, holds, count = arrays().Float, self.cells.holds(cell), self.cells.matter_count
        place, cell = (way - self.first) * count + arrays().UInt(cell), arrays().UInt(cell)
        sigma = dr.gather(kind, self.ways.sigma, way * count + cell, holds)
        return sigma, [dr.gather(kind, s, place, holds) for s in self.sources]


def sweep(
    ways: Ways, sent: list[list[Float]], sight: Sight | None = None, balance: Balance | None = None
) -> tuple[list[list[Float]], Float]:
    """Incident light of each channel at the filled cells, and the share of their own light that they get back, 0…1.

    sent: per channel the nine numbers of the light that the filled cells send per metre. sight: how far rays go before
    a surface ends them; None: without end. balance: to which what cells send and receive is added.
    """
    jit, cells, filled = arrays(), ways.cells, ways.cells.filled
    incident, own = [[dr.zeros(jit.Float, filled)] * NUMBERS for _ in sent], dr.zeros(jit.Float, filled)
    together = max(min(LANES_AT_ONCE // (PARTS * filled), ways.count), 1)
    for first in range(0, ways.count, together):
        count = min(together, ways.count - first)
        sources = Sources(ways, sent, PARTS * first, PARTS * count)
        lane, begin = dr.arange(jit.UInt, filled * count), dr.opaque(jit.UInt, first)
        cell = lane % cells.matter_count
        way = ways.of(begin + lane // cells.matter_count, cell)
        place, towards = ways.place(way, cell), ways.at(way)[0]
        far = sight(cells, place, towards) if sight else dr.opaque(jit.Float, FARTHEST)
        light, back, leaves = gathered(cells, sources, place, chord_through(place, towards), way, towards, far)
        dr.eval(light, back, leaves)
        if balance:
            balance.add(cell, towards, ways.at(way)[1], ways.along(way, cell), light, leaves)
        incident, own = collected(SweptLight(light, back, ways, begin), incident, own, count)
        dr.eval(incident, own)
    return incident, own


def balanced(ways: Ways, sent: list[list[Float]], sight: Sight | None = None) -> list[list[Float]]:
    """Light of what cells send that arrives in them, as much as there is; see `sweep` and `Balance`."""
    balance = Balance(sent)
    return balance.scaled(sweep(ways, sent, sight, balance)[0])


class SweptLight:
    """Light that arrived along some ways of each cell. A plain object: loops do not take its arrays into their state.

    first: number of the first of these ways.
    """

    def __init__(self, light: list[Float], own: Float, ways: Ways, first: UInt) -> None:
        self.light, self.own, self.ways, self.first = light, own, ways, first

    def added(self, k: UInt, cell: UInt, incident: list[list[Float]], own: Float) -> tuple[list[list[Float]], Float]:
        """`incident` and `own` of every cell with the light of one way."""
        kind, place = arrays().Float, k * self.ways.cells.matter_count + cell
        towards, weight = self.ways.at(self.ways.of(self.first + k, cell))
        factors = [weight * factor for factor in projected(towards)]
        arrived = [dr.gather(kind, light, place) for light in self.light]
        incident = [
            [dr.fma(factor, new, old) for factor, old in zip(factors, numbers, strict=True)]
            for numbers, new in zip(incident, arrived, strict=True)
        ]
        return incident, dr.fma(weight * MEAN, dr.gather(kind, self.own, place), own)


@dr.syntax
def collected(
    light: SweptLight, incident: list[list[Float]], own: Float, count: int
) -> tuple[list[list[Float]], Float]:
    """`incident` and `own` with the light of `count` ways, one after the other: the sum has the same bits always."""
    jit = arrays()
    k, cell = jit.UInt(0), dr.arange(jit.UInt, dr.width(own))
    ways = dr.opaque(jit.UInt, count)
    while k < ways:
        incident, own = light.added(k, cell, incident, own)
        k += 1
    return incident, own


@dr.syntax
def smooth_extinction(ways: Ways) -> list[Float]:
    """The nine numbers of σ of every filled cell [1/m], from σ along all ways."""
    jit = arrays()
    way, cell = jit.UInt(0), dr.arange(jit.UInt, ways.cells.filled)
    end = dr.opaque(jit.UInt, ways.count * PARTS)
    numbers = [dr.zeros(jit.Float, ways.cells.filled) for _ in range(NUMBERS)]
    while way < end:
        numbers = ways.with_sigma(numbers, way, cell)
        way += 1
    dr.eval(numbers)
    return numbers


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
    passed = mean_of_decay(sigma * whole * cells.edge)  # of light that enters a chord, its mean over it
    own = 1.0 - passed
    light = with_ramp([dr.zeros(jit.Float, count) for _ in last], own, last, 0.0, last)
    open_depth = dr.zeros(jit.Float, count)
    cell = path.cell_behind(distance)
    inside = cells.inside(cell) & (distance < farthest)
    while inside & (passed > LEAST_PASSED):
        number = cells.find(cell)
        end = dr.fmin(path.end(cell, number, distance), farthest)
        sigma, here = sources.at(way, number)
        half = 0.5 * sigma * (end - distance) * cells.edge
        matter, before = half > LEAST_DEPTH, open_depth > LEAST_DEPTH
        between = open_depth + half
        near, far, rest = ramp(between)
        back = selected(matter, here, last)
        light = with_ramp(light, passed * near, selected(before, last, here), passed * far, back)
        last = back
        passed *= rest
        open_depth = dr.select(matter, half, 0.0)
        distance = end
        cell = path.cell_behind(distance)
        inside = cells.inside(cell) & (distance < farthest)
    rest = dr.select(passed > LEAST_PASSED, 1.0 - dr.exp(-open_depth), 1.0)
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
        least = dr.fmax(LEAST_STEP, LEAST_SHARE * begin)
        return dr.fmax(dr.min((faces - self.place) * self.inverse), begin + least)

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


def ramp(depth: Float) -> tuple[Float, Float, Float]:
    """∫ exp(−t) (1 − t/D) dt and ∫ exp(−t) t/D dt over 0…D: weights of the sources at the ends of a linear ramp; and
    exp(−D).
    """
    thin, rest = depth < 0.02, dr.exp(-depth)
    mean = dr.select(thin, 1.0 - depth * (0.5 - depth * (1.0 / 6.0)), (1.0 - rest) / dr.select(thin, 1.0, depth))
    return 1.0 - mean, mean - rest, rest
