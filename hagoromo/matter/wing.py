"""Wing: the pair of feathered wings of the standing figure. All in mm.

Each wing is a curved sheet with rows of overlapping feathers on both faces. On the sheet, a counts along the arm from
the shoulder and b down along the feathers from the arm: feathers lie on lines of constant a, which fan out downwards.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.fill import Fineness
from hagoromo.matter.noise import random
from hagoromo.matter.shape import coverage, spline, unit

TOP, ROOT = 296.0, 5.0  # height of the wrist, x of the shoulder
FAN = 0.0011, 2.0e-6  # by how much feathers spread per mm and mm² below TOP
ALONG = (0.0, 12.0, 30.0, 46.0, 58.0, 72.0, 84.0, 92.0)  # a
DROP = (88.0, 60.0, 23.0, 5.0, 1.0, 9.0, 32.0, 66.0)  # of the arm below TOP, at ALONG
LENGTH = (56.0, 76.0, 108.0, 136.0, 152.0, 170.0, 172.0, 140.0)  # of the longest feathers, at ALONG
SHEET = 25.0, 0.0042, 0.0006  # y of the shoulder, curvature of the sheet outwards and downwards [1/mm]
BARB = 0.9  # distance of the barbs
THICKNESS = 0.9  # of a feather
REACH = 7.5  # of all feathers off the sheet

SLOPE = 1.0 / math.tan(math.radians(40))  # of the barbs: along the rachis per mm across, near the rachis
BEND = 0.35  # by how much the barbs have turned towards the tip at the edge of the vane
TIP = 0.68  # share of the length where the tip begins to round


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


class Row(NamedTuple):
    """A row of feathers: distance between them along a, length as a share of the longest, height off the sheet."""

    pitch: float
    share: float
    height: float


ROWS = (Row(6.6, 1.0, 0.3), Row(5.6, 0.52, 1.5), Row(4.6, 0.34, 2.6), Row(3.8, 0.21, 3.6), Row(3.2, 0.12, 4.4))


class Place(NamedTuple):
    """A place on the wing: a, b, height off the sheet, side (Int: 0 left, 1 right), unit directions of a and b."""

    a: Any
    b: Any
    height: Any
    side: Any
    towards_a: Any
    towards_b: Any


def wing(point: Any, fineness: Fineness, seed: int) -> tuple[Any, Any]:
    """Density and tangent of the barbs of both wings."""
    kinds, soft, place = arrays(), fineness.softness, place_on_wing(point)
    longest = spline(place.a, ALONG, LENGTH)
    arm = spline(place.b, (0.0, 7.0, 20.0, 50.0), (2.6, 2.2, 0.8, 0.0)) * clip((ALONG[-1] - place.a) / 20.0, 0.2, 1.0)
    above = dr.fmin(place.b - 3.0, 0.0)
    height = dr.sqrt(dr.square(place.height) + dr.square(above)) - arm
    flesh = dr.fmax(dr.fmax(height - 0.3, place.b - 30.0), dr.fmax(-place.a, place.a - ALONG[-1] + 7.0))
    density, tangent = coverage(flesh, soft), kinds.Array2f(0.0, 1.0)
    for number, row in enumerate(ROWS):
        for step in (0, -1, 1):
            index = dr.floor(place.a / row.pitch) + step
            here, along = _feather(place, height, index, number, longest, fineness, seed)
            here = dr.select((index >= 0) & (index + 1.0 < (ALONG[-1] - 1.8 * number) / row.pitch), here, 0.0)
            more = here > density
            density, tangent = dr.select(more, here, density), dr.select(more, along, tangent)
    return density, unit(place.towards_a * tangent.x + place.towards_b * tangent.y)


def wing_bound(point: Any) -> Any:
    """A bound of the distance to the wings."""
    place = place_on_wing(point)
    longest = spline(place.a, ALONG, LENGTH)
    middle = 0.5 * ALONG[-1]
    beside = dr.fmax(abs(place.a - middle) - middle - 4.0, dr.fmax(-place.b - REACH, place.b - 1.1 * longest))
    return dr.fmax(abs(place.height) - REACH, 0.6 * beside)


def place_on_wing(point: Any) -> Place:
    """Where points are on the sheet of the wing on their side."""
    kinds, (back, outwards, downwards) = arrays(), SHEET
    x, q = abs(point.x), TOP - point.z
    a = (x - ROOT) / (1.0 + FAN[0] * q + FAN[1] * q * q)
    lean = a * (FAN[0] + 2.0 * FAN[1] * q)  # dx/dq along a feather
    sign = dr.select(point.x < 0, -1.0, kinds.Float(1.0))
    slope_x, slope_q = outwards * x, downwards * q
    flat = dr.rsqrt(1.0 + slope_x * slope_x + slope_q * slope_q)
    height = (point.y - back - 0.5 * outwards * x * x - 0.5 * downwards * q * q) * flat
    towards_a = unit(kinds.Array3f(sign, slope_x, 0.0))
    towards_b = unit(kinds.Array3f(sign * lean, slope_x * lean + slope_q, -1.0))
    side = dr.select(point.x < 0, kinds.Int(0), kinds.Int(1))
    return Place(a, q - spline(a, ALONG, DROP), height, side, towards_a, towards_b)


def _feather(
    place: Place, height: Any, index: Any, number: int, longest: Any, fineness: Fineness, seed: int
) -> tuple[Any, Any]:
    """Density and tangent (towards a and b) of feather `index` of row `number`."""
    row, soft = ROWS[number], fineness.softness
    name = arrays().Int(index) * 2 + place.side
    aside, longer, lifted, turned = (random((name, number, k), seed) - 0.5 for k in range(4))
    half, length = 0.78 * row.pitch, longest * row.share * (1.0 + 0.1 * longer)
    along = dr.fmax(place.b, -3.0) + 6.0  # feathers are rooted behind the arm
    across = place.a - (index + 0.5 + 0.2 * aside) * row.pitch - 0.02 * turned * along
    share = clip(along / length, 0.0, 1.0)
    found = vane(across, along, length, half)
    tilt = 0.7 * across / row.pitch + 0.5 * lifted  # like tiles, each lies on its neighbour
    curl = 0.9 * share**4 - 0.5 * share - 0.5 * dr.square(across / half)
    off = height - (row.height + tilt + curl)
    ridge = fineness.resolved(0.5 * BARB) * 0.12 * dr.cos((2.0 * math.pi / BARB) * found.start)
    density = coverage(dr.fmax(abs(off) - 0.5 * THICKNESS * (1.0 + ridge), found.edge), soft)
    rachis = dr.sqrt(dr.square(across) + dr.square(off - 0.35)) - 0.6 * (1.0 - 0.8 * share)
    rachis = coverage(dr.fmax(rachis, dr.fmax(-along, along - 0.95 * length)), soft)
    stiff = rachis > density
    return dr.fmax(density, rachis), dr.select(stiff, type(found.tangent)(0.0, 1.0), found.tangent)
