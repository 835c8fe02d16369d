"""Cumulative shares: tables by which one of many entries is drawn in the share that it has of the light."""

from __future__ import annotations

import drjit as dr
import numpy as np

from hagoromo.backend import Float, UInt, arrays


def shares_before(light: np.ndarray) -> np.ndarray:
    """Shares of the entries of the last axis that stand before each one, and 1: one more than there are entries."""
    sums = np.pad(np.cumsum(light, axis=-1), [(0, 0)] * (light.ndim - 1) + [(1, 0)])
    total = sums[..., -1:]
    even = np.linspace(0.0, 1.0, sums.shape[-1])
    shares = np.where(total > 0.0, sums / np.where(total > 0.0, total, 1.0), even).astype(np.float32)
    shares[..., -1] = 1.0
    return shares


def interval_of(shares: Float, count: int, number: Float, first: UInt) -> UInt:
    """The entry, of `count` whose shares begin at `first`, that a number in [0, 1) falls into."""
    jit = arrays()
    beyond = dr.binary_search(0, count, lambda k: dr.gather(jit.Float, shares, first + jit.UInt(k)) <= number)
    return dr.minimum(dr.maximum(jit.UInt(beyond), 1) - 1, count - 1)
