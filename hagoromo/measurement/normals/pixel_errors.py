"""Pixel errors: what the normal and the body of each pixel are off by, of their own and with all others.

Footprint: a pixel at the edge of the object is covered by more than half, its visible middle thus off by 0 to ¼ px,
whose mean square is 1/48; the mean of a curved surface is off by 1/24 of its second difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNKNOWN_DIRECTION = math.pi - 2.0  # [rad²] mean square of the angle to a direction that may be any of a hemisphere
OFF_MIDDLE = 1.0 / 48.0  # [px²] mean square by which the visible part of a pixel at the edge is off its middle
KEPT = 0.99  # share of the shared variance that modes are kept for
OF_CURVATURE = 1.0 / 24.0  # share of the second difference by which the mean over a pixel is off


@dataclass(frozen=True, eq=False)
class PixelErrors:
    """Errors of P pixels: what they have of their own, and what all share.

    own: (P,) variance of the direction [rad²], the sum over two turns; independent between pixels. modes: (m, P, 3)
    changes of the normal [rad], world axes: the errors that pixels share are Σ_j x_j modes_j with independent x_j of
    variance 1.
    rest: (P,) part of `own` that smoothing over neighbours does not change. width: (n, P, 3) further modes, by the
    width of a pixel (`footprint`), with which body colours do not change.
    body, body_modes: (C, P) and (m, C, P) the same of the relative body colours, over the unit of all lamps.
    """

    own: Array
    modes: Array
    rest: Array
    body: Array
    body_modes: Array
    width: Array

    def pixels(self, chosen: NDArray) -> PixelErrors:
        """Those of some pixels."""
        own, rest = self.own[chosen], self.rest[chosen]
        bodies, modes, width = self.body_modes[:, :, chosen], self.modes[:, chosen], self.width[:, chosen]
        return PixelErrors(own, modes, rest, self.body[:, chosen], bodies, width)

    def leading(self, kept: float = KEPT) -> PixelErrors:
        """The same with the fewest modes that hold this share of the shared variance; the rest is the pixels' own."""
        size, turned = np.linalg.eigh(np.einsum("mpi,npi->mn", self.modes, self.modes))
        size, turned = np.maximum(size[::-1], 0.0), turned[:, ::-1]
        count = int(np.searchsorted(np.cumsum(size), kept * size.sum())) + 1
        modes, bodies = (np.tensordot(turned[:, :count].T, one, axes=1) for one in (self.modes, self.body_modes))
        shared = np.einsum("mpi,mpi->p", modes, modes)
        own, body = self.shared - shared, np.sum(self.body_modes**2, axis=0) - np.sum(bodies**2, axis=0)
        own, body = np.maximum(own, 0.0), np.maximum(body, 0.0)
        return PixelErrors(self.own + own, modes, self.rest + own, self.body + body, bodies, self.width)

    @property
    def shared(self) -> Array:
        """(P,) variance of the direction [rad²] that is shared."""
        return np.einsum("mpi,mpi->p", self.modes, self.modes)

    @property
    def variance(self) -> Array:
        """(P,) of the direction [rad²]: own, shared, and by the width of a pixel."""
        return np.minimum(self.own + self.shared + np.sum(self.width**2, axis=(0, 2)), UNKNOWN_DIRECTION)

    @property
    def body_variance(self) -> Array:
        """(C, P) of ln of the body colours, over the unit of all lamps: own and shared."""
        return self.body + np.sum(self.body_modes**2, axis=0)


def footprint(image: Array) -> Array:
    """(2, h, w, 3) modes [rad] of normals (h, w, 3), 0 where unknown, by the width of a pixel: that of pixels at the
    edge, and that of the curvature. Each is alike all around an object.
    """
    known = np.linalg.norm(image, axis=2) > 0.5
    modes = np.zeros((2, *image.shape))
    for axis in (0, 1):
        before, after = (_moved(image, axis, step) for step in (1, -1))
        has_before, has_after = (np.linalg.norm(one, axis=2) > 0.5 for one in (before, after))
        beside = np.where(has_before[..., None], before, after) - image
        modes[0] += math.sqrt(OFF_MIDDLE) * np.where((has_before ^ has_after)[..., None], beside, 0.0)
        second = before + after - 2.0 * image
        modes[1] += OF_CURVATURE * np.where((has_before & has_after)[..., None], second, 0.0)
    modes -= np.sum(modes * image, axis=3, keepdims=True) * image
    return np.where(known[..., None], modes, 0.0)


def _moved(image: Array, axis: int, step: int) -> Array:
    """The picture of the neighbours along an axis, 0 beyond the border."""
    wide = np.pad(image, [(1, 1) if i == axis else (0, 0) for i in range(3)])
    return np.roll(wide, step, axis=axis)[1:-1] if axis == 0 else np.roll(wide, step, axis=axis)[:, 1:-1]
