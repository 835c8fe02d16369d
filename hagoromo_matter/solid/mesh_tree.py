"""Mesh tree: the face of a triangle mesh that is nearest to a point, on the device.

Enters: vertices and faces in any unit; leaves: Dr.Jit arrays for points in that unit. The tree is a complete binary
one over the faces in Morton order; node k has the children 2k and 2k + 1, the root is 1, so that no links are stored.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip, lookup

MORTON_BITS = 16  # a coordinate
LEAST_AREA = 1e-6  # square of the sine of the angle of a triangle below which it counts as a line


class Nearest(NamedTuple):
    """The nearest face within reach: whether there is one, its number, shares of its corners, the point on it."""

    is_within_reach: Any
    face: Any
    shares: Any
    point: Any


class MeshTree:
    """Faces (m, 3) of vertices (n, 3) as the leaves of a tree of boxes."""

    def __init__(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        corners = np.asarray(vertices, float)[faces]
        order = _morton_order(corners.mean(axis=1))
        self.leaves = 1 << math.ceil(math.log2(max(len(faces), 2)))
        order = np.concatenate([order, np.full(self.leaves - len(order), order[-1])])  # padded by the last face
        corners = corners[order]
        self._faces = lookup(arrays().UInt, order.astype(np.uint32))
        self._corners = lookup(arrays().Float, corners.astype(np.float32))
        low, high = _levels(corners.min(axis=1), np.minimum), _levels(corners.max(axis=1), np.maximum)
        self._low, self._high = (lookup(arrays().Float, box.astype(np.float32)) for box in (low, high))

    def nearest(self, point: Any, reach: float) -> Nearest:
        """The face nearest to `point` (Array3f), no farther than `reach`."""
        _, leaf = self._search(point, dr.opaque(arrays().Float, reach * reach) + 0.0 * point.x)
        is_within_reach = leaf >= self.leaves
        leaf = dr.select(is_within_reach, leaf - self.leaves, 0)
        shares, on = _nearest_on(point, *self._corners_of(leaf))
        return Nearest(is_within_reach, dr.gather(arrays().UInt, self._faces, leaf), shares, on)

    @dr.syntax
    def _search(self, point: Any, best: Any) -> tuple[Any, Any]:
        """Squared distance and number of the leaf (0: none) of the nearest face closer than √`best`."""
        jit = arrays()
        node, leaf = jit.UInt(1) + 0 * jit.UInt(point.x), jit.UInt(0)
        while node < self.leaves:  # straight down to a near face, so that the search may skip the rest
            left, right = self._square_to(point, node * 2), self._square_to(point, node * 2 + 1)
            node = node * 2 + dr.select(right < left, jit.UInt(1), 0)
        _, on = _nearest_on(point, *self._corners_of(node - self.leaves))
        square = dr.squared_norm(point - on)
        near = square < best
        best, leaf = dr.select(near, square, best), dr.select(near, node, leaf)
        node = jit.UInt(1) + 0 * node
        while node > 0:
            down = self._square_to(point, node) < best
            if down & (node >= self.leaves):
                _, on = _nearest_on(point, *self._corners_of(node - self.leaves))
                square = dr.squared_norm(point - on)
                near = square < best
                best, leaf = dr.select(near, square, best), dr.select(near, node, leaf)
            node = dr.select(down & (node < self.leaves), node * 2, _next(node))
        return best, leaf

    def _square_to(self, point: Any, node: Any) -> Any:
        """Square of the distance to the box of a node."""
        jit = arrays()
        low = dr.gather(jit.Array3f, self._low, node)
        high = dr.gather(jit.Array3f, self._high, node)
        apart = jit.Array3f(*(dr.fmax(dr.fmax(low[k] - point[k], point[k] - high[k]), 0.0) for k in range(3)))
        return dr.squared_norm(apart)

    def _corners_of(self, leaf: Any) -> tuple[Any, Any, Any]:
        jit = arrays()
        a, b, c = (dr.gather(jit.Array3f, self._corners, leaf * 3 + k) for k in range(3))
        return a, b, c


def _next(node: Any) -> Any:
    """The node that follows when the subtree of `node` is skipped; 0 behind the last one."""
    after = node + 1
    after = after >> dr.tzcnt(after)
    return dr.select(after == 1, 0, after)


def _levels(leaves: NDArray[np.float64], join: Any) -> NDArray[np.float64]:
    """Values of all nodes from those of the leaves: (2 · leaves, k), the first row unused."""
    levels = [leaves]
    while len(levels[0]) > 1:
        levels.insert(0, join(levels[0][0::2], levels[0][1::2]))
    return np.concatenate([levels[0][:1], *levels])


def _morton_order(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Order of points (n, 3) along a curve that keeps neighbours together."""
    low, extent = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-300)
    cell = ((points - low) / extent * ((1 << MORTON_BITS) - 1)).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")


def _nearest_on(point: Any, a: Any, b: Any, c: Any) -> tuple[Any, Any]:
    """Shares of the corners, and the point, of the triangle a b c that is nearest to `point`."""
    jit = arrays()
    ab, ac, ap = b - a, c - a, point - a
    aa, bb, ab_ac = dr.squared_norm(ab), dr.squared_norm(ac), dr.dot(ab, ac)
    along_b, along_c = dr.dot(ap, ab), dr.dot(ap, ac)
    area = aa * bb - ab_ac * ab_ac
    is_wide = area > LEAST_AREA * aa * bb  # otherwise one of its edges decides
    area = dr.select(is_wide, area, 1.0)
    v, w = (bb * along_b - ab_ac * along_c) / area, (aa * along_c - ab_ac * along_b) / area
    inside = is_wide & (v >= 0) & (w >= 0) & (v + w <= 1)
    on_b, on_c = clip(along_b / dr.fmax(aa, 1e-30), 0.0, 1.0), clip(along_c / dr.fmax(bb, 1e-30), 0.0, 1.0)
    bc = c - b
    on_bc = clip(dr.dot(point - b, bc) / dr.fmax(dr.squared_norm(bc), 1e-30), 0.0, 1.0)
    zero = jit.Float(0)
    edges = ((on_b, zero), (zero, on_c), (1.0 - on_bc, on_bc))
    best = jit.Float(dr.inf)
    for edge_v, edge_w in edges:
        square = dr.squared_norm(ap - ab * edge_v - ac * edge_w)
        nearer = ~inside & (square < best)
        v, w = dr.select(nearer, edge_v, v), dr.select(nearer, edge_w, w)
        best = dr.select(nearer, square, best)
    return jit.Array3f(1.0 - v - w, v, w), a + ab * v + ac * w
