"""Distance field: a signed distance and body colours on a lattice, as kernels read them.

Lengths are in voxels, places in lattice coordinates (whole at nodes, x first). The distance between nodes is a
quadratic B-spline of the 27 nodes around a place: its slope changes without steps, so normals are smooth. Colours are
trilinear.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, Int64, UInt, arrays, clip, lookup

COLOURS = 3  # body colours of a node
UNITS = 2.0**48  # of a gradient's 1: sums reach 3e4, and an addend is rounded to 4e-15


class Stencil(NamedTuple):
    """The 27 nodes around a place: the first one's number, and weights and their slopes along x, y and z."""

    first: UInt
    weights: list[list[Float]]
    slopes: list[list[Float]]


class DistanceField:
    """distance: Float (nodes,) signed distance [voxel], negative inside. colours: Float (nodes · 3) body colours.

    sums_by_distance, sums_by_colours: Int64, what is added to their gradients, in whole units of 1 / UNITS: such sums
    do not depend on the order of what is added, so that one seed gives one result, whatever the number of cores. All
    are fields of this object, so that Dr.Jit's loops do not take them into their state.
    """

    def __init__(self, distance: NDArray[np.floating], colours: NDArray[np.floating]) -> None:
        """distance: (nz, ny, nx). colours: (nz, ny, nx, 3)."""
        jit = arrays()
        self.shape = distance.shape
        self.distance = lookup(jit.Float, np.asarray(distance, np.float32))
        self.colours = lookup(jit.Float, np.asarray(colours, np.float32))
        nz, ny, nx = self.shape
        self.rows = [dr.opaque(jit.UInt, each) for each in (1, nx, nx * ny)]
        self.last = [dr.opaque(jit.Float, float(n - 2)) for n in (nx, ny, nz)]
        self.no_gradients()

    def no_gradients(self) -> None:
        """Gradients of 0."""
        self.sums_by_distance = dr.zeros(arrays().Int64, dr.width(self.distance))
        self.sums_by_colours = dr.zeros(arrays().Int64, dr.width(self.colours))
        dr.make_opaque(self.sums_by_distance, self.sums_by_colours)

    @property
    def by_distance(self) -> Float:
        """Float (nodes,), the gradient by distances."""
        return arrays().Float(self.sums_by_distance) * (1.0 / UNITS)

    @property
    def by_colours(self) -> Float:
        """Float (nodes · 3), the gradient by body colours."""
        return arrays().Float(self.sums_by_colours) * (1.0 / UNITS)

    def scale_colours(self, factors: NDArray[np.floating]) -> None:
        """Multiply the body colours of all nodes, by a factor for each of the COLOURS."""
        jit = arrays()
        channel = dr.arange(jit.UInt, dr.width(self.colours)) % COLOURS
        self.colours = self.colours * dr.gather(jit.Float, lookup(jit.Float, np.asarray(factors, np.float32)), channel)
        dr.eval(self.colours)

    def distances(self) -> NDArray[np.float32]:
        """Signed distances (nz, ny, nx) [voxel]."""
        return np.array(self.distance).reshape(self.shape)

    def body_colours(self) -> NDArray[np.float32]:
        """Body colours (nz, ny, nx, 3)."""
        return np.array(self.colours).reshape(*self.shape, COLOURS)

    def stencil(self, place: Array3f) -> Stencil:
        """The nodes around a place; a place outside counts as the nearest one inside."""
        jit = arrays()
        first, weights, slopes = jit.UInt(0), [], []
        for k in range(3):
            middle = clip(dr.floor(dr.detach(place[k]) + 0.5), 1.0, self.last[k])
            t = clip(place[k] - middle, -0.5, 0.5)
            low, high = 0.5 - t, 0.5 + t
            weights.append([0.5 * low * low, 0.75 - t * t, 0.5 * high * high])
            slopes.append([-low, -2.0 * t, high])
            first += (jit.UInt(middle) - 1) * self.rows[k]
        return Stencil(first, weights, slopes)

    def distance_at(self, place: Array3f) -> Float:
        """Signed distance [voxel]."""
        jit, s = arrays(), self.stencil(place)
        total = jit.Float(0)
        for z in range(3):
            plane = jit.Float(0)
            for y in range(3):
                row, line = s.first + self.rows[2] * z + self.rows[1] * y, jit.Float(0)
                for x in range(3):
                    line = dr.fma(s.weights[0][x], dr.gather(jit.Float, self.distance, row + x), line)
                plane = dr.fma(s.weights[1][y], line, plane)
            total = dr.fma(s.weights[2][z], plane, total)
        return total

    def slope_at(self, place: Array3f) -> Array3f:
        """Gradient of the distance."""
        jit, s = arrays(), self.stencil(place)
        slope = [jit.Float(0)] * 3
        for z in range(3):
            for y in range(3):
                row = s.first + self.rows[2] * z + self.rows[1] * y
                line, rise = jit.Float(0), jit.Float(0)
                for x in range(3):
                    node = dr.gather(jit.Float, self.distance, row + x)
                    line, rise = dr.fma(s.weights[0][x], node, line), dr.fma(s.slopes[0][x], node, rise)
                slope[0] = dr.fma(s.weights[1][y] * s.weights[2][z], rise, slope[0])
                slope[1] = dr.fma(s.slopes[1][y] * s.weights[2][z], line, slope[1])
                slope[2] = dr.fma(s.weights[1][y] * s.slopes[2][z], line, slope[2])
        return jit.Array3f(*slope)

    def colours_at(self, place: Array3f) -> list[Float]:
        """Body colours."""
        jit, colours = arrays(), [arrays().Float(0)] * COLOURS
        for node, weight in self._corner_nodes(place):
            for c in range(COLOURS):
                colours[c] = dr.fma(weight, dr.gather(jit.Float, self.colours, node * COLOURS + c), colours[c])
        return colours

    def nearest_node(self, place: Array3f) -> NDArray[np.int64]:
        """Number of the node nearest to each place."""
        z, y, x = (np.clip(np.rint(np.array(place[2 - k])), 0, self.shape[k] - 1).astype(np.int64) for k in range(3))
        return (z * self.shape[1] + y) * self.shape[2] + x

    def add_by_distance(self, place: Array3f, by: Float) -> None:
        """Add the gradient of by · distance_at(place)."""
        s = self.stencil(place)
        for z in range(3):
            for y in range(3):
                row, both = s.first + self.rows[2] * z + self.rows[1] * y, by * s.weights[1][y] * s.weights[2][z]
                for x in range(3):
                    add_to(self.sums_by_distance, row + x, both * s.weights[0][x])

    def add_by_slope(self, place: Array3f, by: Array3f) -> None:
        """Add the gradient of by · slope_at(place)."""
        s = self.stencil(place)
        for z in range(3):
            for y in range(3):
                row = s.first + self.rows[2] * z + self.rows[1] * y
                rise = by[0] * s.weights[1][y] * s.weights[2][z]
                line = by[1] * s.slopes[1][y] * s.weights[2][z] + by[2] * s.weights[1][y] * s.slopes[2][z]
                for x in range(3):
                    add_to(self.sums_by_distance, row + x, dr.fma(rise, s.slopes[0][x], line * s.weights[0][x]))

    def add_by_colours(self, place: Array3f, by: list[Float]) -> None:
        """Add the gradient of Σ by · colours_at(place)."""
        for node, weight in self._corner_nodes(place):
            for c in range(COLOURS):
                add_to(self.sums_by_colours, node * COLOURS + c, weight * by[c])

    def _corner_nodes(self, place: Array3f) -> Iterator[tuple[UInt, Float]]:
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


def add_to(target: Int64, index: UInt, value: Float) -> None:
    """target[index] += value, by copies of the target for each core: few cores then do not wait for each other."""
    units = arrays().Int64(value * UNITS)
    dr.scatter_reduce(dr.ReduceOp.Add, target, units, index, mode=dr.ReduceMode.Expand)
