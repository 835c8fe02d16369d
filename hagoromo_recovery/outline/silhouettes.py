"""Silhouettes: where the object is in each photograph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.outline.object_view import ObjectView

DARK_EDGE = 0.25  # share of bright pixels at the edge of a picture up to which its background counts as dark


def views_of(photographs: Sequence[Photograph]) -> list[ObjectView]:
    """The photographs with the silhouettes that masks or transparency state.

    Without masks in all photographs it is what is brighter than the dark background in one of those from a pose;
    shadows of the object on itself may be missing from it. `InputError` where a background is not dark, or a silhouette
    is empty.
    """
    stated = [p.silhouette for p in photographs if p.silhouette is not None]
    if len(stated) < len(photographs):
        lit: dict[bytes, NDArray[np.bool_]] = {}
        for p in photographs:
            pose, bright = p.camera.world_to_camera.tobytes(), bright_of(p)
            lit[pose] = bright if pose not in lit or lit[pose].shape != bright.shape else lit[pose] | bright
        return [ObjectView(p, lit[p.camera.world_to_camera.tobytes()], False) for p in photographs]
    for photograph, silhouette in zip(photographs, stated, strict=True):
        if not silhouette.any():
            raise InputError(f"the mask of photograph {photograph.name!r} is empty: it must be white on the object")
    return [ObjectView(*each) for each in zip(photographs, stated, strict=True)]


def bright_of(photograph: Photograph) -> NDArray[np.bool_]:
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
