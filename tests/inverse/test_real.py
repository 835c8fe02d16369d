"""Real photographs (uw_psm, beside the checkout): lamps off a chrome ball, normals of a ball; skipped where absent."""

import numpy as np

from hagoromo.measurement.normals.normals import least_squares_lambert, solve_normals
from studies.uw_psm import read_lamps, read_object, sphere_normals
from tests.data import DATA, real_data

UW_PSM = DATA / "uw_psm"
pytestmark = real_data("uw_psm")


def test_lamps_agree_with_another_reading_of_the_same_ball():
    """The laboratory that took the photographs read the same ball; 1° is a third of the lamp's picture on it."""
    rows = np.loadtxt(UW_PSM / "lights_from_chrome_ball_by_lab.txt")
    theirs = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    ours = np.array([lamp.to_lamp for lamp in read_lamps(UW_PSM)[1]])
    assert np.degrees(np.arccos(np.clip((ours * theirs).sum(axis=1), -1, 1))).max() < 1.0


def test_normals_of_a_ball_are_nearer_than_least_squares():
    """A sphere's normals are known: gloss, shadow and uneven lamps must be worth something over plain least squares.

    Within 95 % of the radius (where plain least squares is 5.1° off with the best of the set's readings) 3.5° is the
    goal set before this was built.
    """
    found = solve_normals(read_object(UW_PSM, "gray", read_lamps(UW_PSM)[1]))
    truth = sphere_normals(UW_PSM)[found.views.rows, found.views.columns]

    def errors(normals):
        return np.degrees(np.arccos(np.clip((normals * truth).sum(axis=1), -1, 1)))

    plain, ours = errors(least_squares_lambert(found.views)[0]), errors(found.fit.normals)
    assert ours.mean() < plain.mean()
    assert ours[np.hypot(truth[:, 0], truth[:, 1]) < 0.95].mean() < 3.5
