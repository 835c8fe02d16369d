"""Lamp departure: how far the lamps that a photometric fit found depart from the stated ones, over an object.

The fit finds of each lamp how strong it is beside the others, how its light falls off over the object, and its
direction. A lamp that is not among those measured departs likewise, and no photograph shows how: what its photograph is
off by for that alone is here taken as what those that were measured would be off by under their stated lamps.

Rig share: how much of the differences in strength that a rig states hold for the photographs of an object.

A lamp that is near is stronger for what stands nearer to it, so all differences grow or shrink together where an object
stands higher or lower than what the rig was measured on. One factor b of ln strength is estimated for a capture, from
its photographs alone: b − 1 is the regression of the strengths that the photometric fit still finds on those that the
rig has taken out; before the photographs b is 1 ± 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hagoromo.light.lamp import Lamp
from hagoromo.measurement.normals.normals import NormalMap, solve_with_one_lobe
from hagoromo.measurement.normals.photometric_model import Prior, evenness, predicted
from hagoromo.measurement.normals.views import UNLIT, Array
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.rig import Rig
from hagoromo.progress import Progress, silent

MOST_PIXELS = 4000  # that are compared
LEAST_DEPARTURE = 0.005  # relative: less is not said
CHANCE = 0.01  # of calling lamps uneven that are not
UNEVEN = Prior(strength=0.1, slope=0.1)
STRENGTH_ERROR = 0.01  # of ln strength, beside the error that the fit states: lamps vary from capture to capture
PRIOR_SPREAD = 1.0  # standard deviation of b before the photographs


@dataclass(frozen=True)
class LampDeparture:
    """Root mean squares over the lamps, what all have in common left out.

    strength: of ln irradiance in the middle of the object. falloff: of ln irradiance over the object, beside that.
    direction: between directions to the lamps found and stated [rad]. photograph: of the relative error of a photograph
    whose lamp is taken as stated; photographs: that of each, no mean. evident: whether strength and fall-off are more
    than their errors explain, and more than lamps vary from capture to capture.
    """

    strength: float
    falloff: float
    direction: float
    photographs: tuple[float, ...]
    evident: bool

    @property
    def photograph(self) -> float:
        """Root mean square of the relative errors of `photographs`."""
        return _rms(np.array(self.photographs))

    @property
    def significant(self) -> bool:
        """Whether the photographs show that the lamps depart, by enough to be said."""
        return self.evident and self.photograph > LEAST_DEPARTURE

    @property
    def sentence(self) -> str:
        """What was found, for a report."""
        return (
            f"the photographs show lamps that depart from the stated ones by {100 * self.strength:.2g} % in strength "
            f"and {100 * self.falloff:.2g} % in fall-off over the object, and by {np.degrees(self.direction):.2g}° in "
            "direction (root mean squares)"
        )


def lamp_departure(solved: NormalMap, stated: Sequence[Lamp]) -> LampDeparture | None:
    """How far the lamps of `solved` depart from those `stated`, one a photograph; None where they were not fitted."""
    fit = solved.fit
    if fit.lamp_variance is None:
        return None
    count = len(solved.views.rows)
    some = np.unique(np.linspace(0, count - 1, min(count, MOST_PIXELS)).astype(int))
    views, few = solved.views.pixels(some), fit.pixels(some)
    strength, slope = fit.strength - fit.strength.mean(), fit.slope - fit.slope.mean(axis=0)
    light = np.log(evenness(strength, slope, solved.views.place[some]))  # (K, P) ln of found over stated irradiance
    towards = np.empty_like(views.to_lamp)
    for k, lamp in enumerate(stated):
        towards[k], before = lamp.direction_and_irradiance(views.points)
        light[k] += _log_ratio(views.lamps[k].direction_and_irradiance(views.points)[1], before)
    light -= light.mean(axis=0)  # what all lamps have in common is in the body colours
    middle = light.mean(axis=1)
    own = np.exp(light)[:, None] * predicted(few, views.to_lamp, views.to_eye)
    missed = np.sum((own - predicted(few, towards, views.to_eye)) ** 2, axis=(1, 2))
    return LampDeparture(
        _rms(middle),
        _rms(light - middle[:, None]),
        _rms(np.arccos(np.clip(np.sum(towards * views.to_lamp, axis=2), -1.0, 1.0))),
        tuple(np.sqrt(missed / np.maximum(np.sum(own**2, axis=(1, 2)), 1e-300)).tolist()),
        _evident(np.column_stack([strength, slope]), fit.lamp_variance[:, :3]),
    )


def _log_ratio(after: Array, before: Array) -> Array:
    """(P,) ln of the ratio of irradiances (P,) or (P, C), means of the channels; 0 where a lamp shines no light."""
    after, before = (one.reshape(len(one), -1).mean(axis=1) for one in (after, before))
    lit = (after > UNLIT * after.max()) & (before > UNLIT * before.max())
    return np.log(np.where(lit, after, 1.0) / np.where(lit, before, 1.0))


def _evident(found: Array, variance: Array) -> bool:
    """Whether numbers (K, 3) of the lamps, of mean 0, are not all 0."""
    from scipy.stats import chi2

    known = variance > 0.0
    squares = np.sum(found[known] ** 2 / (variance[known] + STRENGTH_ERROR**2))
    return bool(squares > chi2.isf(CHANCE, known.sum() - known.shape[1]))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def solve_uneven_lamps(capture: Capture, distance: float, progress: Progress = silent) -> NormalMap:
    """The photometric fit of an object of unknown shape, `distance` [m] from the camera, with wide priors of lamps."""
    if has_near_lamps(capture):
        return solve_shape(capture, distance, UNEVEN, progress).normal_map
    return solve_with_one_lobe(capture, prior=UNEVEN, progress=progress)


def fitted_rig(rig: Rig, capture: Capture, distance: float, progress: Progress = silent) -> tuple[Rig, float]:
    """The rig with the strengths that hold for `capture`, an object of unknown shape at `distance` [m], and b."""
    solved = solve_uneven_lamps(rig.evened_capture(capture), distance, progress)
    views, fit = solved.views, solved.fit
    if fit.lamp_variance is None:
        return rig, 1.0
    place = rig.place(views.shape)[views.rows, views.columns].mean(axis=0)
    stated = rig.strengths_at([one.lamps[0] for one in capture.photographs], place)
    weight = 1.0 / (fit.lamp_variance[:, 0] + STRENGTH_ERROR**2)
    stated, left = (one - np.average(one, weights=weight) for one in (stated, fit.strength))
    change = float(np.sum(weight * stated * left) / (np.sum(weight * stated**2) + PRIOR_SPREAD**-2))
    share = max(1.0 + change, 0.0)
    return rig.weakened(share, place), share
