"""Feather: rachis, barbs (element cylinder, tangents along them) and a thin, half transparent vane. All in mm."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.noise import gradient_noise, random
from hagoromo.matter.shape import coverage, unit
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan

SLOPE = 1.0 / math.tan(math.radians(40))  # of the barbs: along the rachis per mm across, near the rachis
BEND = 0.35  # by how much the barbs have turned towards the tip at the edge of the vane
TIP = 0.68  # share of the length where the tip begins to round
VANE_DENSITY = 0.3  # of the barbules between the barbs
SPLITS = 5  # places a side where a vane may be torn


class Plume(NamedTuple):
    """A feather [mm]: length, half width of the outer and the inner vane, distance of the barbs, radius of the rachis.

    quill: share of the length that is bare. bow: how far the tip is off the line of the quill.
    """

    length_mm: float = 90.0
    outer_mm: float = 8.0
    inner_mm: float = 12.0
    barb_mm: float = 0.8
    rachis_mm: float = 0.8
    quill: float = 0.15
    bow_mm: float = 10.0


class Vane(NamedTuple):
    """A place on a vane: distance to the outline (negative inside), start of its barb, tangent (across, along)."""

    edge: Any
    start: Any
    tangent: Any


def vane(across: Any, along: Any, length: Any, half: Any, quill: float = 0.0) -> Vane:
    """The vane of a feather whose rachis runs `along` 0 to `length`; `half`: width of the vane on this side."""
    kinds = arrays()
    share = clip((along / length - quill) / (1.0 - quill), 0.0, 1.0)
    rounding = dr.fmax((share - TIP) / (1.0 - TIP), 0.0)
    rise = clip(share / 0.15, 0.0, 1.0)
    outline = half * dr.sqrt(dr.fmax(1.0 - dr.square(rounding), 1e-6)) * rise * (2.0 - rise) * (0.8 + 0.2 * share)
    edge = dr.fmax(dr.abs(across) - outline, dr.fmax(quill * length - along, along - length))
    out = dr.abs(across)
    slope = SLOPE * (1.0 + BEND * out / half)
    side = dr.select(across < 0, -1.0, 1.0)
    steep = SLOPE * (1.0 + 2.0 * BEND * out / half)
    return Vane(edge, along - out * slope, kinds.Array2f(side, steep) * dr.rsqrt(1.0 + steep * steep))


def feather(
    material: Reflectance,
    plume: Plume = Plume(),  # noqa: B008 (an immutable record)
    fineness: Fineness = Fineness(0.12, 0.12),  # noqa: B008
    seed: int = 0,
) -> BoxPlan:
    """One feather that stands on its quill at z = 0 around x = 0 and shows its upper side to −y."""
    long, widest = plume.length_mm, max(plume.outer_mm, plume.inner_mm)

    def field(point: Any) -> tuple[Any, Any]:
        return plumage(point, plume, fineness, seed)

    def bound(point: Any) -> Any:
        across, height, _ = _place(point, plume)
        return dr.fmax(abs(height) - 1.5, abs(across) - widest) * 0.7

    bend = abs(plume.bow_mm)
    extent = (-widest - bend - 2.0, -0.2 * widest - 3.0, -1.0), (widest + bend + 2.0, 0.1 * long + 3.0, long + 2.0)
    return fill(field, bound, extent, fineness, material, name="feather")


def plumage(point: Any, plume: Plume, fineness: Fineness, seed: int) -> tuple[Any, Any]:
    """Density and tangent of one feather."""
    kinds, soft = arrays(), fineness.softness
    across, height, (right, ahead) = _place(point, plume)
    share = clip(point.z / plume.length_mm, 0.0, 1.0)
    half = dr.select(across < 0, plume.outer_mm, kinds.Float(plume.inner_mm))
    down = clip(1.0 - (share - plume.quill) / 0.22, 0.0, 1.0)  # the downy part at the foot of the vane
    waver = gradient_noise(kinds.Array3f(across * 0.25, point.z * 0.12, 0.5), seed)
    found = vane(across, point.z + waver * (0.6 + 3.5 * down), plume.length_mm, half, plume.quill)

    number = dr.floor(found.start / plume.barb_mm)
    spacing = plume.barb_mm * found.tangent.x * dr.select(across < 0, -1.0, 1.0)
    beside = (found.start / plume.barb_mm - number - 0.5) * spacing
    ragged = (random((kinds.Int(number), 0, kinds.Int(half)), seed) - 0.5) * (0.6 + 2.0 * down)
    outline = dr.fmax(found.edge + ragged, _split(found.start, across, half, plume, seed))
    barb = dr.sqrt(dr.square(beside) + dr.square(height)) - 0.3 * plume.barb_mm * (1.0 - 0.5 * down)
    barbs = coverage(dr.fmax(barb, outline), soft)
    barbules = coverage(dr.fmax(abs(height) - 0.12 * plume.barb_mm, outline), soft)
    density = dr.fmax(barbs, barbules * VANE_DENSITY * (1.0 - 0.9 * down))
    axis = unit(right * found.tangent.x + ahead * found.tangent.y)

    thick = plume.rachis_mm * (1.0 - 0.85 * share)
    rachis = dr.sqrt(dr.square(across) + dr.square(height + 0.4 * thick)) - thick
    rachis = coverage(dr.fmax(rachis, dr.fmax(-point.z, point.z - 0.97 * plume.length_mm)), soft)
    return dr.fmax(density, rachis), dr.select(rachis > density, ahead, axis)


def _place(point: Any, plume: Plume) -> tuple[Any, Any, tuple[Any, Any]]:
    """Across the rachis, height behind the vane, and unit directions to the right and ahead on it."""
    kinds, share = arrays(), point.z * (1.0 / plume.length_mm)
    across = point.x - plume.bow_mm * (share * share - 0.5 * share)
    lean = plume.bow_mm / plume.length_mm * (2.0 * share - 0.5)
    widest = max(plume.outer_mm, plume.inner_mm)
    hollow = 0.18 / widest  # the vanes curve back on both sides of the rachis
    back = 0.05 * plume.length_mm * share * share
    height = point.y - back - hollow * across * across
    right = unit(kinds.Array3f(1.0, 2.0 * hollow * across, 0.0))
    ahead = unit(kinds.Array3f(lean, 0.1 * share, 1.0))
    return across, height * right.x, (right, ahead)


def _split(start: Any, across: Any, half: Any, plume: Plume, seed: int) -> Any:
    """Where barbs have come apart: above 0 within gaps that open towards the edge of the vane [mm]."""
    kinds, every = arrays(), plume.length_mm / SPLITS
    cell = dr.floor(start / every)
    place, chance, width = (random((kinds.Int(cell), kinds.Int(half), k), seed + 9) for k in range(3))
    middle = (cell + 0.25 + 0.5 * place) * every
    out = abs(across) / half
    gap = (0.4 + 1.1 * width) * plume.barb_mm * 2.0 * out * out
    return dr.select(chance < 0.6, gap - abs(start - middle), -1e3)
