"""Measurement: what it finds, what it refuses, and what it says where the photographs do not tell."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hagoromo.camera.response import Response, camera_response, camera_white
from hagoromo.camera.sensor import Sensor, develop_raw, expose_raw, native_channels
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.png import read_png
from hagoromo.files.record import read_json, write_json
from hagoromo.least_squares.loss import TUKEY
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.segment import segment
from hagoromo.measurement.observations import Pixels, known_shape, observe
from hagoromo.measurement.parameters import pack_theta
from hagoromo.measurement.robust_fit import Objective
from hagoromo.measurement.sight import sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.materials_file import read_materials, write_materials
from tests.inverse.simulated_ball import LAMPS, BallMaterial, simulate

PARAMETERS = ("alpha", "beta", "gamma", "n")
OF_THE_INTERFACE = ("beta", "gamma", "n", "nu", "interface_colour")
RED = BallMaterial((0.20, 0.15, 0.10), 0.5, 0.15, 1.5)
BLUE = BallMaterial((0.06, 0.15, 0.10), 0.3, 0.25, 1.4)
HALVES = np.repeat([0, 1], [36, 37])[:, None] * np.ones((1, 73), int)


def close(found, truth, keys=PARAMETERS, limit=4.0):
    """Every estimate within `limit` standard errors: 4 are passed by chance once in 16,000."""
    return all(abs(getattr(found, key) - getattr(truth, key)) < limit * found.standard_error[key] for key in keys)


@pytest.fixture(scope="module")
def ball():
    return simulate([RED], 1)


@pytest.fixture(scope="module")
def two_balls_in_one():
    return simulate([RED, BLUE], 2, size=73, labels=HALVES, white=(1.3, 1.0, 0.7))


def test_gradient_of_the_fit_is_that_of_its_cost(ball):
    """Oracle: central differences of Σρ; their error is of the order step² and rounding/step, each below 1e-5 here."""
    seen = observe(ball, known_shape(ball), None, 0)
    objective = Objective(seen, seen.noise, TUKEY, shaped=(3, 4, 5))
    theta = pack_theta(np.array(RED.alpha_body), RED.beta, RED.gamma, RED.n, 40.0, np.array([1.01, 1.0, 0.99])) * 1.01
    gradient = objective.evaluate(theta[None])[1][0]
    for i, step in enumerate(1e-6 * np.eye(len(theta))):
        cost = objective.evaluate(np.stack([theta + step, theta - step]))[0]
        assert gradient[i] == pytest.approx((cost[0] - cost[1]) / 2e-6, rel=1e-3)


def test_prediction_is_the_light_of_the_simulation():
    """With 1e12 electrons the noise is 1e-6 and nothing but the two transcriptions of eq. (2)–(6) can differ."""
    capture = simulate([RED], 3, full_well=1e12)
    measured = measure_known_shape(capture)
    for photograph, predicted in zip(capture.photographs, measured.predicted, strict=True):
        lit = photograph.mask & np.isfinite(predicted[..., 0])
        np.testing.assert_allclose(predicted[lit], photograph.values[lit], atol=2e-5 * photograph.values.max())


def test_two_materials_are_separated_and_measured_under_a_lamp_of_unknown_colour(two_balls_in_one):
    """Labels: all but a tenth of a per cent of the lit pixels, as two rows at the border may carry either."""
    measured = measure_known_shape(two_balls_in_one, colour_from_highlights=True)
    assert len(measured.materials) == 2
    red = 0 if measured.materials[0].body_colour[0] > 1 else 1
    lit = measured.labels >= 0
    assert np.mean((measured.labels == red)[lit] == (HALVES == 0)[lit]) > 0.999
    colour = measured.lamp_colour
    assert colour is not None
    assert (np.abs(colour.value - [1.3, 1.0, 0.7]) < 4 * colour.standard_error).all()
    assert colour.standard_error.max() < 0.01
    for found, truth in zip(measured.materials, (RED, BLUE) if red == 0 else (BLUE, RED), strict=True):
        assert close(found, truth) and all(found.identifiable[key] for key in (*PARAMETERS, "nu"))
        assert not found.identifiable["interface_colour"]  # that of the lamp was read off it


def test_lamp_colour_is_not_made_up(ball):
    with pytest.raises(InputError, match="only 1 material"):
        measure_known_shape(ball, colour_from_highlights=True)


def test_matte_ball_tells_nothing_of_its_interface():
    matte = replace(RED, beta=0.0)
    (found,) = measure_known_shape(simulate([matte], 4)).materials
    assert found.identifiable == {"alpha": True} | dict.fromkeys(OF_THE_INTERFACE, False)
    assert found.beta == 0.0 and found.standard_error["beta"] is None
    assert found.interval_95["specular_albedo"][1] < 1e-3 * math.pi * found.alpha
    assert close(found, matte, ["alpha"])
    assert "no interface reflection" in found.remarks[-1]


def test_one_lamp_does_not_tell_n_and_the_interval_of_beta_says_so(ball):
    one = replace(ball, photographs=ball.photographs[:1])
    (free,), (given,) = measure_known_shape(one).materials, measure_known_shape(one, n=1.5).materials
    known = {"alpha": True, "beta": False, "gamma": True, "n": False, "nu": True, "interface_colour": True}
    assert free.identifiable == known
    assert free.n == 1.5 and "n is not identifiable" in free.remarks[0]
    assert free.interval_95["beta"][0] < RED.beta / 2 and free.interval_95["beta"][1] > RED.beta * 2
    assert given.identifiable["beta"] and not given.identifiable["n"] and given.interval_95["n"] == (1.5, 1.5)
    assert close(given, RED, ["alpha", "beta", "gamma"])


@pytest.mark.parametrize("kind", ["bright", "black", "any"])
def test_gross_outliers_do_not_move_alpha(ball, kind):
    """5 % of the pixels of each photograph are anything: α moves by less than 1 %."""
    random, photographs = np.random.default_rng(5), []
    for photograph in ball.photographs:
        values = photograph.values.copy()
        bad, top = random.random(values.shape[:2]) < 0.05, values.max()
        values[bad] = {"bright": 2 * top, "black": 0, "any": random.uniform(0, top, (bad.sum(), 3))}[kind]
        photographs.append(replace(photograph, values=values))
    labels = np.zeros((61, 61), int)
    (found,) = measure_known_shape(replace(ball, photographs=tuple(photographs)), labels=labels).materials
    assert found.alpha == pytest.approx(RED.alpha, rel=0.01)
    assert close(found, RED)
    assert "beyond 6 standard deviations" in found.remarks[0]


def test_saturated_highlights_do_not_bias_what_is_left():
    """The brightest value is 1.5 times what the well holds: the middle of a highlight is lost, its flanks tell."""
    (found,) = measure_known_shape(simulate([RED], 6, metered=1.5), labels=np.zeros((61, 61), int)).materials
    assert close(found, RED) and found.identifiable["gamma"]


def test_lacking_model_is_said_and_widens_the_intervals(ball):
    """A texture of 5 % that no parameter can follow: it is found as the model error and the errors grow with it."""
    texture = 1 + 0.05 * np.random.default_rng(7).standard_normal((61, 61, 1)).astype(np.float32)
    rough = [replace(photograph, values=photograph.values * texture) for photograph in ball.photographs]
    (found,) = measure_known_shape(replace(ball, photographs=tuple(rough))).materials
    (smooth,) = measure_known_shape(ball).materials
    assert "model error of" in found.remarks[0] and found.chi_square > 10
    assert found.standard_error["alpha"] > 10 * smooth.standard_error["alpha"]
    assert close(found, RED, ["alpha", "gamma"])


def test_several_lamps_in_a_photograph(ball):
    """Photographs of pairs of lamps are sums of photographs: the same material is measured."""
    singles = simulate([RED], 8, full_well=1e6).photographs
    pairs = []
    for a, b in ((0, 1), (1, 2), (0, 2)):
        one, other = singles[a], singles[b]
        pairs.append(replace(one, values=one.values + other.values, variance=one.variance + other.variance,
                             mask=one.mask & other.mask, lamps=one.lamps + other.lamps))  # fmt: skip
    (found,) = measure_known_shape(replace(ball, photographs=tuple(pairs)), labels=np.zeros((61, 61), int)).materials
    assert close(found, RED) and all(found.identifiable.values())


def test_only_samples_that_the_mosaic_measured_are_fitted(ball):
    """Interpolated values repeat their neighbours' noise: without them χ² is 1 (standard deviation 0.02 of 5,000)."""
    sensor = Sensor(1.0, 45_000, 10, 11.4, 128, 12, "RGGB")
    photographs = []
    for photograph in simulate([RED], 9, full_well=1e12).photographs:
        metered = sensor.metered(float(photograph.values.max()))
        developed = develop_raw(expose_raw(np.maximum(photograph.values, 0), metered, 10), metered)
        mask, native = developed.valid & photograph.mask, native_channels(metered, 61, 61)
        photographs.append(replace(photograph, values=developed.values, variance=developed.variance, mask=mask,
                                   native=native))  # fmt: skip
    (found,) = measure_known_shape(replace(ball, photographs=tuple(photographs))).materials
    assert close(found, RED)
    assert found.chi_square == pytest.approx(1, abs=0.08)


def test_pixels_are_drawn_by_their_geometry_and_keep_the_highlights():
    """Of 80,000 pixels 13,000 are fitted; the middle of the highlights, the rarest of the strata, is there in full."""
    capture = simulate([RED], 11, size=361, angles=((-60, 15), (10, 15), (80, 15)))
    seen = observe(capture, known_shape(capture), None, 0)
    every = Pixels.where(capture, known_shape(capture))
    middle = 0
    for photograph in capture.photographs:
        view = sight_of(photograph, every.points, every.normals)
        middle += np.sum((view.least_half_angle < 0.05) & view.fit_to_use)
    angle = np.arccos(seen.sight.cosines.half[:, 0])
    assert seen.values.size <= 120_000 and np.sum(angle < 0.05) == middle
    np.testing.assert_array_equal(seen.values, observe(capture, known_shape(capture), None, 0).values)


def test_shades_of_one_colour_are_one_material():
    dark = replace(RED, alpha_body=(0.10, 0.075, 0.05))
    labels = segment(simulate([RED, dark], 12, size=73, labels=HALVES))
    assert set(np.unique(labels)) == {-1, 0}


def test_reflectance_looks_to_the_camera_as_the_material_does(ball):
    """ρ of the spectrum built is b_c times the camera's reading of the lamp, to rounding: eq. (10) solved exactly."""
    (found,) = measure_known_shape(ball).materials
    response, lamp = Response.load("canon_eos_300d"), Spectrum.named("A")
    reflectance = found.reflectance(response, lamp, "cylinder")
    seen = camera_response(reflectance.body_colour, lamp, response)
    np.testing.assert_allclose(seen, np.array(found.body_colour) * camera_white(lamp, response), rtol=1e-12)
    assert (reflectance.element, reflectance.alpha, reflectance.n) == ("cylinder", found.alpha, found.n)


def test_colour_without_a_spectrum_is_refused(ball):
    (found,) = measure_known_shape(ball).materials
    with pytest.raises(InputError, match="no smooth spectrum"):
        replace(found, body_colour=(2.9, 0.05, 0.05)).reflectance(Response.load("canon_eos_300d"))


def test_materials_are_read_as_they_were_written(tmp_path, two_balls_in_one):
    glossy = measure_known_shape(two_balls_in_one, labels=HALVES).materials
    matte = measure_known_shape(simulate([replace(RED, beta=0.0)], 13)).materials
    path = write_materials((*glossy, *matte), tmp_path / "materials.json")
    assert read_json(path)[2]["interval_95"]["beta"] == [0.0, None]
    for read, written in zip(read_materials(path), (*glossy, *matte), strict=True):
        assert vars(read) == vars(written)
    with pytest.raises(InputError, match="exists"):
        write_materials(glossy, path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colour": 1}, "unknown key 'colour'"),
        ({"alpha": "0.1"}, "alpha must be a finite number"),
        ({"interval_95": {"alpha": [0.1]}}, "interval_95.alpha must be a list of 2 finite numbers"),
        ({"identifiable": {"alpha": True}}, "lacks the key 'beta'"),
        ({"interface_colour": [1.0]}, "one number per channel"),
    ],
)
def test_broken_materials_are_refused(tmp_path, ball, change, message):
    path = write_materials(measure_known_shape(ball).materials, tmp_path / "materials.json")
    write_json(path, [{**read_json(path)[0], **change}])
    with pytest.raises(InputError, match=message):
        read_materials(path)


def test_measurement_is_written_whole(tmp_path, ball):
    measured = measure_known_shape(ball)
    folder = measured.save(tmp_path / "measured")
    assert read_materials(folder / "materials.json")[0].pixels == measured.materials[0].pixels
    normals = read_exr(folder / "normals.exr")[0]
    np.testing.assert_array_equal(np.stack([normals[f"N.{axis}"] for axis in "XYZ"], axis=-1), measured.normals)
    np.testing.assert_array_equal(read_png(folder / "labels.png"), measured.labels + 1)
    assert len(list(folder.glob("residual_*.png"))) == len(LAMPS)
    with pytest.raises(InputError, match="exists"):
        measured.save(folder)


def test_progress_runs_from_0_to_1(ball):
    shares = []
    measure_known_shape(ball, progress=lambda share, step="": shares.append(share))
    assert shares[0] == 0 and shares[-1] == 1 and shares == sorted(shares)


def test_bad_captures_are_refused_in_one_line(ball):
    dark = tuple(replace(photograph, mask=np.zeros((61, 61), bool)) for photograph in ball.photographs)
    unlit = tuple(replace(photograph, lamps=()) for photograph in ball.photographs)
    first = ball.photographs[0]
    grey = Photograph(first.values[..., :1], first.variance[..., :1], first.mask, first.camera, first.lamps, "grey")
    cases: list[tuple[Capture, dict[str, Any], str]] = [
        (replace(ball, photographs=dark), {}, "all are masked, saturated, dark or grazing"),
        (replace(ball, photographs=dark), {"labels": np.zeros((61, 61), int)}, "0 usable values"),
        (replace(ball, photographs=unlit), {}, "has no lamp"),
        (replace(ball, points=None), {}, "has no shape"),
        (replace(ball, normals=np.zeros((61, 61, 3), np.float32)), {}, "no pixel with a point and a unit normal"),
        (replace(ball, photographs=(first, grey)), {}, "another size"),
        (ball, {"labels": np.zeros((3, 5), int)}, "labels of shape"),
        (ball, {"labels": np.full((61, 61), -1)}, "name no material"),
        (ball, {"n": 0.5}, "n is 0.5"),
    ]
    for capture, options, message in cases:
        with pytest.raises(InputError, match=message) as refused:
            measure_known_shape(capture, **options)
        assert "\n" not in str(refused.value)
