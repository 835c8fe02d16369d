"""Mixed gloss: β and γ of places that have shares of two glosses, as one gloss has them.

The facets of a place are those of both, D = Σ share β exp(−ln2 φ²/γ²). Its β is D at φ = 0, its γ the angle at which D
has half of that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo_recovery.shading.shading import each_gloss

Array = NDArray[np.float64]
HALVINGS = 40  # of the interval in which γ lies


class MixedGloss(NamedTuple):
    """β [1/sr] and γ [rad] of places, of one shape."""

    beta: Array
    gamma: Array


def mixed_gloss(gloss: NDArray[np.floating], shares: NDArray[np.floating]) -> MixedGloss:
    """β and γ of places with these shares of the second gloss. gloss: see `NodeShading`, of two.

    >>> both = mixed_gloss(np.log([2.0, 0.1, 0.5, 0.2, 0.3]), np.array([0.0, 1.0]))
    >>> both.beta.round(6).tolist(), both.gamma.round(6).tolist()
    ([2.0, 0.2], [0.1, 0.3])
    """
    beta, gamma = np.exp([[gloss[k] for k in one[:2]] for one in each_gloss(gloss)]).T
    second = np.asarray(shares, np.float64)[..., None]
    weights = np.concatenate([1.0 - second, second], axis=-1) * beta
    peak = weights.sum(axis=-1)
    low, high = np.full(peak.shape, gamma.min()), np.full(peak.shape, gamma.max())
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = (weights * np.exp2(-((middle[..., None] / gamma) ** 2))).sum(axis=-1) > 0.5 * peak
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return MixedGloss(peak, 0.5 * (low + high))
