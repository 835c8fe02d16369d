"""Photographs that moved between lamps, or are blurred, are named with by how much; others are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from hagoromo.camera.camera import Camera
from hagoromo.measurement.stillness import Stillness, stillness
from hagoromo.photograph.photograph import Photograph
from studies.uw_psm import read_lamps, read_object
from tests.data import DATA, real_data

UW_PSM = DATA / "uw_psm"
CAMERA = Camera(211, 163, (300.0, 300.0), (105.5, 81.5))
BY = (2.3, -1.4)  # px (x, y)


def photograph(light: np.ndarray, seed: int) -> Photograph:
    """1 % noise."""
    noise = np.random.default_rng(seed).normal(0.0, 0.01, (*light.shape, 3))
    values = (light[..., None] + noise).astype(np.float32)
    return Photograph(values, np.full_like(values, 1e-4), np.ones(light.shape, np.bool_), CAMERA, (), f"{seed}")


def relief(seed: int) -> np.ndarray:
    """A bumpy, spotted plane under a lamp that goes round it, its own shadows among them."""
    random = np.random.default_rng(1)
    height = 25.0 * gaussian_filter(random.normal(size=(163, 211)), 4)
    spots = 0.4 + 0.3 * (gaussian_filter(random.normal(size=height.shape), 2) > 0.0)
    down, across = np.gradient(height)
    angle = 2 * np.pi * seed / 7
    facing = (1.0 - across * np.cos(angle) - down * np.sin(angle)) / np.sqrt(2.0 * (1.0 + across**2 + down**2))
    return spots * np.maximum(facing, 0.0)


def moved_by(one: Photograph, x: float, y: float) -> Photograph:
    return replace(one, values=shift(one.values, (y, x, 0), order=3, mode="nearest"))


def found_in(photographs: list[Photograph]) -> Stillness:
    found = stillness(photographs)
    assert found is not None
    return found


def blurred(one: Photograph, width: float) -> Photograph:
    return replace(one, values=gaussian_filter(one.values, (width, width, 0.0)))


@pytest.fixture(scope="module")
def still() -> list[Photograph]:
    return [photograph(relief(k), k) for k in range(7)]


def test_photographs_that_stood_still_are_not_named(still):
    found = found_in(still)
    assert found.shifts == found.blurs == {} and found.shift_trials.enough and found.blur_trials.enough


@pytest.mark.parametrize("by", [(0.5, 0.3), (2.3, -1.4), (11.0, 7.0), (-40.0, 25.0)])
def test_one_that_moved_is_named_by_how_much(still, by):
    """To 0.1 px; it takes none of the others with it."""
    found = found_in([*still[:4], moved_by(still[4], *by), *still[5:]])
    assert list(found.shifts) == ["4"] and np.abs(np.array(found.shifts["4"]) - by).max() < 0.1
    assert found.blurs == {}


@pytest.mark.parametrize("width", [2.0, 4.0])
def test_one_that_is_blurred_is_named_by_how_much(still, width):
    found = found_in([*still[:2], blurred(still[2], width), *still[3:]])
    assert list(found.blurs) == ["2"] and abs(found.blurs["2"] - width) <= 0.5 and found.shifts == {}


def test_one_that_moved_and_is_blurred_is_both(still):
    found = found_in([*still[:5], blurred(moved_by(still[5], *BY), 2.0), still[6]])
    assert list(found.shifts) == list(found.blurs) == ["5"] and abs(found.blurs["5"] - 2.0) <= 0.5


def test_two_that_moved_are_both_named(still):
    found = found_in([moved_by(still[0], *BY), *still[1:3], moved_by(still[3], -1.0, 0.8), *still[4:]])
    assert list(found.shifts) == ["0", "3"]


def test_photographs_of_nothing_and_of_several_views_say_nothing():
    even = found_in([photograph(np.full((163, 211), 0.5), k) for k in range(5)])
    assert even.shifts == even.blurs == {} and not even.shift_trials.enough and not even.blur_trials.enough
    one = photograph(relief(0), 0)
    turned = replace(one, camera=CAMERA.look_at((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert stillness([one, turned, moved_by(one, *BY)]) is None
    assert stillness([one, moved_by(one, *BY)]) is None
    black = replace(one, values=np.zeros_like(one.values))
    assert stillness([one, black, black, moved_by(one, *BY)]) is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("shape", [(60, 70), (6, 5), (1, 1), (1, 90)], ids=str)
@pytest.mark.parametrize("even", [True, False], ids=["even", "noise"])
def test_pictures_with_nothing_to_compare_say_nothing(shape, even):
    random, camera = np.random.default_rng(2), Camera(shape[1], shape[0], (300.0, 300.0), (0.5, 0.5))
    shots = []
    for number in range(7):
        values = (np.full((*shape, 3), 0.5) if even else random.random((*shape, 3))).astype(np.float32)
        there = np.ones(shape, np.bool_)
        shots.append(Photograph(values, np.full_like(values, 1e-4), there, camera, (), f"{number}"))
    found = found_in(shots)
    assert found.shifts == found.blurs == {} and not found.shift_trials.enough and not found.blur_trials.enough


@real_data("uw_psm")
@pytest.mark.parametrize("name", ["gray", "cat", "rock"])
def test_real_photographs_under_twelve_lamps_stand_still_until_one_is_moved(name):
    """To half a pixel: some of these moved by 0.4 px themselves, as it seems."""
    shots = list(read_object(UW_PSM, name, read_lamps(UW_PSM)[1]).photographs)
    right = found_in(shots)
    assert right.shifts == right.blurs == {}
    found = found_in([*shots[:5], moved_by(shots[5], *BY), *shots[6:]]).shifts
    assert list(found) == [shots[5].name] and np.abs(np.array(found[shots[5].name]) - BY).max() < 0.5
    found = found_in([*shots[:5], blurred(shots[5], 2.0), *shots[6:]])
    assert list(found.blurs) == [shots[5].name] and found.shifts == {}
