"""A black level that was left in all readings: the odds are those of the integrals, and intervals of curves hold it."""

import numpy as np
import pytest

from hagoromo.calibration.response import calibrate_response
from hagoromo.calibration.response.calibrate_response import overlap_matrix, solve_response
from hagoromo.calibration.response.doubtful_readings import REPORTED, black_level
from hagoromo.calibration.response.positive_curve import PositiveCurve
from hagoromo.calibration.response.reading_transfer import TRANSFER_PRIOR, ReadingTransfer
from hagoromo.least_squares.fit_status import FitStatus, Status
from tests.inverse.test_response_faults import TRUE, WAVELENGTHS, coverage

STATUS = FitStatus(Status.CONVERGED, 1)
STEPS = np.linspace(-2.0, 2.0, 400_001)


def curve(offset, error):
    nothing = np.zeros(1)
    transfer = ReadingTransfer(1.0, offset, np.diag([1e-4, error**2]), np.zeros((1, 2)))
    return PositiveCurve(nothing, nothing, np.zeros((1, 2)), 50.0, 0.01, STATUS, transfer=transfer)


def integrated(offsets, errors, units):
    """∫ Π N(b | d u, σ²) N(d | 0, τ²) dd over Π N(b | 0, σ²)."""
    spread = TRANSFER_PRIOR[1]
    log = -0.5 * (STEPS / spread) ** 2 - np.log(spread * np.sqrt(2.0 * np.pi))
    for b, error, unit in zip(offsets, errors, units, strict=True):
        log = log - 0.5 * ((b - STEPS * unit) / error) ** 2 + 0.5 * (b / error) ** 2
    return float(np.exp(log).sum() * (STEPS[1] - STEPS[0]))


@pytest.mark.parametrize("offsets", [(0.05, 0.03, 0.06), (0.01, -0.01, 0.0), (0.02, 0.04, 0.0)])
def test_odds_are_those_of_integrals(offsets):
    """Of three channels, of equal and of different mean readings."""
    errors, means = (0.02, 0.03, 0.015), np.array([2.0, 1.0, 0.7])
    found = black_level([curve(*pair) for pair in zip(offsets, errors, strict=True)], means)
    odds = 0.5 * sum(integrated(offsets, errors, units) for units in (means.mean() / means, np.ones(3)))
    assert found is not None and found.probability == pytest.approx(odds / (1.0 + odds), rel=1e-6)
    assert (found.remark() is None) == (found.probability < REPORTED)


def test_without_a_transfer_there_is_none():
    alone = PositiveCurve(np.zeros(1), np.zeros(1), np.zeros((1, 2)), 50.0, 0.01, STATUS)
    assert black_level([alone], np.ones(1)) is None


def test_intervals_hold_a_black_level_under_lights_of_one_mean(monkeypatch):
    """The same is added to all readings. No channel tells it for certain; the three together do."""
    lights = np.exp(-0.5 * ((WAVELENGTHS - np.linspace(380.0, 740.0, 80)[:, None]) / 40.0) ** 2) + 0.1
    matrix = lights / lights.mean(axis=1, keepdims=True) @ overlap_matrix(WAVELENGTHS)
    exact = TRUE @ matrix.T
    noisy = exact * (1.0 + 0.01 * np.random.default_rng(1).standard_normal(exact.shape))
    spoilt = noisy + 0.05 * noisy.mean(axis=1, keepdims=True)
    clean, black = (solve_response(WAVELENGTHS, matrix, dict(zip("RGB", of, strict=True))) for of in (noisy, spoilt))
    assert clean.black is not None and clean.black.probability < 0.5 and not clean.remarks()
    assert black.black is not None and black.black.probability > REPORTED
    assert not any(transfer is None or transfer.certain for transfer in black.transfers)
    assert ["black level" in line for line in black.remarks()] == [True]
    assert black.record()["black_level"]["probability"] == black.black.probability
    monkeypatch.setattr(calibrate_response, "black_level", lambda *_: None)
    without = solve_response(WAVELENGTHS, matrix, dict(zip("RGB", spoilt, strict=True)))
    assert coverage(clean) > 0.95 and coverage(black) > 0.95 > coverage(without)
