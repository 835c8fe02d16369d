"""Drape: a piece of cloth that has fallen over a body, or a ball, on a table. Lengths in mm."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.matter.shape import Shape, sphere
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.cut import Cut, Place
from hagoromo_matter.drape.settle import ClothMechanics, Fall, settled
from hagoromo_matter.drape.sheet import Sheet

POINTS = 70  # along the longer edge of a piece
FABRIC = ClothMechanics(bending=2.5, friction=0.35, clear=0.6)
ABOVE_MM = 1.0  # of the highest point of the body, where the piece is let go
FINEST = 128  # steps of the lattice of a body along its longest side
GUARD = 0.75  # [spacings] of the points from a body, which may be thin
BETWEEN = 4  # places along an edge of the cloth's grid at which the body is looked for
LYING = 0.1  # share of the body's height over the table below which a piece lies beside it


def over_ball(size_mm: tuple[float, float], radius_mm: float, seed: int = 0) -> Sheet:
    """A piece that fell over a ball on the table z = 0; the ball's middle is on the axis z."""
    if not (np.isfinite(radius_mm) and 0.0 < radius_mm < max(size_mm)):
        raise InputError(f"radius_mm is {radius_mm:g}: give more than 0, and less than {max(size_mm):g} of the cloth")
    reach, top = radius_mm + 5.0, 2.0 * radius_mm
    middle = (0.0, 0.0, radius_mm)
    ball = Collider(
        [lambda p: sphere(p, middle, radius_mm)], (-reach, -reach, -5.0), (reach, reach, top + 5.0), radius_mm / 16.0
    )
    return _fallen(size_mm, ball, top, Fall(_spacing(size_mm), seed=seed))


def over_body(
    size_mm: tuple[float, float], body: Shape, low: Sequence[float], high: Sequence[float], seed: int = 0
) -> Sheet:
    """A piece that fell over a body on the table z = 0; it is let go level, with its middle on the axis z.

    low, high: corners of a box around the body, with room for the cloth on it. Parts of the body that are thinner than
    1/128 of its longest side, or half of the distance of the cloth's points, are blunt. A warning says where the body
    stands through the cloth: points and edges that all of its weight would hang from. `InputError` where the piece
    falls off the body.
    """
    longest = float(np.subtract(high, low).max())
    step = max(longest / FINEST, 0.5 * _spacing(size_mm))
    top = float(high[2])
    fall = Fall(_spacing(size_mm), seed=seed, guard=GUARD)
    sheet = _fallen(size_mm, Collider([body], low, high, step), top, fall)
    if sheet.points[..., 2].max() < FABRIC.clear + LYING * top:
        raise InputError(
            f"the cloth of {size_mm[0]:g} × {size_mm[1]:g} mm fell off the body, {top:.3g} mm high: give a larger one, "
            "or turn the body"
        )
    between = sheet.refined(BETWEEN).points.reshape(-1, 3).T
    through = float((np.array(body(arrays().Array3f(*np.ascontiguousarray(between, np.float32)))) < 0.0).mean())
    if through > 0.0:
        warnings.warn(
            f"the body stands through {through:.2g} of the cloth, where it is too pointed or thin to carry it: turn "
            "the body, or give another",
            stacklevel=2,
        )
    return sheet


def _fallen(size_mm: tuple[float, float], body: Collider, top: float, fall: Fall) -> Sheet:
    def start(s: Place, t: Place) -> NDArray[np.floating]:
        x, y = size_mm[0] * (s - 0.5), size_mm[1] * (t - 0.5)
        return np.stack(np.broadcast_arrays(x, y, top + ABOVE_MM), axis=-1)

    return settled([Cut(*size_mm, start)], body, FABRIC, fall)[0]


def _spacing(size_mm: tuple[float, float]) -> float:
    """Distance of the points of a piece [mm]."""
    return min(max(size_mm) / POINTS, 0.25 * min(size_mm))
