"""Colours of lamps: how strong each channel of a photograph is, beside the mean of all."""

from __future__ import annotations

import numpy as np

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array


def colours(values: Array) -> Array:
    """(K, C) strength of each channel over the lamp's mean, up to a colour that all lamps share."""
    grey = values.mean(axis=2)
    bright = np.isfinite(grey) & (grey > 0.2 * np.nan_to_num(grey).max(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(bright[..., None], np.log(values / grey[..., None]), np.nan)
    share = np.where(np.isfinite(share), share, np.nan)
    own = share[:, np.isfinite(share).all(axis=(0, 2))]
    if own.shape[1] < 100:
        return np.ones((len(values), 1))
    return np.exp(np.median(own - own.mean(axis=0), axis=1))
