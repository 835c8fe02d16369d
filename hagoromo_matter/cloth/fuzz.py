"""Fuzz: fly-away fibres that leave a yarn and curl, and their density in voxels."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip, lookup
from hagoromo.files.memory import require
from hagoromo.matter.shape import coverage
from hagoromo_matter.cloth.section import sharp_radius
from hagoromo_matter.cloth.strand import Paths, PeriodCells, nearest_steps
from hagoromo_matter.cloth.wander import check_drawn
from hagoromo_matter.cloth.yarn import Yarn

HAIR_STEP = 0.06  # length of a step along a hair [diameters of its yarn]
CURL = 0.2  # [rad] standard deviation of the change of bending in a step
FOLLOWED = 8.0  # steps along a hair that are searched, from the one nearest to a cell
LIFT = 0.5, 1.1  # [rad] range of the angle between a hair and its yarn where it leaves it


class Hairs(NamedTuple):
    """Steps of hairs. points, tangents: (n, 3) [mm]; radius: (n,) [mm]; population: (n,)."""

    points: NDArray[np.float64]
    tangents: NDArray[np.float64]
    radius: NDArray[np.float64]
    population: NDArray[np.int64]


def grown(
    yarn: Yarn, paths: Paths, variant: int, height: tuple[float, float], draw: np.random.Generator
) -> list[Hairs]:
    """Hairs of one kind of yarns; they bend back before they leave the range of heights [mm]."""
    points = paths.points[variant]
    length = np.linalg.norm(np.diff(points, axis=1), axis=-1).sum()
    hairs, step = [], HAIR_STEP * yarn.diameter_mm
    check_drawn(0.1 * yarn.hairs_per_cm * length, "fly-away fibres")
    require(100.0 * 0.1 * yarn.hairs_per_cm * length * (4.0 + yarn.hair_mm / step), "the fly-away fibres of a yarn")
    for _ in range(draw.poisson(0.1 * yarn.hairs_per_cm * length)):
        thread, at = draw.integers(points.shape[0]), draw.integers(1, points.shape[1] - 1)
        tangent = points[thread, at + 1] - points[thread, at - 1]
        tangent *= draw.choice([-1.0, 1.0]) / np.linalg.norm(tangent)
        outward = np.cross(tangent, draw.normal(size=3))
        outward /= np.linalg.norm(outward)
        lift = draw.uniform(*LIFT)
        direction = np.cos(lift) * tangent + np.sin(lift) * outward
        count = max(4, int(draw.exponential(yarn.hair_mm) / step))
        bend = np.cumsum(draw.normal(0.0, CURL, (count, 3)), axis=0) * 0.3
        directions = direction + bend
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        # flattened yarns are thinner above than beside
        root = points[thread, at] + 0.4 * yarn.diameter_mm * outward * (1.0, 1.0, 1.0 / yarn.flatness)
        path = root + np.cumsum(directions, axis=0) * step
        path[:, 2] = _between(path[:, 2], height)
        along = np.gradient(path, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        radius = np.full(count, 0.5e-3 * yarn.fibre_um)
        hairs.append(Hairs(path, along, radius, np.full(count, paths.population[thread, at])))
    return hairs


class Fuzz:
    """Hairs of all variants, on the device; there may be none."""

    def __init__(
        self, variants: list[list[Hairs]], period: tuple[float, float], grid: PeriodCells, voxel_mm: float
    ) -> None:
        jit = arrays()
        far = Hairs(np.array([[0.0, 0.0, 1e3]]), np.eye(3)[:1], np.full(1, 1e-6), np.zeros(1, np.int64))
        joined = [Hairs(*(np.concatenate(part) for part in zip(*(hairs or [far]), strict=True))) for hairs in variants]
        starts = np.cumsum([0] + [len(each.radius) for each in joined[:-1]])
        reach = 2.0 * voxel_mm + max(float(each.radius.max()) for each in joined)
        cells = [
            nearest_steps(each.points, period, grid, reach) + start for each, start in zip(joined, starts, strict=True)
        ]
        self.period, self._count = period, sum(len(each.radius) for each in joined)
        lengths = [np.linalg.norm(np.diff(each.points, axis=0), axis=1) for each in joined]
        self._length = float(np.median(np.concatenate([*lengths, [1e-3]])))
        self._nearest = lookup(jit.UInt, np.concatenate(cells).astype(np.uint32))
        soft = 2.0 * voxel_mm
        rows = []
        for each in joined:
            edge = np.array([sharp_radius(r, soft) for r in each.radius])
            height = np.minimum(1.0, 3.0 * (each.radius / soft) ** 2)
            rows.append(np.column_stack([each.points, edge, each.tangents, height + 2.0 * each.population]))
        self._steps, self._soft = lookup(jit.Float, np.concatenate(rows).astype(np.float32)), soft

    def at(self, point: Any, cell: Any) -> tuple[Any, Any, Any]:
        """Density, unit tangent and population (UInt) of the hair nearest to points."""
        jit = arrays()
        first = dr.gather(jit.UInt, self._nearest, cell)
        along = self._beside(point, first)[1]
        moved = clip(dr.round(along / self._length), -FOLLOWED, FOLLOWED)
        last = jit.Int(self._count - 1)
        other = jit.UInt(dr.minimum(dr.maximum(jit.Int(first) + jit.Int(moved), 0), last))
        better = (
            self._beside(point, other)[0] < self._beside(point, first)[0]
        )  # otherwise the step belongs to another hair
        squared, along, a, b = self._beside(point, dr.select(better, other, first))
        far = dr.sqrt(dr.fmax(squared - along * along, 0.0) + dr.square(dr.fmax(abs(along) - self._length, 0.0)))
        tangent = jit.Array3f(b.x, b.y, b.z)
        population = dr.floor(0.5 * b.w)
        height = b.w - 2.0 * population
        return height * coverage(far - a.w, self._soft), tangent, jit.UInt(population)

    def _beside(self, point: Any, step: Any) -> tuple[Any, Any, Any, Any]:
        """Squared distance of points from a step, how far they lie along it, and its numbers."""
        jit = arrays()
        a, b = (dr.gather(jit.Array4f, self._steps, 2 * step + k) for k in (0, 1))
        offset, (u, v) = point - jit.Array3f(a.x, a.y, a.z), self.period
        offset.x -= u * dr.round(offset.x * (1.0 / u))
        offset.y -= v * dr.round(offset.y * (1.0 / v))
        return dr.squared_norm(offset), dr.dot(offset, jit.Array3f(b.x, b.y, b.z)), a, b


def _between(z: NDArray, height: tuple[float, float]) -> NDArray:
    """Heights bent back smoothly within their bounds."""
    middle, half = 0.5 * (height[0] + height[1]), 0.5 * (height[1] - height[0])
    return middle + half * np.tanh((z - middle) / half)
