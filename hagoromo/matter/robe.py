"""Robe: the clothes of the standing figure: a belted gown with pipe folds, wide sleeves and a veil. All in mm.

The figure stands on z = 0 and looks towards −y. Folds hang from the belt, fan out downwards and are deepest at the hem.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.cloth import Weave, covering
from hagoromo.matter.drape import pipes
from hagoromo.matter.fill import Fineness
from hagoromo.matter.noise import random, seed_of
from hagoromo.matter.shape import (
    capsule,
    ellipsoid,
    length,
    mirrored,
    smooth_difference,
    smooth_intersection,
    smooth_union,
    spline,
    unit,
)

WEAVE = Weave(threads_per_cm=11.0, diameter_mm=0.92, warp=0.5, crimp=0.35, uneven=0.15)
BELT = 166.0  # height
HEIGHTS = (0.0, 4.0, 30.0, 80.0, 120.0, 145.0, 160.0, 166.0, 171.0, 180.0, 195.0, 206.0, 214.0, 220.0, 227.0)
WIDTHS = (49.0, 46.0, 40.0, 31.0, 26.5, 24.0, 20.0, 18.5, 20.5, 24.0, 26.0, 25.0, 20.5, 12.5, 7.5)  # half, at HEIGHTS
DEPTHS = (43.0, 40.0, 34.0, 25.5, 21.0, 19.0, 16.0, 14.5, 16.0, 18.0, 18.5, 16.0, 12.5, 9.0, 7.0)  # half, at HEIGHTS
FOLDS, PLEATS = 13, 37  # around the skirt: pipe folds, and fine pleats under the belt
SHOULDER, ELBOW, WRIST = (23.0, 3.5, 207.0), (39.0, 1.0, 166.0), (9.0, -35.0, 186.0)
CROWN = 250.0  # height where the veil begins to round over the head


def robe(point: Any, seed: int | Any) -> Any:
    """All the cloth as one solid; only its outer layer is filled."""
    cloth = smooth_union(gown(point, seed), sleeves(point), 4.0)
    return smooth_union(cloth, veil(point, seed), 1.5)


def cloth(point: Any, fineness: Fineness, seed: int | Any) -> tuple[Any, Any]:
    """Density and tangent of the yarns in the layer under the surface of the robe."""
    seed = seed_of(seed)  # once, so that the garments of the shape and of the chart are one in the kernel
    return covering(point, lambda p: robe(p, seed), lambda p: chart(p, seed), WEAVE, fineness, seed)


def chart(point: Any, seed: int | Any) -> tuple[Any, Any, Any]:
    """Coordinates u, v on the cloth and the direction of its warp, of the garment whose surface is nearest."""
    kinds, p = arrays(), mirrored(point)
    around = dr.atan2(point.x, -point.y)  # the seam is at the back
    body = spline(point.z, (0.0, 80.0, BELT, 190.0, 276.0), (45.0, 29.0, 18.0, 26.0, 17.0))
    arc = dr.asin(clip((point.z - CROWN) / 22.0, 0.0, 0.98)) * 22.0  # over the crown of the veil
    u, v, along = around * body, dr.select(point.z > CROWN, CROWN + arc, point.z), kinds.Array3f(0, 0, 1)
    sleeve = abs(sleeves(point)) < dr.fmin(abs(gown(point, seed)), abs(veil(point, seed)))
    upper, fore = _along(p, ELBOW, SHOULDER), _along(p, WRIST, ELBOW)
    nearer = fore[0] < upper[0]
    _, down, axis, side = (dr.select(nearer, a, b) for a, b in zip(fore, upper, strict=True))
    axis = kinds.Array3f(dr.select(point.x < 0, -axis.x, axis.x), axis.y, axis.z)
    return dr.select(sleeve, 11.0 * side, u), dr.select(sleeve, down, v), dr.select(sleeve, axis, along)


def gown(point: Any, seed: int | Any) -> Any:
    """Bodice and skirt as one folded tube, a knee that pushes through it, and a belt."""
    z = point.z
    x = point.x - spline(z, (0.0, 90.0, 150.0, 220.0), (1.5, 3.0, 0.5, 0.0))
    y = point.y - spline(z, (0.0, 100.0, 225.0), (2.0, 0.0, 3.0))
    rx, ry = spline(z, HEIGHTS, WIDTHS), spline(z, HEIGHTS, DEPTHS)
    angle, around = _around(x / rx, y / ry)
    tube = (around - 1.0) * dr.sqrt(rx * ry)
    folded = tube - dr.select(z < BELT, _skirt_folds(angle, z, seed), _bodice_folds(angle, z, seed))
    knee = capsule(point, (-12.0, -8.0, 130.0), (-15.0, -22.0, 74.0), 14.5, 11.5)
    folded = smooth_union(folded, knee, 16.0)
    belt = dr.sqrt(dr.square(tube) + dr.square(0.8 * (z - BELT - 0.5))) - 2.0
    return dr.fmax(smooth_union(folded, belt, 1.0), dr.fmax(-z, z - 224.0))


def sleeves(point: Any) -> Any:
    """Wide sleeves on arms bent to prayer, open at the wrists."""
    p = mirrored(point)
    upper = capsule(p, SHOULDER, ELBOW, 9.0, 10.5)
    fore = capsule(p, ELBOW, WRIST, 10.5, 7.5)
    hanging = capsule(p, (37.0, -1.0, 158.0), (12.0, -31.0, 163.0), 8.5, 6.5)
    sleeve = smooth_union(fore, hanging, 14.0) - _creases(p)
    along = unit(_vector(WRIST) - _vector(ELBOW))
    mouth = dr.dot(p - _vector(WRIST), along) + 2.0
    cavity = smooth_intersection(sleeve + 2.4, -(mouth + 16.0), 3.0)
    return smooth_union(upper, smooth_difference(smooth_intersection(sleeve, mouth, 1.0), cavity, 1.0), 6.0)


def veil(point: Any, seed: int | Any) -> Any:
    """A veil over the head that falls behind the shoulders, open around the face."""
    z = point.z
    crown = ellipsoid(point, (0.0, 1.5, CROWN), (17.6, 20.6, 21.5))
    heights = (185.0, 205.0, 222.0, 245.0)
    rx, ry = spline(z, heights, (34.0, 31.0, 23.0, 17.0)), spline(z, heights, (21.0, 20.0, 18.5, 19.8))
    angle, around = _around(point.x / rx, (point.y - spline(z, (185.0, 222.0, 245.0), (9.0, 5.0, 1.5))) / ry)
    swing = angle * (15.0 / (2.0 * math.pi)) + 0.9 * _swing(angle, seed + 7)
    deep = spline(z, (185.0, 236.0, 252.0), (4.5, 1.8, 0.0))
    fall = (around - 1.0) * dr.sqrt(rx * ry) - pipes(swing, 15, seed + 7) * deep
    fall = smooth_intersection(fall, z - CROWN - 3.0, 9.0)
    fall = smooth_intersection(fall, 187.0 + 4.0 * dr.sin(3.0 * angle) - z, 1.5)
    fall = smooth_difference(fall, ellipsoid(point, (0.0, -24.0, 195.0), (21.0, 27.0, 40.0)), 1.5)
    face = ellipsoid(point, (0.0, -22.0, 243.5), (12.4, 27.0, 19.5))
    throat = capsule(point, (0.0, -30.0, 236.0), (0.0, -20.0, 205.0), 10.5, 14.0)
    return smooth_difference(smooth_union(crown, fall, 9.0), smooth_union(face, throat, 6.0), 2.0)


def _skirt_folds(angle: Any, z: Any, seed: int | Any) -> Any:
    """Height of the skirt's folds: pipes that deepen downwards, and pleats that run out below the belt."""
    deep = spline(z, (0.0, 50.0, 110.0, 150.0, BELT), (17.0, 13.0, 6.5, 2.4, 0.6))
    fine = spline(z, (60.0, 120.0, 155.0, BELT), (0.0, 0.8, 1.3, 0.5))
    turn = angle / (2.0 * math.pi) + 0.012 * dr.sin(2.0 * angle + 0.02 * z)
    pipe = pipes(turn * FOLDS + _swing(angle, seed), FOLDS, seed)
    return pipe * deep + pipes(turn * PLEATS + _swing(angle, seed + 3), PLEATS, seed + 3) * fine


def _bodice_folds(angle: Any, z: Any, seed: int | Any) -> Any:
    """Height of the folds between belt and neck."""
    deep = spline(z, (BELT, 172.0, 195.0, 222.0), (0.5, 2.4, 1.8, 0.6))
    return deep * (pipes(angle * (25.0 / (2.0 * math.pi)) + 0.6 * _swing(angle, seed + 5), 25, seed + 5) - 0.5)


def _creases(point: Any) -> Any:
    """Folds of the sleeve that fan out from the bent elbow."""
    offset = point - _vector((44.0, 6.0, 176.0))
    a, b = offset.z, -0.7 * (offset.x + offset.y)
    reach = dr.sqrt(a * a + b * b + 1e-6)
    return 1.3 * dr.sin(13.0 * dr.atan2(a, b)) * dr.exp(-dr.square((reach - 22.0) / 9.0))


def _swing(angle: Any, seed: int | Any) -> Any:
    """Uneven spacing of folds around an axis: a smooth periodic function of the angle."""
    phase = [2.0 * math.pi * random((k, 0, 0), seed) for k in range(3)]
    return sum(share * dr.sin((k + 1) * angle + phase[k]) for k, share in enumerate((0.5, 0.25, 0.15)))


def _around(x: Any, y: Any) -> tuple[Any, Any]:
    """Angle and radius; the axis itself has none."""
    return dr.atan2(y, x), dr.sqrt(x * x + y * y + 1e-9)


def _along(point: Any, start: tuple[float, ...], end: tuple[float, ...]) -> tuple[Any, Any, Any, Any]:
    """Distance from a line, way along it, its direction and the angle around it."""
    axis = unit(_vector(end) - _vector(start))
    offset = point - _vector(start)
    way = dr.dot(offset, axis)
    across = offset - axis * way
    right = unit(dr.cross(_vector((0.0, 0.0, 1.0)), axis))
    angle = dr.atan2(dr.dot(across, right), dr.dot(across, dr.cross(axis, right)))
    over = way - clip(way, 0.0, math.dist(start, end))
    return length(across) + abs(over), way, axis, angle


def _vector(values: tuple[float, ...]) -> Any:
    return arrays().Array3f(*values)
