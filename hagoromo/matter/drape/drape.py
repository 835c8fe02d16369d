"""Drape: a piece of cloth that has fallen over a ball on a table. Lengths in mm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.matter.drape.collider import Collider
from hagoromo.matter.drape.cut import Cut, Place
from hagoromo.matter.drape.settle import Fabric, Fall, settled
from hagoromo.matter.drape.sheet import Sheet
from hagoromo.matter.shape import sphere

POINTS = 70  # along the longer edge of a piece
FABRIC = Fabric(bending=2.5, friction=0.35, clear=0.6)


def over_ball(size_mm: tuple[float, float], radius_mm: float, seed: int = 0) -> Sheet:
    """A piece that fell over a ball on the table z = 0; the ball's middle is on the axis z."""
    if not (np.isfinite(radius_mm) and 0.0 < radius_mm < max(size_mm)):
        raise InputError(f"radius_mm is {radius_mm:g}: give more than 0, and less than {max(size_mm):g} of the cloth")
    reach, top = radius_mm + 5.0, 2.0 * radius_mm
    middle = (0.0, 0.0, radius_mm)
    ball = Collider(
        [lambda p: sphere(p, middle, radius_mm)], (-reach, -reach, -5.0), (reach, reach, top + 5.0), radius_mm / 16.0
    )

    def start(s: Place, t: Place) -> NDArray[np.floating]:
        x, y = size_mm[0] * (s - 0.5), size_mm[1] * (t - 0.5)
        return np.stack(np.broadcast_arrays(x, y, top + 1.0), axis=-1)

    fall = Fall(min(max(size_mm) / POINTS, 0.25 * min(size_mm)), seed=seed)
    return settled([Cut(*size_mm, start)], ball, FABRIC, fall)[0]
