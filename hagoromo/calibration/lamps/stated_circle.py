"""Stated circle: a ball by its circle, x,y,radius [px], in place of a mask: as messages offer it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from hagoromo.calibration.lamps.ball import MASK_ERROR, Ball, fit_ball
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError

NUMBER = r"(\d{1,6}(?:\.\d{1,4})?)"
CIRCLE = re.compile(rf"{NUMBER},{NUMBER},{NUMBER}")
PARTLY = 0.01  # of the radius: standard error of an outline that photographs show on a part of the circle
SMALLEST = 6.0  # [px] radius


def stated(ball: Ball) -> str:
    """Options that state the ball's circle.

    >>> stated(Ball((31.5, 30.5), 11.0, (0.1, 0.1, 0.1), 0.0, np.zeros((0, 2))))
    '--mask 31.5,30.5,11.0 or --ball 31.5,30.5,11.0'
    """
    x, y = ball.outline(90).mean(axis=0).tolist()
    circle = f"{x:.1f},{y:.1f},{ball.radius:.1f}"
    return f"--mask {circle} or --ball {circle}"


def is_circle(text: str) -> bool:
    """Whether `text` states a circle.

    >>> is_circle("253.8,148.3,119.5"), is_circle("mask.png")
    (True, False)
    """
    return CIRCLE.fullmatch(text) is not None


def ball_of_circle(text: str, camera: Camera | None = None) -> Ball:
    """The ball whose outline is the stated circle."""
    numbers = CIRCLE.fullmatch(text)
    if numbers is None:
        raise InputError(f"a circle is x,y,radius [px]: given {text}")
    x, y, radius = map(float, numbers.groups())
    if radius < SMALLEST:
        raise InputError(f"a ball has a radius of {SMALLEST:g} px at least: given {radius:g} ({text})")
    turn = 2.0 * np.pi * np.arange(90) / 90
    edge = np.array([x, y]) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return replace(fit_ball(edge, camera, MASK_ERROR), standard_error=(PARTLY * radius,) * 3)
