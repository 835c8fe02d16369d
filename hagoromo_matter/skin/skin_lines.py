"""Skin lines: the furrows that cut skin into rhombs, triangles and finer polygons, and its pores. All in mm.

Lines are intersections of the surface with sheets in space, so they need no map: families of parallel, warped
sheets for the primary lines, the borders of cells for the secondary ones. Depths are below the skin between the lines.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.fill import Fineness
from hagoromo_matter.noise import cellular_noise, gradient_noise, random

LINE_SHIFT = 0.6  # random shift of lines [spacings]
WARP = 0.55  # amplitude [spacings] of their wandering, and its waves per spacing
LINE_WAVES = 0.45
HALF_WIDTH = 1.2  # half width of a furrow [depths]
LEAST_LINE_DEPTH = 0.35  # least depth along a line, relative to its nominal depth
THIRD = 0.6  # depth of the lines that halve the rhombs, relative to primary lines
PORE_DEPTH = 0.7  # depth of a pore [diameters]


class FurrowLattice(NamedTuple):
    """A lattice of furrows: spacings and depths of primary and secondary lines [mm], angle of the rhombs [°]; pores.

    Primary lines are 20–100 µm deep, secondary ones 5–40 µm (Piérard, Uhoda & Piérard-Franchimont 2003, "From skin
    microrelief to wrinkles"). Pores of limbs and back stand 14–32 on a cm², those of the forehead 292, with openings of
    66–105 µm (Otberg et al. 2004, "Variations of hair follicle size and distribution in different body sites").
    """

    primary_mm: float = 0.8
    primary_depth_mm: float = 0.06
    secondary_mm: float = 0.35
    secondary_depth_mm: float = 0.02
    rhomb_deg: float = 65.0
    pore_mm: float = 0.1
    pores_per_cm2: float = 32.0


def furrows(point: Any, normal: Any, lines: FurrowLattice, fineness: Fineness, seed: Any) -> Any:
    """Depth of lines and pores [mm] at a point of a surface with a unit `normal`; 0 where they cannot be resolved."""
    coarse = fineness.resolved(2.0 * HALF_WIDTH * lines.primary_depth_mm)
    fine = fineness.resolved(2.0 * HALF_WIDTH * lines.secondary_depth_mm)
    depth = arrays().Float(0)
    if coarse > 0:
        depth += coarse * primary(point, normal, lines, seed)
    if fine > 0:
        depth = dr.fmax(depth, fine * secondary(point, lines, seed))
    if lines.pores_per_cm2 > 0 and fineness.resolved(lines.pore_mm) > 0:
        depth = dr.fmax(depth, fineness.resolved(lines.pore_mm) * pores(point, lines, seed))
    return depth


def primary(point: Any, normal: Any, lines: FurrowLattice, seed: Any) -> Any:
    """Depth of the primary lines [mm]: three families in each plane of the axes, shown as the surface faces it."""
    wander = [gradient_noise(point * (LINE_WAVES / lines.primary_mm), seed + 11 + k) for k in range(3)]
    slant = math.radians(0.5 * lines.rhomb_deg)  # of the rhombs' sides to the horizontal, their longer diagonal
    families = (math.sin(slant), math.cos(slant), 1.0), (-math.sin(slant), math.cos(slant), 1.0), (1.0, 0.0, THIRD)
    weights = [dr.square(dr.square(normal[k])) for k in range(3)]
    planes = (point.y, point.z), (point.x, point.z), (point.x, point.y)
    depth = arrays().Float(0)
    for k, (u, v) in enumerate(planes):
        left = arrays().Float(1)  # of the skin, where lines cross too
        for family, (across_u, across_v, share) in enumerate(families):
            at = (u * across_u + v * across_v) * (1.0 / lines.primary_mm) + WARP * wander[family]
            faint = clip(0.6 + 2.0 * wander[family - 1], 0.0, 1.0)
            left *= 1.0 - share * _family(at, faint, lines, seed + 23 + 3 * k + family)
        depth += weights[k] * (1.0 - left)
    return lines.primary_depth_mm * depth / (weights[0] + weights[1] + weights[2] + 1e-6)


def secondary(point: Any, lines: FurrowLattice, seed: Any) -> Any:
    """Depth of the secondary lines [mm]: the borders of cells."""
    cells = cellular_noise(point * (1.0 / lines.secondary_mm), seed + 7, 0.9)
    away = 0.5 * lines.secondary_mm * (cells.second - cells.nearest)  # distance from the border, to first order
    return lines.secondary_depth_mm * dr.exp(-dr.square(away / (HALF_WIDTH * lines.secondary_depth_mm)))


def pores(point: Any, lines: FurrowLattice, seed: Any) -> Any:
    """Depth of the pores [mm]: hollows that balls of their diameter, strewn in space, leave where they meet the skin.

    Balls of radius r, one in a³ of space, meet a surface 2 r / a³ times on a unit of it.
    """
    radius = 0.5 * lines.pore_mm
    pitch = (2.0 * radius / (0.01 * lines.pores_per_cm2)) ** (1.0 / 3.0)
    near = cellular_noise(point * (1.0 / pitch), seed + 41).nearest * (pitch / radius)
    return PORE_DEPTH * lines.pore_mm * dr.square(clip(1.0 - near * near, 0.0, 1.0))


def _family(at: Any, faint: Any, lines: FurrowLattice, seed: Any) -> Any:
    """0…1 of the depth of a line, of one family of lines; `at`: place across them [spacings]."""
    whole, half_width = dr.floor(dr.detach(at)), HALF_WIDTH * lines.primary_depth_mm / lines.primary_mm
    strongest = arrays().Float(0)
    for step in (-1, 0, 1):
        number = arrays().Int(whole) + step
        away = whole + (step + 0.5) - at + LINE_SHIFT * (random((number, 0, 0), seed) - 0.5)
        strength = LEAST_LINE_DEPTH + (1.0 - LEAST_LINE_DEPTH) * faint * (0.5 + 0.5 * random((number, 1, 0), seed))
        strongest = dr.fmax(strongest, strength * dr.exp(-dr.square(away / half_width)))
    return strongest
