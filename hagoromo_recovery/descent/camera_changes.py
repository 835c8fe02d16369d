"""Camera changes: small turns and shifts of cameras from where they are stated to be, that photographs agree on.

A principal point that is wrong by some pixels, or a mount that is not straight, turns all cameras alike. Poses from
photographs are wrong each by its own: by half a pixel, as a rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hagoromo.files.content import digest
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.descent.gloss_step import CORRELATED, robust
from hagoromo_recovery.descent.pixel_table import PixelTable
from hagoromo_recovery.descent.rendering import Rendering, SeenLight

Array = NDArray[np.float64]
PRIOR, PRIOR_EACH = 3.0, 1.0  # [px] standard deviation, known beforehand, of the turn of all cameras, and of each
CORRELATED_EACH = 1e5  # so many values of a camera's pixels count as one: the surface gives way to what it alone says
DIFFERENCE = 0.5  # [px] of the derivatives by differences
LARGEST = 1.0  # [px] of a step
DAMPED = 0.5  # share of a step of Gauss and Newton that is taken
ALL = "all"  # name of the one change of all cameras
TURNS, NUMBERS = 3, 6  # of a change: its angles, and all


class CameraChanges:
    """Changes of cameras: one of all, or one of `each`. A turn in the axes of each camera (x right, y down, z ahead),
    and a shift: of all in the axes of the world, of each in its own.

    found: changes (6,) by camera, as `changes` gives them: rotation vector [rad], then the shift [m].
    """

    def __init__(self, photographs: Sequence[Photograph], each: bool, found: Mapping[str, Array]) -> None:
        self.each = each
        self.frames = np.stack([p.camera.world_to_camera[:3, :3] for p in photographs])
        self.pixel = float(np.median([1.0 / min(p.camera.focal) for p in photographs]))  # rad
        names = [self.name_of(p) for p in photographs]
        self.names = list(dict.fromkeys(names))
        self.number = np.array([self.names.index(name) for name in names])
        self.values = np.stack([np.asarray(found.get(name, np.zeros(NUMBERS)), float) for name in self.names])

    def __str__(self) -> str:
        if self.each:
            turned, shifted = np.sqrt((self.values.reshape(-1, 2, TURNS) ** 2).sum(axis=2).mean(axis=0))
            return f"each turned by {turned / self.pixel:.2f} px and shifted by {1e3 * shifted:.3g} mm (rms)"
        down, left = self.values[0, :2] / self.pixel
        roll, shift = np.degrees(self.values[0, 2]), np.linalg.norm(self.values[0, TURNS:])
        return (
            f"all turned: principal point {-left:.2f} px to the right and {down:.2f} px down, roll {roll:.3f} degrees; "
            f"shifted together by {1e3 * shift:.3g} mm"
        )

    @property
    def changes(self) -> dict[str, Array]:
        """Changes (6,) by camera."""
        return dict(zip(self.names, self.values, strict=True))

    def name_of(self, photograph: Photograph) -> str:
        """That of its camera: photographs from one pose have one."""
        return digest(photograph.camera.world_to_camera.tolist()) if self.each else ALL

    def _units(self, pixels: PixelTable) -> Array:
        """What moves the picture of the object by a pixel [rad, m]; seldom less, ahead."""
        return np.repeat([self.pixel, self.pixel * pixels.distance], TURNS)

    def apply(self, pixels: PixelTable, more: Any = 0.0) -> None:
        """Change the rays of a table of pixels, by `more` (6,) in addition."""
        moved = (self.values + more)[self.number].reshape(-1, 2, TURNS)
        turns, shifts = np.einsum("nji,nkj->kni", self.frames, moved)
        pixels.move(turns, shifts if self.each else moved[:, 1])

    def step(self, rendering: Rendering, pixels: PixelTable, chunks: NDArray[np.integer], fall: float) -> None:
        """Half a step of Gauss and Newton by some chunks of pixels, times `fall` for each camera: few are its own.

        A turn of all cameras shows nearly the same as a shift of all of them, or of the object, which follows a turn
        that is wrong. So both are solved for.
        """
        drawn = pixels.of(chunks)
        base = rendering.light(drawn)
        rest = [value - light for value, light in zip(drawn.values, base.channels, strict=True)]
        weight = robust(drawn, rest, pixels.limit)
        weights = np.stack([np.array(w * weight, np.float64) for w in drawn.weights])
        slopes = self._slopes(rendering, pixels, chunks, base)
        residual, camera = np.stack([np.array(r, np.float64) for r in rest]), self.number[np.array(drawn.photograph)]
        copies = pixels.count / weights.shape[1] / (CORRELATED_EACH if self.each else CORRELATED)
        prior, units = 1.0 / (PRIOR_EACH if self.each else PRIOR) ** 2, self._units(pixels)

        def sums(values: Array) -> Array:
            return copies * np.bincount(camera, (weights * values).sum(axis=0), len(self.names))

        matrix = np.stack([[sums(a * b) for b in slopes] for a in slopes], axis=0).transpose(2, 0, 1)
        side = np.stack([sums(a * residual) for a in slopes], axis=1) - prior * self.values / units
        solved = np.linalg.solve(matrix + prior * np.eye(NUMBERS), side[..., None])[..., 0]
        change = (fall if self.each else 1.0) * DAMPED * solved
        self.values = self.values + np.clip(change, -LARGEST, LARGEST) * units
        self.apply(pixels)

    def _slopes(self, rendering: Rendering, pixels: PixelTable, chunks: NDArray[np.integer], base: SeenLight) -> Array:
        """Derivatives (6, channels, pixels) of the light by what moves the picture by a pixel, by differences."""
        slopes, units = [], self._units(pixels)
        for k in range(NUMBERS):
            self.apply(pixels, DIFFERENCE * units * np.eye(NUMBERS)[k])
            moved = rendering.light(pixels.of(chunks)).channels
            slopes.append([np.array(a - b, np.float64) / DIFFERENCE for a, b in zip(moved, base.channels, strict=True)])
        return np.array(slopes)

    def of(self, photograph: Photograph) -> Photograph:
        """A photograph whose camera is changed; by the mean turn, where nothing is known of a camera."""
        mean = np.concatenate([self.values[:, :TURNS].mean(axis=0), np.zeros(TURNS)])
        change = self.changes.get(self.name_of(photograph), mean)
        pose = photograph.camera.world_to_camera.copy()
        pose[:3, 3] -= change[TURNS:] if self.each else pose[:3, :3] @ change[TURNS:]
        pose[:3] = Rotation.from_rotvec(-change[:TURNS]).as_matrix() @ pose[:3]
        return replace(photograph, camera=photograph.camera.with_pose(pose))
