"""Sums of an unfinished picture as channels of its EXR.

A sum is kept as three single-precision numbers whose sum it is exactly: sums of single-precision numbers in double
precision are multiples of the smallest of these.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

PARTS = 3  # numbers in single precision that a sum is kept as
NAME = re.compile(r"unfinished\.(\d{1,4})\.(\d{1,4})\.(\d)")
Array = NDArray[np.float64]


def channels_of_sums(sums: Array) -> dict[str, NDArray[np.float32]]:
    """EXR channels of (batches, height, width, columns): unfinished.BATCH.COLUMN.PART."""
    channels = {}
    for batch, column in np.ndindex(sums.shape[0], sums.shape[3]):
        rest = sums[batch, :, :, column]
        for part in range(PARTS):
            kept = rest.astype(np.float32)
            rest = rest - kept
            channels[f"unfinished.{batch}.{column}.{part}"] = kept
    return channels


def sums_of_channels(channels: Mapping[str, NDArray[np.float32]]) -> Array | None:
    """The inverse of `channels_of_sums`; None where there are none. `ValueError` for some of them only."""
    places = {name: tuple(map(int, m.groups())) for name in channels if (m := NAME.fullmatch(name))}
    if not places:
        return None
    shape = np.array(list(places.values())).max(axis=0) + 1
    if shape[2] != PARTS or len(places) != shape.prod():
        raise ValueError("sums of an unfinished picture are missing")
    sums = np.zeros((shape[0], *next(iter(channels.values())).shape, shape[1]))
    for name, (batch, column, _) in sorted(places.items(), key=lambda item: -item[1][2]):
        sums[batch, :, :, column] += channels[name]  # the smallest first
    return sums
