"""Garments of the two standing figures, draped on them: the robe of an angel, the habit of a nun."""

from __future__ import annotations

import math

from hagoromo.errors import InputError
from hagoromo_matter.drape.settle import Fall
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.figure.gown import gown
from hagoromo_matter.figure.habit import habit

CLOTH_SPACING_MM = 1.6  # [mm] between the points of the cloth at resolution 1
WIDEST_SPACING_MM = 4.2  # [mm] on the coarsest grid: a knee or a foot would pass between points farther apart
RESOLUTIONS = 0.4, 2.0
GARMENTS = {
    "angel": lambda fall: {"robe": gown(fall)},
    "nun": habit,
}


def garments(figure: str, resolution: float = 1.0, seed: int = 1) -> dict[str, list[Sheet]]:
    """The sheets that a figure wears, by the name of their cloth, in mm.

    figure: "angel", in the pose WELCOME: "robe"; or "nun", in the pose PRAYER: "habit", "linen" and "veil".
    resolution: points of the cloth per length, of those of the full demo; time grows with its cube.
    """
    if figure not in GARMENTS:
        raise InputError(f"no figure {figure!r} wears garments: give one of {', '.join(GARMENTS)}")
    if not (math.isfinite(resolution) and RESOLUTIONS[0] <= resolution <= RESOLUTIONS[1]):
        raise InputError(f"resolution is {resolution:g}: give {RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g}")
    spacing = CLOTH_SPACING_MM / resolution
    return GARMENTS[figure](Fall(spacing, levels=2 if 2.0 * spacing <= WIDEST_SPACING_MM else 1, seed=seed))
