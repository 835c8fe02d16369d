"""Cross-section: heights along one line at both dates, over the same two ends, and where they differ significantly.

Enters: two surfaces and their registration. Leaves: two profiles with their bands, and the difference with its own.

AFTER's heights are those of its surface where the plane through BEFORE's line and BEFORE's camera meets it. Each date's
heights are over its own chord between the two ends, so that what the integration does not know (where the whole lies,
how it is tilted) drops out: changes are relative to the ends, which must lie where nothing changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.inspection.height_errors import LinePlaces, height_variance
from hagoromo.measurement.inspection.profile import HeightProfile, Point, chord_axes, points_at, profile
from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo_campaigns.registration import PARAMETERS, STEP, Registration
from hagoromo_campaigns.similarity import Similarity

Array = NDArray[np.float64]
STEPS = 4  # steps in which AFTER's surface is found on the plane of the section
FEWEST_KNOWN = 3  # places that both show


@dataclass(frozen=True, eq=False, repr=False)
class CrossSection:
    """before, after: profiles at the same n places and distances. registration_error: (n,) standard error of AFTER's
    heights by the registration, in the unit of the profiles.
    """

    before: HeightProfile
    after: HeightProfile
    registration_error: Array

    @property
    def unit(self) -> str:
        """Of lengths: mm, or px."""
        return self.before.unit

    @property
    def difference(self) -> Array:
        """(n,) AFTER less BEFORE: below 0 matter is gone."""
        return self.after.height - self.before.height

    @property
    def error(self) -> Array:
        """(n,) standard error of the difference."""
        return np.sqrt(self.before.error**2 + self.after.error**2 + self.registration_error**2)

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(n,) at 95 %, place by place: of a line on which nothing changed, a twentieth is marked, in the mean."""
        with np.errstate(invalid="ignore"):
            return (np.abs(self.difference) > NORMAL_95 * self.error) & (self.error > 0.0)  # 0 at the ends

    @property
    def sentence(self) -> str:
        """What is found, in a line."""
        known = np.isfinite(self.difference) & np.isfinite(self.error)
        if not known.any():
            return "the cross-section has no band: nothing says what is significant"
        share = 100.0 * float(self.significant[known].mean())
        said = f"along the line {share:.0f} % of the places differ significantly (5 % where nothing changed)"
        if not self.significant.any():
            return said
        most = self.difference[np.nanargmax(np.where(self.significant, np.abs(self.difference), np.nan))]
        return f"{said}, by {most:.3g} {self.unit} at most"

    def __repr__(self) -> str:
        return f"CrossSection({self.sentence})"

    def columns(self) -> dict[str, Array]:
        """What section.csv holds: name → (n,), NaN where unknown."""
        found = {"x_px": self.before.image[:, 0], "y_px": self.before.image[:, 1]}
        found[f"distance_{self.unit}"] = self.before.distance
        difference, half = self.difference, NORMAL_95 * self.error
        bands = {
            "before": (self.before.height, *self.before.band_95),
            "after": (self.after.height, *self.after.band_95),
            "difference": (difference, difference - half, difference + half),
        }
        for name, parts in bands.items():
            for word, part in zip(("", "_low_95", "_high_95"), parts, strict=True):
                found[f"{name}{word}_{self.unit}"] = part
        return found | {"significant": np.where(np.isfinite(difference + half), self.significant, np.nan)}


def cross_section(
    before: SeenSurface, after: SeenSurface, registration: Registration, start: Point, end: Point
) -> CrossSection:
    """Heights of both along the line between two places of BEFORE's picture [px].

    `InputError` as `profile`, and where AFTER does not show both ends.
    """
    both = before.in_metres and after.in_metres
    before = replace(before, in_metres=both)
    own = profile(before, start, end)
    points = points_at(before, own.image)
    if not np.isfinite(points).all(axis=1).sum() > FEWEST_KNOWN:
        raise InputError("hardly a place of the line is known: draw it over the surface")
    found = _after_heights(before, after, registration.to_after, points)
    if not np.isfinite(found.height[[0, -1]]).all():
        raise InputError("an end of the line is not shown by AFTER: draw it where both measurements show the surface")
    factor, scale = before.units_per_metre, registration.to_after.scale
    known = np.isfinite(found.height)
    own_error, shared = (np.full(len(known), np.nan) for _ in range(2))
    if after.own_variance is not None:
        variances = height_variance(after, found.places.of(np.flatnonzero(known)))
        own_error[known], shared[known] = (factor / scale * np.sqrt(one) for one in variances)
    slopes = np.zeros((len(known), PARAMETERS - 1))
    for k, one in enumerate(STEP * np.eye(PARAMETERS)[: PARAMETERS - 1]):
        up, down = (
            _after_heights(before, after, registration.moved(side * one), points).height for side in (1.0, -1.0)
        )
        slopes[:, k] = (up - down) / (2.0 * STEP)
    moved = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", slopes, registration.covariance, slopes), 0.0))
    other = replace(own, height=factor * found.height, own=own_error, shared=shared, remarks=())
    return CrossSection(own, other, factor * moved)


@dataclass(frozen=True, eq=False)
class _AfterHeights:
    """AFTER's surface on the plane of the section: height over its chord [m of BEFORE], and what its error needs."""

    height: Array
    places: LinePlaces


def _after_heights(before: SeenSurface, after: SeenSurface, to_after: Similarity, points: Array) -> _AfterHeights:
    """Where AFTER's surface is over the chord of `points` (n, 3), BEFORE's along the line."""
    chord, up = chord_axes(before, points)
    share = (points - points[0]) @ chord / ((points[-1] - points[0]) @ chord)
    here, place = points, points
    for _ in range(STEPS):  # along `up` from each point of BEFORE to AFTER's surface
        image = after.camera.project(to_after.points(place))
        here = to_after.inverse.points(points_at(after, image))
        place = points + ((here - points) @ up)[:, None] * up
    rise = (here - points[0]) @ up
    height = rise - (1.0 - share) * rise[0] - share * rise[-1]
    there = to_after.points(here) - after.camera.position
    away = np.linalg.norm(there, axis=1)
    along = there @ to_after.directions(up) / away
    return _AfterHeights(height, LinePlaces(image, np.clip(np.nan_to_num(share), 0.0, 1.0), along, away))
