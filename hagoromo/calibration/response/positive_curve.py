"""Positive curve: a smooth curve R(λ) > 0 from weighted integrals of it, with smoothness and noise from the data.

R = s κ log(1 + exp(z/κ)) with a Gaussian process z(λ), so R is positive, and linear in z where it is large. What is
expected of z is a prior (`curve_prior`): smooth and no more, or like the curves of published cameras. Its parameters
and the noise maximise the marginal likelihood (Laplace's approximation), and of two priors the one of more evidence is
taken. Errors that spectra share, which are no noise, are seen by prediction of whole clusters of spectra.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.curve_process import positive, slope
from hagoromo.errors import InputError
from hagoromo.least_squares import FitStatus, scipy_status

# Wide log-normal priors (median, standard deviation of the logarithm) of the relative noise and of its floor (in units
# of the mean reading), for data that do not determine them.
NOISE, FLOOR = (0.01, 1.5), (0.002, 1.5)
LEAST_NOISE = 1e-5  # least relative noise of a reading
CURVE_STEPS = 200  # most Gauss–Newton steps to the mode of one curve
EVIDENCE_STEPS = 600  # evaluations of the evidence, in the search for smoothness and noise
CURVE_DECREASE = 1e-6
CLUSTERS = 5  # of similar spectra; each is predicted from the others
FEWEST_CLUSTERED = 40  # least number of readings for that
FAIR_MISFIT = 2.0  # mean square error of predictions, in units of typical noise, up to which the evidence is right
NOISE_FACTORS = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0)  # on the noise, among which the prediction chooses
# Half a 95 % interval in standard deviations: 1.96 for a known prior, more as its parameters are fitted. Chosen by
# leaving out each of 28 cameras (`make spectra`).
HALF_INTERVAL = 2.2
TRANSFER_PRIOR = (0.5, 0.2)  # standard deviations of the power (around 1) and of the offset [mean reading]
TRANSFER_STEPS = 6
TRANSFER_FITS = 2  # of the curve and its noise, to readings made linear
LEAST_POWER, LEAST_OFFSET = 0.03, 0.005  # smaller ones are not told, and not corrected
CERTAIN_TRANSFER = 5.0  # standard errors of a power or offset that is told
Array = NDArray[np.float64]
Rows = NDArray[np.intp]
LARGE = 1e300  # misfit of a fit that does not converge


@dataclass(frozen=True, eq=False)
class PositiveCurve:
    """R > 0 and how well it is known.

    values: (n,). standard_error: (n,), to first order. interval_95: (n, 2). length: correlation length [nm]. noise:
    relative noise of a mean reading. status: how the search for length and noise ended. prior: name of the one that was
    taken. noise_factor: factor on the noise, which prediction of clusters of spectra asked for. transfer: power and
    offset of the readings; None where there are too few.
    """

    values: Array
    standard_error: Array
    interval_95: Array
    length: float
    noise: float
    status: FitStatus
    prior: str = ""
    noise_factor: float = 1.0
    transfer: Transfer | None = None


class Transfer(NamedTuple):
    """Readings are ρ^power + offset, in units of their mean; covariance (2, 2); effect (n, 2) of both on the curve."""

    power: float
    offset: float
    covariance: NDArray[np.floating]
    effect: NDArray[np.floating]
    stated: bool = False

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of power and offset."""
        return float(np.sqrt(self.covariance[0, 0])), float(np.sqrt(self.covariance[1, 1]))

    @property
    def bent(self) -> bool:
        """Whether the power differs from 1 by what matters, and certainly."""
        return abs(self.power - 1.0) > max(LEAST_POWER, CERTAIN_TRANSFER * self.errors[0])

    @property
    def shifted(self) -> bool:
        """Whether the offset differs from 0 by what matters, and certainly."""
        return abs(self.offset) > max(LEAST_OFFSET, CERTAIN_TRANSFER * self.errors[1])

    @property
    def matters(self) -> bool:
        """Whether power or offset is as large as what would matter."""
        return abs(self.power - 1.0) > LEAST_POWER or abs(self.offset) > LEAST_OFFSET

    @property
    def certain(self) -> bool:
        """Whether the readings are not proportional to light."""
        return self.stated or self.bent or self.shifted


class Cause(NamedTuple):
    """Precision (k, k) and gradient (k,) of ½ χ² in the coefficients of a cause; relative residuals of all readings."""

    precision: Array
    gradient: Array
    residual: Array


class Equations(NamedTuple):
    """readings (m,) = matrix (m, n) R, both scaled so that R = 1 gives readings of mean 1.

    apart: wavelengths (n,) [nm]. rounding: variance of the readings by rounding. unit: of R.
    """

    matrix: Array
    readings: Array
    wavelengths: Array
    rounding: float
    unit: float

    def variance(self, relative: float, floor: float) -> Array:
        """(m,): (relative · reading)² + floor² + rounding."""
        least = LEAST_NOISE**2
        return (relative**2 + least) * self.readings**2 + floor**2 + least + self.rounding

    def linearised(self, power: float, offset: float) -> Equations:
        """With readings that are proportional to light, if they were ρ^power + offset."""
        return self._replace(readings=np.maximum(self.readings - offset, 1e-6) ** (1.0 / power))

    def normal(self, variance: Array, rows: Rows | None = None) -> Normal:
        """The sums from which the cost of every curve follows; the number of readings does not enter after that."""
        at = slice(None) if rows is None else rows
        matrix, readings, weight = self.matrix[at], self.readings[at], 1.0 / variance[at]
        weighted = matrix.T * weight
        return Normal(weighted @ matrix, weighted @ readings, float(weight @ readings**2))


class Normal(NamedTuple):
    """Σ (M R − ρ)²/v = Rᵀ A R − 2 b R + c."""

    square: Array
    linear: Array
    constant: float

    def less(self, other: Normal) -> Normal:
        """Without the readings of `other`."""
        return Normal(self.square - other.square, self.linear - other.linear, self.constant - other.constant)

    def misfit(self, curve: Array) -> float:
        """Σ (M R − ρ)²/v."""
        return float(curve @ self.square @ curve - 2.0 * self.linear @ curve + self.constant)

    def scaled(self, factor: float) -> Normal:
        """With the variances divided by `factor`."""
        return Normal(factor * self.square, factor * self.linear, factor * self.constant)


class Mode(NamedTuple):
    """z (n,) of least cost, that cost, its curvature (n, n), and the scale s of R."""

    z: Array
    cost: float
    curvature: Array
    scale: float

    @property
    def curve(self) -> Array:
        """R (n,)."""
        return self.scale * positive(self.z)


class Found(NamedTuple):
    """A prior with the parameters of the most evidence: of the prior, then ln relative noise and ln floor."""

    prior: CurvePrior
    parameters: Array
    cost: float
    status: FitStatus
    noise_factor: float = 1.0


def fit_positive_curve(
    wavelengths: Array,
    matrix: Array,
    readings: Array,
    priors: Sequence[CurvePrior] = (),
    rounding: float = 0.0,
    power: float | None = None,
) -> PositiveCurve:
    """R > 0 at `wavelengths` (n,) [nm] from `readings` (m,) = matrix (m, n) R + noise; `readings` have a mean above 0.

    The variance of the noise is (relative · reading)² + floor² + rounding. power: of the readings over light, if other
    channels show one that this one leaves open. priors: among which the evidence
    chooses (default: smooth). Raises `InputError` if the fit does not converge.
    Rasmussen and Williams 2006, "Gaussian Processes for Machine Learning", §3.4 (Laplace) and §5.4 (evidence).
    """
    size, level = matrix.sum(axis=1).mean(), readings.mean()
    equations = Equations(matrix / size, readings / level, wavelengths, rounding / level**2, level / size)
    priors = priors or priors_of("", wavelengths)
    if power is not None:
        start = Transfer(power, 0.0, np.zeros((2, 2)), np.zeros((0, 2)))
        found = _best(equations.linearised(power, 0.0), priors)
        transfer = _transfer(equations, found, start)
        if transfer is not None:
            linear = equations.linearised(transfer.power, transfer.offset)
            return _curve(linear, _best(linear, priors), transfer._replace(stated=True))
    best = _best(equations, priors)
    if len(readings) < FEWEST_CLUSTERED // 2:
        return _curve(equations, best, None)
    return _curve(*_linear(equations, best))


def typical_curve(wavelengths: Array, matrix: Array, readings: Array, prior: CurvePrior) -> Array:
    """R (n,) as `fit_positive_curve`, for typical noise and smoothness: a first look without a search."""
    size, level = matrix.sum(axis=1).mean(), max(float(readings.mean()), 1e-300)
    equations = Equations(matrix / size, readings / level, wavelengths, 0.0, level / size)
    parameters = np.concatenate([prior.middles, np.log([NOISE[0], FLOOR[0]])])
    mode = _laplace(equations, prior, parameters, prior.start(wavelengths))
    if mode is None:
        raise InputError("the fit of the response does not converge: add spectra that differ more")
    return equations.unit * mode.curve


def common_cause(
    wavelengths: Array,
    matrix: Array,
    readings: Mapping[str, Array],
    priors: Mapping[str, Sequence[CurvePrior]],
    basis: Array,
    known: dict[str, Found] | None = None,
) -> Cause:
    """How readings of all channels change by ρ' = ρ (1 + basis · x), with the curves free: their precision of x.

    basis: (m, k). Readings that are NaN are left out. known: channel → parameters of the fit; filled where missing.
    """
    precision, gradient = np.zeros((basis.shape[1],) * 2), np.zeros(basis.shape[1])
    residuals = []
    for name, reading in readings.items():
        use = np.isfinite(reading) & (reading > 0.0)
        size, level = matrix[use].sum(axis=1).mean(), reading[use].mean()
        equations = Equations(matrix[use] / size, reading[use] / level, wavelengths, 0.0, level / size)
        found = None if known is None else known.get(name)
        found = _most_evidence(equations, priors[name][0]) if found is None else found
        if known is not None and found is not None:
            known[name] = found
        mode = found and _laplace(equations, found.prior, found.parameters, found.prior.start(wavelengths))
        if not found or not mode:
            raise InputError("the fit of the response does not converge: add spectra that differ more")
        weight = 1.0 / equations.variance(*np.exp(found.parameters[-2:]))
        expected = equations.matrix @ mode.curve
        causes = expected[:, None] * basis[use]
        across = (equations.matrix * (mode.scale * slope(mode.z))).T @ (weight[:, None] * causes)
        precision += causes.T @ (weight[:, None] * causes) - across.T @ np.linalg.solve(mode.curvature, across)
        gradient += causes.T @ (weight * (equations.readings - expected))
        residuals.append((equations.readings - expected) / np.maximum(equations.readings, 0.05))
    return Cause(precision, gradient, np.concatenate(residuals))


def _linear(equations: Equations, found: Found) -> tuple[Equations, Found, Transfer | None]:
    """With readings made linear, if that is certain; else as they are.

    A wrong transfer looks like noise to the first fit, so its noise would hide the transfer: the fit of the linearised
    readings says how certain it is.
    """
    first = transfer = _transfer(equations, found)
    again = found
    for _ in range(TRANSFER_FITS):
        if transfer is None or not transfer.matters:
            return equations, found, first
        linear = equations.linearised(transfer.power, transfer.offset)
        again = _best(linear, [found.prior])
        transfer = _transfer(equations, again, transfer)
    if transfer is None or not transfer.certain:
        return equations, found, first
    linear = equations.linearised(transfer.power, transfer.offset)
    return linear, again._replace(prior=found.prior), transfer


def _best(equations: Equations, priors: Sequence[CurvePrior]) -> Found:
    """The prior and parameters of most evidence; others, and more noise, if these predict clusters of spectra better.

    With errors that similar spectra share, such as those of a lamp's spectrum, the evidence takes them for the camera,
    and the curve follows them. Then the curve from some spectra predicts others badly. Where it does, the
    prior that certainly predicts better is taken, and in doubt that of published cameras; and the noise is larger than
    by evidence where that certainly predicts better.
    """
    searched = [one for prior in priors if (one := _most_evidence(equations, prior)) is not None]
    if not searched:
        raise InputError("the fit of the response does not converge: add spectra that differ more")
    best = min(searched, key=lambda one: one.cost)
    if len(equations.readings) < FEWEST_CLUSTERED:
        return best
    parts = _clusters(equations.matrix)
    variance = equations.variance(NOISE[0], FLOOR[0])
    parts = [(rows, equations.normal(variance, rows)) for rows in parts]
    # of each cluster the logarithm, so that one that nothing predicts does not decide
    scores = np.log([[_predictions(equations, one, factor, parts) for factor in NOISE_FACTORS] for one in searched])
    if np.exp(scores[searched.index(best), 0]).sum() < FAIR_MISFIT * len(equations.readings):
        return best
    kind = int(np.argmin(scores.sum(axis=2).min(axis=1)))
    gain = scores[searched.index(best)].min(axis=0) - scores[kind].min(axis=0)
    if searched[kind] is not best and not _certain(gain):  # evidence and prediction disagree
        kind = next((i for i, one in enumerate(searched) if one.prior.mean is not None), kind)
    k = int(np.argmin(scores[kind].sum(axis=1)))
    chosen, factor = searched[kind], NOISE_FACTORS[k]
    gain = scores[kind, 0] - scores[kind, k]
    if not _certain(gain):
        return chosen
    relative, floor = (float(v) for v in chosen.parameters[-2:] + np.log(factor))
    return (_most_evidence(equations, chosen.prior, (relative, floor)) or chosen)._replace(noise_factor=factor)


def _certain(gain: Array) -> bool:
    """Whether clusters gain in the mean by more than its standard error."""
    return bool(gain.sum() > np.sqrt(len(gain)) * gain.std(ddof=1))


def _predictions(equations: Equations, found: Found, factor: float, parts: Sequence[tuple[Rows, Normal]]) -> Array:
    """(clusters,): misfit of each cluster of spectra by the curve from the others, with `factor` times the noise."""
    mean, kernel, scale = found.prior.of(found.parameters[:-2], equations.wavelengths)
    variance = equations.variance(*np.exp(found.parameters[-2:]))
    precision, every = np.asarray(np.linalg.inv(kernel), np.float64), equations.normal(variance)
    scores, start = np.full(len(parts), np.inf), found.prior.start(equations.wavelengths)
    for k, (rows, part) in enumerate(parts):
        try:
            others = every.less(equations.normal(variance, rows)).scaled(factor**-2)
            mode = _mode(others, mean, precision, scale, start)
        except (np.linalg.LinAlgError, FloatingPointError):
            return np.full(len(parts), LARGE)
        start, scores[k] = mode.z, part.misfit(mode.curve)
    return scores


def _transfer(equations: Equations, found: Found, start: Transfer | None = None) -> Transfer | None:
    """Power γ and offset b of readings ρ' = ρ^γ + b, in units of the mean reading, with the curve free as well.

    Gauss–Newton on both: readings are made linear by the last estimate and compared with the curve that fits them. The
    covariance of the curve is in that of γ and b, so a curve that could explain the readings as well makes both
    uncertain. start: an earlier estimate.
    """
    power, offset = (1.0, 0.0) if start is None else (start.power, start.offset)
    linear, z = equations.linearised(power, offset), found.prior.start(equations.wavelengths)
    covariance, effect = np.zeros((2, 2)), np.zeros((len(z), 2))
    for _ in range(TRANSFER_STEPS):
        mode = _laplace(linear, found.prior, found.parameters, z)
        if mode is None:
            return None
        z, weight = mode.z, 1.0 / linear.variance(*np.exp(found.parameters[-2:]))
        expected = np.maximum(linear.matrix @ mode.curve, 1e-6)
        causes = np.stack([expected * np.log(expected), np.ones_like(expected)], axis=1)
        across = (linear.matrix * (mode.scale * slope(mode.z))).T @ (weight[:, None] * causes)
        towards = np.linalg.solve(mode.curvature, across)
        known_to = (
            causes.T @ (weight[:, None] * causes) - across.T @ towards + np.diag(np.array(TRANSFER_PRIOR) ** -2.0)
        )
        covariance, effect = np.linalg.inv(known_to), -(mode.scale * slope(mode.z))[:, None] * towards
        away = np.array([power - 1.0, offset]) / np.array(TRANSFER_PRIOR) ** 2
        step = covariance @ (causes.T @ (weight * (linear.readings - expected)) - away)
        power, offset = float(np.clip(power * (1.0 + step[0]), 0.2, 5.0)), float(np.clip(offset + step[1], -0.5, 0.5))
        linear = equations.linearised(power, offset)
    return Transfer(power, offset, covariance, effect)


def _most_evidence(equations: Equations, prior: CurvePrior, noise: tuple[float, float] | None = None) -> Found | None:
    """The parameters of most evidence; noise: ln relative and ln floor, if they are known."""
    from scipy.optimize import minimize

    middles = np.concatenate([prior.middles, np.log([NOISE[0], FLOOR[0]])])
    widths = np.concatenate([prior.widths, [NOISE[1], FLOOR[1]]])
    count = len(prior.middles) if noise is not None else len(middles)
    if noise is not None:
        middles[-2:] = noise
    last = [prior.start(equations.wavelengths)]  # each fit starts where the one before it ended

    def cost(parameters: Array) -> float:
        every = np.concatenate([parameters, middles[count:]])
        mode = _laplace(equations, prior, every, last[0])
        if mode is None:
            return np.inf
        last[0] = mode.z
        return mode.cost + 0.5 * float(np.sum(((parameters - middles[:count]) / widths[:count]) ** 2))

    simplex = np.vstack([middles[:count], middles[:count] + 0.5 * np.diag(widths[:count])])
    options = {"initial_simplex": simplex, "xatol": 0.03, "fatol": 0.02, "maxfev": EVIDENCE_STEPS}
    search = minimize(cost, middles[:count], method="Nelder-Mead", options=options)
    if not np.isfinite(search.fun):
        return None
    return Found(prior, np.concatenate([search.x, middles[count:]]), float(search.fun), scipy_status(search))


def _laplace(equations: Equations, prior: CurvePrior, parameters: Array, start: Array) -> Mode | None:
    """The mode with −log evidence as its cost; None if the Newton steps do not converge."""
    mean, kernel, scale = prior.of(parameters[:-2], equations.wavelengths)
    variance = equations.variance(*np.exp(parameters[-2:]))
    try:
        mode = _mode(equations.normal(variance), mean, np.asarray(np.linalg.inv(kernel), np.float64), scale, start)
        logs = np.linalg.slogdet(kernel)[1] + np.linalg.slogdet(mode.curvature)[1] + np.sum(np.log(variance))
    except (np.linalg.LinAlgError, FloatingPointError):
        return None
    return mode._replace(cost=mode.cost + 0.5 * float(logs))


def _mode(normal: Normal, mean: Array, precision: Array, scale: float, start: Array) -> Mode:
    """Gauss–Newton with halved steps, from `start`."""

    def cost_at(z: Array) -> float:
        return 0.5 * (normal.misfit(scale * positive(z)) + float((z - mean) @ precision @ (z - mean)))

    z, cost = start, cost_at(start)
    for _ in range(CURVE_STEPS):
        rate = scale * slope(z)
        curvature = rate[:, None] * normal.square * rate + precision
        gradient = rate * (normal.square @ (scale * positive(z)) - normal.linear) + precision @ (z - mean)
        step = np.linalg.solve(curvature, gradient)
        share = 1.0
        while not (lower := cost_at(z - share * step)) < cost and share > 1e-6:
            share /= 2.0
        if share <= 1e-6 or cost - lower < CURVE_DECREASE * (1.0 + abs(cost)):
            return Mode(z, cost, curvature, scale)
        z, cost = z - share * step, lower
    raise FloatingPointError


def _clusters(matrix: Array) -> list[Rows]:
    """Rows of each cluster of similar spectra (k-means of the spectra, each of norm 1)."""
    from scipy.cluster.vq import kmeans2

    shapes = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-30)
    starts = [int(np.argmax(shapes @ shapes.mean(axis=0)))]
    for _ in range(CLUSTERS - 1):  # the spectrum that is furthest from all so far
        starts.append(int(np.argmin((shapes @ shapes[starts].T).max(axis=1))))
    labels = kmeans2(shapes, shapes[starts], minit="matrix", missing="warn")[1]
    return [rows for k in range(CLUSTERS) if len(rows := np.flatnonzero(labels == k))]


def _curve(equations: Equations, found: Found, transfer: Transfer | None) -> PositiveCurve:
    mode = _laplace(equations, found.prior, found.parameters, found.prior.start(equations.wavelengths))
    if mode is None:
        raise InputError("the fit of the response does not converge: add spectra that differ more")
    rate, unit = mode.scale * slope(mode.z), equations.unit
    variance = np.diag(np.linalg.inv(mode.curvature))
    if transfer is not None and transfer.certain:  # the curve is as uncertain as what the readings were corrected by
        variance = variance + np.einsum("ni,ij,nj->n", transfer.effect, transfer.covariance, transfer.effect) / rate**2
    deviation, values = np.sqrt(variance), mode.curve
    error = rate * deviation
    # R is convex in z: its tangent is a lower bound, which is 0 where R is not significantly above 0
    upper = mode.scale * positive(mode.z + HALF_INTERVAL * deviation)
    interval = np.stack([np.maximum(values - HALF_INTERVAL * error, 0.0), upper], axis=1)
    noise = float(np.sqrt(np.sum(np.exp(2.0 * found.parameters[-2:])) + 2.0 * LEAST_NOISE**2))
    return PositiveCurve(
        unit * values, unit * error, unit * interval, found.prior.length(found.parameters[:-2]), noise, found.status,
        found.prior.name, found.noise_factor, transfer,
    )  # fmt: skip
