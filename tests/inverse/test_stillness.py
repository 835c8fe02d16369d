"""Photographs that moved between lamps are told, by how much; those that stood still are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from hagoromo.camera.camera import Camera
from hagoromo.measurement.photograph_checks import moved
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


def test_one_that_moved_is_told_by_how_much():
    """To 0.3 px, what lamps alone make of real photographs that stand still."""
    still = [photograph(relief(k), k) for k in range(7)]
    assert moved(still) == {}
    found = moved([*still[:4], moved_by(still[4], *BY), *still[5:]])
    assert list(found) == ["4"] and np.abs(np.array(found["4"]) - BY).max() < 0.3


def test_photographs_of_nothing_and_of_several_views_tell_nothing():
    assert moved([photograph(np.full((163, 211), 0.5), k) for k in range(5)]) == {}
    one = photograph(relief(0), 0)
    turned = replace(one, camera=CAMERA.look_at((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    assert moved([one, turned, moved_by(one, *BY)]) == {}
    assert moved([one, moved_by(one, *BY)]) == {}


@real_data("uw_psm")
@pytest.mark.parametrize("name", ["gray", "cat"])
def test_real_photographs_under_twelve_lamps_stand_still_until_one_is_moved(name):
    shots = list(read_object(UW_PSM, name, read_lamps(UW_PSM)[1]).photographs)
    assert moved(shots) == {}
    found = moved([*shots[:5], moved_by(shots[5], *BY), *shots[6:]])
    assert list(found) == [shots[5].name] and np.abs(np.array(found[shots[5].name]) - BY).max() < 0.3
