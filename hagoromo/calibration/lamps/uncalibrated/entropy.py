"""Entropy of ln albedo: least for objects of few albedos (Alldrin, Mallick and Kriegman 2007)."""

from __future__ import annotations

import numpy as np

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array

BINS, REACH, SMOOTH = 200, 2.5, 1.5  # of the histogram of ln albedo: bins, half width, smoothing in bins
WIDTH = 2.0 * REACH / BINS * SMOOTH  # of the smoothing, in ln albedo
KERNEL = np.exp(-0.5 * (np.arange(-6, 7) / SMOOTH) ** 2)


def entropy(values: Array) -> tuple[float, Array]:
    """−∫ p ln p [nat] of the smoothed histogram p of values (P,) about their median, and its slope by each value."""
    bin_width, bell = 2.0 * REACH / BINS, KERNEL / KERNEL.sum()
    at = np.clip((values - np.median(values) + REACH) / bin_width - 0.5, 0.0, BINS - 1.001)
    low = at.astype(np.intp)
    part = at - low
    counts = np.bincount(low, 1.0 - part, BINS) + np.bincount(low + 1, part, BINS)
    share = np.convolve(counts / len(values), bell, "same")
    logarithm = np.log(share + 1e-9)  # an empty bin has a finite one: a value may move there
    # δ ∫ p ln p = ∫ (ln p + 1) δp, and a value that moves takes its part from one bin to the next
    slope = np.diff(np.convolve(logarithm, bell, "same")) / bin_width
    return float(-np.sum(share * logarithm)), -slope[low] / len(values)
