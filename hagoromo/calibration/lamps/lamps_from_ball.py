"""Lamps from a chrome ball: photographs with one lamp each, and a mask of the ball → directions to the lamps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Ball, find_ball
from hagoromo.calibration.lamps.highlight import LampReading, find_highlight, read_lamp
from hagoromo.calibration.lamps.outline import check_focus, refined
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.progress import Progress, silent


def lamps_from_ball(
    photographs: Mapping[str, NDArray],
    mask: NDArray | Ball,
    camera: Camera | None = None,
    progress: Progress = silent,
) -> tuple[Ball, tuple[LampReading, ...]]:
    """One far lamp per photograph of a chrome ball, and the ball.

    photographs: name → (height, width[, channels]) integers, or light as floats (NaN where clipped); a mapping that
    reads them one by one needs memory for one. mask: (height, width[, channels]), bright on the ball; or a ball that
    `search_balls` found. `InputError` for
    sizes that differ, a mask that is not a whole disc, a ball out of focus, or a photograph without a highlight.
    """
    if not photographs:
        raise InputError("no photograph of the chrome ball: give one per lamp")
    shape = None if isinstance(mask, Ball) else mask.shape[:2]
    if camera is not None and shape not in (None, (camera.height, camera.width)):
        raise InputError(f"the camera is {camera.height} × {camera.width} pixels and the mask {shape}")

    def of_one_size() -> Iterator[NDArray]:
        for name, photograph in photographs.items():
            size = photograph.shape[:2]
            if shape not in (None, size):
                raise InputError(f"{name} is {size} pixels and the mask {shape}: give them one size")
            yield photograph

    ball = refined(mask if isinstance(mask, Ball) else find_ball(mask, camera), of_one_size())
    check_focus(ball)
    readings = []
    for i, (name, photograph) in enumerate(photographs.items()):
        try:
            readings.append(read_lamp(name, find_highlight(photograph, ball), ball))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
        progress((i + 1) / len(photographs), name)
    return ball, tuple(readings)
