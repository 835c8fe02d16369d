"""Spread: whether the directions of lamps determine normals, and how well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError

FEWEST_DIRECTIONS = 3  # a Lambertian normal has three unknowns; a fourth lamp judges it
LARGEST_CONDITION = 20.0  # errors of the photographs grow by it in the worst direction of the normal


class LampSpread(NamedTuple):
    """lamps: how many. condition: largest over smallest singular value of their unit directions (K, 3), 1 at best.
    widest_deg: largest angle between two [°].
    """

    lamps: int
    condition: float
    widest_deg: float


def check_spread(to_lamp: ArrayLike) -> LampSpread:
    """How far the directions `to_lamp` (K, 3) are spread.

    `InputError` for fewer than three, or directions in one plane with the scene, which do not determine normals.
    """
    directions = np.asarray(to_lamp, np.float64).reshape(-1, 3)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    if len(directions) < FEWEST_DIRECTIONS:
        raise InputError(
            f"{len(directions)} lamps do not determine normals: light the object from {FEWEST_DIRECTIONS} or more"
        )
    condition = condition_of(directions)
    widest = float(np.degrees(np.arccos(np.clip((directions @ directions.T).min(), -1.0, 1.0))))
    if condition > LARGEST_CONDITION:
        raise InputError(
            f"the {len(directions)} lamps lie nearly in one plane with the scene, or side by side (condition number "
            f"{min(condition, 9999.0):.3g}, {LARGEST_CONDITION:g} at most; {widest:.3g}° apart): move one out of it"
        )
    return LampSpread(len(directions), condition, widest)


def condition_of(directions: NDArray[np.float64]) -> float:
    """Largest over smallest singular value of `directions` (K, 3), K three or more; 1e12 at most."""
    values = np.linalg.svd(directions, compute_uv=False)
    return float(values[0] / max(values[2], 1e-12 * values[0]))
