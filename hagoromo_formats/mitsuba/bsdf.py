"""BSDF: a reflectance as the dictionary of Mitsuba's plugin `hagoromo`, and as a text for its XML."""

from __future__ import annotations

from typing import Any

from hagoromo.errors import InputError
from hagoromo.reflectance.facets import is_gaussian
from hagoromo.reflectance.parameters import ROWS, lost
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_formats.mitsuba.colours import colour_of

NAME = "hagoromo"
NUMBERS = ("alpha", "beta", "gamma", "n")  # that it always states
# Numbers that it may state
PLACED = tuple(each.name for each in ROWS.values() if each.range is not None and "mitsuba" in each.varies)  # textures
TAKEN = tuple(each.name for each in ROWS.values() if each.range is not None and "mitsuba" not in each.lost)


def bsdf(reflectance: Reflectance) -> dict[str, Any]:
    """The reflectance for `mitsuba.load_dict`, in the variant that Mitsuba has, whose plugin is registered by this.

    f cosθ_i = α cosθ_i c_b + β D F G / cosθ_r e, see `torrance_sparrow`. `InputError` for what is no surface: elements
    other than planes, and light that passes.

    >>> silk = hg.Reflectance(alpha=0.2, beta=0.5, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(0.5))
    >>> hg.mitsuba.bsdf(silk)["alpha"]
    0.2
    """
    from hagoromo_formats.mitsuba.plugin import register

    register()
    colours = {key: colour_of(getattr(reflectance, key)) for key in ("body_colour", "interface_colour")}
    return {"type": NAME, **numbers_of(reflectance), **colours}


def numbers_of(reflectance: Reflectance) -> dict[str, Any]:
    """What the plugin takes of a reflectance beside its two colours; `InputError` for what is no surface."""
    who = f"reflectance {reflectance.name!r}"
    if said := lost("mitsuba", reflectance):
        raise InputError(f"{who}: Mitsuba's BSDF has no place for {said}: give a 'plane' with transmission = 0")
    record: dict[str, Any] = {key: float(getattr(reflectance, key)) for key in NUMBERS}
    record |= {} if is_gaussian(reflectance.nu) else {"nu": float(reflectance.nu)}
    record |= reflectance.body_departures
    lobes = ", ".join(f"{beta:.9g} {gamma:.9g}" for beta, gamma in reflectance.lobes)
    return record | ({"lobes": lobes} if lobes else {})
