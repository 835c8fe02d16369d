"""Choices: the words by which a recovery is asked for what nobody measured."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from hagoromo.errors import InputError

Light = Literal["auto", "even", "object", "camera"]  # what unknown light is fixed to
Law = Literal["surface", "fuzzy"]  # of matter
MatterChoice = Literal["surface", "fuzzy", "auto"]
Gloss = Literal["one", "places"]  # β and γ of the whole object, or of each place
GlossChoice = Literal["one", "places", "auto"]
Orders = Literal["first", "all"]  # of light: of lamps alone, or also from other parts of the object
OrdersChoice = Literal["first", "all", "auto"]
Part = Literal["turn", "cameras", "lamps", "exposure", "places", "masks"]  # what can be refined beside the object
PARTS: tuple[Part, ...] = get_args(Part)
AUTO, NONE = "auto", "none"


@dataclass(frozen=True)
class FoundMatter:
    """law: of the matter. gloss: whether it differs from place to place. orders: of light. tried, gloss_tried,
    orders_tried: PSNR [dB] of each of these that was tried.
    """

    law: Law
    gloss: Gloss = "one"
    orders: Orders = "first"
    tried: dict[str, float] = field(default_factory=dict)
    gloss_tried: dict[str, float] = field(default_factory=dict)
    orders_tried: dict[str, float] = field(default_factory=dict)


def parts_of(refine: str) -> tuple[Part, ...]:
    """The parts that a list such as "cameras,lamps" names; none for "auto" and "none". `InputError` for others."""
    named = [] if refine in (AUTO, NONE) else [word.strip() for word in refine.split(",")]
    wrong = [word for word in named if word not in PARTS]
    if wrong:
        raise InputError(f"refine is {refine!r}: give {AUTO}, {NONE}, or a list of {', '.join(PARTS)}")
    return tuple(part for part in PARTS if part in named)
