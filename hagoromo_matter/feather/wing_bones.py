"""Wing bones: the curved sheet that a wing lies in, and the line of its arm on it. All in mm.

On the sheet, x counts outwards from the middle of the back, z upwards, `height` towards the front (−y), along the
normal. Both wings lie in it: the left one is folded over at x = 0.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.matter.shape import unit

ROOT_Y, SWEEP, WIDTH, HANG, TOP = 24.0, 34.0, 150.0, 0.0005, 296.0  # of the sheet: see `sheet`
# the arm's line (x, z): shoulder, elbow, wrist, end of the hand
ARM = (
    (7.0, 194.0), (16.0, 203.0), (28.0, 215.0), (38.0, 233.0), (47.0, 253.0), (57.0, 272.0), (70.0, 286.5),
    (85.0, 290.5), (98.0, 281.0), (107.0, 261.0),
)  # fmt: skip
WRIST = 0.66  # share of the arm's length from the shoulder


class Ground(NamedTuple):
    """A place over the sheet: x ≥ 0, z, height; side: 0 right (x < 0), 1 left; unit directions of x, z and height."""

    x: Any
    z: Any
    height: Any
    side: Any
    outwards: Any
    upwards: Any
    forwards: Any


def ground(point: Any) -> Ground:
    """Where points are over the sheet, to first order in the height."""
    jit = arrays()
    x, q = abs(point.x), TOP - point.z
    turn = (math.pi / (2.0 * WIDTH)) * dr.fmin(x, 1.5 * WIDTH)
    sine, cosine = dr.sin(turn), dr.cos(turn)
    y = ROOT_Y + SWEEP * sine * sine + 0.5 * HANG * q * q
    slope_x = (SWEEP * math.pi / WIDTH) * sine * cosine
    slope_q = HANG * q
    flat = dr.rsqrt(1.0 + slope_x * slope_x + slope_q * slope_q)
    sign = dr.select(point.x < 0, -1.0, jit.Float(1.0))
    side = dr.select(point.x < 0, jit.UInt(0), jit.UInt(1))
    outwards = unit(jit.Array3f(sign, slope_x, 0.0))
    upwards = unit(jit.Array3f(0.0, -slope_q, 1.0))
    forwards = jit.Array3f(sign * slope_x, -1.0, -slope_q) * flat
    return Ground(x, point.z, (y - point.y) * flat, side, outwards, upwards, forwards)


def arm(share: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (…, 2) of the arm's line, (x, z) [mm], at shares of its length, and its unit direction there."""
    from scipy.interpolate import CubicSpline

    knots = np.array(ARM)
    rough = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1)))
    curve = CubicSpline(rough, knots)
    fine = np.linspace(0.0, rough[-1], 2001)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1)))
    at = np.interp(np.asarray(share) * way[-1], way, fine)
    direction = curve(at, 1)
    return curve(at), direction / np.linalg.norm(direction, axis=-1, keepdims=True)
