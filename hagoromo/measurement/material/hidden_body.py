"""Hidden body: intervals of a material whose body is black, or lies wholly under a highlight that no photograph leaves.

No body reflects less than nothing. Where the best fit has none in some channel, it is at the limit of its range, and
how bright it may be does not follow from the curvature there. It follows from a profile along the strength of the
highlight: the less of it, the more of the body.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.material.interval import NODES, Profile, inflation
from hagoromo.measurement.material.quantity import coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, inverse_over
from hagoromo.measurement.parameters import STRENGTH, channels_of
from hagoromo.measurement.robust_fit import at_bound, minimise

STEPS = np.linspace(0.02, 1.5, 38)  # of the strength, over the estimate


def is_hidden(fit: MaterialFit) -> bool:
    """Whether a channel of the body is at its limit, 0."""
    return bool(np.any(fit.theta[: channels_of(fit.theta)] <= 0.0))


def profile_over_strength(fit: MaterialFit) -> Profile:
    """Profile of `fit` along β F₀, with the body that fits best at each."""
    place, best = fit.theta.size + STRENGTH, fit.theta[STRENGTH]
    spread = np.sqrt(inverse_over(fit.curvature, fit.free)[place, place] * inflation(fit, coordinate(STRENGTH)))
    nodes = np.unique(np.maximum(np.concatenate([best + spread * NODES, best * STEPS]), 1e-9 * best))
    starts = np.tile(fit.theta, (len(nodes), 1))
    starts[:, place] = nodes
    others = fit.free & (np.arange(fit.theta.size) != place)
    rows = minimise(fit.objective, starts, others)
    pairs = zip(rows.curvature, rows.theta, strict=True)
    covariance = np.stack([inverse_over(curvature, others & ~at_bound(theta)) for curvature, theta in pairs])
    cost = fit.objective.evaluate(fit.theta[None])[0][0]
    return Profile(fit, np.maximum(2.0 * (rows.cost - cost), 0.0), rows.theta, covariance, rows.statuses, place)
