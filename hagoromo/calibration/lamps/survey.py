"""Survey: what all photographs of a ball tell before one is read: what stands still, and whether it is a mirror.

A mirrored room can look like a body's shading, but it does not turn with the lamps, and the brightest spot is not where
a body of that shading has its highlight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.lamp_speck import Surroundings, brightest_speck
from hagoromo.calibration.lamps.light_on_ball import Light, LightOnBall, above_surroundings, light_on_ball
from hagoromo.calibration.lamps.shading import NEARBY, BallShading, shading_of
from hagoromo.errors import InputError

FEWEST_STILL = 3  # photographs that tell what does not move
TURNS = 10.0  # [°] from its mean: a shading that turns by more is that of a body
GLOSSY, AGREEING = 0.4, 0.6  # share of the photographs that show a body's shading; of these, whose highlight agrees


class Survey:
    """Gathers `Surroundings` from photographs of one ball, one at a time."""

    def __init__(self, ball: Ball) -> None:
        self.ball = ball
        self.still: Light | None = None
        self.corner = (0, 0)
        self.count = 0
        self.shadings: dict[str, BallShading] = {}
        self.agreeing: list[bool] = []

    def add(self, name: str, photograph: NDArray) -> None:
        """Look at one photograph; one that shows nothing is said where it is read."""
        self.count += 1
        try:
            seen = light_on_ball(photograph, self.ball)
        except InputError:
            return
        above = above_surroundings(seen)
        self.still = above if self.still is None else np.minimum(self.still, above)
        self.corner = int(seen.corner[0]), int(seen.corner[1])
        shading = shading_of(seen, self.ball)
        if shading is not None:
            self.shadings[name] = shading
        if shading is not None and shading.is_body:
            self._judge(seen, above, shading)

    def _judge(self, seen: LightOnBall, above: Light, shading: BallShading) -> None:
        """Whether the brightest spot is where a body of this shading has its highlight, as a mirrored room has not."""
        try:
            spot = brightest_speck(seen, above, above, self.ball.radius)
        except InputError:
            return
        rows, columns = (np.array([at.mean()]) for at in np.nonzero(spot.speck))
        towards = self.ball.mirrored(seen.points(rows, columns)).to_lamp[0]
        self.agreeing.append(bool(towards @ shading.to_lamp > np.cos(np.radians(NEARBY))))

    def surroundings(self) -> Surroundings:
        """What the photographs told: of a mirror what stands still, of another ball its shading."""
        bodies = sum(one.is_body for one in self.shadings.values())
        if bodies >= GLOSSY * max(self.count, 1) and (self._follows() or np.mean(self.agreeing or [0.0]) >= AGREEING):
            return Surroundings(shadings=self.shadings)
        return Surroundings(self.still if self.count >= FEWEST_STILL else None, self.corner)

    def _follows(self) -> bool:
        """Whether the shading turns with the lamps, as that of a mirrored room does not."""
        towards = np.array([one.to_lamp for one in self.shadings.values() if one.is_body])
        middle = towards.mean(axis=0)
        return bool(np.median(towards @ middle) < np.cos(np.radians(TURNS)) * np.linalg.norm(middle))
