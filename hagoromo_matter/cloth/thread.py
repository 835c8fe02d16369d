"""Thread: position relative to a yarn → density and unit tangent of the fibre there, on the device.

Plies lie on a circle and turn about the yarn, fibres turn about their ply and wander in it (migration). The wandering
is a divergence-free flow, so that their share of the section is constant.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.shape import coverage
from hagoromo_matter.cloth.section import TABLE_SIDE, Section, sharp_radius, shown_plies
from hagoromo_matter.cloth.strand import YarnPlace
from hagoromo_matter.cloth.yarn import Yarn
from hagoromo_matter.noise import random

# waves by which fibres wander: vector [1/radius of a ply], length along the yarn [diameters]
FIBRE_WAVES = ((3.1, 0.7, 6.0), (-1.3, 2.7, 9.0), (1.9, -2.4, 14.0))
FULL_TURN = 2.0 * math.pi


class Spun(NamedTuple):
    """A yarn as voxels resolve it.

    radius, softness [mm]; flatness; plies; ply, offset: their radius and circle, of the yarn's; back: rate at which
    fibres turn against their plies [rad/mm]; migration; waves: of migration [rad per way along the yarn]; length of the
    yarn [mm]; first: entry of its section in the table; shown: that section; edge, fade: of the plies' outline, where
    it stands and its height, as the softness allows.
    """

    radius: float
    softness: float
    flatness: float
    plies: int
    ply: float
    offset: float
    back: float
    migration: float
    waves: tuple[float, ...]
    length: float
    first: int
    shown: Section
    edge: float
    fade: float


def spun(yarn: Yarn, shown: Section, voxel_mm: float, length: float, first: int) -> Spun:
    """The yarn of `length` [mm] a period on voxels; `first`: where its section lies in the table."""
    plies, wider = shown_plies(yarn, voxel_mm)
    radius, (ply, offset) = 0.5 * yarn.diameter_mm, yarn.ply
    if plies == 1:
        ply, offset = ply * wider, 0.0
    turn, spin = yarn.rates
    back = FULL_TURN * round((turn - spin) * length / FULL_TURN) / length if plies > 1 else 0.0
    waves = tuple(FULL_TURN * max(1, round(length / (wave[2] * yarn.diameter_mm))) for wave in FIBRE_WAVES)
    soft = 2.0 * voxel_mm / (radius * ply)
    fade = min(1.0, 3.0 / soft**2)
    return Spun(
        radius, 2.0 * voxel_mm, yarn.flatness, plies, ply, offset, back, yarn.migration, waves, length,
        first, shown, sharp_radius(1.0, soft), fade,
    )  # fmt: skip


def fibre(place: YarnPlace, yarn: Spun, table: Any, number: Any, seed: int | Any) -> tuple[Any, Any]:
    """Density (share of the space that is fibre) and unit tangent of the fibre at a place.

    table: of the sections; number: by which yarns differ.
    """
    jit = arrays()
    girth = yarn.radius * place.girth
    wide, high = girth * yarn.flatness, girth / yarn.flatness
    x, y = place.across / wide, place.above / high
    apart = FULL_TURN / yarn.plies
    ply = dr.round((dr.atan2(y, x) - place.phase) / apart)
    angle = place.phase + ply * apart
    ply = jit.Int(ply - yarn.plies * dr.floor(ply / yarn.plies))
    sine, cosine = dr.sincos(angle)
    name = (jit.Int(number) * 8 + ply, 5)
    rolled = place.phase - yarn.back * yarn.length * place.way + FULL_TURN * random((*name, 0), seed)
    spin = place.rate - yarn.back
    s, c = dr.sincos(rolled)
    x, y = (x - yarn.offset * cosine) / yarn.ply, (y - yarn.offset * sine) / yarn.ply
    p = jit.Array2f(c * x + s * y, c * y - s * x)
    q, drift = _migrated(p, place.way, yarn, name, seed)
    p = p * dr.rcp(dr.fmax(dr.norm(p), 1.0))  # in the soft edge fibres run as at the outside
    moving = jit.Array2f(drift.x - spin * p.y, drift.y + spin * p.x) * yarn.ply
    turning = place.rate * yarn.offset
    slope_x = (c * moving.x - s * moving.y - turning * sine) * wide
    slope_y = (s * moving.x + c * moving.y + turning * cosine) * high
    # per length where the fibre is, not on the axis
    slope_x, slope_y = slope_x / place.stretch, slope_y / place.stretch
    lengthened = dr.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    tangent = (place.tangent + place.aside * slope_x + place.up * slope_y) / lengthened

    cell = jit.Array2u(
        clip((0.5 * q.x + 0.5) * TABLE_SIDE, 0, TABLE_SIDE - 1), clip((0.5 * q.y + 0.5) * TABLE_SIDE, 0, TABLE_SIDE - 1)
    )
    centre = dr.gather(jit.Array2f, table, cell.y * TABLE_SIDE + cell.x + yarn.first)
    o = q - centre
    far = dr.norm(jit.Array2f((c * o.x - s * o.y) * yarn.flatness, (s * o.x + c * o.y) / yarn.flatness))
    profile = coverage(far - yarn.shown.radius, yarn.shown.softness)
    # an inclined fibre is longer by the factor by which its section across the yarn is wider
    filled = yarn.shown.filling * lengthened * dr.lerp(1.0, profile / yarn.shown.mean, yarn.shown.contrast)
    outline = yarn.fade * coverage((dr.norm(q) - yarn.edge) * (girth * yarn.ply), yarn.softness)
    return filled * outline, tangent


def _migrated(p: Any, way: Any, yarn: Spun, name: tuple[Any, int], seed: int | Any) -> tuple[Any, Any]:
    """Where a fibre at p would lie had it not wandered, and how fast it wanders at p [1/mm].

    A product of shears, each a wave across its own direction, which keeps areas.
    """
    jit = arrays()
    moved, shears = p, []
    for k, (x, y, _) in enumerate(FIBRE_WAVES):
        across = jit.Array2f(y, -x) * (yarn.migration / math.hypot(x, y))
        phase = moved.x * x + moved.y * y + yarn.waves[k] * way + FULL_TURN * random((*name, k + 1), seed)
        sine, cosine = dr.sincos(phase)
        moved = moved + across * sine
        shears.append((across * cosine, x, y, yarn.waves[k] / yarn.length))
    drift = jit.Array2f(0.0)
    for shear, x, y, rate in reversed(shears):
        drift = drift - shear * (x * drift.x + y * drift.y + rate)
    return moved, drift
