"""Lamp places: small shifts of lamps from where they are stated to be, that photographs agree on.

A lamp is placed by hand, or read off a ball: a per cent of its distance is usual. A far lamp is turned instead. A lamp
that moves with the camera, such as a flash, has one shift in the axes of the camera. If all near lamps stand nearer by
one factor, the object looks brighter, as of brighter body colours: the mean of that factor stays as stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.content import digest
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.descent.gloss_step import CORRELATED, robust
from hagoromo_recovery.descent.pixel_table import PixelTable
from hagoromo_recovery.descent.rendering import Rendering
from hagoromo_recovery.descent.strengths import normal_equations
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.shading.lamp_table import LampTable

Array = NDArray[np.float64]
PRIOR = 0.01  # standard deviation of a shift in each axis, of the distance; of a far lamp's direction [rad]
DIFFERENCE = 0.01  # of the derivatives by differences, likewise
LARGEST = 0.01  # of a step, likewise
DAMPED = 0.5  # share of a step of Gauss and Newton that is taken
RIDES = 2e-3  # of its distance, that a lamp which moves with the camera stands elsewhere in its axes, at most


class LampPlaces:
    """Shifts (3,) of lamps, in the world or in the axes of the camera that they move with: of near ones [m], of the
    direction of far ones [rad].

    found: shifts by lamp, as `shifts` gives them.
    """

    def __init__(self, photographs: Sequence[Photograph], found: Mapping[str, Array]) -> None:
        self.each = max((len(p.lamps) for p in photographs), default=0)
        self.riding = [_rides(photographs, k) for k in range(self.each)]
        names: dict[str, int] = {}
        self.number = np.full((len(photographs), self.each), -1)  # of the shift of each lamp; −1 where there is no lamp
        self.frames = np.zeros((len(photographs), self.each, 3, 3))  # its axes → the world's
        for k, photograph in enumerate(photographs):
            for j, lamp in enumerate(photograph.lamps):
                self.number[k, j] = names.setdefault(self._name(lamp, j), len(names))
                self.frames[k, j] = self._frame(photograph, j)
        self.names = list(names)
        near = [lamp.near for photograph in photographs for lamp in photograph.lamps]
        self.near = np.zeros(len(names), bool)
        self.near[self.number[self.number >= 0]] = near
        self.values = np.stack([np.asarray(found.get(name, np.zeros(3)), float) for name in self.names])

    def __str__(self) -> str:
        length = np.linalg.norm(self.values, axis=1)
        parts = []
        for near, factor, word in ((True, 1e3, "shifted by {:.3g} mm"), (False, np.degrees(1.0), "turned by {:.2g}°")):
            own = factor * length[self.near == near]
            if len(own):
                parts.append(word.format(np.sqrt(np.mean(own**2))) + f" (rms), {own.max():.3g} at most")
        return f"each lamp {', '.join(parts)}"

    @property
    def shifts(self) -> dict[str, Array]:
        """By lamp."""
        return dict(zip(self.names, self.values, strict=True))

    def _name(self, lamp: Lamp, slot: int) -> str:
        return f"with the camera {slot}" if self.riding[slot] else digest([lamp.place_key, *lamp.place.tolist()])

    def _frame(self, photograph: Photograph, slot: int) -> Array:
        return photograph.camera.world_to_camera[:3, :3].T if self.riding[slot] else np.eye(3)

    def apply(self, lamps: LampTable, more: Array | float = 0.0) -> None:
        """Move the lamps of a table, by `more` (lamps, 3) in addition."""
        own = np.concatenate([self.values + more, np.zeros((1, 3))])[self.number]
        lamps.move(np.einsum("nkij,nkj->nki", self.frames, own))

    def _units(self, lamps: LampTable) -> Array:
        """(lamps, 1) distance of each from the object [m]; 1 of far ones."""
        own = self.number >= 0
        sums = np.bincount(self.number[own], lamps.away[own], len(self.names))
        return (sums / np.bincount(self.number[own], minlength=len(self.names)))[:, None]

    def _outwards(self, lamps: LampTable) -> Array:
        """(lamps, 3) mean direction of each near one from the object, in its axes; of others 0."""
        own = self.number >= 0
        ways = lamps.lattice.to_world(lamps.stated[..., :3]) - lamps.lattice.middle
        ways = np.einsum("nkji,nkj->nki", self.frames, ways)[own] * (lamps.stated[..., 3:4] > 0.0)[own]
        sums = np.zeros((len(self.names), 3))
        np.add.at(sums, self.number[own], ways)
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)

    def step(self, rendering: Rendering, pixels: PixelTable, chunks: NDArray[np.integer], fall: float) -> None:
        """Half a step of Gauss and Newton by some chunks of pixels, times `fall`."""
        drawn, lamps = pixels.of(chunks), rendering.shading.lamps
        base, units = rendering.light(drawn), self._units(lamps)
        rest = [value - seen for value, seen in zip(drawn.values, base.channels, strict=True)]
        weight = np.array(robust(drawn, rest, pixels.limit), np.float64)
        before, slopes = base.of_lamps, []
        for axis in np.eye(3):
            self.apply(lamps, DIFFERENCE * units * axis)
            slopes.append((rendering.light(drawn).of_lamps - before) / DIFFERENCE)
        number = self.number[np.array(drawn.photograph)].T  # (each, pixels)
        at = np.concatenate([np.where(number < 0, -1, 3 * number + axis) for axis in range(3)])
        by_channel = [(at, np.concatenate([slope[:, c] for slope in slopes])) for c in range(COLOURS)]
        matrix, side = normal_equations(pixels, drawn, rest, weight, by_channel, self.values.size, CORRELATED)
        now, prior = (self.values / units).ravel(), PRIOR**-2
        change = fall * DAMPED * np.linalg.solve(matrix + prior * np.eye(len(now)), side - prior * now)
        self.values = self.values + np.clip(change, -LARGEST, LARGEST).reshape(-1, 3) * units
        outwards, near = self._outwards(lamps), self.near[:, None]
        farther = (self.values * outwards).sum(axis=1, keepdims=True) / units
        if near.any():
            self.values = self.values - farther[near].mean() * units * outwards
        self.apply(lamps)

    def of(self, photograph: Photograph) -> Photograph:
        """A photograph with its lamps where they were found; as stated, where nothing is known of them."""
        known, lamps = self.shifts, list(photograph.lamps)
        for j, lamp in enumerate(lamps[: self.each]):
            lamps[j] = lamp.shifted(self._frame(photograph, j) @ known.get(self._name(lamp, j), np.zeros(3)))
        return replace(photograph, lamps=tuple(lamps))


def _rides(photographs: Sequence[Photograph], slot: int) -> bool:
    """Whether near lamp `slot` of each photograph stands at one place in the axes of its camera, which moves."""
    own, world = [], []
    for photograph in photographs:
        if len(photograph.lamps) <= slot or not photograph.lamps[slot].near:
            return False
        place = photograph.lamps[slot].place
        pose = photograph.camera.world_to_camera
        own.append(pose[:3, :3] @ place + pose[:3, 3])
        world.append(place)
    spread = [float(np.ptp(np.stack(places), axis=0).max()) for places in (own, world)]
    return spread[0] <= RIDES * max(spread[1], 1e-12)
