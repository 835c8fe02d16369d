"""Camera turn: one small rotation of all cameras in their own axes, that photographs and object agree on.

A principal point that is wrong by some pixels, or a mount that is not straight, turns all cameras alike. It is
estimated from the photographs that are used, and holds for those that are kept aside, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hagoromo.photograph.photograph import Photograph
from hagoromo.recovery.gloss_step import CORRELATED, robust
from hagoromo.recovery.pixel_table import PixelTable
from hagoromo.recovery.rendering import Rendering, SeenLight

Array = NDArray[np.float64]
PRIOR = 3.0  # [px] standard deviation of the turn, known beforehand
DIFFERENCE = 0.5  # [px] of the derivatives by differences
LARGEST = 1.0  # [px] of a step
DAMPED = 0.5  # share of a step of Gauss and Newton that is taken


class CameraTurn:
    """vector: (3,) rotation vector [rad] by which all cameras turn, in their own axes (x right, y down, z ahead)."""

    def __init__(self, photographs: Sequence[Photograph], vector: NDArray[np.floating] | None = None) -> None:
        self.frames = np.stack([p.camera.world_to_camera[:3, :3] for p in photographs])
        self.pixel = float(np.median([1.0 / min(p.camera.focal) for p in photographs]))  # rad
        self.vector = np.zeros(3) if vector is None else np.asarray(vector, np.float64)

    def __str__(self) -> str:
        down, left = self.vector[:2] / self.pixel
        roll = np.degrees(self.vector[2])
        return f"principal point {-left:.2f} px to the right and {down:.2f} px down, roll {roll:.3f} degrees"

    def apply(self, pixels: PixelTable, more: NDArray[np.floating] | float = 0.0) -> None:
        """Turn the rays of a table of pixels, by `more` (3,) [rad] in addition."""
        pixels.turn(np.einsum("nji,j->ni", self.frames, self.vector + more))

    def step(self, rendering: Rendering, pixels: PixelTable, chunks: NDArray[np.integer]) -> None:
        """Half a step of Gauss and Newton by some chunks of pixels."""
        drawn = pixels.of(chunks)
        base = rendering.light(drawn)
        rest = [value - light for value, light in zip(drawn.values, base.channels, strict=True)]
        weight = robust(drawn, rest, pixels.limit)
        weights = np.stack([np.array(w * weight, np.float64) for w in drawn.weights])
        slopes = self._slopes(rendering, pixels, chunks, base)
        copies = pixels.count / weights.shape[1] / CORRELATED
        prior = 1.0 / (PRIOR * self.pixel) ** 2
        matrix = copies * np.einsum("cn,icn,jcn->ij", weights, slopes, slopes) + prior * np.eye(3)
        residual = np.stack([np.array(each, np.float64) for each in rest])
        side = copies * np.einsum("cn,icn,cn->i", weights, slopes, residual) - prior * self.vector
        change = DAMPED * np.linalg.solve(matrix, side)
        self.vector = self.vector + np.clip(change, -LARGEST * self.pixel, LARGEST * self.pixel)
        self.apply(pixels)

    def _slopes(self, rendering: Rendering, pixels: PixelTable, chunks: NDArray[np.integer], base: SeenLight) -> Array:
        """Derivatives (3, channels, pixels) of the light by the three angles [1/rad], by differences."""
        step, slopes = DIFFERENCE * self.pixel, []
        for axis in np.eye(3):
            self.apply(pixels, step * axis)
            moved = rendering.light(pixels.of(chunks)).channels
            slopes.append([np.array(a - b, np.float64) / step for a, b in zip(moved, base.channels, strict=True)])
        return np.array(slopes)

    def of(self, photograph: Photograph) -> Photograph:
        """A photograph whose camera is turned."""
        pose = photograph.camera.world_to_camera.copy()
        pose[:3] = Rotation.from_rotvec(-self.vector).as_matrix() @ pose[:3]
        return replace(photograph, camera=photograph.camera.with_pose(pose))
