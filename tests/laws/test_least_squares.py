"""The least-squares driver: minima of known problems, bounds, robust losses, and how a fit that fails says so."""

import numpy as np
import pytest
from scipy import optimize

from hagoromo.least_squares.fit_status import FitStatus, Status, scipy_status
from hagoromo.least_squares.levenberg_marquardt import Damping, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import CAUCHY, HUBER, TUKEY, robust_scale
from hagoromo.least_squares.rows import RowsProblem, reweighted

FREE = np.inf
TIME = np.linspace(0.0, 3.0, 41)
DECAY = np.array([2.0, -0.7])  # a exp(b t)


def linear_rows(matrix, values, loss=None):
    """Evaluation of ½|values − matrix θ|² or Σ ρ of the residuals, for rows θ (K, P)."""

    def evaluate(theta):
        r = values - theta @ matrix.T
        weight = np.ones_like(r) if loss is None else loss.weight(r)
        cost = (0.5 * r**2 if loss is None else loss.value(r)).sum(axis=1)
        return cost, -(weight * r) @ matrix, np.einsum("kn,np,nq->kpq", weight, matrix, matrix)

    return evaluate


def decay_rows(values):
    """Evaluation of ½ Σ (values − a exp(b t))², a curved valley in (a, b)."""

    def evaluate(theta):
        shape = np.exp(theta[:, 1:] * TIME)
        r = values - theta[:, :1] * shape
        j = np.stack([shape, theta[:, :1] * TIME * shape], axis=2)
        return 0.5 * (r**2).sum(axis=1), -np.einsum("kn,knp->kp", r, j), np.einsum("knp,knq->kpq", j, j)

    return evaluate


def solved(evaluate, start, low=-FREE, high=FREE, steps=60, damping=None):
    start = np.atleast_2d(start).astype(float)
    size = start.shape[1]
    problem = RowsProblem(evaluate, np.full(size, low), np.full(size, high), np.ones(size, bool))
    damping = damping or Damping()
    return levenberg_marquardt(problem, problem.start(start), damping, Tolerance(decrement=1e-12), steps)


def line(seed=1):
    random = np.random.default_rng(seed)
    matrix = random.standard_normal((29, 3))
    return matrix, matrix @ [1.0, -2.0, 0.5] + 0.1 * random.standard_normal(29)


def test_a_quadratic_is_at_its_minimum_after_one_step_without_damping():
    matrix, values = line()
    found = solved(linear_rows(matrix, values), np.zeros(3), damping=Damping(start=1e-14, least=1e-14))
    assert found.status.converged and found.status.steps == 1
    np.testing.assert_allclose(found.state.theta[0], np.linalg.lstsq(matrix, values)[0], rtol=1e-9)
    assert found.status.gradient < 1e-9


def test_a_curved_fit_ends_where_that_of_scipy_does_from_every_start():
    values = DECAY[0] * np.exp(DECAY[1] * TIME) + 0.05 * np.random.default_rng(2).standard_normal(len(TIME))
    starts = np.array([[0.5, 0.3], [5.0, -2.0], [1.0, 0.0]])
    found = solved(decay_rows(values), starts)
    expected = optimize.least_squares(lambda x: x[0] * np.exp(x[1] * TIME) - values, starts[0], xtol=1e-14, ftol=1e-14)
    assert found.statuses.converged.all()
    np.testing.assert_allclose(found.state.theta, np.tile(expected.x, (3, 1)), rtol=1e-5)
    np.testing.assert_allclose(found.statuses.cost, expected.cost, rtol=1e-9)


def test_a_fit_whose_minimum_lies_beyond_its_bounds_converges_on_them():
    matrix, values = line()
    found = solved(linear_rows(matrix, values), np.zeros(3), -1.0, 0.8)
    expected = optimize.lsq_linear(matrix, values, (-1.0, 0.8), tol=1e-12)
    assert found.status.converged
    np.testing.assert_allclose(found.state.theta[0], expected.x, atol=1e-6)
    assert found.state.theta[0, 1] == -1.0


def test_huber_s_fit_is_scipy_s_and_outliers_do_not_move_it():
    matrix, values = line()
    values = values / 0.1
    values[::7] += 300.0
    found = solved(linear_rows(matrix, values, HUBER), np.zeros(3))
    expected = optimize.least_squares(
        lambda x: matrix @ x - values,
        np.zeros(3),
        loss="huber",
        f_scale=HUBER.scale,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    assert found.status.converged
    np.testing.assert_allclose(found.state.theta[0], expected.x, rtol=1e-5)
    assert np.abs(0.1 * found.state.theta[0] - [1.0, -2.0, 0.5]).max() < 0.15


@pytest.mark.parametrize("loss", [HUBER, TUKEY, CAUCHY])
def test_weight_and_curvature_of_a_loss_are_its_derivatives(loss):
    """Central differences of step 1e-5, away from the corners of Huber's and Tukey's."""
    r, step = np.array([-9.0, -3.1, -1.0, 0.3, 2.0, 5.2]), 1e-5
    slope = (loss.value(r + step) - loss.value(r - step)) / (2 * step)
    bend = (loss.value(r + step) - 2 * loss.value(r) + loss.value(r - step)) / step**2
    np.testing.assert_allclose(loss.weight(r) * r, slope, atol=1e-8)
    np.testing.assert_allclose(loss.curvature(r), bend, atol=1e-3)
    np.testing.assert_allclose(loss.value(1e-3 * r), 0.5e-6 * r**2, rtol=1e-4)


def test_reweighted_least_squares_ends_at_the_minimum_of_the_loss():
    """Cauchy's loss of a location: the derivative of Σρ is 0 there."""
    values = np.r_[np.random.default_rng(4).standard_normal(101), 50.0, 60.0]

    def solve(weight):
        middle = np.atleast_1d(np.average(values, weights=weight))
        return middle, values - middle

    middle, _, status = reweighted(solve, CAUCHY.weight, np.ones_like(values), 60, 1e-9)
    assert status.converged
    assert abs(np.sum(CAUCHY.weight(values - middle) * (values - middle))) < 1e-6
    assert not reweighted(solve, CAUCHY.weight, np.ones_like(values), 2, 1e-9)[2].converged


def test_robust_scale_is_the_standard_deviation_of_normal_errors():
    """Its relative standard error is 1.17/√n; four of them."""
    errors = 0.3 * np.random.default_rng(5).standard_normal(40_001)
    assert robust_scale(errors) == pytest.approx(0.3, rel=4 * 1.17 / 200)
    errors[:400] = 1e9
    assert robust_scale(errors) == pytest.approx(0.3, rel=0.05)


def test_a_fit_that_has_too_few_steps_says_so():
    values = DECAY[0] * np.exp(DECAY[1] * TIME)
    found = solved(decay_rows(values), [0.5, 0.3], steps=2)
    assert found.status.status == Status.OUT_OF_STEPS and found.status.steps == 2
    assert found.status.gradient > 1e-3 and found.status.last_step > 0.0
    assert "did not converge after 2 steps" in found.status.remark("a decay")
    assert found.status.record()["status"] == "out of steps"


def test_a_fit_that_no_step_improves_says_that_it_stalled():
    """The gradient points uphill: every trial is rejected until the damping is at its largest."""
    matrix, values = line()
    evaluate = linear_rows(matrix, values)

    def wrong(theta):
        cost, gradient, curvature = evaluate(theta)
        return cost, -gradient, curvature

    found = solved(wrong, np.full(3, 5.0))
    assert found.status.status == Status.STALLED and found.status.steps < 60
    assert (found.state.theta == 5.0).all() and found.status.last_step == 0.0
    assert "stalled" in found.status.remark("a line")


def test_rows_are_independent_and_each_has_its_own_status():
    values = DECAY[0] * np.exp(DECAY[1] * TIME)
    starts = np.array([DECAY, [0.5, 0.3]])
    both, alone = solved(decay_rows(values), starts, steps=3), solved(decay_rows(values), starts[1], steps=3)
    assert both.statuses.converged.tolist() == [True, False]
    assert both.statuses.steps.tolist() == [0, 3]
    np.testing.assert_array_equal(both.state.theta[1], alone.state.theta[0])


def test_the_status_of_a_fit_by_scipy_is_stated():
    def residual(x):
        return DECAY[0] * np.exp(DECAY[1] * TIME) - x[0] * np.exp(x[1] * TIME)

    assert scipy_status(optimize.least_squares(residual, [1.0, 0.0])).converged
    short = scipy_status(optimize.least_squares(residual, [1.0, 0.0], max_nfev=2))
    assert short.status == Status.OUT_OF_STEPS and short.steps == 2
    assert FitStatus(Status.CONVERGED, 1).record()["gradient"] is None
