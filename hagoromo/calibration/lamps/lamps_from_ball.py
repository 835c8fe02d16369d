"""Lamps from a chrome ball: photographs with one lamp each, and a mask of the ball → directions to the lamps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Ball, find_ball
from hagoromo.calibration.lamps.highlight import find_highlight
from hagoromo.calibration.lamps.lamp_speck import Surroundings
from hagoromo.calibration.lamps.mask_check import confirmed
from hagoromo.calibration.lamps.outline import check_focus, refined
from hagoromo.calibration.lamps.reading import LampReading, read_lamp, read_shading
from hagoromo.calibration.lamps.survey import Survey
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.progress import Progress, silent

SHADED_EDGE = 0.4  # [px] by which the edge of a ball that is no mirror is found too far in, as it darkens there


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
