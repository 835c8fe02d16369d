"""Lamp view: the projection from a lamp onto the square of its shadow map. Enters: a lamp and the points to cover."""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_light import LampInTurn

ROW = 20  # numbers of a view
TICKS = 65535.0  # of a distance in 16 bits
WIDEST_TANGENT = math.tan(math.radians(75))  # of the half angle; a wider view is mapped onto an octahedron


class LampView:
    """Square coordinates a, b in 0…1 of the rays of a lamp: parallel (far lamp), or a pyramid or octahedral map of all
    directions (near lamp). Which of the last two is read from memory: a lamp that moves compiles no new kernel.

    Rays begin in front of all matter, and places count from the middle of it: a lamp a thousand kilometres away has as
    exact a map as one in the room.
    """

    def __init__(self, kind: str, numbers: Sequence[Float]) -> None:
        """`kind`: lines, pyramid or octahedron, see `view_from`. numbers: see `row_of`."""
        vectors = [arrays().Array3f(*numbers[k : k + 3]) for k in range(8, ROW, 3)]
        self.kind, self.folded = kind, numbers[1] > 0.5
        self.extent, _, self.away, self.front, self.depth, self.before = numbers[:6]
        self.middle, self.right, self.up, self.ahead = vectors

    def ticks(self) -> tuple[Float, Float]:
        """Distance of tick 0 [m], and ticks per metre [1/m]: TICKS of them span all matter."""
        return arrays().Float(0), TICKS / self.depth

    def cone(self, size: UInt) -> tuple[Float, Float]:
        """Footprint of a ray of `size` along a side: width where it begins [m], and its growth per metre [1]."""
        jit = arrays()
        apart = 2.0 / jit.Float(size)
        if self.kind == "lines":
            return self.extent * apart, jit.Float(0)
        spread = dr.select(self.folded, 1.6, self.extent) * apart  # 1.6: π / 2 and a little
        return spread * self.before, spread

    def place(self, point: Array3f) -> tuple[Float, Float, Float]:
        """Square coordinates a, b of a point and its distance along the ray [m]."""
        offset = point - self.middle
        x, y, z = (dr.dot(offset, axis) for axis in (self.right, self.up, self.ahead))
        if self.kind == "lines":
            scale = 0.5 / self.extent
            return x * scale + 0.5, y * scale + 0.5, z + self.front
        ahead, aside = z + self.away, dr.fma(x, x, y * y)
        a, b = dr.if_stmt((x, y, ahead), self.folded, _folded, lambda x, y, z: _flat(x, y, z, self.extent))
        distance = dr.sqrt(dr.fma(ahead, ahead, aside))
        # the same less `before`, without the difference of two long distances
        flat = z + self.front + aside / (distance + dr.fmax(ahead, 0.0))
        return a, b, dr.select(self.folded, distance - self.before, flat)

    def ray(self, a: Float, b: Float) -> tuple[Array3f, Array3f]:
        """Origin and unit direction of the ray at square coordinates a, b."""
        u, v = 2.0 * a - 1.0, 2.0 * b - 1.0
        if self.kind == "lines":
            return self.middle + (u * self.right + v * self.up) * self.extent - self.ahead * self.front, self.ahead
        z = 1.0 - dr.abs(u) - dr.abs(v)
        fold = [dr.select(z < 0, _turned(1.0 - dr.abs(other), own), own) for own, other in ((u, v), (v, u))]
        turned = dr.normalize(fold[0] * self.right + fold[1] * self.up + z * self.ahead)
        # where the ray passes the plane through the middle, in distances of the lamp
        aside = (u * self.right + v * self.up) * self.extent
        squared = dr.squared_norm(aside)
        length = dr.sqrt(1.0 + squared)
        straight = (aside + self.ahead) / length
        back = dr.fma(self.away, squared / (1.0 + length), self.front)
        folded = turned * self.before - self.ahead * self.away
        begin = dr.select(self.folded, folded, aside * self.away - straight * back)
        return self.middle + begin, dr.select(self.folded, turned, straight)


class LampViews:
    """The views of lamps: one by one, and for loops that go through lamps, as rows of numbers."""

    def __init__(self, lamps: Sequence[Lamp], corners: np.ndarray) -> None:
        """`corners`: see `view_from`."""
        made = [view_from(lamp, corners) for lamp in lamps]
        self.each = [LampView(kind, [dr.opaque(arrays().Float, float(v)) for v in row]) for kind, row in made]
        self.rows = lookup(arrays().Float, np.concatenate([row for _, row in made]))

    def of(self, lamp: int | LampInTurn) -> LampView:
        """The view of a lamp."""
        if isinstance(lamp, int):
            return self.each[lamp]
        packets = [dr.gather(arrays().Array4f, self.rows, lamp.number * (ROW // 4) + k) for k in range(ROW // 4)]
        return LampView("pyramid" if lamp.near else "lines", [packet[k] for packet in packets for k in range(4)])


def _flat(x: Float, y: Float, z: Float, extent: Float) -> tuple[Float, Float]:
    """Square coordinates on the base of a pyramid."""
    scale = 0.5 / (extent * z)
    return x * scale + 0.5, y * scale + 0.5


def _folded(x: Float, y: Float, z: Float) -> tuple[Float, Float]:
    """Square coordinates on the octahedron."""
    inverse = dr.rcp(dr.abs(x) + dr.abs(y) + dr.abs(z))
    u, v = x * inverse, y * inverse
    outer = _turned(1.0 - dr.abs(v), u), _turned(1.0 - dr.abs(u), v)
    u, v = (dr.select(z < 0, out, within) for out, within in zip(outer, (u, v), strict=True))
    return 0.5 * u + 0.5, 0.5 * v + 0.5


def view_from(lamp: Lamp, corners: np.ndarray) -> tuple[str, np.ndarray]:
    """The kind of view of a lamp that covers the world points `corners` (n, 3), and its row of numbers."""
    middle = corners.mean(axis=0)
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    if not lamp.near:
        axes = _axes(-lamp.place)
        extent = 1.01 * np.abs((corners - middle) @ axes[:2].T).max()
        return "lines", row_of("lines", middle, axes, float(extent), (0.0, 1.1 * radius, 1.1 * radius))
    axes, away = _axes(middle - lamp.place), float(np.linalg.norm(middle - lamp.place))
    reach = away, min(away, 1.01 * radius), 1.01 * radius
    across, along = (corners - lamp.place) @ axes[:2].T, (corners - lamp.place) @ axes[2]
    extent = float(np.max(np.abs(across) / along[:, None])) if (along > 0).all() else math.inf
    if extent > WIDEST_TANGENT:
        return "octahedron", row_of("octahedron", middle, axes, 1.0, reach)
    return "pyramid", row_of("pyramid", middle, axes, 1.01 * extent, reach)


def row_of(
    kind: str, middle: np.ndarray, axes: np.ndarray, extent: float, reach: tuple[float, float, float]
) -> np.ndarray:
    """Numbers of a view, (ROW,). middle: (3,) of the matter. axes: (3, 3) right, up, and ahead from the lamp to the
    middle. extent: half the width of the square, at distance 1 in a pyramid [m]. reach: distance of the lamp from the
    middle (lines: 0), and of the ends of all matter before and behind the middle [m].
    """
    away, front, back = reach
    figures = [
        extent,
        kind == "octahedron",
        away,
        front,
        front + back,
        away - front,
        0.0,
        0.0,
        *middle,
        *np.ravel(axes),
    ]
    return np.array(figures, np.float32)


def _axes(ahead: np.ndarray) -> np.ndarray:
    """Right, up and ahead, unit and at right angles: (3, 3)."""
    length = float(np.linalg.norm(ahead))
    ahead = np.array([0.0, 0.0, 1.0]) if length == 0 else ahead / length
    aside = np.eye(3)[int(np.argmin(np.abs(ahead)))]
    right = np.cross(aside, ahead) / np.linalg.norm(np.cross(aside, ahead))
    return np.stack([right, np.cross(ahead, right), ahead])


def _turned(value: Float, like: Float) -> Float:
    return dr.select(like < 0, -value, value)
