"""Remarks: what the user of a recovery should know, of its object and of its photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hagoromo.errors import listed
from hagoromo.recovery.explained import said_of

if TYPE_CHECKING:
    from hagoromo.recovery.recovered import Recovered

UNLIT = 0.1  # share of the surface that no photograph shows lit, from which that is said


def remarks_on(recovered: Recovered) -> list[str]:
    """All that is said of a recovery."""
    said = [_of_brightness(recovered)] if recovered.brightest > 1.0 else []
    if recovered.never_shown > UNLIT:
        said.append(
            f"{100.0 * recovered.never_shown:.0f} % of the surface is lit in no photograph: its body colours are not "
            "known, and it is closed smoothly"
        )
    if recovered.dark:
        said.append(
            f"{len(recovered.dark)} photographs show no light above their noise, or clipped pixels alone, and were "
            f"left out: {listed(list(recovered.dark))}; did their lamps flash?"
        )
    said += [] if recovered.masks is None else [recovered.masks.said]
    return said + said_of(recovered.explained)


def _of_brightness(recovered: Recovered) -> str:
    what, why = "light that is sent out", "the unit of the photographs is no share of all light"
    if recovered.lit:
        what, why = "body colours", "lamps are stated too weak or too far for the values of the photographs"
    return (
        f"{what} reach {recovered.brightest:.3g}, and 1 is all light: {why}. Only their ratios are known; box and mesh "
        f"are dimmed by {recovered.dim:.3g}"
    )
