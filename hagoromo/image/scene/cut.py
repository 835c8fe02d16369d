"""Cut: a plane before which the camera sees nothing, so that the inside of the matter is seen.

Only what is seen is cut: the matter that is not seen throws its shadows, and lets through what light it did.
"""

from __future__ import annotations

from typing import TypeAlias

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.errors import InputError
from hagoromo.image.scene.origin import Origin

Cut: TypeAlias = tuple[float, float, float, float]  # normal n, and d [m]: n · x ≥ d is seen, world


def checked_cut(cut: Cut | None) -> Cut | None:
    """A cut with a unit normal; `InputError` for four numbers that make none."""
    if cut is None:
        return None
    numbers = np.asarray(cut, np.float64)
    length = float(np.linalg.norm(numbers[:3])) if numbers.shape == (4,) else 0.0
    if not (np.isfinite(numbers).all() and 1e-12 < length < 1e12):
        raise InputError(f"cut is {cut!r:.80}: give [nx, ny, nz, d], a normal and a distance [m]: n · x ≥ d is seen")
    if abs(length - 1.0) <= 1e-12:
        return tuple(numbers.tolist())
    return tuple((numbers / length).tolist())


class CutRays:
    """The part of rays on the side of a cut that is seen; places count from the `origin` of a scene."""

    def __init__(self, cut: Cut, origin: Origin) -> None:
        *normal, distance = cut
        jit = arrays()
        self.normal = jit.Array3f(*(dr.opaque(jit.Float, x) for x in normal))
        self.distance = dr.opaque(jit.Float, distance - float(np.dot(normal, origin)))

    def span(self, origin: Array3f, direction: Array3f) -> tuple[Float, Float]:
        """Where the part of a ray that is seen begins, and how long it is [m]; its length is 0 where there is none."""
        above, rate = dr.dot(self.normal, origin) - self.distance, dr.dot(self.normal, direction)
        to_plane = -above / dr.select(rate == 0.0, 1.0, rate)
        begin = dr.select((above < 0.0) & (rate > 0.0), to_plane, 0.0)
        hidden = (above < 0.0) & (rate <= 0.0)
        length = dr.select(hidden, 0.0, dr.select((above >= 0.0) & (rate < 0.0), to_plane, dr.inf))
        return begin, length
