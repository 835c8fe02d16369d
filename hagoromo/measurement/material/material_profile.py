"""Material profile: what the fit of one material says of the terms that its photographs have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.photometric.term import Term
from hagoromo.measurement.photometric.term_fit import Profile, dispersion
from hagoromo.measurement.sight import Array
from hagoromo.photograph.capture import Capture

MOST_LEVERAGE = 0.9  # of a value in the body of its pixel, by which its residual is made whole
Observe = Callable[[Capture], Observations]


def changes_of(capture: Capture, terms: Sequence[Term], samples: Observations, observed: Observe) -> Array:
    """(N, C, T) change of the values of `samples` of `capture` by a unit of each term; observed: how they are taken."""
    columns = []
    for term in terms:
        changes = [term.change(photograph) for photograph in capture.photographs]
        added = observed(_with_values(capture, [one.added for one in changes])).values
        share = observed(_with_values(capture, [one.share for one in changes])).values
        columns.append(added + share * samples.values)
    return np.stack(columns, axis=-1)


def _with_values(capture: Capture, each: Sequence[NDArray | float]) -> Capture:
    photographs = (
        replace(photograph, values=np.broadcast_to(values, photograph.values.shape))
        for photograph, values in zip(capture.photographs, each, strict=True)
    )
    return replace(capture, photographs=tuple(photographs))


def profile_of_material(fit: MaterialFit, changes: Array) -> Profile:
    """The profile of terms that change the values by `changes` (N, C, T): a sandwich, as that of the fit itself.

    The parameters of the material, and body colours of pixels, are eliminated.
    """
    objective, used = fit.objective, fit.objective.observations.used
    root = np.sqrt(objective.variance[used])
    r = (objective.observations.values - objective.model(fit.theta))[used] / root
    j = objective.jacobian(fit.theta)[used][:, fit.inside] / root[:, None]
    x = objective.within(changes)[used] / root[:, None]
    weight, curved = objective.loss.weight(r), objective.loss.curvature(r)
    # the step with weights of the loss never goes too far, however wrong the model is; the error has its curvature
    outer = _without(x, j, weight)
    step = np.linalg.pinv(outer.T @ (weight[:, None] * outer), hermitian=True) @ (outer.T @ (weight * r))
    left = _without(x, j, curved)
    information = left.T @ (curved[:, None] * left)
    leverage = np.clip(objective.own_leverage()[used], 0.0, MOST_LEVERAGE)
    each = (left * (weight * r / np.sqrt(1.0 - leverage))[:, None]).T
    scores = np.stack([np.bincount(fit.group, one).astype(np.float64) for one in each], axis=1)
    return Profile(step, information / dispersion(information, scores.T @ scores))


def _without(columns: Array, others: Array, weight: Array) -> Array:
    """Columns (V, T) less their weighted projection on `others` (V, P)."""
    weighed = others * weight[:, None]
    return columns - others @ (np.linalg.pinv(weighed.T @ others, hermitian=True) @ (weighed.T @ columns))
