"""Change: what has changed between two measurements of one object.

Enters: two measurements whose errors are stated. Leaves: maps of colour, gloss, shape and normals with errors, where
they are significant at a stated rate of false discoveries, and the regions that make these up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.record import written_by
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.inspection.profile import checked_line
from hagoromo.measurement.inspection.seen_surface import seen_surface
from hagoromo.measurement.measurement import Measurement
from hagoromo.progress import Progress, silent
from hagoromo_campaigns.campaign import GLOSS, Campaign, campaign
from hagoromo_campaigns.cross_section import CrossSection, cross_section
from hagoromo_campaigns.overlap import Overlap, overlap
from hagoromo_campaigns.paint import Paint, paint
from hagoromo_campaigns.quantity import Quantity, quantities
from hagoromo_campaigns.region import ChangedRegion, regions
from hagoromo_campaigns.registration import Registration, register

Array = NDArray[np.float64]
RATE = 0.05  # of false discoveries
FEWEST_COMPARED = 200  # pixels
MOST_CHANGED = 1.0 / 3.0  # of what both show: beyond it, what stayed the same may not be what it is taken for
MOST_WIDENING = 4.0  # of the errors of single pixels: beyond it most of the object changed, or its errors are not these
SEED = 0  # of the random choices of the registration
WORDS = {
    "colour": "colour",
    "gloss": "strength of the highlight",
    "width": "width of the highlight",
    "shape": "shape",
    "normals": "normals",
}


@dataclass(frozen=True)
class CommonChange:
    """What all of the surface has in common, and is not in the maps: a relative change, its standard error as both
    campaigns state it (infinite: not known), of a quantity and a channel ("" of gloss).
    """

    quantity: str
    channel: str
    change: float
    error: float

    @property
    def significant(self) -> bool:
        """At 95 %."""
        return abs(self.change) > NORMAL_95 * self.error


@dataclass(frozen=True, eq=False, repr=False)
class Change:
    """What has changed between BEFORE and AFTER, at the pixels (h, w) of BEFORE.

    compared: (h, w) what both show. pictures: BEFORE's and AFTER's body colours there as linear sRGB (h, w, 3), under
    the first lamp, NaN where not compared. rate: of false discoveries. remarks: what is doubted. assumptions: what is
    taken for given. section: heights of both along a line, where one was asked for.
    """

    before: Campaign
    after: Campaign
    registration: Registration
    compared: NDArray[np.bool_]
    pictures: tuple[Array, Array]
    quantities: tuple[Quantity, ...]
    regions: tuple[ChangedRegion, ...]
    common: tuple[CommonChange, ...]
    rate: float
    assumptions: tuple[str, ...]
    remarks: tuple[str, ...]
    settings: dict[str, Any]
    section: CrossSection | None = None

    def __getitem__(self, name: str) -> Quantity:
        """The quantity of that name: colour, gloss, width, shape or normals; KeyError where it is not compared."""
        return next(one for one in self.quantities if one.name == name) if name in self else {}[name]

    def __contains__(self, name: str) -> bool:
        return any(one.name == name for one in self.quantities)

    def __repr__(self) -> str:
        height, width = self.compared.shape
        return f"Change({width} × {height} px, {', '.join(one.name for one in self.quantities)}: {self.sentence})"

    @property
    def sentence(self) -> str:
        """What is found, in a line."""
        if not self.regions:
            return f"nothing has changed significantly (rate of false discoveries {100 * self.rate:g} %)"
        counts = {one.name: len({r.number for r in self.regions if r.quantity == one.name}) for one in self.quantities}
        said = ", ".join(f"{WORDS[name]} in {count}" for name, count in counts.items() if count)
        return f"regions that changed: {said} (rate of false discoveries {100 * self.rate:g} %)"

    def record(self) -> dict[str, Any]:
        """As change.json has it."""
        return {
            "hagoromo": written_by(self.settings, SEED),
            "before": self.before.name,
            "after": self.after.name,
            "found": self.sentence,
            "pixels_compared": int(self.compared.sum()),
            "false_discovery_rate": self.rate,
            "registration": self.registration.record(),
            "lengths_in_metres": self.before.in_metres and self.after.in_metres,
            "quantities": [_quantity_record(one, self.compared) for one in self.quantities],
            "common_changes": [
                {"quantity": one.quantity, "channel": one.channel, "change": one.change, "significant": one.significant,
                 "standard_error": one.error if math.isfinite(one.error) else None}
                for one in self.common
            ],
            "regions": [one.record() for one in self.regions],
            "section": None if self.section is None else self.section.sentence,
            "assumptions": list(self.assumptions),
            "remarks": list(self.remarks),
        }  # fmt: skip

    def save(self, folder: str | Path, force: bool = False) -> Path:
        """Write change.json, regions.csv and change.exr to `folder`, whole or not at all; see `write_into`."""
        from hagoromo.files.whole import whole_folder

        with whole_folder(folder, force) as home:
            self.write_into(home)
        return Path(folder)

    def write_into(self, folder: str | Path) -> None:
        """Write the data files into an existing folder.

        change.json: registration, errors, regions, assumptions. regions.csv: a row for each region. change.exr: of each
        quantity its value, `error.*`, `p.*`, and `significant.*` and `compared.*` (1 or 0); 0 where not compared, p 1.
        section.csv, section.png: of a line, heights at both dates and their difference, with bands.
        """
        from hagoromo_campaigns.change_files import write_change

        write_change(self, Path(folder))


def change(
    before: Measurement | str | Path,
    after: Measurement | str | Path,
    *,
    lamps: Sequence[str] = (),
    rate: float = RATE,
    doubted: bool = False,
    line: Sequence[float] = (),
    progress: Progress = silent,
) -> Change:
    """What has changed between two measurements of one object at two dates; camera and lamps may differ.

    before, after: measurements, or the folders that `measure` wrote. lamps: names of illuminants under which colours
    are compared (default: D65, or channels as photographed where the response of the camera is not known). rate: of
    false discoveries, the expected share of places that are marked though they did not change; if nothing has changed,
    the probability that anything is marked. doubted: compare also where more has changed than has stayed the same.
    line: x0, y0, x1, y1 in BEFORE's picture [px]: heights of both along it are compared, too (`Change.section`).
    progress: called with the share of the work done (0 … 1) and the name of the step.

    What all of the surface has in common (a factor of colours and its linear course, a bend of the shape) is taken out
    of the maps: lamps and integration make it, too. It is reported beside them (`common`).
    `InputError` for measurements without errors, of two objects or without overlap, and where so much has changed that
    nothing to compare with is left.
    """
    if not 0.0 < rate < 1.0:
        raise InputError(f"the rate of false discoveries is {rate:g}: give a number between 0 and 1, such as {RATE:g}")
    progress(0.0, "reading")
    loaded = [_loaded(one) for one in (before, after)]
    own, other = (
        campaign(read, _named(one, word)).averaged()
        for read, one, word in zip(loaded, (before, after), ("BEFORE", "AFTER"), strict=True)
    )
    surfaces = [seen_surface(one) for one in loaded] if len(line) else []
    if surfaces:
        checked_line(surfaces[0], line[:2], line[2:])
    painted = paint(own, other, lamps)
    progress(0.1, "registration")
    registered = register(own, other, SEED)
    progress(0.5, "differences")
    both = overlap(own, other, registered)
    if both.shown.sum() < FEWEST_COMPARED:
        raise InputError(
            f"{own.name} and {other.name} have {both.shown.sum()} pixels in common, and {FEWEST_COMPARED} are needed: "
            "they hardly overlap; give measurements of the same side"
        )
    found = quantities(both, painted, rate)
    doubts = _doubts(found, both)
    if doubts and not doubted:
        raise InputError(
            f"{other.name} shows {own.name}'s object, but {'; '.join(doubts)}: was it mended, cleaned or painted in "
            "between? Registration, common colour and errors rest on what stayed the same, which must be most of it; "
            "--doubted compares all the same"
        )
    progress(0.9, "regions")
    settings = {"lamps": list(lamps) or None, "rate": rate, "doubted": doubted or None}
    settings |= {"line": list(line)} if len(line) else {}
    section = cross_section(surfaces[0], surfaces[1], registered, line[:2], line[2:]) if surfaces else None
    return Change(
        own,
        other,
        registered,
        both.shown,
        _pictures(both, painted),
        found,
        tuple(region for one in found for region in regions(one, own)),
        _common(both, found),
        rate,
        _assumptions(own, other, painted, registered),
        tuple([*(f"doubted: {one}" for one in doubts), *_missing(own, other, found)]),
        settings,
        section,
    )


def _loaded(one: Measurement | str | Path) -> Measurement:
    return one if isinstance(one, Measurement) else Measurement.load(one)


def _named(one: Measurement | str | Path, word: str) -> str:
    return word if isinstance(one, Measurement) else Path(one).name or word


def _doubts(found: Sequence[Quantity], both: Overlap) -> list[str]:
    """Why what stayed the same may not be what it is taken for, in words."""
    doubts = []
    for one in found:
        share = float(one.significance.found.sum()) / max(int(both.shown.sum()), 1)
        if share > MOST_CHANGED:
            doubts.append(f"{100 * share:.0f} % of it has other {WORDS[one.name]}")
        elif one.significance.widening[0] > MOST_WIDENING:
            by = one.significance.widening[0]
            doubts.append(
                f"its {WORDS[one.name]} differs in most places, {by:.1f} times as much as the stated errors, which may "
                "be too small"
            )
    return doubts


def _common(both: Overlap, found: Sequence[Quantity]) -> tuple[CommonChange, ...]:
    """Colour by its channels, and gloss as a whole."""
    changes = []
    for one in found:
        if one.name == "colour":
            channels = "RGB" if one.trend.shape[1] == 3 else [str(k) for k in range(one.trend.shape[1])]
            changes += [
                CommonChange("colour", str(c), math.expm1(t), one.shared)
                for c, t in zip(channels, one.trend[0], strict=True)
            ]
    if both.before.gloss is not None and both.after.gloss is not None:
        value, _ = both.after_map(both.after.gloss)
        errors = np.hypot(both.before.gloss_shared, both.after.gloss_shared)
        difference = (value - both.before.gloss)[both.shown]
        for k, name in enumerate(GLOSS):
            known = np.isfinite(difference[:, k])
            if known.any():
                changes.append(CommonChange(name, "", math.expm1(np.median(difference[known, k])), float(errors[k])))
    return tuple(changes)


def _pictures(both: Overlap, painted: Paint) -> tuple[Array, Array]:
    to_display = next(iter(painted.displays.values()))
    after, _ = both.after_map(painted.after)
    shown = both.shown[..., None]
    before, after = (np.where(shown, one @ to_display.T, np.nan) for one in (painted.before, after))
    return before, after


def _assumptions(before: Campaign, after: Campaign, painted: Paint, registered: Registration) -> tuple[str, ...]:
    scale = 100.0 * (1.0 / registered.to_after.scale - 1.0)
    metres = before.in_metres and after.in_metres
    said = [f"colour: {painted.assumption}"]
    said += [
        f"maps: {one.name} is compared in means over {one.step} × {one.step} pixels, as if these erred independently"
        for one in (before, after)
        if one.step > 1
    ]
    said.append(
        f"scale: lengths are those of {before.name}; {after.name} was made {abs(scale):.2g} % "
        f"{'larger' if scale > 0.0 else 'smaller'} to fit"
        if metres
        else "scale: the distance of the object is not known in both: lengths are pixels of " + before.name
    )
    return tuple(said)


def _missing(before: Campaign, after: Campaign, found: Sequence[Quantity]) -> list[str]:
    """What is not compared, and why."""
    names, said = {one.name for one in found}, []
    if not {"shape", "normals"} & names:
        said.append("shape and normals are not compared: they were given to the measurement, without errors")
    if "gloss" not in names and (before.gloss is None or after.gloss is None):
        said.append("gloss is not compared: no highlight was measured in both")
    elif "gloss" not in names:
        said.append(
            "gloss has no map: each material has one gloss in both, which is compared as a whole; a place that was "
            "polished, or became dull, then shows as one that changed its colour or its normals"
        )
    return said


def _quantity_record(one: Quantity, compared: NDArray[np.bool_]) -> dict[str, Any]:
    found, tested = one.significance.found, one.significance
    return {
        "name": one.name,
        "unit": one.unit,
        "pixels_compared": int((one.compared & compared).sum()),
        "pixels_significant": int(found.sum()),
        "largest_significant_p": max(tested.threshold, 0.0),
        "widening_of_errors": list(tested.widening),
        "median_standard_error": {
            label or one.name: float(np.median(error[one.compared])) for label, error in one.error.items()
        },
        "taken_out": one.trend.tolist(),
    }
