"""Cloth: a plain weave of cylinders (element cylinder) on any surface that has coordinates u and v. All in mm.

Warp yarns run along v, one every 10 / threads_per_cm mm of u; weft yarns run along u and pass over and under them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.matter.fill import Fineness
from hagoromo.matter.noise import gradient_noise
from hagoromo.matter.shape import Shape, coverage, distance_and_normal, unit

Chart = Callable[[Any], tuple[Any, Any, Any]]  # point → u, v, direction of the warp


POLE = 0.05  # sine of the angle between normal and warp below which the direction of the weft is not told by them


class Weave(NamedTuple):
    """A plain weave: threads per cm either way and diameter of the weft yarns [mm].

    warp: diameter of the warp yarns, of the weft's (less than 1: the weft covers them). crimp: rise and fall of the
    yarns, of their radius. uneven: spread of the yarns' girth and place, of themselves (0: machine made).
    """

    threads_per_cm: float = 11.0
    diameter_mm: float = 0.85
    warp: float = 1.0
    crimp: float = 0.8
    uneven: float = 0.12

    @property
    def pitch(self) -> float:
        """Distance between neighbouring yarns [mm]."""
        return 10.0 / self.threads_per_cm

    @property
    def thickness(self) -> float:
        """Of the whole cloth [mm]."""
        return (1.0 + self.crimp) * self.diameter_mm


def woven(u: Any, v: Any, height: Any, weave: Weave, fineness: Fineness, seed: int | Any) -> tuple[Any, Any]:
    """Density and unit tangent (along u, v and the normal) of the nearest yarn, `height` above the cloth's middle.

    Where the lattice is too coarse for single yarns they merge into a sheet; the tangents stay theirs.
    """
    kinds, carried = arrays(), fineness.resolved(0.5 * weave.pitch)
    warp, warp_slope = _yarn(u, v, height, weave, weave.warp, seed)
    weft, weft_slope = _yarn(v, u, height, weave, -1.0, seed + 1)
    upper = warp < weft
    slope = carried * dr.select(upper, warp_slope, weft_slope)
    tangent = kinds.Array3f(dr.select(upper, 0.0, 1.0), dr.select(upper, 1.0, 0.0), slope)
    sheet = abs(height) - 0.5 * weave.diameter_mm
    surface = dr.lerp(sheet, dr.fmin(warp, weft), carried)
    return coverage(surface, fineness.softness), tangent * dr.rsqrt(1.0 + slope * slope)


def covering(
    point: Any, shape: Shape, chart: Chart, weave: Weave, fineness: Fineness, seed: int | Any
) -> tuple[Any, Any]:
    """Density and tangent of cloth that lies on a thick thing, its upper side the surface of `shape`.

    chart: u, v and the direction of the warp, as functions of the point.
    """
    distance, normal = distance_and_normal(shape, point)
    u, v, along = chart(point)
    aside = arrays().Array3f(POLE, 0.0, 0.0)  # decides where the normal lies along the warp
    weft = unit(dr.cross(along, normal) + aside - normal * dr.dot(normal, aside))
    warp = dr.cross(normal, weft)
    density, tangent = woven(u, v, distance + 0.5 * weave.thickness, weave, fineness, seed)
    lining = coverage(distance + 0.7 * weave.thickness, fineness.softness)
    density = dr.fmax(density, lining) * fineness.core(-distance)
    return density, weft * tangent.x + warp * tangent.y + normal * tangent.z


def check_weave(weave: Weave) -> Weave:
    """`weave`, or `InputError` where its yarns are thicker than there is room for."""
    if weave.diameter_mm > 1.5 * weave.pitch:
        raise InputError(
            f"yarns of diameter_mm {weave.diameter_mm:g} do not fit at threads_per_cm {weave.threads_per_cm:g}: "
            f"give at most {1.5 * weave.pitch:.3g} mm or fewer threads"
        )
    return weave


def _yarn(across: Any, along: Any, height: Any, weave: Weave, girth: float, seed: int | Any) -> tuple[Any, Any]:
    """Distance to the surface of the nearest yarn of one set [mm], and the yarn's slope there.

    girth: diameter of the set's yarns, of diameter_mm; its sign says whether the first yarn begins above or below.
    """
    kinds, pitch, radius = arrays(), weave.pitch, 0.5 * weave.diameter_mm
    number = dr.floor(across / pitch)
    swing = math.copysign(weave.crimp * radius, girth) * (1.0 - 2.0 * (number - 2.0 * dr.floor(0.5 * number)))
    place = kinds.Array3f(number * 7.31, along * (0.13 / pitch), 0.5)
    aside, thicker = gradient_noise(place, seed), gradient_noise(place * 2.0 + 31.7, seed)
    centre = (number + 0.5 + 0.5 * weave.uneven * aside) * pitch
    turn = along * (math.pi / pitch)
    middle, slope = swing * dr.sin(turn), swing * (math.pi / pitch) * dr.cos(turn)
    offset = (height - middle) * dr.rsqrt(1.0 + slope * slope)
    reach = dr.sqrt(dr.square(across - centre) + dr.square(offset) + 1e-9)
    return reach - abs(girth) * radius * (1.0 + weave.uneven * thicker), slope
