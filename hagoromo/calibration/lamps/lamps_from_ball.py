"""Lamps from a chrome ball: photographs with one lamp each, and a mask of the ball → directions to the lamps.

Survey: what all photographs of a ball show before one is read: what stands still, and whether it is a mirror.

A mirrored room can look like a body's shading, but it does not turn with the lamps, and the brightest spot is not where
a body of that shading has its highlight.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Ball, find_ball
from hagoromo.calibration.lamps.highlight import find_highlight
from hagoromo.calibration.lamps.lamp_speck import Surroundings, brightest_speck
from hagoromo.calibration.lamps.light_on_ball import (
    NEARBY,
    BallShading,
    Light,
    LightOnBall,
    above_surroundings,
    light_on_ball,
    shading_of,
)
from hagoromo.calibration.lamps.mask_check import confirmed
from hagoromo.calibration.lamps.outline import check_focus, refined
from hagoromo.calibration.lamps.reading import LampReading, read_lamp, read_shading
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.progress import Progress, silent

SHADED_EDGE = 0.4  # [px] by which the edge of a ball that is no mirror is found too far in, as it darkens there
FEWEST_STILL = 3  # photographs that show what does not move
TURNS = 10.0  # [°] from its mean: a shading that turns by more is that of a body
GLOSSY, AGREEING = 0.4, 0.6  # share of the photographs that show a body's shading; of these, whose highlight agrees


def lamps_from_ball(
    photographs: Mapping[str, NDArray],
    mask: NDArray | Ball,
    camera: Camera | None = None,
    progress: Progress = silent,
) -> tuple[Ball, tuple[LampReading, ...]]:
    """One far lamp per photograph of a chrome ball, and the ball.

    photographs: name → (height, width[, channels]) integers, or light as floats (NaN where clipped); a mapping that
    reads them one by one needs memory for one. mask: (height, width[, channels]), bright on the ball; or a ball that
    `search_balls` found. `InputError` for sizes that differ, a mask that is not a whole disc or not on the ball, a ball
    out of focus, or a photograph without a highlight.
    """
    if not photographs:
        raise InputError("no photograph of the chrome ball: give one per lamp")
    shape = None if isinstance(mask, Ball) else mask.shape[:2]
    if camera is not None and shape not in (None, (camera.height, camera.width)):
        raise InputError(f"the camera is {camera.height} × {camera.width} pixels and the mask {shape}")

    given = mask if isinstance(mask, Ball) else find_ball(mask, camera)
    survey = Survey(given)

    def of_one_size() -> Iterator[NDArray]:
        for name, photograph in photographs.items():
            size = photograph.shape[:2]
            if shape not in (None, size):
                raise InputError(f"{name} is {size} pixels and the mask {shape}: give them one size")
            if not given.is_within(size):
                raise InputError(f"the ball is cut by the edge of the picture: {name} has {size[1]} × {size[0]} pixels")
            survey.add(name, photograph)
            yield photograph

    ball = confirmed(refined(given, of_one_size()), photographs)
    check_focus(ball)
    known = survey.surroundings()
    if known.shadings:
        x, y, radius = ball.standard_error
        ball = replace(ball, standard_error=(x, y, float(np.hypot(radius, SHADED_EDGE))))
    readings = []
    for i, (name, photograph) in enumerate(photographs.items()):
        try:
            readings.append(_reading(name, photograph, ball, known))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
        progress((i + 1) / len(photographs), name)
    return ball, tuple(readings)


def _reading(name: str, photograph: NDArray, ball: Ball, known: Surroundings) -> LampReading:
    """The lamp by its highlight, on a ball that is no mirror also by its shading, or by that alone."""
    shading = known.shadings.get(name)
    try:
        highlight = find_highlight(photograph, ball, known, shading)
    except InputError:
        if shading is None:
            raise
        return read_shading(name, shading, ball)
    return read_lamp(name, highlight, ball, shading)


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
        """What the photographs show: of a mirror what stands still, of another ball its shading."""
        bodies = sum(one.is_body for one in self.shadings.values())
        if bodies >= GLOSSY * max(self.count, 1) and (self._follows() or np.mean(self.agreeing or [0.0]) >= AGREEING):
            return Surroundings(shadings=self.shadings)
        return Surroundings(self.still if self.count >= FEWEST_STILL else None, self.corner)

    def _follows(self) -> bool:
        """Whether the shading turns with the lamps, as that of a mirrored room does not."""
        towards = np.array([one.to_lamp for one in self.shadings.values() if one.is_body])
        middle = towards.mean(axis=0)
        return bool(np.median(towards @ middle) < np.cos(np.radians(TURNS)) * np.linalg.norm(middle))
