"""Windows of the corner search: those are chosen with which photographs left out of the fit have the least residual."""

import cv2
import numpy as np
import pytest

from hagoromo.calibration.camera.board import OWN_WINDOWS, Corners
from hagoromo.calibration.camera.calibrate_camera import chosen_corners, residual

SIZE, COUNT = (600, 450), 10
LENS = np.array([[640.0, 0.0, 306.0], [0.0, 650.0, 221.0], [0.0, 0.0, 1.0]]), np.array([-0.2, 0.1, 0.0, 0.0, 0.0])
POINTS = np.array([(0.02 * k, 0.02 * row, 0.0) for row in range(5) for k in range(7)], np.float32)
POOR = ("3", "8")


def photographed(error, poor, seed):
    """Name → corners of ten photographs with these errors [px], the poor ones with theirs."""
    random, corners = np.random.default_rng(1), {}
    noise = np.random.default_rng(seed)
    for k in range(COUNT):
        turn, shift = random.normal(0.0, 0.35, 3), np.array([-0.06, -0.04, random.uniform(0.2, 0.3)])
        image = cv2.projectPoints(POINTS, turn, shift, *LENS)[0].reshape(-1, 2)
        own = poor if f"{k}" in POOR else error
        corners[f"{k}"] = Corners(POINTS, (image + noise.normal(0.0, own, image.shape)).astype(np.float32))
    return corners


def fit(corners):
    points, image = [one.points for one in corners], [one.image for one in corners]
    matrix, distortion = cv2.calibrateCamera(points, image, SIZE, np.eye(3), np.zeros(5))[1:3]
    return np.asarray(matrix, np.float64), np.asarray(distortion, np.float64)


def odd(corners):
    lens = fit(list(corners.values()))
    return tuple(name for name, one in corners.items() if residual(one, lens) > 0.4)


def rms(corners):
    lens = fit(list(corners.values()))
    return np.sqrt(np.mean([residual(one, lens) ** 2 for one in corners.values()]))


@pytest.mark.parametrize(
    ("own", "plain", "windows", "mixed"),
    [
        ((0.05, 0.05), (0.06, 0.06), OWN_WINDOWS, ()),
        ((0.05, 1.0), (0.1, 0.1), "11 px", ()),
        ((0.05, 0.6), (0.4, 0.1), OWN_WINDOWS, POOR),
    ],
)
def test_the_choice_is_never_behind_plain_windows(own, plain, windows, mixed):
    """Good photographs keep our windows; where two are blurred, all or these alone are sought as OpenCV does it."""
    found = {OWN_WINDOWS: photographed(*own, seed=2), "11 px": photographed(*plain, seed=3)}
    chosen = chosen_corners(found, fit, odd)
    assert chosen.windows.startswith(windows)
    for name in mixed:
        assert name in chosen.windows and chosen.corners[name] is found["11 px"][name]
    assert rms(chosen.corners) <= 1.02 * min(rms(one) for one in found.values())
    assert min(chosen.left_out.values()) <= min(chosen.left_out[name] for name in found)
