"""What Mitsuba's plugin `hagoromo` takes of a reflectance: its numbers by name."""

from __future__ import annotations

from typing import Any

from hagoromo.errors import InputError
from hagoromo.reflectance.facets import is_gaussian
from hagoromo.reflectance.parameters import ROWS, STATED, lost
from hagoromo.reflectance.reflectance import Reflectance

NAME = "hagoromo"
# Numbers that it may state, beside those that it always does
PLACED = tuple(each.name for each in ROWS.values() if each.range is not None and "mitsuba" in each.varies)  # textures
TAKEN = tuple(each.name for each in ROWS.values() if each.range is not None and "mitsuba" not in each.lost)


def numbers_of(reflectance: Reflectance) -> dict[str, Any]:
    """What the plugin takes of a reflectance beside its two colours; `InputError` for what is no surface."""
    who = f"reflectance {reflectance.name!r}"
    if said := lost("mitsuba", reflectance):
        raise InputError(f"{who}: Mitsuba's BSDF has no place for {said}: give a 'plane' with transmission = 0")
    record: dict[str, Any] = {key: float(getattr(reflectance, key)) for key in STATED}
    record |= {} if is_gaussian(reflectance.nu) else {"nu": float(reflectance.nu)}
    record |= reflectance.body_departures
    lobes = ", ".join(f"{beta:.9g} {gamma:.9g}" for beta, gamma in reflectance.lobes)
    return record | ({"lobes": lobes} if lobes else {})
