"""Shape: solids as signed distances on the device, negative inside.

Enters: positions (Array3f) and lengths, all in one unit; leaves: a Float, a distance bound (exact where the docstring
says no other). `dr.fmin` is the union of shapes, `dr.fmax` their intersection, a minus sign the complement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip

Shape = Callable[[Any], Any]
Triple = Sequence[float]
SLOPES = 0.3, 4.0  # valid slopes of a distance bound: smaller at seams and centres, larger at poles of angles


def sphere(point: Any, centre: Triple, radius: float) -> Any:
    """Ball around `centre`."""
    return length(point - _vector(centre)) - radius


def ellipsoid(point: Any, centre: Triple, radii: Triple) -> Any:
    """Ellipsoid along the axes: near the surface a distance to first order (k₀(k₀−1)/k₁ of Quilez)."""
    offset = point - _vector(centre)
    k0, k1 = length(offset / _vector(radii)), length(offset / _vector([r * r for r in radii]))
    return k0 * (k0 - 1.0) / dr.fmax(k1, 1e-6)


def capsule(point: Any, start: Triple, end: Triple, radius: float, end_radius: float | None = None) -> Any:
    """Points within `radius` of the line from `start` to `end`; with `end_radius` it tapers (then a bound only)."""
    along, offset = np.subtract(end, start), point - _vector(start)
    share = clip(dr.dot(offset, _vector(along)) / float(along @ along), 0.0, 1.0)
    grown = 0.0 if end_radius is None else end_radius - radius
    return length(offset - _vector(along) * share) - (radius + grown * share)


def limb(
    point: Any,
    joints: NDArray[np.floating],
    radius: Callable[[Any], Any],
    bend: float,
    aside: Callable[[Any], Any] | None = None,
) -> Any:
    """A tube around the line through `joints` (n, 3), of a radius that is a smooth function of the way along it.

    It has no rings: a smooth union of one capsule a bone would swell where two of them have the same surface. Corners
    of the line are rounded over `bend`, by the mean of the feet of the point on all bones, weighted by their
    distances; beside a joint it is thinner by at most 0.28 bend. radius ends level, or the round end has an edge.
    aside: offset of the middle by the way along (Array3f).
    """
    feet, ways, distances, begin = [], [], [], 0.0
    for start, end in pairwise(joints):
        along, offset = end - start, point - _vector(start)
        share = clip(dr.dot(offset, _vector(along)) / float(along @ along), 0.0, 1.0)
        feet.append(_vector(start) + _vector(along) * share)
        distances.append(length(point - feet[-1]))
        whole = float(np.linalg.norm(along))
        ways.append(begin + whole * share)
        begin += whole
    least = distances[0]
    for distance in distances[1:]:
        least = dr.fmin(least, distance)
    weights = [dr.exp((least - distance) * (1.0 / bend)) for distance in distances]
    scale = dr.rcp(sum(weights))
    middle = sum(foot * (weight * scale) for foot, weight in zip(feet, weights, strict=True))
    way = sum(one * (weight * scale) for one, weight in zip(ways, weights, strict=True))
    if aside is not None:
        middle += aside(way)
    return length(point - middle) - radius(way)


def rounded_box(point: Any, centre: Triple, half: Triple, rounding: float = 0.0) -> Any:
    """Box of half edges `half` along the axes, its edges rounded by `rounding`."""
    reach = dr.abs(point - _vector(centre)) - _vector([h - rounding for h in half])
    outside = length(type(reach)(*(dr.fmax(x, 0.0) for x in reach)))
    return outside + dr.fmin(dr.fmax(reach.x, dr.fmax(reach.y, reach.z)), 0.0) - rounding


def plane(point: Any, normal: Triple, offset: float = 0.0) -> Any:
    """Half space below the plane normal · point = offset; `normal` is unit and points out."""
    return dr.dot(point, _vector(normal)) - offset


def smooth_union(a: Any, b: Any, blend: float) -> Any:
    """Union, the seam rounded over a width of `blend` (polynomial smooth minimum of Quilez)."""
    reach = dr.fmax(blend - dr.abs(a - b), 0.0)
    return dr.fmin(a, b) - reach * reach * (0.25 / blend)


def smooth_difference(a: Any, b: Any, blend: float) -> Any:
    """`a` without `b`, the edge rounded over a width of `blend`."""
    return smooth_intersection(a, -b, blend)


def smooth_intersection(a: Any, b: Any, blend: float) -> Any:
    """Intersection, the edge rounded over a width of `blend`."""
    return -smooth_union(-a, -b, blend)


def rising(t: Any) -> Any:
    """0 below 0, 1 above 1, a smooth cubic between."""
    t = clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def sheet(distance: Any, thickness: float) -> Any:
    """Shell of a shape: from its surface to a depth of `thickness`."""
    return dr.abs(distance + 0.5 * thickness) - 0.5 * thickness


def placed(point: Any, centre: Triple, turn_deg: Triple = (0.0, 0.0, 0.0)) -> Any:
    """`point` in the axes of a part that was turned about x, then y, then z [°] and moved to `centre`."""
    x, y, z = np.radians(turn_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]])
    about_y = np.array([[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]])
    about_z = np.array([[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]])
    columns, offset = (about_z @ about_y @ about_x).T, point - _vector(centre)
    return type(offset)(*(dr.dot(offset, _vector(column)) for column in columns))


def mirrored(point: Any, seam: float = 0.0) -> Any:
    """`point` mirrored to x ≥ 0: a shape of it is symmetric about x = 0, its seam rounded over `seam`."""
    across = dr.abs(point.x) if seam == 0 else dr.sqrt(point.x * point.x + seam * seam)
    return type(point)(across, point.y, point.z)


def spline(at: Any, knots: Sequence[float], values: Sequence[float]) -> Any:
    """Smooth curve through (knots, values), without overshoot (PCHIP), constant beyond its ends."""
    from scipy.interpolate import PchipInterpolator

    jit, pieces = arrays(), PchipInterpolator(knots, values)
    table = jit.Float(np.ascontiguousarray(pieces.c.T[:, ::-1], np.float32).ravel())
    at = clip(at, float(knots[0]), float(knots[-1]))
    piece = jit.UInt(0)
    for knot in knots[1:-1]:
        piece += dr.select(dr.detach(at) >= float(knot), jit.UInt(1), 0)
    start = jit.Float(np.asarray(knots, np.float32))
    part = at - dr.gather(jit.Float, start, piece)
    c = [dr.gather(jit.Float, table, piece * 4 + k) for k in range(4)]
    return dr.fma(dr.fma(dr.fma(c[3], part, c[2]), part, c[1]), part, c[0])


def distance_and_normal(shape: Shape, point: Any) -> tuple[Any, Any]:
    """Distance to first order, f / |∇f|, and the outward unit normal ∇f / |∇f|, by automatic differentiation."""
    moved = type(point)(dr.detach(point))
    dr.enable_grad(moved)
    value = shape(moved)
    dr.backward(value)
    slope = dr.grad(moved)
    return dr.detach(value) / clip(length(slope), *SLOPES), unit(slope)


def coverage(distance: Any, softness: float) -> Any:
    """Share of the space that a shape fills: 1 inside, 0 outside, linear over `softness` around its surface.

    With a softness of two voxels trilinear interpolation shows the surface without steps. A sheet thinner than that
    has a coverage below 1.
    """
    return clip(0.5 - distance / softness, 0.0, 1.0)


def unit(vector: Any) -> Any:
    """Unit vector; (0, 0, 1) for a zero vector."""
    squared = dr.squared_norm(vector)
    some = squared > 1e-24
    scale = dr.rsqrt(dr.select(some, squared, 1.0))
    return dr.select(some, vector * scale, type(vector)(0, 0, 1))


def length(vector: Any) -> Any:
    """Length of a vector, differentiable at 0."""
    return dr.sqrt(dr.fmax(dr.squared_norm(vector), 1e-18))


def _vector(values: Sequence[float] | np.ndarray) -> Any:
    return arrays().Array3f(*(float(value) for value in values))
