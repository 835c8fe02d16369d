"""Plume: the outer form of a feather: how it bends, its outline, its shaft. All in mm.

On a feather, `along` counts from the end of the quill to the tip, `across` from the shaft (outer, narrow vane below 0),
`height` over the upper side of the vane.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.files.record import Positive, about
from hagoromo.matter.shape import coverage

SHAFT_TAPER = 0.9  # share of the shaft's width that is lost from the foot of the vane to the tip
WALL, PITH = 0.16, 0.3  # wall of the shaft as a share of its radius; density of the foam within (0 in the quill)
STRAIGHT = 1e-5  # [1/mm] curvature below which a feather counts as straight
SUNK = 0.5  # depth of the shaft's middle below the vane [radii]: the vane joins it near its upper side


class Plume(NamedTuple):
    """The form of a feather.

    Sizes: a pigeon's (Lucas & Stettenheim, Avian Anatomy: Integument, 1972; Bachmann et al., Front. Zool. 4:23, 2007).
    The ratio of the vanes' widths is the asymmetry (3 and more in outer primaries).
    """

    length_mm: Annotated[Positive, about("length of quill and vane [mm]")] = 90.0
    outer_mm: Annotated[Positive, about("width of the outer vane [mm]")] = 5.0
    inner_mm: Annotated[Positive, about("width of the inner vane [mm]")] = 13.0
    rachis_mm: Annotated[Positive, about("width of the shaft at the foot of the vane [mm]")] = 1.8
    quill: Annotated[float, about("share of the length that is bare, 0…1")] = 0.2
    tip: Annotated[float, about("share of the vane over which it rounds off to the tip, 0…1")] = 0.5
    bow_mm: Annotated[float, about("distance of the tip from the line of the quill, within the vane [mm]")] = 7.0
    arch_mm: Annotated[float, about("distance of the tip below the line of the quill [mm]")] = 6.0
    camber_mm: Annotated[float, about("distance of the edges below the shaft [mm]")] = 1.5


class Spot(NamedTuple):
    """A place on a feather and the unit directions in which across, along and height increase."""

    across: Any
    along: Any
    height: Any
    right: Any
    ahead: Any
    above: Any


def flat_spot(point: Any) -> Spot:
    """A place on a flat feather that lies in the plane y = 0, its upper side towards −y."""
    jit = arrays()
    directions = jit.Array3f(1, 0, 0), jit.Array3f(0, 0, 1), jit.Array3f(0, -1, 0)
    return Spot(point.x, point.z, -point.y, *directions)


def spot_on(point: Any, plume: Plume) -> Spot:
    """A place on a bent feather: arched and cambered over cylinders, bowed along a circle, all true to lengths."""
    jit, long = arrays(), plume.length_mm
    height, z, s, c = rolled(-point.y, point.z, 2.0 * plume.arch_mm / long**2)
    right, ahead, above = jit.Array3f(1, 0, 0), jit.Array3f(0, s, c), jit.Array3f(0, -c, s)
    across, along, s, c = rolled(point.x, z, -2.0 * plume.bow_mm / long**2)
    right, ahead = right * c + ahead * s, ahead * c - right * s
    wide = max(plume.outer_mm, plume.inner_mm)
    height, across, s, c = rolled(height, across, 2.0 * plume.camber_mm / wide**2)
    right, above = right * c - above * s, above * c + right * s
    return Spot(across, along, height, right, ahead, above)


def outline(across: Any, along: Any, plume: Any) -> Any:
    """Distance to the edge of the vane [mm], negative within, to first order; beyond its first barb see `barbs`."""
    half = dr.select(across < 0, plume.outer_mm, arrays().Float(plume.inner_mm))
    vane = plume.length_mm * (1.0 - plume.quill)
    share = clip((along - plume.length_mm * plume.quill) / vane, 0.0, 2.0)
    start = 1.0 - plume.tip
    rounding = dr.fmax(share - start, 0.0) / plume.tip
    foot = clip(5.0 * share, 0.0, 1.0)
    half = half * (0.55 + 0.27 * foot * (2.0 - foot) + 0.36 * dr.fmin(share, 1.0) * (1.0 - 0.5 * dr.fmin(share, 1.0)))
    x, r = across / half, rounding * rounding
    value = x * x + r * r - 1.0
    slope = dr.sqrt(dr.square(x / half) + dr.square(2.0 * r * rounding / (plume.tip * vane)))
    return 0.5 * value / dr.fmax(slope, 0.3 / half)


def shaft(spot: Spot, plume: Any, softness: float) -> tuple[Any, Any]:
    """Density of quill and rachis: round, then square with a groove beneath, then round and thin at the tip.

    Also the share of space that they occupy exclusively.
    """
    quill = plume.length_mm * plume.quill
    share = clip((spot.along - quill) / (plume.length_mm - quill), 0.0, 1.0)
    foot = dr.sqrt(clip(spot.along / (1.5 * plume.rachis_mm) + 0.05, 0.0, 1.0))
    radius = 0.5 * plume.rachis_mm * (1.0 - SHAFT_TAPER * share) * foot
    x, y = abs(spot.across), spot.height + SUNK * radius
    square = clip(8.0 * share, 0.0, 1.0) * clip(3.0 * (1.0 - share), 0.0, 1.0)
    rounding = radius * (1.0 - 0.55 * square)
    a, b = x - radius + rounding, abs(y) - radius + rounding
    outside = dr.sqrt(dr.square(dr.fmax(a, 0.0)) + dr.square(dr.fmax(b, 0.0))) + dr.fmin(dr.fmax(a, b), 0.0)
    distance = outside - rounding
    groove = 0.4 * radius * square - dr.sqrt(x * x + dr.square(y + 1.1 * radius))
    distance = dr.fmax(distance, dr.fmax(groove, dr.fmax(-spot.along, spot.along - 0.985 * plume.length_mm)))
    pith = PITH * clip(10.0 * share, 0.05, 1.0)
    solid = coverage(-distance - WALL * radius, softness)  # 1 in the wall, 0 deep inside
    inside = coverage(distance, softness)
    return inside * (pith + (1.0 - pith) * solid), inside


def rolled(off: Any, along: Any, curvature: Any) -> tuple[Any, Any, Any, Any]:
    """(off, along) about a circle through (0, 0) that leaves along `along` and bends towards −off.

    The distance outside the circle, the arc length, and sine and cosine of the turn there: along the circle the
    direction is along · cos − off · sin.
    """
    if isinstance(curvature, float) and abs(curvature) < STRAIGHT:
        zero = 0.0 * off
        return off, along, zero, zero + 1.0
    curvature = arrays().Float(curvature)
    sign = dr.select(curvature < 0, -1.0, arrays().Float(1.0))
    radius = sign / dr.fmax(abs(curvature), STRAIGHT)
    reach = sign * dr.sqrt(dr.square(off + radius) + along * along)
    turn = dr.atan2(sign * along, sign * (off + radius))
    return reach - radius, radius * turn, along / reach, (off + radius) / reach
