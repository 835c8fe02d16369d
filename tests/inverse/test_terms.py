"""Terms that photographs have in common: unknowns declared once, found by fits of materials and of pixels alike."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.record import read_json
from hagoromo.measurement import known_shape, measure
from hagoromo.measurement.known_shape import changes_of, measure_known_shape, profile_of_material, terms_of_known_shape
from hagoromo.measurement.material.material_fit import fit_material
from hagoromo.measurement.measurement_files import read_terms
from hagoromo.measurement.observations import known_shape as region_of
from hagoromo.measurement.observations import observe
from hagoromo.measurement.photometric import terms as registry
from hagoromo.measurement.photometric.term import CaptureTerms, ReadingChange, Term
from hagoromo.measurement.photometric.term_fit import TermProfile, fit_terms
from hagoromo.measurement.robust_fit import minimise
from tests.inverse.simulated_ball import BallMaterial, simulate

SIZE, PEDESTAL, FALL = 31, 0.004, -0.08
ACROSS = np.linspace(-1.0, 1.0, SIZE)[:, None]
BODY = BallMaterial((0.2, 0.15, 0.1), 0.4, 0.2, 1.5)
OFFSET = Term(
    "pedestal", "a pedestal", "[1/sr]", 0.0, 0.02, (-1.0, 1.0), "this test", lambda _: ReadingChange(added=1.0)
)
TILT = Term("fall", "light that falls off to the right", "per half a picture", 0.0, 0.2, (-0.5, 0.5), "this test",
            lambda _: ReadingChange(share=ACROSS))  # fmt: skip


def with_both(capture):
    """The photographs, multiplied and raised."""
    factor = 1.0 + FALL * ACROSS
    changed = (
        replace(one, values=one.values * factor + PEDESTAL, variance=one.variance * factor**2)
        for one in capture.photographs
    )
    return replace(capture, photographs=tuple(changed))


def measured(capture, terms=None):
    return measure_known_shape(capture, facets="gaussian", interface="neutral", terms=terms)


@pytest.fixture(scope="module")
def ball():
    return simulate([BODY], 7, SIZE)


def test_what_is_taken_out_is_what_was_put_in(ball):
    found = CaptureTerms((OFFSET, TILT), np.array([PEDESTAL, FALL]), np.eye(2))
    for before, after in zip(ball.photographs, found.without(with_both(ball)).photographs, strict=True):
        np.testing.assert_allclose(after.values, before.values, atol=1e-6)
        np.testing.assert_allclose(after.variance, before.variance, rtol=1e-5)


def test_a_term_that_adds_and_one_that_multiplies_are_found_with_their_errors(ball):
    """Within 4 standard errors, a tenth of what is known before at most; then the material is the true one."""
    capture = with_both(ball)
    found = terms_of_known_shape(capture, [OFFSET, TILT], facets="gaussian", interface="neutral")
    assert (np.abs(found.values - [PEDESTAL, FALL]) < 4.0 * found.errors).all()
    assert (found.errors < [0.002, 0.02]).all()
    wrong, right = measured(capture), measured(found.without(capture), terms=found)
    for key, truth in (("alpha", BODY.alpha), ("gamma", BODY.gamma), ("beta", BODY.beta)):
        value, error = getattr(right.materials[0], key), right.materials[0].standard_error[key]
        assert abs(value - truth) < 4.0 * error
    assert abs(wrong.materials[0].alpha - BODY.alpha) > 5.0 * abs(right.materials[0].alpha - BODY.alpha)


def test_the_profile_of_a_material_is_the_slope_of_its_cost_with_all_else_following(ball):
    """Oracle: the cost of fits to photographs that lack ± a step of the term; the dispersion by noise is below 1.1.

    The step is that of least squares with the weights of the loss: shorter than Newton's, by curvature over weight.
    """

    def observed(of):
        return observe(of, region_of(ball), None, 0)

    samples = observed(ball)
    fit = fit_material(samples)
    changes, step, rows = changes_of(ball, [OFFSET], samples, observed), 1e-5, []
    for sign in (1.0, 0.0, -1.0):
        moved = replace(samples, values=samples.values - sign * step * changes[..., 0])
        objective = replace(fit.objective, observations=moved, weights=None)
        rows.append(minimise(objective, fit.theta[None], fit.free).cost[0])
    slope, curvature = (rows[2] - rows[0]) / (2.0 * step), (rows[0] + rows[2] - 2.0 * rows[1]) / step**2
    found = profile_of_material(fit, changes)
    assert found.precision[0, 0] == pytest.approx(curvature, rel=0.1)
    r = np.random.default_rng(0).standard_normal(100_000)
    shorter = fit.objective.loss.curvature(r).mean() / fit.objective.loss.weight(r).mean()
    assert found.step[0] == pytest.approx(shorter * slope / curvature, rel=0.05)


def test_fits_count_as_much_as_they_know_and_bounds_hold(ball):
    """Two fits of u = 0.3 ± 0.1 and 0.5 ± 0.2, before 0 ± 1: the mean by inverse variances, worked out by hand."""
    one = replace(OFFSET, spread=1.0)
    without = []

    def profiles_of(capture):
        without.append(float(ball.photographs[0].values.mean() - capture.photographs[0].values.mean()))
        return [TermProfile(np.array([u - without[-1]]), np.array([[s**-2]])) for u, s in ((0.3, 0.1), (0.5, 0.2))]

    found = fit_terms(ball, [one], profiles_of)
    assert found.values[0] == pytest.approx((0.3 * 100 + 0.5 * 25) / 126, rel=1e-4)
    assert found.errors[0] == pytest.approx(126**-0.5)
    assert fit_terms(ball, [replace(one, range=(-1.0, 0.2))], profiles_of).values[0] == 0.2


def test_an_unknown_that_nobody_expects_is_doubted():
    found = CaptureTerms((OFFSET,), np.array([PEDESTAL]), np.eye(1) * 1e-6)
    doubt = "something else in them looks like it"
    assert doubt not in found.estimates()["pedestal"].sentence
    assert doubt in replace(found, values=np.array([0.06])).estimates()["pedestal"].sentence
    assert "these photographs do not show it" in CaptureTerms.before([OFFSET]).estimates()["pedestal"].sentence


def test_rounds_that_do_not_converge_are_said(ball):
    def wrong(capture):
        return [TermProfile(np.array([1e3]), np.array([[1.0]]))]

    with pytest.raises(InputError, match=r"pedestal: the estimate is still .* standard errors from its place after"):
        fit_terms(ball, [replace(OFFSET, spread=1e3, range=(-1e9, 1e9))], wrong)


def test_a_measurement_says_what_it_estimated(ball, monkeypatch, tmp_path, capsys):
    """In the record, in what it assumes, and again when it is read; a wrong name is answered with the right ones."""
    monkeypatch.setattr(registry, "TERMS", (OFFSET, TILT))
    with_both(ball).save(tmp_path / "capture")
    asked = "--estimate", "pedestal", "fall", "--facets", "gaussian", "--interface", "neutral"
    assert main(["measure", str(tmp_path / "capture"), *asked, "--out", str(tmp_path / "measured")]) == 0
    record = read_json(tmp_path / "measured" / "terms.json")["terms"]
    assert list(record) == ["pedestal", "fall"] and record["pedestal"]["determined"]
    assert abs(record["fall"]["value"] - FALL) < 4.0 * record["fall"]["standard_error"]
    measured = hg.Measurement.load(tmp_path / "measured")
    assert measured.terms["fall"].value == record["fall"]["value"]
    assert measured.settings["estimate"] == ["pedestal", "fall"]
    said = (
        f"ight that falls off to the right: {record['fall']['value']:.4f} ± {record['fall']['standard_error']:.4f} per"
    )
    assert measured.assumptions["fall"].startswith(f"l{said}")
    page = (tmp_path / "measured" / "report.html").read_text()
    assert "<h3>all photographs together</h3>" in page and f"L{said}" in page
    assert main(["measure", str(tmp_path / "capture"), "--estimate", "dust", "--out", str(tmp_path / "other")]) == 2
    assert not (tmp_path / "other").exists()
    assert "'dust' cannot be estimated: give one of pedestal, fall" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["{", '{"terms": [1]}', '{"terms": {"fall": {"value": "much", "standard_error": 1}}}'])
def test_a_damaged_record_is_refused_in_one_line(text, tmp_path):
    (tmp_path / "terms.json").write_text(text)
    with pytest.raises(InputError, match=r"terms\.json"):
        read_terms(tmp_path)


def test_photographs_that_are_solved_in_tiles_have_no_terms(ball, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "TERMS", (OFFSET,))
    monkeypatch.setattr(measure, "large_source", lambda _: object())
    with pytest.raises(InputError, match="solved in tiles, and pedestal cannot be estimated"):
        hg.measure(tmp_path, estimate=["pedestal"])


def test_without_terms_nothing_is_fitted_for_them(ball, monkeypatch):
    monkeypatch.setattr(known_shape, "fit_terms", None)
    assert not hg.measure(ball).terms
