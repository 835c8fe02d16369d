"""Matter field: what nodes of a lattice hold, as kernels read it. Every law of matter has body colours at nodes.

Lengths are in voxels, places in lattice coordinates (whole at nodes, x first). Colours are trilinear.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, Int64, UInt, arrays, clip, lookup
from hagoromo.reflectance.element import Element

if TYPE_CHECKING:
    from hagoromo_recovery.descent.pixel_table import Drawn
    from hagoromo_recovery.field.matter_march import MatterMarch
    from hagoromo_recovery.field.matter_moves import MatterMoves

COLOURS, AXES = 3, 3  # body colours of a node, and numbers of its axis
SUMS = "sums_by_"  # of a name, the name of its gradient
UNITS = 2.0**48  # of a gradient's 1: sums reach 3e4, and an addend is rounded to 4e-15


class MatterField(ABC):
    """A value, an axis and body colours at every place of a lattice; what these are is the law of the matter.

    colours: Float (nodes · 3) body colours. shares: Float (nodes,) of the second of two glosses, 0 … 1, which have no
    gradient; None: the object has one gloss. Gradients are summed in whole units of 1 / UNITS, Int64: such
    sums do not depend on the order of what is added, so that one seed gives one result, whatever the number of cores.
    All arrays are fields of this object, so that Dr.Jit's loops do not take them into their state.
    """

    def __init__(self, colours: NDArray[np.floating], shares: NDArray[np.floating] | None = None) -> None:
        """colours: (nz, ny, nx, 3). shares: (nz, ny, nx)."""
        jit = arrays()
        self.shape = colours.shape[:3]
        self.colours = lookup(jit.Float, np.asarray(colours, np.float32))
        self.shares = None if shares is None else lookup(jit.Float, np.asarray(shares, np.float32))
        nz, ny, nx = self.shape
        self.rows = [dr.opaque(jit.UInt, each) for each in (1, nx, nx * ny)]
        self.last = [dr.opaque(jit.Float, float(n - 2)) for n in (nx, ny, nz)]
        self.no_gradients()

    moving: Mapping[str, int]  # names of arrays that move, and how many numbers a node has of each
    element: Element  # that the axis is of
    shown_around: int  # nodes around the mean place of a ray that it shows, too

    @abstractmethod
    def march(self, shading: Any, softness: float, shadows: bool) -> MatterMarch:
        """What rays see of this matter. softness: of a surface [voxel]."""

    @abstractmethod
    def moves(self) -> MatterMoves:
        """How its numbers follow their gradients."""

    @abstractmethod
    def plain(self) -> tuple[NDArray[np.float32], ...]:
        """What it is made of, as plain arrays."""

    @abstractmethod
    def outline_weight(self, drawn: Drawn) -> Float:
        """Weight of the silhouette's share in each pixel, which the opacity should have."""

    @abstractmethod
    def value_at(self, place: Array3f) -> Float:
        """What opacity is by: a signed distance [voxel], or an extinction [1/voxel]."""

    @abstractmethod
    def axis_at(self, place: Array3f) -> Array3f:
        """A vector along the axis of the elements, of any length: along a normal, or a tangent."""

    @abstractmethod
    def add_by_value(self, place: Array3f, by: Float) -> None:
        """Add the gradient of by · value_at(place)."""

    @abstractmethod
    def add_by_axis(self, place: Array3f, by: Array3f) -> None:
        """Add the gradient of by · axis_at(place)."""

    def at(self, nodes: UInt) -> list[NDArray[np.float32]]:
        """Numbers (n · each,) of some nodes, of each array that moves."""
        jit = arrays()
        return [
            np.array(dr.gather(jit.Float, getattr(self, name), _numbers(nodes, each)))
            for name, each in self.moving.items()
        ]

    def set_at(self, nodes: UInt, numbers: Sequence[NDArray[np.float32]]) -> None:
        """Other numbers of some nodes, as `at` gives them."""
        for (name, each), values in zip(self.moving.items(), numbers, strict=True):
            target = getattr(self, name)
            dr.scatter(target, lookup(arrays().Float, values), _numbers(nodes, each), mode=dr.ReduceMode.NoConflicts)
            dr.eval(target)

    def sums(self, nodes: UInt) -> list[NDArray[np.int64]]:
        """Gradients (n · each,) by the numbers of some nodes, in units of 1 / UNITS."""
        jit = arrays()
        return [
            np.array(dr.gather(jit.Int64, getattr(self, SUMS + name), _numbers(nodes, each)))
            for name, each in self.moving.items()
        ]

    def set_sums(self, nodes: UInt, sums: Sequence[NDArray[np.int64]]) -> None:
        """Gradients by the numbers of some nodes, as `sums` gives them."""
        for (name, each), values in zip(self.moving.items(), sums, strict=True):
            target = getattr(self, SUMS + name)
            dr.scatter(target, lookup(arrays().Int64, values), _numbers(nodes, each), mode=dr.ReduceMode.NoConflicts)
            dr.eval(target)

    def no_gradients(self) -> None:
        """Gradients of 0."""
        self.sums_by_colours = no_sums(dr.width(self.colours))

    @property
    def by_colours(self) -> Float:
        """Float (nodes · 3), the gradient by body colours."""
        return gradient_of(self.sums_by_colours)

    def scale_colours(self, factors: NDArray[np.floating]) -> None:
        """Multiply the body colours of all nodes, by a factor for each of the COLOURS."""
        jit = arrays()
        channel = dr.arange(jit.UInt, dr.width(self.colours)) % COLOURS
        self.colours = self.colours * dr.gather(jit.Float, lookup(jit.Float, np.asarray(factors, np.float32)), channel)
        dr.eval(self.colours)

    def body_colours(self) -> NDArray[np.float32]:
        """Body colours (nz, ny, nx, 3)."""
        return np.array(self.colours).reshape(*self.shape, COLOURS)

    def gloss_shares(self) -> NDArray[np.float32] | None:
        """Shares (nz, ny, nx) of the second gloss."""
        return None if self.shares is None else np.array(self.shares).reshape(self.shape)

    def shares_of(self, nodes: NDArray[np.integer]) -> NDArray[np.float64]:
        """Shares (n,) of some nodes."""
        return np.array(self.shares, np.float64)[nodes]

    def set_shares(self, nodes: NDArray[np.integer], shares: NDArray[np.floating]) -> None:
        """Other shares (n,) of some nodes."""
        every = np.array(self.shares)
        every[nodes] = shares
        self.shares = lookup(arrays().Float, every)

    def colours_at(self, place: Array3f) -> list[Float]:
        """Body colours."""
        return self._linear_at(self.colours, COLOURS, place)

    def looks_at(self, place: Array3f) -> list[Float]:
        """What a shading needs of a place: body colours and, of two glosses, the share of the second."""
        return [*self.colours_at(place), *([] if self.shares is None else [self.share_at(place)])]

    def share_at(self, place: Array3f) -> Float:
        """Share of the second gloss."""
        return self._linear_at(self.shares, 1, place)[0]

    def _linear_at(self, numbers: Float, each: int, place: Array3f) -> list[Float]:
        """Numbers of nodes, `each` of every one, between them."""
        jit, found = arrays(), [arrays().Float(0)] * each
        for node, weight in self.corner_nodes(place):
            for c in range(each):
                found[c] = dr.fma(weight, dr.gather(jit.Float, numbers, node * each + c), found[c])
        return found

    def nearest_node(self, place: Array3f) -> NDArray[np.int64]:
        """Number of the node nearest to each place."""
        z, y, x = (np.clip(np.rint(np.array(place[2 - k])), 0, self.shape[k] - 1).astype(np.int64) for k in range(3))
        return (z * self.shape[1] + y) * self.shape[2] + x

    def node_at(self, place: Array3f) -> UInt:
        """Number of the node nearest to a place of the lattice."""
        jit, node = arrays(), arrays().UInt(0)
        for k in range(3):
            node += jit.UInt(clip(dr.floor(place[k] + 0.5), 0.0, self.last[k] + 1.0)) * self.rows[k]
        return node

    def way_to_edge(self, place: Array3f, direction: Array3f, margin: float) -> Float:
        """Way from a place along a direction to where the lattice ends, but for a margin [voxel]."""
        jit, way = arrays(), arrays().Float(1e6)
        for k in range(3):
            end = dr.select(direction[k] > 0.0, self.last[k] + (1.0 - margin), margin)
            step = (end - place[k]) / dr.select(dr.abs(direction[k]) > 1e-6, direction[k], jit.Float(1e-6))
            way = dr.fmin(way, dr.fmax(step, 0.0))
        return way

    def add_by_colours(self, place: Array3f, by: list[Float]) -> None:
        """Add the gradient of Σ by · colours_at(place)."""
        for node, weight in self.corner_nodes(place):
            for c in range(COLOURS):
                add_to(self.sums_by_colours, node * COLOURS + c, weight * by[c])

    def corner_nodes(self, place: Array3f) -> Iterator[tuple[UInt, Float]]:
        """Number and weight of each node of the cell around a place."""
        jit = arrays()
        first, weights = jit.UInt(0), []
        for k in range(3):
            low = clip(dr.floor(dr.detach(place[k])), 0.0, self.last[k])
            t = clip(place[k] - low, 0.0, 1.0)
            weights.append([1.0 - t, t])
            first += jit.UInt(low) * self.rows[k]
        for z in range(2):
            for y in range(2):
                row, both = first + self.rows[2] * z + self.rows[1] * y, weights[1][y] * weights[2][z]
                for x in range(2):
                    yield row + x, both * weights[0][x]


def _numbers(nodes: UInt, each: int) -> UInt:
    """Indices of the numbers of nodes that have `each` of them."""
    jit = arrays()
    lane = dr.arange(jit.UInt, dr.width(nodes) * each)
    return dr.gather(jit.UInt, nodes, lane // each) * each + lane % each


def no_sums(count: int) -> Int64:
    """Sums of 0, for a gradient by `count` numbers."""
    sums = dr.zeros(arrays().Int64, count)
    dr.make_opaque(sums)
    return sums


def gradient_of(sums: Int64) -> Float:
    """The gradient that sums are of."""
    return arrays().Float(sums) * (1.0 / UNITS)


def add_to(target: Int64, index: UInt, value: Float) -> None:
    """target[index] += value, by copies of the target for each core: few cores then do not wait for each other."""
    units = arrays().Int64(value * UNITS)
    dr.scatter_reduce(dr.ReduceOp.Add, target, units, index, mode=dr.ReduceMode.Expand)
