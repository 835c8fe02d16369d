"""Near lamps from mirror balls: places are found within their own stated errors; far ones are told to be far."""

from functools import cache

import numpy as np
import pytest

from hagoromo.calibration.lamps import check_spread, lamps_from_ball, locate_lamp
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from tests.inverse.simulated_mirror import degrees_between, mask_of, mirror_photograph, seen_through, unit

CAMERA = Camera(409, 283, (560.0, 552.0), (201.0, 144.0), (-0.05, 0.01, 0.0, 0.0, 0.0)).look_at(
    (0.2, -1.1, 0.3), (0.0, 0.0, 0.0)
)
RADIUS = 0.07  # m: about 35 px
PLACES = [np.array([-0.25, 0.02, 0.05]), np.array([0.26, -0.03, -0.04])]
LAMP = 0.07  # m: radius of a lamp
NEAR = [np.array([0.3, -0.8, 0.7]), np.array([-0.7, -0.9, 0.2])]  # m
FAR = unit([0.2, -1.0, 0.6])


@cache
def balls():
    """Both, as the camera sees them."""
    return [seen_through(CAMERA, place, RADIUS) for place in PLACES]


def rays(photographs_of_balls):
    """Per lamp, the readings of all balls; photographs of each ball: name → numbers."""
    found = [
        lamps_from_ball(photographs, mask_of(ball), CAMERA)[1]
        for photographs, ball in zip(photographs_of_balls, balls(), strict=True)
    ]
    return list(zip(*found, strict=True))


@pytest.fixture(scope="module")
def seen():
    """Per lamp, near ones and a far one, the readings of both balls in one view."""
    pictures = {str(k): mirror_photograph(balls(), lamp, k, LAMP, position=True) for k, lamp in enumerate(NEAR)}
    pictures["far"] = mirror_photograph(balls(), FAR, 9, 0.04)
    return rays([pictures, pictures])


@pytest.mark.nightly
def test_near_lamps_are_placed_from_two_balls_in_one_view_within_their_errors(seen):
    """A lamp is 1.1 m away and the balls stand half a metre apart: 0.3° is 13 mm along the ray, to 2 cm of one aslant.

    Mahalanobis' square has three degrees of freedom: 16.3 is passed once in a thousand lamps.
    """
    *near, far = (locate_lamp(readings, RADIUS) for readings in seen)
    for lamp, truth in zip(near, NEAR, strict=True):
        assert lamp.position is not None and lamp.covariance is not None
        off = lamp.position - truth
        assert np.linalg.norm(off) < 0.02
        assert off @ np.linalg.solve(lamp.covariance, off) < 16.3
        assert np.sqrt(np.trace(lamp.covariance)) < 0.05
    assert far.position is None and abs(far.inverse_distance) < 3 * far.inverse_distance_error
    off = degrees_between(far.to_lamp, FAR)
    assert off < 0.3 and off < 3 * far.standard_error_deg
    assert far.record().keys() >= {"to_lamp", "name", "intensity"} and "position" in near[0].record()


def test_a_near_lamp_is_placed_from_a_ball_that_was_moved():
    """As above, from two photographs with one ball each."""
    pictures = [{"a": mirror_photograph([ball], NEAR[0], k, LAMP, position=True)} for k, ball in enumerate(balls())]
    lamp = locate_lamp(rays(pictures)[0], RADIUS)
    assert lamp.position is not None and np.linalg.norm(lamp.position - NEAR[0]) < 0.02


def test_balls_that_show_two_lamps_or_lack_a_camera_are_refused(seen):
    readings = seen[0][0], seen[1][1]
    with pytest.raises(InputError, match="miss each other by"):
        locate_lamp(readings, RADIUS)
    with pytest.raises(InputError, match="two balls"):
        locate_lamp(readings[:1], RADIUS)
    with pytest.raises(InputError, match="above 0"):
        locate_lamp(readings, -1.0)


def test_the_spread_of_lamps_is_stated_and_too_little_of_it_refused():
    """Three lamps along the axes have condition number 1; lamps of a ring of half angle t have √2 / tan t (t < 55°)."""
    assert check_spread(np.eye(3)).condition == pytest.approx(1.0)
    turn, tilt = np.arange(7) * 2 * np.pi / 7, np.radians(20)
    ring = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.full(7, np.cos(tilt))], axis=1)
    spread = check_spread(3.0 * ring)
    assert spread.lamps == 7 and spread.condition == pytest.approx(np.sqrt(2) / np.tan(tilt))
    assert spread.widest_deg == pytest.approx(degrees_between(ring[0], ring[3]))
    for lamps, said in [(ring[:2], "2 lamps"), (ring * [1, 0, 1], "condition number 1e"), (ring[[0, 0, 1]], "plane")]:
        with pytest.raises(InputError, match=said):
            check_spread(lamps)
