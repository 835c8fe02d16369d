"""Marking: the pattern of the second colour of a feather. Lengths in mm."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.files.record import NotNegative, Positive, about, one_of
from hagoromo_matter.noise import random

PATTERNS = ("plain", "bars", "tip", "edge", "eye")


class Marking(NamedTuple):
    """The second pigment of a feather."""

    pattern: Annotated[
        str, one_of(*PATTERNS), about("plain: none; bars across, the tip, the edge, or an eye near the tip")
    ] = "plain"
    bars_per_cm: Annotated[Positive, about("bars along the feather [1/cm]")] = 1.0
    bar_share: Annotated[Positive, about("share of the way from one bar to the next that it fills, 0…1")] = 0.4
    tip_mm: Annotated[Positive, about("length of the tip that has the colour [mm]")] = 12.0
    edge_mm: Annotated[Positive, about("width of the edge that has the colour [mm]")] = 1.5
    eye_mm: Annotated[Positive, about("radius of the eye, a ring and a spot [mm]")] = 6.0
    jag_mm: Annotated[NotNegative, about("difference of the marking between barbs [mm]")] = 0.6


def is_marked(across: Any, along: Any, edge: Any, number: Any, plume: Any, marking: Marking, seed: Any) -> Any:
    """Whether a place has the second colour; edge: distance to the outline, negative within; number: of its barb."""
    jit = arrays()
    side = dr.select(across < 0, jit.Int(1), 0)
    jag = (random((jit.Int(number), side, 77), seed) - 0.5) * marking.jag_mm
    if marking.pattern == "bars":
        place = (plume.length_mm - along + jag + 0.35 * abs(across)) * (0.1 * marking.bars_per_cm)
        return place - dr.floor(place) < marking.bar_share
    if marking.pattern == "tip":
        return along + jag + 0.15 * abs(across) > plume.length_mm - marking.tip_mm
    if marking.pattern == "edge":
        return edge + 0.5 * jag > -marking.edge_mm
    if marking.pattern == "eye":
        middle = plume.length_mm - 2.2 * marking.eye_mm
        apart = dr.sqrt(across * across + dr.square(0.8 * (along + jag - middle))) / marking.eye_mm
        return (apart < 0.45) | ((apart > 0.7) & (apart < 1.0))
    return across > 1e9
