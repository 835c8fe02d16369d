"""Remarks: what the record of a recovery shows that its user should know."""

from __future__ import annotations

from typing import Any


def said_of_brightness(record: dict[str, Any]) -> str:
    """What is said where body colours are more than all light; nothing otherwise."""
    brightest = record["brightest_body_colour"]
    if brightest <= 1.0:
        return ""
    what, why = "light that is sent out", "the unit of the photographs is no share of all light"
    if record["lamps"] == "known":
        what, why = "body colours", "lamps are stated too weak or too far for the values of the photographs"
    return (
        f"{what} reach {brightest:.3g}, and 1 is all light: {why}. Only their ratios are known; box and mesh are "
        f"dimmed by {1.0 / brightest:.3g} or less"
    )
