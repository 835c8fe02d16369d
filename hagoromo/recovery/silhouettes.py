"""Silhouettes: where the object is in each photograph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo.photograph.photograph import Photograph

DARK_EDGE = 0.25  # share of bright pixels at the edge of a picture up to which its background counts as dark


def silhouettes_of(photographs: Sequence[Photograph]) -> tuple[list[NDArray[np.bool_]], bool]:
    """The silhouette (h, w) of each photograph, and whether masks or transparency state them.

    Without masks in all photographs it is what is brighter than the dark background; shadows of the object on itself
    may then be missing from it. `InputError` where a background is not dark, or a silhouette is empty.
    """
    if all(p.silhouette is not None for p in photographs):
        stated = [np.asarray(p.silhouette) for p in photographs]
        for photograph, silhouette in zip(photographs, stated, strict=True):
            if not silhouette.any():
                raise InputError(f"the mask of photograph {photograph.name!r} is empty: it must be white on the object")
        return stated, True
    return [_bright(photograph) for photograph in photographs], False


def _bright(photograph: Photograph) -> NDArray[np.bool_]:
    """Pixels that are brighter than a dark background, by Otsu's threshold of √light."""
    from skimage.filters import threshold_otsu

    light = np.sqrt(np.maximum(photograph.values.max(axis=2), 0.0))
    valid = photograph.mask & np.isfinite(light)
    if not valid.any() or float(np.ptp(light[valid])) == 0.0:
        raise InputError(f"photograph {photograph.name!r} shows nothing that is brighter than the rest: give masks")
    bright = ~valid | (light > 0.6 * threshold_otsu(light[valid]))
    edge = np.concatenate([bright[0], bright[-1], bright[:, 0], bright[:, -1]])
    if edge.mean() > DARK_EDGE:
        raise InputError(
            f"the background of photograph {photograph.name!r} is not dark: give masks that are white on the object "
            "(mask_path), or pictures with transparency"
        )
    return np.asarray(ndimage.binary_fill_holes(ndimage.binary_opening(bright)), np.bool_)
