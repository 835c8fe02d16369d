"""A lamp's image on a mirror ball with streaks of glare: located by its core, not by the centroid of all the light."""

import numpy as np
import pytest

from hagoromo.calibration.lamps.ball import find_ball
from hagoromo.calibration.lamps.highlight import find_highlight, read_lamp

BALL, RADIUS, CENTRE = (120.0, 110.0), 90.0, np.array([150.4, 88.7])


def photographed(streaks):
    """8-bit photograph of the ball and its mask; streaks: (angle [°], length [px]) of rays of light from the lamp."""
    y, x = np.mgrid[:220, :240] + 0.5
    mask = np.where(np.hypot(x - BALL[0], y - BALL[1]) < RADIUS, 255, 0).astype(np.uint8)
    off = np.stack([x - CENTRE[0], y - CENTRE[1]], axis=2)
    light = 15.0 + 600.0 / (1.0 + np.exp(2.0 * (np.linalg.norm(off, axis=2) - 5.0)))
    for angle, length in streaks:
        way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        along, aside = off @ way, off @ np.array([-way[1], way[0]])
        light += 190.0 * np.exp(-0.5 * (aside / 1.2) ** 2) * ((along > 0.0) & (along < length))
    return np.where(mask > 0, np.clip(light, 0, 255), 0).astype(np.uint8), mask


@pytest.mark.parametrize(
    ("streaks", "most"), [((), 0.1), (((20.0, 45.0), (110.0, 15.0)), 1.0), (((-40.0, 30.0),), 1.0)]
)
def test_glare_does_not_move_the_lamp(streaks, most):
    """Before, the centroid was 5 and 9 px off, 6° and 11° of the lamp; the stated error holds what is left."""
    photograph, mask = photographed(streaks)
    ball = find_ball(mask)
    highlight = find_highlight(photograph, ball)
    off = np.hypot(*(np.array(highlight.centre) - CENTRE))
    assert off < most and off < 4.0 * highlight.standard_error + 0.1
    true = ball.mirrored(CENTRE[None]).to_lamp[0]
    reading = read_lamp("lamp", highlight, ball)
    assert np.degrees(np.arccos(np.clip(reading.to_lamp @ true, -1.0, 1.0))) < 1.5
