"""Thread: from a place beside a yarn to the fibre there, on the device: density, unit tangent.

Plies lie on a circle and turn about the yarn, fibres turn about their ply and wander in it (migration). They wander by
a flow without divergence, so that their share of the section stays what it is.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.noise import random
from hagoromo.matter.section import SIDE, Section, sharp_radius, shown_plies
from hagoromo.matter.shape import coverage
from hagoromo.matter.strand import Place
from hagoromo.matter.yarn import Yarn

# waves by which fibres wander: vector [1/radius of a ply], length along the yarn [diameters]
WAVES = ((3.1, 0.7, 6.0), (-1.3, 2.7, 9.0), (1.9, -2.4, 14.0))
TURN = 2.0 * math.pi


class Spun(NamedTuple):
    """A yarn as voxels show it: numbers, or arrays that hold those of the yarn at each point.

    radius, softness [mm]; flatness; plies; ply, offset: their radius and circle, of the yarn's; back: rate at which
    fibres turn against their plies [rad/mm]; migration; waves: of migration [rad per way along the yarn]; length of the
    yarn [mm]; first: entry of its section in the table; the rest as in `Section`; edge, fade: of the plies' outline,
    where it stands and its height, as the softness allows.
    """

    radius: Any
    softness: Any
    flatness: Any
    plies: Any
    ply: Any
    offset: Any
    back: Any
    migration: Any
    waves: tuple[Any, ...]
    length: Any
    first: Any
    fibre: Any
    fibre_softness: Any
    contrast: Any
    mean: Any
    filling: Any
    edge: Any
    fade: Any


def spun(yarn: Yarn, shown: Section, voxel_mm: float, length: float, first: int) -> Spun:
    """The yarn of `length` [mm] a period on voxels; `first`: where its section lies in the table."""
    plies, wider = shown_plies(yarn, voxel_mm)
    radius, (ply, offset) = 0.5 * yarn.diameter_mm, yarn.ply
    if plies == 1:
        ply, offset = ply * wider, 0.0
    turn, spin = yarn.rates
    back = TURN * round((turn - spin) * length / TURN) / length if plies > 1 else 0.0
    waves = tuple(TURN * max(1, round(length / (wave[2] * yarn.diameter_mm))) for wave in WAVES)
    soft = 2.0 * voxel_mm / (radius * ply)
    fade = min(1.0, 3.0 / soft**2)
    return Spun(
        radius, 2.0 * voxel_mm, yarn.flatness, float(plies), ply, offset, back, yarn.migration, waves, length,
        float(first), shown.radius, shown.softness, shown.contrast, shown.mean, shown.filling,
        sharp_radius(1.0, soft), fade,
    )  # fmt: skip


def either(first: Any, one: Spun, other: Spun) -> Spun:
    """`one` where `first`, else `other`."""
    kinds = arrays()

    def chosen(a: Any, b: Any) -> Any:
        if isinstance(a, tuple):
            return tuple(chosen(x, y) for x, y in zip(a, b, strict=True))
        return dr.select(first, kinds.Float(a), b)

    return Spun(*(chosen(a, b) for a, b in zip(one, other, strict=True)))


def inside(place: Place, yarn: Spun) -> Any:
    """How far out in the yarn a place is: 0 on its axis, 1 at its surface."""
    x, y = _round(place, yarn)
    return dr.sqrt(x * x + y * y)


def fibre(place: Place, yarn: Spun, table: Any, seed: int | Any) -> tuple[Any, Any]:
    """Density (share of the space that is fibre) and unit tangent of the fibre at a place. table: of the sections."""
    kinds, (x, y) = arrays(), _round(place, yarn)
    apart = TURN / yarn.plies
    number = dr.round((dr.atan2(y, x) - place.phase) / apart)
    angle = place.phase + number * apart
    number = kinds.Int(number - yarn.plies * dr.floor(number / yarn.plies))
    sine, cosine = dr.sincos(angle)
    name = (kinds.Int(place.yarn) * 8 + number, 5)
    rolled = place.phase - yarn.back * yarn.length * place.way + TURN * random((*name, 0), seed)
    spin = place.rate - yarn.back
    s, c = dr.sincos(rolled)
    x, y = (x - yarn.offset * cosine) / yarn.ply, (y - yarn.offset * sine) / yarn.ply
    p = kinds.Array2f(c * x + s * y, c * y - s * x)
    q, drift = _migrated(p, place.way, yarn, name, seed)
    moving = kinds.Array2f(-spin * p.y - drift.x, spin * p.x - drift.y) * yarn.ply
    turning = place.rate * yarn.offset
    girth = yarn.radius * place.girth
    wide, high = girth * yarn.flatness, girth / yarn.flatness
    slope_x = (c * moving.x - s * moving.y - turning * sine) * wide
    slope_y = (s * moving.x + c * moving.y + turning * cosine) * high
    # per length where the fibre is, not on the axis
    slope_x, slope_y = slope_x / place.stretch, slope_y / place.stretch
    lengthened = dr.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    tangent = (place.tangent + place.aside * slope_x + place.up * slope_y) / lengthened

    cell = kinds.Array2u(clip((0.5 * q.x + 0.5) * SIDE, 0, SIDE - 1), clip((0.5 * q.y + 0.5) * SIDE, 0, SIDE - 1))
    centre = dr.gather(kinds.Array2f, table, kinds.UInt(yarn.first) + cell.y * SIDE + cell.x)
    o = q - centre
    o = kinds.Array2f((c * o.x - s * o.y) * yarn.flatness, (s * o.x + c * o.y) / yarn.flatness)
    along = (o.x * slope_x + o.y * slope_y) / lengthened
    far = dr.sqrt(dr.fmax(dr.squared_norm(o) - along * along, 1e-12))
    profile = coverage(far - yarn.fibre, yarn.fibre_softness)
    filled = yarn.filling * dr.lerp(lengthened, profile / yarn.mean, yarn.contrast)
    outline = yarn.fade * coverage((dr.norm(q) - yarn.edge) * (girth * yarn.ply), yarn.softness)
    return filled * outline, tangent


def _round(place: Place, yarn: Spun) -> tuple[Any, Any]:
    """Offsets from the yarn's axis, of its radius, flattened yarns made round."""
    girth = yarn.radius * place.girth
    return place.across / (girth * yarn.flatness), place.above * yarn.flatness / girth


def _migrated(p: Any, way: Any, yarn: Spun, name: tuple[Any, int], seed: int | Any) -> tuple[Any, Any]:
    """Where a fibre at p would lie had it not wandered, and the rate of that along the yarn [1/mm]."""
    kinds = arrays()
    moved, drift = p, kinds.Array2f(0.0)
    for k, (x, y, _) in enumerate(WAVES):
        across = kinds.Array2f(y, -x) * (yarn.migration / math.hypot(x, y))
        phase = p.x * x + p.y * y + yarn.waves[k] * way + TURN * random((*name, k + 1), seed)
        sine, cosine = dr.sincos(phase)
        moved = moved + across * sine
        drift = drift + across * (cosine * yarn.waves[k] / yarn.length)
    return moved, drift
