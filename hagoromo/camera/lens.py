"""Lens distortion: OpenCV's model k1 k2 p1 p2 k3 on normalised image coordinates, and its inverse.

A point (X, Y, Z) of the camera frame has x = X/Z, y = Y/Z; the lens images it at the distorted (u, v). The model is
invertible inside its field, the circle on which the radial derivative 1 + 3k₁r² + 5k₂r⁴ + 7k₃r⁶ first turns (or, where
it never does, r = 100, 89.4° off the axis): outside, both directions give NaN. Every function takes Python floats or
Dr.Jit arrays alike (NumPy arrays are not accepted).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

WIDEST_FIELD = 100.0**2  # r²
BISECTIONS = 16  # from a start this good Newton's method converges for every lens
START_LIMIT = 0.9  # of the field's radius: at the limit itself the slope is 0 and the first step would be lost
NEWTON_STEPS = 40  # three suffice in the middle of the field; beside its limit each step only halves the error


class Lens(NamedTuple):
    """Distortion coefficients (no unit) and `field`, the squared radius r² up to which they hold."""

    k1: Any
    k2: Any
    p1: Any
    p2: Any
    k3: Any
    field: Any


def lens_from_coefficients(coefficients: Sequence[float]) -> Lens:
    """The lens of OpenCV's (k1, k2, p1, p2, k3), with its field."""
    k1, k2, p1, p2, k3 = (float(k) for k in coefficients)
    turns = np.roots([7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
    real = turns.real[(np.abs(turns.imag) <= 1e-9 * np.abs(turns)) & (turns.real > 0.0)]
    return Lens(k1, k2, p1, p2, k3, float(min([WIDEST_FIELD, *real])))


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
    found = (missed < dr.square(8.0 * tiny) * (1.0 + u * u + v * v)) & _inside(x, y, lens)
    return dr.select(found, x, math.nan), dr.select(found, y, math.nan)


def _image(x: Any, y: Any, lens: Lens) -> tuple[Any, Any]:
    """The model itself, inside its field or not."""
    s, xy = x * x + y * y, x * y
    radial = _radial(s, lens)
    return (
        x * radial + 2.0 * lens.p1 * xy + lens.p2 * (s + 2.0 * x * x),
        y * radial + lens.p1 * (s + 2.0 * y * y) + 2.0 * lens.p2 * xy,
    )


def _radial(s: Any, lens: Lens) -> Any:
    return 1.0 + s * (lens.k1 + s * (lens.k2 + s * lens.k3))


def _derivative(x: Any, y: Any, lens: Lens) -> tuple[Any, Any, Any]:
    """(a, b, c) of the model's derivative [[a, b], [b, c]]."""
    s = x * x + y * y
    radial = _radial(s, lens)
    slope = 2.0 * (lens.k1 + s * (2.0 * lens.k2 + s * 3.0 * lens.k3))
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
    low, high = 0.0 * far, 0.0 * far + START_LIMIT * dr.sqrt(lens.field)
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
