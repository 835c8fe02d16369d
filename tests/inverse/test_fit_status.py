"""Fits that are given too few steps on purpose: each says so, in its result or by an error, and in its report."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.app.calibration_report import object_summary
from hagoromo.calibration.lamps import highlight, locate_lamp, place, reference
from hagoromo.calibration.lamps.ball import fit_ball
from hagoromo.calibration.lamps.reference import robust_regression
from hagoromo.calibration.lamps.uncalibrated import bas_relief, calibrate_from_object, low_rank, self_calibrate
from hagoromo.calibration.response import calibrate_response as response
from hagoromo.calibration.response import curve_evidence
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import Status
from hagoromo.measurement.gloss import gloss_spread, pixel_gloss
from hagoromo.measurement.gloss.gloss_map import with_gloss
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material import albedo_variation, interval, material_fit
from hagoromo.measurement.normals import photometric_rounds, pixel_fit
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.normals.normals import solve_normals
from hagoromo.measurement.photometric import gloss_posterior
from hagoromo.measurement.robust_fit import minimise
from hagoromo.measurement.surface import shape as near_shape
from hagoromo.reflectance.material.materials_file import read_materials, write_materials
from hagoromo.reflectance.spectra import spectrum_estimate
from studies.near_rig import SURFACE_DISTANCE, Finish, ring_rig, sphere
from studies.near_rig import simulate as near_capture
from tests.inverse.simulated_ball import BallMaterial, simulate
from tests.inverse.simulated_mirror import mirror_photograph
from tests.inverse.test_gloss_map import BETA, BODY, GAMMA, N, all_of, lamps
from tests.inverse.test_near_lamps import NEAR, RADIUS, balls, rays
from tests.inverse.test_self_calibration import LAMPS, photographs, shaped

SIZE = 21  # px of balls: half of those whose gloss is mapped
ALL = np.zeros((SIZE, SIZE), int)


def ball(beta, gamma, seed):
    return simulate([BallMaterial(BODY, beta, gamma, N)], seed, SIZE, angles=lamps(24))


@pytest.fixture(scope="module")
def glossy():
    return ball(np.full((SIZE, SIZE), 0.4), np.full((SIZE, SIZE), 0.2), 7)


@pytest.fixture(scope="module")
def worn():
    return ball(BETA[::2, ::2], GAMMA[::2, ::2], 1)


def test_a_material_s_fit_that_does_not_come_to_rest_is_an_error(glossy, monkeypatch):
    assert (measure_known_shape(glossy, labels=ALL, n=N).materials[0].convergence or {})["status"] == "converged"
    monkeypatch.setattr(material_fit, "MATERIAL_FIT_ROUNDS", 1)
    with pytest.raises(InputError, match=r"material 1: the fit still moves by .* after 1 rounds: mask"):
        measure_known_shape(glossy, labels=ALL, n=N)


def test_a_profile_that_does_not_converge_is_remarked_and_read_back(glossy, monkeypatch, tmp_path):
    monkeypatch.setattr(interval, "minimise", lambda objective, theta, free: minimise(objective, theta, free, 0))
    material = measure_known_shape(glossy, labels=ALL).materials[0]
    assert any("did not converge at" in remark for remark in material.remarks)
    again = read_materials(write_materials([material], tmp_path / "materials.json"))[0]
    assert again.convergence == material.convergence and again.remarks == material.remarks


def test_a_texture_whose_fit_fails_is_remarked(monkeypatch):
    rows, columns = np.mgrid[:SIZE, :SIZE]
    capture = simulate([BallMaterial(BODY, 0.4, 0.2, N)], 3, SIZE, angles=lamps(6))
    paint = (1.0 + 0.3 * np.sin(rows) * np.cos(columns))[..., None]
    painted = [replace(p, values=(p.values * paint).astype(np.float32)) for p in capture.photographs]
    capture = replace(capture, photographs=tuple(painted))
    monkeypatch.setattr(albedo_variation, "ALBEDO_FIT_ROUNDS", 1)
    material = measure_known_shape(capture, labels=ALL, n=N).materials[0]
    assert (material.texture or {})["per_pixel"] is False
    assert any("one colour was fitted to all: the fit of each pixel's body still moves" in r for r in material.remarks)


@pytest.mark.nightly
def test_pixels_whose_gloss_does_not_converge_are_counted(worn, monkeypatch):
    material = measure_known_shape(worn, labels=ALL, n=N).materials[0]
    monkeypatch.setattr(pixel_gloss, "PIXEL_GLOSS_STEPS", 0)
    monkeypatch.setattr(gloss_posterior, "GLOSS_LAW_STEPS", 1)
    monkeypatch.setattr(gloss_spread, "SHARED_GLOSS_STEPS", 1)
    start = np.log([0.4 * ((N - 1) / (N + 1)) ** 2, 0.2])
    found = gloss_spread.gloss_spread(all_of(worn), start, N, is_given=True)
    assert found is not None and found.converged < 0.5
    assert [one.status for one in found.statuses] == [Status.OUT_OF_STEPS] * 2
    remarked = with_gloss(replace(material, remarks=()), found)
    assert sum("the fit of the gloss did not converge" in remark for remark in remarked.remarks) == 2
    assert any("of the pixels did not converge" in remark for remark in remarked.remarks)
    assert (remarked.gloss or {})["convergence"]["pixels"] == found.converged


def test_normals_and_their_lamps_that_do_not_converge_are_remarked(glossy, monkeypatch):
    monkeypatch.setattr(pixel_fit, "PIXEL_FIT_STEPS", 1)
    monkeypatch.setattr(photometric_rounds, "PHOTOMETRIC_FIT_STEPS", 1)
    monkeypatch.setattr(photometric_rounds, "PHOTOMETRIC_FIT_ROUNDS", 1)
    found = solve_normals(glossy, ALL)
    assert found.fit.pixel_status is not None and (found.fit.pixel_status == Status.OUT_OF_STEPS).mean() > 0.5
    material = measurement_of(glossy, found).materials[0]
    ended = material.convergence or {}
    assert ended["status"] == "out of steps" and ended["steps"] == 1
    assert any("the fit of gloss and lamps did not converge after 1 steps" in remark for remark in material.remarks)
    assert any("the normal of" in remark and "did not converge" in remark for remark in material.remarks)


@pytest.mark.nightly
def test_most_normals_converge_within_their_steps(glossy):
    """Nine in ten: pixels at the limb, which few lamps light, may be left."""
    status = solve_normals(glossy, ALL).fit.pixel_status
    assert status is not None and (status == Status.CONVERGED).mean() > 0.9


def test_a_surface_under_near_lamps_that_still_moves_is_remarked(monkeypatch):
    monkeypatch.setattr(near_shape, "SHAPE_ROUNDS", 1)
    capture, _ = near_capture(ring_rig(31, 29, 5), sphere, Finish(0.2), bits=10)
    found = near_shape.solve_shape(replace(capture, points=None, normals=None), SURFACE_DISTANCE)
    assert found.status.status == Status.OUT_OF_STEPS and found.rounds == 1
    remarks = measurement_of(capture, found.normal_map).materials[0].remarks
    assert any("the surface under near lamps did not converge after 1 steps" in remark for remark in remarks)


@pytest.mark.nightly
def test_a_near_lamp_that_does_not_converge_is_an_error(monkeypatch):
    pictures = [{"a": mirror_photograph([one], NEAR[0], k, 0.07, position=True)} for k, one in enumerate(balls())]
    readings = rays(pictures)[0]
    assert locate_lamp(readings, RADIUS).position is not None
    monkeypatch.setattr(place, "ASTRAY", np.inf)  # the rays of an early step miss each other
    monkeypatch.setattr(place, "LAMP_PLACE_STEPS", 1)
    with pytest.raises(InputError, match="the fit of a did not converge after 1 steps"):
        locate_lamp(readings, RADIUS)


def test_reweighting_that_still_moves_says_so(monkeypatch):
    random = np.random.default_rng(1)
    design = random.random((500, 3))
    values = design @ [1.0, 2.0, 3.0] + 0.1 * random.standard_normal(500)
    values[::5] += 3.0
    tiles = np.arange(500) // 10
    assert robust_regression(design, values, tiles).status.converged
    monkeypatch.setattr(reference, "REGRESSION_REWEIGHTINGS", 2)
    assert robust_regression(design, values, tiles).status.status == Status.OUT_OF_STEPS


@pytest.mark.nightly
def test_lamps_from_an_object_say_which_fits_did_not_converge(monkeypatch):
    mask, normal, albedo = shaped("ball")
    shown = photographs(mask, normal, albedo, LAMPS, gloss=0.3)
    for module, name in (
        (low_rank, "LOW_RANK_STEPS"),
        (bas_relief, "INTEGRABILITY_REWEIGHTINGS"),
        (bas_relief, "BAS_RELIEF_STEPS"),
        (calibrate_from_object, "JOINT_SURFACE_STEPS"),
        (calibrate_from_object, "JOINT_SURFACE_ROUNDS"),
    ):
        monkeypatch.setattr(module, name, 1)
    found = calibrate_from_object.refined_lamps(shown, mask, None, self_calibrate(shown, mask))
    fits = ("lamps and pixels of low rank", "integrability", "the bas-relief", "the joint surface")
    assert {name: one.converged for name, one in found.statuses.items()} == dict.fromkeys(fits, False)
    assert found.record()["object"]["convergence"]["the joint surface"]["status"] == "out of steps"
    assert sum("did not converge" in text for text in object_summary(found)) == len(fits)


def test_a_response_whose_smoothness_is_not_settled_says_so(monkeypatch):
    wavelengths = np.arange(400.0, 701.0, 20.0)
    matrix = np.random.default_rng(0).random((20, len(wavelengths)))
    readings = {"R": matrix @ np.exp(-0.5 * ((wavelengths - 550.0) / 40.0) ** 2)}
    assert not response.solve_response(wavelengths, matrix, readings).remarks()
    monkeypatch.setattr(curve_evidence, "EVIDENCE_STEPS", 5)
    found = response.solve_response(wavelengths, matrix, readings)
    assert found.statuses[0].status == Status.OUT_OF_STEPS
    assert "the fit of channel R did not converge" in found.remarks()[0]


def test_fits_by_scipy_that_run_out_of_steps_are_errors_or_give_nothing(monkeypatch):
    from scipy import optimize

    exact = optimize.least_squares
    monkeypatch.setattr(optimize, "least_squares", lambda *args, **more: exact(*args, **(more | {"max_nfev": 1})))
    turn = np.linspace(0.0, 6.28, 60)
    edge = np.stack([50.0 + 20.0 * np.cos(turn) * np.where(turn > 3, 1.2, 1.0), 40.0 + 20.0 * np.sin(turn)], axis=1)
    with pytest.raises(InputError, match="the fit of the ball did not converge"):
        fit_ball(edge, None, 0.3)
    y, x = np.mgrid[:31, :37]
    blob = np.minimum(3.0 * np.exp(-(((x - 18.3) / 5.0) ** 2) - ((y - 15.2) / 4.0) ** 2), 1.0)
    assert highlight.ellipse_centre(blob, blob >= 1.0) is None


def test_a_spectrum_within_bounds_that_does_not_converge_is_an_error(monkeypatch):
    random = np.random.default_rng(2)
    root, mean = random.standard_normal((31, 31)), random.standard_normal(31)
    covariance = root @ root.T + np.eye(31)
    assert spectrum_estimate._within(mean, covariance, 1.0).max() <= 1.0
    monkeypatch.setattr(spectrum_estimate, "BOUNDED_SPECTRUM_STEPS", 1)
    with pytest.raises(InputError, match="the fit of a spectrum within its bounds did not converge"):
        spectrum_estimate._within(mean, covariance, 1.0)
