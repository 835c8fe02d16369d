"""Photograph: the linear sensor values of one exposure, their variance, its camera and the lamps that were on."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.png import png_bytes
from hagoromo.light.colour import srgb_encode
from hagoromo.light.lamp import Lamp

DISPLAY_KEY = 0.9  # display value (1: white) of the 99.5th percentile of a photograph


@dataclass(frozen=True, eq=False)
class Photograph:
    """One exposure, linear in light.

    values: (height, width, channels) float32, in units of ρ of Tanaka eq. (10). variance: same shape, in squared units.
    mask: (height, width), true where the pixel is valid (not saturated, part of the object). camera: the camera that
    took it; lamps: those that were on. native: (height, width, channels), true where the sensor measured the channel
    itself, so that the value is independent of its neighbours; None if that is so everywhere. silhouette: (height,
    width), true where the object is, as a mask or transparency states; None if neither is given. Raises `InputError` if
    shapes differ, or a valid pixel is not finite or has no positive variance.

    >>> camera = hg.Camera(5, 3, (10, 10), (2.5, 1.5))
    >>> grey = np.full((3, 5, 3), 0.2)
    >>> shot = hg.Photograph(grey, variance=0.01 * grey, mask=np.ones((3, 5), bool), camera=camera)
    >>> shot.values.dtype, int(shot.mask.sum())
    (dtype('float32'), 15)
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    mask: NDArray[np.bool_]
    camera: Camera
    lamps: tuple[Lamp, ...] = field(default=())
    name: str = ""
    native: NDArray[np.bool_] | None = None
    silhouette: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        """The name, the size and the lamps."""
        height, width, channels = self.values.shape
        lamps = ", ".join(lamp.name or "a lamp without a name" for lamp in self.lamps) or "no lamp"
        return f"Photograph({self.name!r}, {width} × {height} px, {channels} channels, lit by {lamps})"

    def _repr_png_(self) -> bytes:
        """The photograph in a notebook."""
        return png_bytes(self.display())

    def display(self) -> NDArray[np.uint8]:
        """8-bit picture (height, width, 3) for display, in the camera's own colours (grey unless there are 3 channels).

        The 99.5th percentile of the valid pixels is just below white.
        """
        values = np.nan_to_num(self.values.astype(np.float64))
        if values.shape[2] != 3:
            values = np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
        valid = values[self.mask].max(axis=1) if self.mask.any() else np.ones(1)
        return srgb_encode(values * (DISPLAY_KEY / max(float(np.percentile(valid, 99.5)), 1e-30)))

    def __post_init__(self) -> None:
        """Check shapes and numbers once."""
        size = (self.camera.height, self.camera.width)
        if self.values.ndim != 3 or self.values.shape[:2] != size or self.values.shape[2] < 1:
            raise InputError(f"photograph {self.name!r} of shape {self.values.shape}: its camera takes {size} pixels")
        object.__setattr__(self, "values", np.asarray(self.values, np.float32))
        object.__setattr__(self, "variance", np.asarray(self.variance, np.float32))
        object.__setattr__(self, "mask", np.asarray(self.mask, np.bool_))
        object.__setattr__(self, "lamps", tuple(self.lamps))
        for what, array, shape in (
            ("variance", self.variance, self.values.shape),
            ("mask", self.mask, size),
            ("native", self.native, self.values.shape),
            ("silhouette", self.silhouette, size),
        ):
            if array is not None and array.shape != shape:
                raise InputError(f"photograph {self.name!r}: {what} of shape {array.shape}, it must be {shape}")
        if not (np.isfinite(self.values).all(axis=2) | ~self.mask).all():
            raise InputError(f"photograph {self.name!r} has values that are not finite: mask them")
        if not ((np.isfinite(self.variance) & (self.variance > 0.0)).all(axis=2) | ~self.mask).all():
            raise InputError(f"photograph {self.name!r} has pixels without a variance above 0: mask them")
