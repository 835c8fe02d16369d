"""Reduced photographs: the region of an object, binned to a given number of pixels, and the colours of its lamps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array, binned
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError


def reduced(
    photographs: Mapping[str, NDArray], mask: NDArray[np.bool_], camera: Camera | None, most: int
) -> tuple[Array, NDArray[np.bool_], Array]:
    """light (K, h, w, C), mask (h, w), tangent (h, w, 2) of the region of the object, binned to at most `most` pixels.

    tangent: x right, y up of the rays (x, y, −1); 0 in an orthographic view. One photograph is in memory at a time.
    """
    if not mask.any():
        raise InputError("the mask of the object is black: paint the object white")
    if camera is not None and (camera.height, camera.width) != mask.shape:
        size = f"{camera.height} × {camera.width}"
        raise InputError(f"the camera is {size} pixels and the mask {mask.shape}: resize the mask to {size}")
    k = int(np.ceil(np.sqrt(max(mask.sum() / most, 1.0))))
    about = tuple(
        slice(max(int(filled.min()) - 4 * k, 0), int(filled.max()) + 4 * k + 1)
        for filled in (np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0)))
    )
    light = []
    for name, photograph in photographs.items():
        if photograph.shape[:2] != mask.shape:
            raise InputError(f"{name} is {photograph.shape[:2]} pixels and the mask {mask.shape}: give them one size")
        light.append(binned(photograph.reshape(*mask.shape, -1)[about], k))
    on_object = binned(mask[about], k) == 1.0
    if camera is None:
        return np.stack(light), on_object, np.zeros((*on_object.shape, 2))
    row, column = (np.arange(n) * k + 0.5 * k + part.start for n, part in zip(on_object.shape, about, strict=True))
    rays = camera.unproject(np.stack(np.meshgrid(column, row), axis=-1)) @ camera.world_to_camera[:3, :3].T
    return np.stack(light), on_object, rays[..., :2] / rays[..., 2:] * [1.0, -1.0]


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
