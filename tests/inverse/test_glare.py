"""A lamp's image on a mirror ball with streaks of glare: located by its core, not by the centroid of all the light."""

import numpy as np
import pytest

from hagoromo.calibration.lamps.ball import find_ball
from hagoromo.calibration.lamps.highlight import find_highlight, where_streaks_meet
from hagoromo.calibration.lamps.reading import read_lamp

BALL, RADIUS, CENTRE = (120.0, 110.0), 90.0, np.array([150.4, 88.7])


def photographed(streaks, radius=5.0):
    """8-bit photograph of the ball and its mask; streaks: (angle [°], length [px]) of rays of light from the lamp.

    radius: of the lamp's image [px].
    """
    y, x = np.mgrid[:220, :240] + 0.5
    mask = np.where(np.hypot(x - BALL[0], y - BALL[1]) < RADIUS, 255, 0).astype(np.uint8)
    off = np.stack([x - CENTRE[0], y - CENTRE[1]], axis=2)
    light = 15.0 + 600.0 / (1.0 + np.exp(2.0 * (np.linalg.norm(off, axis=2) - radius)))
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


@pytest.mark.parametrize("turn", [0.0, 25.0, 70.0])
def test_streaks_wider_than_the_lamp_meet_in_it(turn):
    """Two overlap and are whiter than white as far as 10 px from the lamp, whose image is 2 px wide: 3 px, as all three
    lie within 15° of a line; the peak of the blurred light is 5.3 px off.
    """
    streaks = [(turn + angle, length) for angle, length in ((10.0, 34.0), (32.0, 30.0), (205.0, 18.0))]
    photograph, mask = photographed(streaks, radius=1.0)
    highlight = find_highlight(photograph, find_ball(mask))
    off = np.hypot(*(np.array(highlight.centre) - CENTRE))
    assert off < 3.0 and off < 4.0 * highlight.standard_error


def test_streaks_along_one_line_meet_nowhere():
    """Of one streak to both sides: the edges tell no place along it."""
    y, x = np.mgrid[:61, :81] + 0.5
    light = np.exp(-0.5 * ((y - 30.2) / 1.2) ** 2 - np.abs(x - 40.0) / 12.0)
    assert where_streaks_meet(light, light > 0.5) is None
