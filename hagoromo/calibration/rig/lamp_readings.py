"""LampReadings: how strong the lamps were beside one another in one capture, and how their light fell off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.light.lamp import Lamp
from hagoromo.photograph.rig import Array


@dataclass(frozen=True, eq=False)
class LampReadings:
    """K lamps on one object or card.

    name: of the capture. size: of its pictures [px]. lamps: as stated. level: (K, 3) ln strength at `place` (2,), the
    middle of the object in p of `Rig`, and slope by p. variance: (K, 3) of it. colour: (K, C) ln of the channels'
    strengths over their mean. turn: (K, 3) of far lamps' directions [rad], and turn_error (K,).
    """

    name: str
    size: tuple[int, int]
    lamps: tuple[Lamp, ...]
    place: Array
    level: Array
    variance: Array
    colour: Array
    turn: Array
    turn_error: Array

    def ordered(self, order: list[int]) -> LampReadings:
        """The lamps in another order."""
        parts = {name: getattr(self, name)[order] for name in ("level", "variance", "colour", "turn", "turn_error")}
        return replace(self, lamps=tuple(self.lamps[k] for k in order), **parts)

    def moved(self) -> Array:
        """(3, 3) matrix from `level` to the same in the middle of the picture."""
        return np.array([[1.0, -self.place[0], -self.place[1]], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
