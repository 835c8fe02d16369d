"""Shading: a small sample of the photographs of an object, one lamp each, and how well Lambert's law explains it.

Photographs are binned to some hundred or thousand squares of pixels. The fit is that of `photograph.exponent`: robust
against highlights and cast shadows. A wide gloss that all places have in common can be taken out before.
Axes: the camera's (OpenCV), x right, y down, z away from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.linearity import lamp_light, near, points_at, shows, towards, unfit
from hagoromo.measurement.surface.tile_store import means
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import DARK, lambert_fit, loss, without_gloss

MOST_SQUARES = 1600  # of the sample
FEWEST_SQUARES = 60
MOST_FITTED = 8_000  # readings of a fit that is done many times
LEAST_READINGS = 4  # of a square
Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class ShadingSample:
    """K photographs of P squares. values: (K, P) light over the lamp's, where usable (K, P). to_lamp: (K, P, 3) unit;
    light: (K, P) of the lamp there. row, column: (P,) of the squares, of a picture `shape` of squares of `side` px;
    outline: (P, 2) unit, away from the object in the picture (x, y), 0 where the square is not at its outline. to_eye:
    (P, 3) unit.
    """

    names: tuple[str, ...]
    values: Array
    usable: NDArray[np.bool_]
    to_lamp: Array
    light: Array
    row: Array
    column: Array
    shape: tuple[int, int]
    side: int
    outline: Array
    to_eye: Array

    def few(self) -> ShadingSample:
        """Fewer squares, for a fit that is done many times."""
        return self.part(np.s_[:: max(-(-self.values.size // MOST_FITTED), 1)])

    def part(self, part: slice | NDArray[np.bool_]) -> ShadingSample:
        """Some of the squares."""
        return replace(
            self, values=self.values[:, part], usable=self.usable[:, part], to_lamp=self.to_lamp[:, part],
            light=self.light[:, part], row=self.row[part], column=self.column[part], outline=self.outline[part],
            to_eye=self.to_eye[part],
        )  # fmt: skip

    @property
    def direction(self) -> Array:
        """(K, 3) unit: to the lamps, the mean over the object."""
        mean = self.to_lamp.mean(axis=1)
        return mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)

    @property
    def taken(self) -> Array:
        """(K, P) the photographs as they were taken, not divided by the light of their lamps."""
        return self.values * self.light

    def arranged(self, order: NDArray[np.integer]) -> ShadingSample:
        """The sample as if each photograph had been taken under the lamp that `order` (K,) gives it."""
        values = self.taken / self.light[order]
        return replace(self, values=values, to_lamp=self.to_lamp[order], light=self.light[order])

    def turned(self, lamp: int, direction: Array) -> ShadingSample:
        """The sample with one lamp moved so that it is in `direction` (3,) from the middle of the object."""
        to_lamp = self.to_lamp.copy()
        moved = to_lamp[lamp] + (direction - self.direction[lamp])
        to_lamp[lamp] = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        return replace(self, to_lamp=to_lamp)

    def fit(self) -> tuple[Array, Array]:
        """Residuals (K, P) in errors of the model, and normal times albedo (P, 3), under the lamps."""
        largest = np.maximum(np.where(self.usable, self.values, 0.0).max(axis=0), 1e-300)
        scaled = np.where(self.usable, self.values / largest, 1.0)
        residual, g = lambert_fit(scaled, self.usable, self.to_lamp)
        return residual, g * largest[:, None]

    @property
    def lit(self) -> Array:
        """(K, P) the values, NaN where they are not usable."""
        return np.where(self.usable, self.values, np.nan)

    @property
    def relief(self) -> float:
        """How far normals are from their mean [rad], root mean square."""
        return float(np.sqrt(np.mean(self._tilts(np.mean) ** 2)))

    @property
    def usual_relief(self) -> float:
        """How far most normals are from the most usual one [rad]: medians. Near 0 of an object before a wall."""
        return float(np.median(self._tilts(np.median)))

    def _tilts(self, middle: Callable[..., Array]) -> Array:
        """(P,) angles [rad] of the normals to their `middle`."""
        _, g = self.fit()
        normals = g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-300)
        mean = middle(normals, axis=0)
        return np.arccos(np.clip(normals @ (mean / max(float(np.linalg.norm(mean)), 1e-300)), -1.0, 1.0))

    def without_gloss(self) -> ShadingSample:
        """The sample less the light of a gloss that is the same everywhere; itself where the photographs show none."""
        matte = without_gloss(self.values, self.usable, self.to_lamp, self.to_eye)
        return self if matte is None else replace(self, values=matte[0], usable=matte[1])

    def misfit(self) -> float:
        """Mean of Huber's loss of the residuals."""
        return loss(self.fit()[0], self.usable)


def shading_of(capture: Capture) -> ShadingSample | str:
    """The sample of `capture`; in words why there is none."""
    shots = capture.photographs
    why = unfit(capture)
    if why:
        return why
    masks = np.stack([shot.mask for shot in shots])
    object_mask = masks.sum(axis=0) >= 0.5 * len(shots)
    side = max(int(np.ceil(np.sqrt(object_mask.sum() / MOST_SQUARES))), 1)
    share = means(object_mask, side)[..., 0]
    inside = share > 0.5
    if inside.sum() < FEWEST_SQUARES:
        return f"the object has {int(object_mask.sum())} pixels only"
    row, column = np.nonzero(inside)
    camera = shots[0].camera
    middles = np.stack([column, row], axis=1) * side + 0.5 * side
    points = points_at(capture, middles) if near(capture) else None
    values, errors, usable, directions, lights = [], [], [], [], []
    for shot, mask in zip(shots, masks, strict=True):
        grey = shot.values.astype(np.float64).sum(axis=2)
        weight = means(mask & np.isfinite(grey), side)[..., 0]
        total = means(np.where(mask & np.isfinite(grey), grey, 0.0), side)[..., 0]
        direction, falloff = towards(shot, points)
        lights.append(np.broadcast_to(lamp_light(shot) * falloff, len(row)))
        directions.append(np.broadcast_to(direction, (len(row), 3)))
        noise = means(np.where(mask & np.isfinite(grey), shot.variance.astype(np.float64).sum(axis=2), 0.0), side)
        values.append((total / np.maximum(weight, 1e-9))[inside])
        errors.append((np.sqrt(noise[..., 0]) / (side * np.maximum(weight, 1e-9)))[inside])
        usable.append((weight > 0.9 * np.maximum(share, 1e-9))[inside])
    to_lamp, lit = np.stack(directions), np.stack(lights)
    placed = np.isfinite(to_lamp).all(axis=(0, 2))
    light, known = np.stack(values) / np.where(placed, lit, 1.0), np.stack(usable) & placed
    known &= shows(np.stack(values), np.stack(errors))
    known &= light > DARK * np.where(known, light, 0.0).max(axis=0)
    enough = known.sum(axis=0) >= LEAST_READINGS
    if enough.sum() < FEWEST_SQUARES:
        return f"fewer than {FEWEST_SQUARES} places are lit by {LEAST_READINGS} lamps"
    to_camera = camera.world_to_camera[:3, :3]
    to_eye = -camera.unproject(middles[enough]) @ to_camera.T
    return ShadingSample(
        tuple(shot.name for shot in shots), light[:, enough], known[:, enough], to_lamp[:, enough] @ to_camera.T,
        lit[:, enough], row[enough], column[enough], inside.shape, side, _outline(inside)[row, column][enough], to_eye,
    )  # fmt: skip


def _outline(inside: NDArray[np.bool_]) -> Array:
    """(h, w, 2) unit (x, y) away from the object at its outline, 0 elsewhere and at the border of the picture."""
    from scipy.ndimage import binary_erosion, gaussian_filter

    down, across = np.gradient(gaussian_filter(inside.astype(np.float64), 1.5, mode="nearest"))
    core: Any = binary_erosion(inside, iterations=2, border_value=1)
    edge = inside & ~core
    away = np.stack([-across, -down], axis=2)
    length = np.linalg.norm(away, axis=2, keepdims=True)
    return np.where(edge[..., None] & (length > 0.05), away / np.maximum(length, 1e-9), 0.0)
