"""Rig share: how much of the differences in strength that a rig states hold for the photographs of an object.

A lamp that is near is stronger for what stands nearer to it, so all differences grow or shrink together where an object
stands higher or lower than what the rig was measured on. One factor b of ln strength is estimated for a capture, from
its photographs alone: b − 1 is the regression of the strengths that the photometric fit still finds on those that the
rig has taken out; before the photographs b is 1 ± 1.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.surface.uneven_lamps import solve_uneven_lamps
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.rig import Rig
from hagoromo.progress import Progress, silent

STRENGTH_ERROR = 0.01  # of ln strength, beside the error that the fit states: lamps vary from capture to capture
PRIOR_SPREAD = 1.0  # standard deviation of b before the photographs


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
