"""Fabric: one period of a cloth as a function of (u, v, height) [mm], from which a texel is made.

Density is the share of space that is fibre (1 inside a resolved fibre); tangents run along the fibres.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, lookup
from hagoromo_matter.cloth.fuzz import Fuzz, Hairs, grown
from hagoromo_matter.cloth.knit import Knitted, check_knitted, knitted_paths, knitted_period, loop_of
from hagoromo_matter.cloth.section import section
from hagoromo_matter.cloth.strand import Paths, PeriodCells, YarnPaths, grid_over
from hagoromo_matter.cloth.thread import fibre, spun
from hagoromo_matter.cloth.weave import Woven, check_woven, period_of, woven_paths
from hagoromo_matter.cloth.yarn import Yarn

CELLS = 3  # cells of the search for the nearest yarn, per diameter of the thinnest yarn
HAIR_SPACE = 0.35  # space for hairs above and below, as a share of their mean length
BORDER_VOXELS = 2  # voxels along the border of the period in which all variants are equal


class Fabric(NamedTuple):
    """field: (point (u, v, height), variant) → density, unit tangent (along u, v, normal), population (UInt);
    period_mm along u and v; heights_mm that it spans; populations; thickness_mm between the yarns' outermost sides.
    """

    field: Callable[[Any, Any], tuple[Any, Any, Any]]
    period_mm: tuple[float, float]
    heights_mm: tuple[float, float]
    populations: int
    thickness_mm: float


def woven(cloth: Woven, voxel_mm: float, variants: int = 4, seed: int = 0) -> Fabric:
    """A woven cloth on voxels of `voxel_mm` [mm]. Raises `InputError` where it cannot be woven."""
    check_woven(cloth)
    yarns, period = (cloth.warp, cloth.weft), period_of(cloth)
    paths = woven_paths(cloth, _margin(yarns, voxel_mm), variants, seed)
    return _fabric(yarns, paths, period, cloth.thickness, len(cloth.palette), voxel_mm, seed)


def knitted(cloth: Knitted, voxel_mm: float, variants: int = 4, seed: int = 0) -> Fabric:
    """A knitted cloth on voxels of `voxel_mm` [mm]. Raises `InputError` where it cannot be knitted."""
    check_knitted(cloth)
    yarns, period = (cloth.yarn, cloth.yarn), knitted_period(cloth)
    paths = knitted_paths(cloth, _margin(yarns, voxel_mm), variants, seed)
    thickness = 2.0 * loop_of(cloth).depth + cloth.yarn.thickness_mm
    return _fabric(yarns, paths, period, thickness, 2, voxel_mm, seed)


def _margin(yarns: tuple[Yarn, Yarn], voxel_mm: float) -> float:
    return BORDER_VOXELS * voxel_mm + max(yarn.width_mm for yarn in yarns)


def _fabric(
    yarns: tuple[Yarn, Yarn], paths: tuple[Paths, Paths], period: tuple[float, float], thickness: float,
    populations: int, voxel_mm: float, seed: int,
) -> Fabric:  # fmt: skip
    """The fabric of two kinds of yarns: densities add where soft edges overlap; the densest yarn gives the tangent."""
    jit = arrays()
    room = HAIR_SPACE * max(yarn.hair_mm if yarn.hairs_per_cm else 0.0 for yarn in yarns) + 2.0 * voxel_mm
    thicker = max(0.5 * yarn.thickness_mm * (each.girth.max() - 1.0) for yarn, each in zip(yarns, paths, strict=True))
    top = float(0.5 * thickness + thicker + room)
    grid = grid_over(period, (-top, top), min(yarn.thickness_mm for yarn in yarns) / CELLS)
    strands = tuple(
        YarnPaths(each, period, grid, 0.5 * yarn.width_mm * float(each.girth.max()) + 2.0 * voxel_mm)
        for yarn, each in zip(yarns, paths, strict=True)
    )
    shown = tuple(section(yarn, voxel_mm, seed) for yarn in yarns)
    table = lookup(jit.Float, np.concatenate([each.nearest for each in shown]))
    lengths = tuple(each.step * each.steps for each in strands)
    kept = tuple(
        spun(yarn, each, voxel_mm, length, k * len(each.nearest))
        for k, (yarn, each, length) in enumerate(zip(yarns, shown, lengths, strict=True))
    )
    fuzz = _fuzz(yarns, paths, period, (-top, top), grid, voxel_mm, seed)

    def field(point: Any, variant: Any) -> tuple[Any, Any, Any]:
        cell = grid.cell(point, variant)
        density, tangent, population = fuzz.at(point, cell)
        total = density
        for k, each in enumerate(strands):
            place = each.nearest(point, cell, variant)
            own, along = fibre(place, kept[k], table, 2 * place.yarn + k, seed)
            more, total = own > density, total + own
            density, population = dr.fmax(own, density), dr.select(more, place.population, population)
            tangent = dr.select(more, along, tangent)
        return total, tangent, population

    return Fabric(field, period, (-top, top), populations, thickness)


def _fuzz(
    yarns: tuple[Yarn, Yarn], paths: tuple[Paths, Paths], period: tuple[float, float], heights: tuple[float, float],
    grid: PeriodCells, voxel_mm: float, seed: int,
) -> Fuzz:  # fmt: skip
    """Hairs of both kinds of yarns; near the border of the period they are the same in all variants."""
    reach = 2.0 * BORDER_VOXELS * voxel_mm + 2.0 * max(grid.edge[:2])  # hairs are two voxels wide at least
    room = heights[0] + 2.0 * voxel_mm, heights[1] - 2.0 * voxel_mm

    def those(variant: int, draw: np.random.Generator, shared: bool) -> list[Hairs]:
        both = zip(yarns, paths, strict=True)
        hairs = [hair for yarn, each in both for hair in grown(yarn, each, variant, room, draw)]
        return [hair for hair in hairs if _crosses(hair.points, period, reach) == shared]

    border = those(0, np.random.default_rng((seed, 7)), True)
    variants = range(paths[0].points.shape[0])
    kept = [border + those(k, np.random.default_rng((seed, 8, k)), False) for k in variants]
    return Fuzz(kept, period, grid, voxel_mm)


def _crosses(points: np.ndarray, period: tuple[float, float], reach: float) -> bool:
    """Whether any of the points is within `reach` of the border of the period."""
    return bool((np.minimum(points[:, :2] % period, -points[:, :2] % period) < reach).any())
