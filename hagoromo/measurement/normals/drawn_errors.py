"""Drawn errors: what normals may be off by of their own, as neighbours share it where they were smoothed.

Noise of smoothed normals is the smoothed noise: S e with the smoother S of `smooth_normals`. It is small in each normal
and alike in neighbours, so that sums over pixels (depth) do not gain by what the pixels gain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION
from hagoromo.measurement.normals.shading import tangents
from hagoromo.measurement.normals.smooth_normals import smoother_of
from hagoromo.measurement.normals.views import Array, Views

LEAST_SHARE = 1e-3  # of the own variance that smoothing leaves


def independent_variance(fit: Fit) -> Array:
    """(P,) own variance of normals [rad²] before they were smoothed: what neighbours do not have in common."""
    return np.minimum(sum(_parts(fit)), UNKNOWN_DIRECTION)


def own_errors(views: Views, fit: Fit) -> Callable[[np.random.Generator], Array]:
    """What draws own errors (P, 3) [rad] of the normals of `fit`, world axes."""
    axes, parts = np.stack(tangents(fit.normals)), [np.sqrt(0.5 * one) for one in _parts(fit)]
    count, smoother = len(fit.normals), smoother_of(views, fit)

    def drawn(random: np.random.Generator) -> Array:
        before, rest = (np.einsum("ip,ipj->pj", spread * random.normal(size=(2, count)), axes) for spread in parts)
        return smoother(before) + rest

    return drawn


def _parts(fit: Fit) -> tuple[Array, Array]:
    """(P,) own variance before smoothing, and that to which smoothing does nothing."""
    own = fit.variance if fit.errors is None else fit.errors.own
    rest = np.zeros(len(own)) if fit.errors is None else np.minimum(fit.errors.rest, own)
    share = 1.0 if fit.smooth is None else np.maximum(fit.smooth.share, LEAST_SHARE)
    return np.minimum((own - rest) / share, UNKNOWN_DIRECTION), rest
