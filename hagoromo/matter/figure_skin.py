"""Figure skin: the box of all skin that a standing figure shows, angel or nun, 270 mm high."""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.errors import InputError
from hagoromo.matter.body import arms, body, bust
from hagoromo.matter.fill import Fineness
from hagoromo.matter.pose import PRAYER, WELCOME
from hagoromo.matter.shape import Shape
from hagoromo.matter.skin import Granules, skin_on
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan

# a sixth of life: lines of 0.1 mm are finer than any lattice here, a grain and a play of the sheen are left of them
GRANULES = Granules(granule_mm=0.15, corneum_mm=0.16, scale_mm=0.2, scale_deg=4.0, fade_mm=0.03)
FINENESS = Fineness(0.16, 0.26)
STEEPEST = 2.2  # slope of `body`, at the line between the lips
EXTENTS = {
    "angel": ((-66.0, -50.0, -0.6), (66.0, 26.0, 268.0)),
    "nun": ((-46.0, -54.0, 158.0), (46.0, 26.0, 268.0)),
}


def figure_skin(figure: str, material: Reflectance, resolution: float = 1.0, seed: int = 1) -> BoxPlan:
    """The skin of the "angel", who shows its feet, or of the "nun"; resolution: voxels in 0.16 mm."""
    if figure not in EXTENTS:
        raise InputError(f"there is no figure {figure!r}: give one of {', '.join(EXTENTS)}")
    fine = FINENESS.finer(resolution)
    record: dict[str, Any] = {
        "kind": "figure",
        "figure": figure,
        "part": "skin",
        "resolution": resolution,
        "seed": seed,
    }
    return skin_on(
        shown(figure),
        EXTENTS[figure],
        material,
        GRANULES,
        fine,
        seed,
        STEEPEST,
        name=f"{figure} skin",
        provenance=record,
    )


def shown(figure: str) -> Shape:
    """The solid whose skin a figure shows."""
    if figure == "angel":
        return lambda point: body(point, WELCOME)
    return lambda point: dr.fmin(bust(point, PRAYER), arms(point, PRAYER))
