"""Bloom: the charge of a clipped sample floods its neighbours, which are treated as clipped, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.photograph.development.exposure import Exposure, planes

BLOOM_PX = 3  # [px] clipped samples flood neighbours up to this distance: these are treated as clipped


def without_bloom(one: Exposure, across: bool) -> Exposure:
    """With the neighbours of clipped samples marked as clipped; across: those of other colours of a mosaic, too."""
    from scipy.ndimage import binary_dilation

    full = np.array(one.full, np.bool_)
    if full.any():
        if one.mosaic and across:
            full |= np.asarray(binary_dilation(one.full, np.ones((2 * BLOOM_PX + 1,) * 2)), np.bool_)
        reach = -(-BLOOM_PX // 2) if one.mosaic else BLOOM_PX
        for plane, grown in zip(planes(one.full, one.mosaic), planes(full, one.mosaic), strict=True):
            grown |= np.asarray(binary_dilation(plane, np.ones((2 * reach + 1,) * 2)), np.bool_)
    return replace(one, full=full)
