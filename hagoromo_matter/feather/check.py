"""Feather check: impossible sizes are refused before anything is built."""

from __future__ import annotations

from hagoromo.errors import InputError
from hagoromo_matter.feather.marking import PATTERNS
from hagoromo_matter.feather.vane import Feather

SIGNED = ("bow_mm", "arch_mm", "camber_mm", "rise_mm")
# may be 0
OPTIONAL = "share", "splits_per_cm", "split_mm", "ragged_mm", "jag_mm", "curl_deg", "hooks", "loft_mm", "waver"


def check_feather(made: Feather) -> Feather:
    """The feather, unchanged; raises `InputError` for impossible sizes."""
    plume, barbs, barbules, down, marking, after = made
    for name, record in zip(made._fields[:5], made[:5], strict=True):
        for key, value in zip(record._fields, record, strict=True):
            signed, some = key in SIGNED, key in SIGNED + OPTIONAL
            if isinstance(value, str):
                continue
            if not abs(value) < 1e6 or (value < 0 and not signed) or (value == 0 and not some):
                raise InputError(f"{key} of the feather's {name} is {value:g}: give a number above 0")
    _below(1.0, "share of the length", quill=plume.quill, after=after)
    _below(1.0001, "share", tip=plume.tip, share=down.share, bar_share=marking.bar_share)
    if plume.rachis_mm >= min(plume.outer_mm, plume.inner_mm):
        raise InputError(f"rachis_mm {plume.rachis_mm:g} is wider than a vane: give less than outer_mm and inner_mm")
    if max(abs(plume.bow_mm), abs(plume.arch_mm)) > 0.6 * plume.length_mm:
        raise InputError(
            f"bow_mm {plume.bow_mm:g} or arch_mm {plume.arch_mm:g} rolls the feather up: at most 0.6 length"
        )
    for key in ("outer_deg", "inner_deg"):
        if not barbs.curl_deg + 5.0 <= getattr(barbs, key) <= 85.0:
            raise InputError(f"{key} is {getattr(barbs, key):g}: give curl_deg + 5 … 85 (°)")
    for key in ("distal_deg", "proximal_deg"):
        if not 10.0 <= getattr(barbules, key) <= 85.0:
            raise InputError(f"{key} is {getattr(barbules, key):g}: give 10 … 85 (°)")
    _packed("barbs", barbs.per_mm * barbs.width_mm, "per_mm", barbs.per_mm)
    for key in ("distal_per_mm", "proximal_per_mm"):
        _packed("barbules", getattr(barbules, key) * barbules.width_mm, key, getattr(barbules, key))
    for name, section in (("barbs", barbs), ("barbules", barbules)):
        if section.height_mm < section.width_mm:
            raise InputError(
                f"height_mm of the {name} is below their width_mm {section.width_mm:g}: they stand upright"
            )
    if marking.pattern not in PATTERNS:
        raise InputError(f"pattern is {marking.pattern!r}: give one of {', '.join(PATTERNS)}")
    return made


def _below(limit: float, what: str, **given: float) -> None:
    for key, value in given.items():
        if not 0 <= value < limit:
            raise InputError(f"{key} is {value:g}: give a {what} from 0 to below 1")


def _packed(what: str, filled: float, key: str, value: float) -> None:
    if filled > 0.7:
        raise InputError(f"{key} is {value:g}: so many {what} of their width_mm do not fit side by side, give fewer")
