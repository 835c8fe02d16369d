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
    body, body_modes: (C, P) and (m, C, P) the same of the relative body colours, over the unit of all lamps.
    """

    own: Array
    modes: Array
    body: Array
    body_modes: Array

    def pixels(self, chosen: NDArray) -> PixelErrors:
        """Those of some pixels."""
        return PixelErrors(self.own[chosen], self.modes[:, chosen], self.body[:, chosen], self.body_modes[:, :, chosen])

    def leading(self, kept: float = KEPT) -> PixelErrors:
        """The same with the fewest modes that hold this share of the shared variance; the rest is the pixels' own."""
        size, turned = np.linalg.eigh(np.einsum("mpi,npi->mn", self.modes, self.modes))
        size, turned = np.maximum(size[::-1], 0.0), turned[:, ::-1]
        count = int(np.searchsorted(np.cumsum(size), kept * size.sum())) + 1
        modes, bodies = (np.tensordot(turned[:, :count].T, one, axes=1) for one in (self.modes, self.body_modes))
        found = PixelErrors(self.own, modes, self.body, bodies)
        own, body = self.shared - found.shared, np.sum(self.body_modes**2, axis=0) - np.sum(bodies**2, axis=0)
        return PixelErrors(self.own + np.maximum(own, 0.0), modes, self.body + np.maximum(body, 0.0), bodies)

    @property
    def shared(self) -> Array:
        """(P,) variance of the direction [rad²] that is shared."""
        return np.einsum("mpi,mpi->p", self.modes, self.modes)

    @property
    def variance(self) -> Array:
        """(P,) of the direction [rad²]: own and shared."""
        return np.minimum(self.own + self.shared, UNKNOWN_DIRECTION)

    @property
    def body_variance(self) -> Array:
        """(C, P) of ln of the body colours, over the unit of all lamps: own and shared."""
        return self.body + np.sum(self.body_modes**2, axis=0)


def footprint(image: Array) -> Array:
    """(h, w) variance [rad²] of the direction of normals (h, w, 3), 0 where unknown: a pixel has a width."""
    known = np.linalg.norm(image, axis=2) > 0.5
    slope, bend, edge = np.zeros(known.shape), np.zeros(known.shape), np.zeros(known.shape, bool)
    for axis in (0, 1):
        before, after = (_moved(image, axis, step) for step in (1, -1))
        here = [np.linalg.norm(one, axis=2) > 0.5 for one in (before, after)]
        steps = [
            np.where(is_known, np.sum((one - image) ** 2, axis=2), 0.0)
            for one, is_known in zip((before, after), here, strict=True)
        ]
        slope += np.maximum(*steps)
        both = here[0] & here[1]
        second = np.where(both[..., None], before + after - 2.0 * image, 0.0)
        along = np.sum(second * image, axis=2, keepdims=True) * image
        bend += np.sum((second - along) ** 2, axis=2)
        edge |= ~both
    return OFF_MIDDLE * np.where(edge, slope, 0.0) + OF_CURVATURE**2 * bend


def _moved(image: Array, axis: int, step: int) -> Array:
    """The picture of the neighbours along an axis, 0 beyond the border."""
    wide = np.pad(image, [(1, 1) if i == axis else (0, 0) for i in range(3)])
    return np.roll(wide, step, axis=axis)[1:-1] if axis == 0 else np.roll(wide, step, axis=axis)[:, 1:-1]
