"""Strand: the paths of yarns through a period of cloth, and the nearest of them to a point, on the device.

A path is sampled at equal steps of its length; it ends where it began, or a whole period of the cloth farther on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hagoromo.backend import arrays, clip, lookup

BEYOND = 1e6  # [mm] period of the third axis, which does not repeat
SOUGHT, FARTHEST = 3, 4.0  # iterations for the foot of a point, largest move in each [steps]
LEAST_STRETCH = 0.4  # on the inside of bends: points nearer to their centre belong to no yarn


class Paths(NamedTuple):
    """Yarns of one kind. points: (variants, yarns, steps, 3) [mm]; girth: (variants, yarns, steps), of the diameter;
    phase: the same, turn of the plies [rad], after the last step `turns` whole turns more than at the first; way: the
    same, share of the yarn up to there; population: (yarns, steps).
    """

    points: NDArray[np.float64]
    girth: NDArray[np.float64]
    phase: NDArray[np.float64]
    way: NDArray[np.float64]
    turns: int
    population: NDArray[np.int64]


class YarnPlace(NamedTuple):
    """The position of a point relative to the nearest yarn.

    Offsets across the cloth and along its normal [mm], their unit axes, the unit tangent of the yarn, the stretch of
    lengths along it there (less than 1 on the inside of bends), girth, phase [rad] and its rate [rad/mm of the axis],
    the position along the yarn 0…1, the number of the yarn and its population.
    """

    across: Any
    above: Any
    aside: Any
    up: Any
    tangent: Any
    stretch: Any
    girth: Any
    phase: Any
    rate: Any
    way: Any
    yarn: Any
    population: Any


class PeriodCells(NamedTuple):
    """Cells over a period: edge counts (x, y, z), edges [mm] and where the lowest lies along the normal [mm]."""

    count: tuple[int, int, int]
    edge: tuple[float, float, float]
    bottom: float

    def middles(self) -> NDArray[np.floating]:
        """Middles of the cells, z slowest: (nz · ny · nx, 3)."""
        z, y, x = np.meshgrid(*(np.arange(n) + 0.5 for n in self.count[::-1]), indexing="ij")
        return np.stack([x, y, z], axis=-1).reshape(-1, 3) * np.array(self.edge) + np.array([0.0, 0.0, self.bottom])

    def cell(self, point: Any, variant: Any) -> Any:
        """Index of the cell of a point (UInt), the variants one after another."""
        jit = arrays()
        place = (point - jit.Array3f(0.0, 0.0, self.bottom)) / jit.Array3f(*self.edge)
        x, y, z = (jit.UInt(dr.fmin(dr.fmax(place[k], 0.0), self.count[k] - 1.0)) for k in range(3))
        nx, ny, nz = self.count
        return ((variant * nz + z) * ny + y) * nx + x


def grid_over(period: tuple[float, float], heights: tuple[float, float], edge: float) -> PeriodCells:
    """Cells of about `edge` [mm]."""
    spans = (*period, heights[1] - heights[0])
    count = tuple(max(1, round(span / edge)) for span in spans)
    edges = tuple(span / n for span, n in zip(spans, count, strict=True))
    return PeriodCells(count, edges, heights[0])  # type: ignore[arg-type]


def nearest_steps(points: NDArray, period: tuple[float, float], grid: PeriodCells, reach: float) -> NDArray[np.uint32]:
    """Number of the step nearest to the middle of every cell; arbitrary where none is within `reach` [mm].

    points: (n, 3).
    """
    box = np.array([*period, BEYOND])
    lifted = np.array([0.0, 0.0, 0.5 * BEYOND])
    wrapped = points + lifted
    wrapped[:, :2] %= period
    wrapped[:, :2] = np.where(wrapped[:, :2] >= period, 0.0, wrapped[:, :2])
    tree = KDTree(wrapped, boxsize=box)
    reach += 0.5 * float(np.linalg.norm(grid.edge))
    nearest = np.asarray(tree.query(grid.middles() + lifted, distance_upper_bound=reach, workers=-1)[1])
    return np.where(nearest < len(points), nearest, 0).astype(np.uint32)


class YarnPaths:
    """Paths on the device. reach: largest distance of the points that are looked up [mm]."""

    def __init__(self, paths: Paths, period: tuple[float, float], grid: PeriodCells, reach: float) -> None:
        jit = arrays()
        _, self.yarns, self.steps, _ = paths.points.shape
        self.period, self.grid = period, grid
        ahead, behind = np.roll(paths.points, -1, axis=2), np.roll(paths.points, 1, axis=2)
        chord = _within(ahead - behind, period)
        tangent = chord / np.linalg.norm(chord, axis=-1, keepdims=True)
        self.step = float(np.linalg.norm(_within(ahead - paths.points, period), axis=-1).mean())
        turn = np.diff(paths.phase, axis=2, append=paths.phase[:, :, :1] + 2.0 * np.pi * paths.turns)
        population = np.broadcast_to(paths.population, paths.girth.shape)
        self._a = _packets(jit, paths.points, paths.girth)
        self._b = _packets(jit, tangent, paths.phase % (2.0 * np.pi))
        onward = np.diff(paths.way, axis=2, append=1.0)
        self._c = lookup(jit.Float, np.stack([turn, population, paths.way, onward], axis=-1).astype(np.float32))
        cells = [nearest_steps(each.reshape(-1, 3), period, grid, reach) for each in paths.points]
        self._nearest = lookup(jit.UInt, np.concatenate(cells))

    def nearest(self, point: Any, cell: Any, variant: Any) -> YarnPlace:
        """The position of points relative to the yarn nearest to them."""
        jit = arrays()
        nearest = dr.gather(jit.UInt, self._nearest, cell)
        yarn, step = nearest // self.steps, jit.Float(nearest % self.steps)
        first = (variant * self.yarns + yarn) * self.steps
        for _ in range(SOUGHT):  # the step stored for a cell is a few steps off
            step = step - self.steps * dr.floor(step / self.steps)
            index = dr.fmin(jit.UInt(step), self.steps - 1)
            following = dr.select(index + 1 < self.steps, index + 1, 0)
            (a, b), (a_next, b_next) = self._step(first + index), self._step(first + following)
            before, beyond = self._beyond(point, a, b), self._beyond(point, a_next, b_next)
            stretch = dr.fmax(before - beyond, LEAST_STRETCH * self.step)
            part = before / stretch
            step = jit.Float(index) + clip(part, -FARTHEST, FARTHEST)
        part = clip(part, 0.0, 1.0)
        middle = _xyz(a) + self._within(_xyz(a_next) - _xyz(a)) * part
        tangent = dr.normalize(dr.lerp(_xyz(b), _xyz(b_next), part))
        offset = self._within(point - middle)
        up = dr.normalize(jit.Array3f(0.0, 0.0, 1.0) - tangent * tangent.z)
        aside = dr.cross(up, tangent)
        turn, population, way, onward = dr.gather(jit.Array4f, self._c, first + index)
        # points beyond every step that was tried are in no yarn
        missed = dr.fmax(abs(dr.dot(offset, tangent)) - self.step, 0.0)
        across = dr.dot(offset, aside)
        across += dr.select(across < 0, -missed, missed)
        return YarnPlace(
            across, dr.dot(offset, up), aside, up, tangent, stretch * (1.0 / self.step),
            dr.lerp(a.w, a_next.w, part), b.w + part * turn, turn * (1.0 / self.step),
            way + part * onward, yarn, jit.UInt(population),
        )  # fmt: skip

    def _beyond(self, point: Any, a: Any, b: Any) -> Any:
        """How far points lie beyond a step [mm]."""
        return dr.dot(self._within(point - _xyz(a)), _xyz(b))

    def _step(self, index: Any) -> tuple[Any, Any]:
        jit = arrays()
        return dr.gather(jit.Array4f, self._a, index), dr.gather(jit.Array4f, self._b, index)

    def _within(self, offset: Any) -> Any:
        """An offset to the nearest periodic copy."""
        u, v = self.period
        x, y = offset.x - u * dr.round(offset.x * (1.0 / u)), offset.y - v * dr.round(offset.y * (1.0 / v))
        return arrays().Array3f(x, y, offset.z)


def _within(offset: NDArray, period: tuple[float, float]) -> NDArray:
    moved = offset.copy()
    moved[..., :2] -= np.round(moved[..., :2] / period) * period
    return moved


def _packets(jit: Any, vector: NDArray, fourth: NDArray) -> Any:
    return lookup(jit.Float, np.concatenate([vector, fourth[..., None]], axis=-1).astype(np.float32))


def _xyz(packet: Any) -> Any:
    return arrays().Array3f(packet.x, packet.y, packet.z)
