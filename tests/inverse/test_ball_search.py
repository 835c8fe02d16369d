"""Chrome balls are found in photographs without a mask, or refused; several of them are read together."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.calibration_report import LAMP, OUTLINE, ball_picture
from hagoromo.calibration.lamps.ball import find_ball
from hagoromo.calibration.lamps.ball_search import search_balls
from hagoromo.calibration.lamps.highlight import ellipse_centre
from hagoromo.files.png import read_png
from tests.data import DATA, real_data
from tests.inverse.simulated_mirror import (
    degrees_between,
    mask_of,
    mirror_photograph,
    seen_from_afar,
    seen_through,
    unit,
)

SHAPE = (223, 331)
LAMPS = unit(np.random.default_rng(0).normal(size=(5, 3)) * [1.0, 1.0, 0.3] + [0.0, 0.0, 1.2])
BALLS = [((60.3, 70.2), 33.0), ((250.1, 150.4), 24.5)]  # px
CAMERA = hg.Camera(331, 223, (450.0, 450.0), (165.0, 112.0))
NEAR = [np.array(place) for place in ((0.3, -0.5, 0.1), (-0.6, -0.2, 0.0), (0.1, 0.5, 0.2), (-0.3, 0.4, -0.1))]  # m


def with_streaks(photograph, balls, lamp):
    """Streaks of glare from the lamp's image on each ball, half as bright as white."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    light = photograph.astype(float)
    half = unit(np.add(lamp, (0.0, 0.0, 1.0)))
    for centre, radius in balls:
        at = np.array(centre) + radius * half[:2] * [1.0, -1.0]
        for angle in (0.4, 2.2, -1.9):
            way = np.array([np.cos(angle), np.sin(angle)])
            along, aside = (x - at[0]) * way[0] + (y - at[1]) * way[1], (x - at[0]) * way[1] - (y - at[1]) * way[0]
            on = (along > 0.0) & (along < 0.45 * radius) & (np.hypot(x - centre[0], y - centre[1]) < radius)
            light += 150.0 * np.exp(-0.5 * (aside / 0.8) ** 2) * on
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def two():
    """Photographs of two balls under far lamps, and the balls."""
    balls = [seen_from_afar(SHAPE, *ball) for ball in BALLS]
    return {f"{k}": mirror_photograph(balls, lamp, k, 0.05) for k, lamp in enumerate(LAMPS)}, balls


def test_two_balls_are_found_and_their_lamps_averaged(two):
    """Outlines to a third of a pixel, lamps to 0.5°, which the stated errors hold; a picture shows both."""
    photographs, _ = two
    found = hg.calibrate_lamps(photographs, "auto")
    assert len(found.balls) == 2
    for ball, (centre, radius) in zip(found.balls, BALLS, strict=True):
        np.testing.assert_allclose((*ball.centre, ball.radius), (*centre, radius), atol=0.33)
        assert ball.source == "photographs"
    off = degrees_between([reading.to_lamp for reading in found.readings], LAMPS)
    assert off.max() < 0.5 and (off < 3 * np.array([reading.standard_error_deg for reading in found.readings])).all()
    picture = ball_picture(photographs["0"], found)
    for colour in (OUTLINE, LAMP):
        assert (np.abs(picture.astype(int) - colour).max(axis=2) < 40).sum() > 20


@pytest.mark.nightly
def test_two_balls_with_glare_agree_within_a_degree():
    """Streaks of half of white from every lamp: the issue has 2.5° between two balls by all light above half of the
    peak, and 0.6° by the blurred peak. Smaller balls than 40 px have no room for the blur.
    """
    places = [((78.3, 90.2), 62.0), ((240.1, 130.4), 48.5)]
    balls = [seen_from_afar(SHAPE, *place) for place in places]
    shown = {f"{k}": with_streaks(mirror_photograph(balls, lamp, k, 0.1), places, lamp) for k, lamp in enumerate(LAMPS)}
    each = [[one.to_lamp for one in hg.lamps_from_ball(shown, mask_of(ball))[1]] for ball in balls]
    assert np.mean(degrees_between(*each)) < 1.0 and np.max(degrees_between(*each)) < 2.0
    assert np.max(degrees_between(each[0], LAMPS)) < 1.0


@pytest.mark.nightly
def test_near_lamps_of_balls_that_were_found_are_placed():
    balls = [seen_through(CAMERA, np.array(place), 0.08) for place in ((-0.22, 0.02, 1.0), (0.24, -0.03, 1.1))]
    photographs = {f"{k}": mirror_photograph(balls, lamp, k, 0.06, position=True) for k, lamp in enumerate(NEAR)}
    found = hg.calibrate_lamps(photographs, "auto", radius=0.08, camera=CAMERA)
    masks = [mask_of(ball) for ball in balls]
    for lamp, place in zip(found.lamps, NEAR, strict=True):
        assert lamp.position is not None and np.linalg.norm(lamp.position - place) < 0.03
    with pytest.raises(hg.InputError, match=r"the balls disagree about the lamps by .*give their radius \(--radius\)"):
        hg.calibrate_lamps(dict(list(photographs.items())[:2]), masks, camera=CAMERA)


def test_what_is_no_mirror_ball_is_not_taken_for_one(two):
    """A matte ball, a disc with a bright spot that stays, and too few photographs."""
    y, x = np.mgrid[:160, :200] + 0.5
    u, v = (x - 90.0) / 50.0, (y - 80.0) / 50.0
    towards = np.sqrt(np.maximum(1.0 - u**2 - v**2, 0.0))
    on = u**2 + v**2 < 1.0
    matte, printed = {}, {}
    for k, (right, up, ahead) in enumerate(LAMPS):
        shading = np.maximum(u * right - v * up + towards * ahead, 0.0) + 0.3 * (towards > 0.999)
        matte[f"{k}"] = np.where(on, 200.0 * shading.clip(0, 1), 10.0).astype(np.uint8)
        spot = np.hypot(x - 100.0, y - 70.0) < 3.0
        printed[f"{k}"] = np.where(spot, 255.0, np.where(on, 30.0, 10.0) * ahead).astype(np.uint8)
    for photographs in (matte, printed):
        with pytest.raises(hg.InputError, match=r"no chrome ball stands out .*paint a mask"):
            search_balls(photographs)
    with pytest.raises(hg.InputError, match="by 4 lamps or more, and 3 are given"):
        search_balls(dict(list(two[0].items())[:3]))


@real_data("uw_psm")
def test_a_real_ball_whose_outline_is_lost_in_the_dark_is_refused_and_told():
    folder = DATA / "uw_psm" / "chrome"
    photographs = {f"{k}": read_png(folder / f"chrome.{k}.png") for k in range(0, 12, 3)}
    with pytest.raises(hg.InputError, match="shows the lamps, but its outline does not show all around") as refused:
        search_balls(photographs)
    ball = find_ball(read_png(folder / "chrome.mask.png"))
    x, y = (float(word.strip("(),")) for word in str(refused.value).split(" at ")[1].split()[:2])
    assert np.hypot(x - ball.centre[0], y - ball.centre[1]) < 0.1 * ball.radius


def test_a_lamp_at_the_edge_of_its_picture_is_located():
    """A bright spot whose window reached beyond the picture was a traceback."""
    y, x = np.mgrid[:13, :15] + 0.5
    light = 1.0 / (1.0 + np.exp(4.0 * (np.hypot(x - 10.7, y - 9.2) - 2.6)))
    found = ellipse_centre(np.minimum(1.3 * light, 1.0), light > 0.5)
    assert found is not None and np.hypot(found.x - 10.7, found.y - 9.2) < 0.1
