"""Hidden body: intervals of a material whose body is black, or lies wholly under a highlight that no photograph leaves.

No body reflects less than nothing. Where the best fit has none in some channel, it is at the limit of its range, and
how bright it may be does not follow from the curvature there. It follows from a profile along the strength of the
highlight: the less of it, the more of the body. So it does where the strength is known too badly for its errors to be
normal: a faint narrow lobe on a body and a strong wide one on nothing may explain the photographs alike.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.material.interval import NODES, WELL_KNOWN, Profile, inflation, profile_from
from hagoromo.measurement.material.quantity import coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, inverse_over
from hagoromo.measurement.parameters import STRENGTH, channels_of

STEPS = np.linspace(0.02, 1.5, 38)  # of the strength, over the estimate
OPEN_STEPS = np.geomspace(0.02, 1000.0, 49)  # the same, where it may be of any size


def is_hidden(fit: MaterialFit) -> bool:
    """Whether a channel of the body is at its limit, 0."""
    return bool(np.any(fit.theta[: channels_of(fit.theta)] <= 0.0))


def is_open(fit: MaterialFit) -> bool:
    """Whether the strength of the highlight is known to worse than WELL_KNOWN of itself."""
    return bool(np.sqrt(fit.covariance[STRENGTH, STRENGTH]) > WELL_KNOWN * fit.theta[STRENGTH])


def profile_over_strength(fit: MaterialFit) -> Profile:
    """Profile of `fit` along β F₀, with the body that fits best at each; through its whole range where it is open."""
    place, best = fit.theta.size + STRENGTH, fit.theta[STRENGTH]
    spread = np.sqrt(inverse_over(fit.curvature, fit.free)[place, place] * inflation(fit, coordinate(STRENGTH)))
    near = best + spread * NODES
    nodes = np.unique(np.maximum(np.concatenate([near, best * STEPS]), 1e-9 * best))
    if not is_hidden(fit):
        nodes = best * np.append(OPEN_STEPS, 1.0)
        nodes.sort()
    starts = np.tile(fit.theta, (len(nodes), 1))
    starts[:, place] = nodes
    others = fit.free & (np.arange(fit.theta.size) != place)
    return profile_from(fit, place, starts, others)
