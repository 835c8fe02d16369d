"""Lens distortion: OpenCV's rational model k1 k2 p1 p2 k3 k4 k5 k6 on normalised image coordinates, and its inverse.

A point (X, Y, Z) of the camera frame has x = X/Z, y = Y/Z; the lens images it at the distorted (u, v), the radius
scaled by (1 + k₁r² + k₂r⁴ + k₃r⁶) / (1 + k₄r² + k₅r⁴ + k₆r⁶). The model is invertible inside its field, the circle on
which the slope of the imaged radius first turns or the denominator is 0 (or, where neither ever happens, r = 100,
89.4° off the axis): outside, both directions give NaN. Every function takes Python floats or Dr.Jit arrays alike
(NumPy arrays are not accepted).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
WIDEST_FIELD = 100.0**2  # r²
BISECTIONS = 16  # from a start this good Newton's method converges for every lens
START_LIMIT = 0.9  # of the radius at which the image turns: the slope is 0 there and the first step would be lost
NEWTON_STEPS = 40  # three suffice in the middle of the field; beside its limit each step only halves the error


class Lens(NamedTuple):
    """Coefficients; field: squared radius r² up to which they hold; start: r of the inverse's widest guess."""

    k1: Any
    k2: Any
    p1: Any
    p2: Any
    k3: Any
    k4: Any
    k5: Any
    k6: Any
    field: Any
    start: Any


def lens_from_coefficients(coefficients: Sequence[float]) -> Lens:
    """The lens of OpenCV's `COEFFICIENTS`, of which the last may be left out, with its field."""
    given = [float(k) for k in coefficients]
    k1, k2, p1, p2, k3, k4, k5, k6 = given + [0.0] * (len(COEFFICIENTS) - len(given))
    over, under, s = np.poly1d([k3, k2, k1, 1.0]), np.poly1d([k6, k5, k4, 1.0]), np.poly1d([1.0, 0.0])
    # d/dr of r N(r²)/D(r²) is [N D + 2 r² (N′ D − N D′)] / D²
    turn = _first_root(over * under + 2.0 * s * (over.deriv() * under - over * under.deriv()))
    pole = _first_root(under)
    start = min(START_LIMIT * turn**0.5, pole**0.5)
    return Lens(k1, k2, p1, p2, k3, k4, k5, k6, min(turn, pole), start)


def _first_root(polynomial: np.poly1d) -> float:
    """The smallest root above 0, if below WIDEST_FIELD, which it is else."""
    roots = np.roots(polynomial.coeffs)
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)]
    return float(min([WIDEST_FIELD, *real]))


def distort(x: Any, y: Any, lens: Lens) -> tuple[Any, Any]:
    """Where the lens images the normalised point (x, y); NaN outside the field.

    Source: OpenCV, "Camera Calibration and 3D Reconstruction", detailed description.
    """
    inside = _inside(x, y, lens)
    u, v = _image(x, y, lens)
    return dr.select(inside, u, math.nan), dr.select(inside, v, math.nan)


@dr.syntax
def undistort(u: Any, v: Any, lens: Lens) -> tuple[Any, Any]:
    """The normalised point that the lens images at (u, v): the inverse of `distort`; NaN outside the field.

    Bisection on the radius, then Newton's method in two dimensions to the last bits of the number type.
    """
    tiny = 8.0 * _epsilon(u)
    x, y = _radial_inverse(u, v, lens)
    n, unsolved = 0 * u, u == u
    while unsolved & (n < NEWTON_STEPS):
        step_x, step_y = _newton_step(x, y, u, v, lens)
        x, y, n = x + step_x, y + step_y, n + 1
        unsolved = dr.square(step_x) + dr.square(step_y) > dr.square(tiny) * (1.0 + x * x + y * y)
    at_x, at_y = _image(x, y, lens)
    missed = dr.square(at_x - u) + dr.square(at_y - v)
    converged = (missed < dr.square(8.0 * tiny) * (1.0 + u * u + v * v)) & _inside(x, y, lens)
    return dr.select(converged, x, math.nan), dr.select(converged, y, math.nan)


def _image(x: Any, y: Any, lens: Lens) -> tuple[Any, Any]:
    """The model itself, inside its field or not."""
    s, xy = x * x + y * y, x * y
    radial = _radial(s, lens)
    return (
        x * radial + 2.0 * lens.p1 * xy + lens.p2 * (s + 2.0 * x * x),
        y * radial + lens.p1 * (s + 2.0 * y * y) + 2.0 * lens.p2 * xy,
    )


def _radial(s: Any, lens: Lens) -> Any:
    return _over(s, lens) / _under(s, lens)


def _over(s: Any, lens: Lens) -> Any:
    return 1.0 + s * (lens.k1 + s * (lens.k2 + s * lens.k3))


def _under(s: Any, lens: Lens) -> Any:
    return 1.0 + s * (lens.k4 + s * (lens.k5 + s * lens.k6))


def _derivative(x: Any, y: Any, lens: Lens) -> tuple[Any, Any, Any]:
    """(a, b, c) of the model's derivative [[a, b], [b, c]]."""
    s = x * x + y * y
    radial, under = _radial(s, lens), _under(s, lens)
    rise = lens.k1 + s * (2.0 * lens.k2 + s * 3.0 * lens.k3)
    slope = 2.0 * (rise - radial * (lens.k4 + s * (2.0 * lens.k5 + s * 3.0 * lens.k6))) / under
    return (
        radial + slope * x * x + 2.0 * lens.p1 * y + 6.0 * lens.p2 * x,
        slope * x * y + 2.0 * lens.p1 * x + 2.0 * lens.p2 * y,
        radial + slope * y * y + 6.0 * lens.p1 * y + 2.0 * lens.p2 * x,
    )


def _inside(x: Any, y: Any, lens: Lens) -> Any:
    """Inside the field; beside its limit p1 and p2 can turn the image a little earlier than the radial derivative."""
    a, b, c = _derivative(x, y, lens)
    return (x * x + y * y < lens.field) & (a * c > b * b)


def _radial_inverse(u: Any, v: Any, lens: Lens) -> tuple[Any, Any]:
    """The point that the lens would image near (u, v) if p1 = p2 = 0."""
    far = dr.sqrt(u * u + v * v)
    low, high = 0.0 * far, 0.0 * far + lens.start
    for _ in range(BISECTIONS):
        r = 0.5 * (low + high)
        short = r * _radial(r * r, lens) < far
        low, high = dr.select(short, r, low), dr.select(short, high, r)
    shrink = 0.5 * (low + high) / dr.maximum(far, 1e-30)  # on the axis u = v = 0
    return u * shrink, v * shrink


def _newton_step(x: Any, y: Any, u: Any, v: Any, lens: Lens) -> tuple[Any, Any]:
    a, b, c = _derivative(x, y, lens)
    at_x, at_y = _image(x, y, lens)
    du, dv, det = u - at_x, v - at_y, a * c - b * b
    det = dr.select(det == 0.0, _epsilon(u), det)  # exactly at the limit of the field
    return (c * du - b * dv) / det, (a * dv - b * du) / det


def _epsilon(number: Any) -> float:
    """Half the distance between 1 and the next number of the type of `number`."""
    return sys.float_info.epsilon / 2.0 if isinstance(number, float) else float(dr.epsilon(number))
