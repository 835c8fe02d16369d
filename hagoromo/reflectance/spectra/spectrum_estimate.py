"""Spectra from colours: readings of a surface under known lamps → its reflectance spectrum with its covariance.

Three channels leave most of a spectrum free (metamers). The prior determines the rest, and the covariance states how
uncertain that is. Several priors are weighted by their evidence.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.camera.response import Response, camera_white, response_matrix
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior

BRIGHTNESS = 0.3  # standard deviation of the brightness, relative to the mean of the readings
BOUNDED_SPECTRUM_STEPS: int | None = 300  # largest number of steps; None is SciPy's own
UNEXPLAINED = 1e-4  # probability of a χ² below which no likely reflectance explains readings
NEGLIGIBLE = 1e-6  # weight, relative to the largest, below which parts of a mixture are left out
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reading:
    """Camera values of a surface, relative to those of a perfect white diffuser in the same place.

    values: (channels,). covariance: (channels, channels), or their standard errors (channels,). lamp: its spectrum, of
    any strength, times that of a filter if there is one.
    """

    values: Array
    covariance: Array
    lamp: Spectrum
    response: Response

    def __init__(self, values: ArrayLike, covariance: ArrayLike, lamp: Spectrum, response: Response) -> None:
        values, covariance = np.array(values, np.float64), np.array(covariance, np.float64)
        covariance = np.diag(covariance**2) if covariance.ndim == 1 else covariance
        count = len(response.channels)
        if values.shape != (count,) or covariance.shape != (count, count):
            shapes = f"{values.shape} and {covariance.shape}"
            raise InputError(f"a reading of {count} channels needs as many values and their errors: given {shapes}")
        if not np.isfinite(values).all() or not np.isfinite(covariance).all():
            raise InputError(f"a reading has values {values} and errors that must be finite")
        if (np.linalg.eigvalsh(covariance) <= 0.0).any():
            raise InputError("the errors of a reading must be above 0, and their covariance positive definite")
        for name, value in (("values", values), ("covariance", covariance), ("lamp", lamp), ("response", response)):
            object.__setattr__(self, name, value)


@dataclass(frozen=True, eq=False)
class SpectrumEstimate:
    """A reflectance spectrum with its covariance.

    wavelengths: (n,) [nm]. values: (n,), the posterior mean, within the bounds. covariance:
    (n, n). log_evidence: prior → log p(readings | prior), up to a constant. probability: prior → its weight.
    chi_square: of the readings from the nearest part of the priors, in their joint covariance; readings: their number;
    NaN and 0 where not known. over: how far the mean without bounds lies above `upper`, at most,
    where the spectrum reaches it. limit_cost: by how
    much χ² of the readings rises because the spectrum is kept within its bounds.
    """

    wavelengths: Array
    values: Array
    covariance: Array
    log_evidence: Mapping[str, float]
    probability: Mapping[str, float]
    chi_square: float = np.nan
    readings: int = 0
    over: float = 0.0
    limit_cost: float = 0.0

    @property
    def explained(self) -> bool:
        """Whether a likely reflectance explains the readings: χ² of as many degrees of freedom, at 1 in 10,000."""
        return not self.chi_square > unexplained_above(self.readings)

    def remarks(self) -> tuple[str, ...]:
        """A line for readings that no likely reflectance explains, and for a bound that keeps the spectrum off them."""
        lines = []
        if not self.explained:
            lines.append(
                f"no likely reflectance explains the readings (χ² {self.chi_square:.0f} of {self.readings}): check the "
                "white, the lamp's spectrum, the response and fluorescence"
            )
        if self.over > 0.0 and self.limit_cost > unexplained_above(1):
            lines.append(
                f"the readings are brighter than the upper bound allows, by {self.over:.3g} of a perfect white: check "
                "the white, or raise `upper`"
            )
        return tuple(lines)

    @property
    def band_95(self) -> tuple[Array, Array]:
        """Lower and upper limit (n,) of the 95 % interval at each wavelength; not below 0."""
        half = 1.96 * self.standard_error
        return np.maximum(self.values - half, 0.0), self.values + half

    @property
    def spectrum(self) -> Spectrum:
        """The values as a spectrum."""
        return Spectrum(self.wavelengths, self.values)

    @property
    def standard_error(self) -> Array:
        """(n,), of the values."""
        return np.sqrt(np.diag(self.covariance))

    def seen(self, lamp: Spectrum, response: Response) -> tuple[Array, Array]:
        """Camera values relative to white: (channels,), and their covariance (channels, channels)."""
        matrix = reading_matrix(lamp, response)
        return matrix @ self.values, matrix @ self.covariance @ matrix.T


def reflectance_spectrum(
    readings: Sequence[Reading], priors: Sequence[ReflectancePrior] | None = None, upper: float = 1.0
) -> SpectrumEstimate:
    """Reflectance spectrum of one surface from `readings`, one per lamp, filter or camera.

    priors: of the classes that it may belong to, as likely before the readings as their `odds`; "surfaces" and
    "smooth" by default.
    upper: bound of the spectrum; infinite where readings are relative. Raises `InputError` without a reading, for
    readings whose mean is not above 0, and when the bounded fit does not converge. Warns as `remarks` says.

    The posterior of a mixture of Gaussians is exact; Wiener's estimate is that of a single one. Pratt and Mancill
    1976, "Spectral estimation techniques for the spectral calibration of a color image scanner".
    """
    if not readings:
        raise InputError("a spectrum needs a reading: none is given")
    priors = [ReflectancePrior.load(name) for name in ("surfaces", "smooth")] if priors is None else priors
    sizes = np.cumsum([0, *(len(reading.values) for reading in readings)])
    covariance = np.zeros((sizes[-1], sizes[-1]))
    for reading, start, end in zip(readings, sizes, sizes[1:], strict=False):
        covariance[start:end, start:end] = reading.covariance
    matrix = np.concatenate([reading_matrix(reading.lamp, reading.response) for reading in readings])
    estimate = estimate_spectrum(matrix, np.concatenate([r.values for r in readings]), covariance, priors, upper)
    for remark in estimate.remarks():
        warnings.warn(remark, stacklevel=2)
    return estimate


def unexplained_above(count: int) -> float:
    """χ² of `count` degrees of freedom that is exceeded with the probability `UNEXPLAINED`; inf for none."""
    from scipy.stats import chi2

    return float(chi2.isf(UNEXPLAINED, count)) if count else np.inf


def reading_matrix(lamp: Spectrum, response: Response) -> Array:
    """(channels, wavelengths): readings, relative to white, of a reflectance that is linear between `WAVELENGTHS`.

    Beyond them it keeps its end values.
    """
    tents = [Spectrum(WAVELENGTHS, row) for row in np.eye(len(WAVELENGTHS))]
    reads = camera_white(lamp, response)
    if not (reads > 0.0).all():
        dark, (low, high) = response.channels[int(np.argmin(reads))], response.limits
        raise InputError(f"channel {dark} has no response to this lamp over {low:g}–{high:g} nm: leave the channel out")
    return response_matrix(tents, lamp, response) / reads[:, None]


def estimate_spectrum(
    matrix: Array, values: Array, covariance: Array, priors: Sequence[ReflectancePrior], upper: float = 1.0
) -> SpectrumEstimate:
    """Like `reflectance_spectrum`, from the matrix (m, wavelengths) of the readings `values` (m,)."""
    names = [prior.name for prior in priors]
    if not priors or len(set(names)) != len(names):
        raise InputError(f"give one or more priors, each of its own name: given {', '.join(names) or 'none'}")
    brightness = float(values.mean())
    if not brightness > 0.0:
        raise InputError(f"readings of mean {brightness:.3g} give no spectrum: give readings above the noise")
    posteriors = [_posterior(prior, matrix, values / brightness, covariance / brightness**2) for prior in priors]
    evidence = np.array([part.log_evidence for part in posteriors])
    log = evidence + np.log([prior.odds for prior in priors])
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean, spread = _mixture(
        weight, np.array([p.mean for p in posteriors]), np.array([p.covariance for p in posteriors])
    )
    mean, spread = brightness * mean, brightness**2 * spread
    within = _within(mean, spread, upper)
    cost = _misfit(values - matrix @ within, covariance) - _misfit(values - matrix @ mean, covariance)
    log_evidence = {name: float(log) for name, log in zip(names, evidence, strict=True)}
    probability = {name: float(share) for name, share in zip(names, weight, strict=True)}
    return SpectrumEstimate(
        WAVELENGTHS,
        within,
        spread,
        log_evidence,
        probability,
        min(part.chi_square for part in posteriors),
        len(values),
        max(float(mean.max()) - upper, 0.0) if within.max() >= upper else 0.0,
        max(cost, 0.0),
    )


def _misfit(off: Array, covariance: Array) -> float:
    return float(off @ np.linalg.solve(covariance, off))


class _PriorPosterior(NamedTuple):
    """Of a spectrum under one prior: evidence, mean (n,), covariance (n, n), and χ² from its nearest part."""

    log_evidence: float
    mean: Array
    covariance: Array
    chi_square: float


class PriorParts(NamedTuple):
    """The parts of a prior as the readings see them, each as bright as readings of mean 1.

    scale: (p,). centres: (p, n). expected: readings of the centres (p, m). gain: K Aᵀ (p, n, m), brightness free.
    """

    scale: Array
    centres: Array
    expected: Array
    gain: Array


def read_parts(prior: ReflectancePrior, matrix: Array) -> PriorParts:
    """The parts of `prior` through the `matrix` (m, n) of the readings."""
    scale = 1.0 / (prior.centres @ matrix.T).mean(axis=1)
    centres = prior.centres * scale[:, None]
    expected = centres @ matrix.T
    # Wiener: K Aᵀ, with the brightness free along each centre
    gain = scale[:, None, None] ** 2 * (prior.covariances @ matrix.T)
    gain += BRIGHTNESS**2 * centres[:, :, None] * expected[:, None, :]
    return PriorParts(scale, centres, expected, gain)


def _posterior(prior: ReflectancePrior, matrix: Array, values: Array, covariance: Array) -> _PriorPosterior:
    """The spectrum under one prior; `values` have mean 1."""
    scale, centres, expected, gain = read_parts(prior, matrix)
    total = matrix @ gain + covariance  # A K Aᵀ + noise
    inverse = np.linalg.inv(total)
    solved = np.einsum("pab,pb->pa", inverse, values - expected)
    square = np.sum((values - expected) * solved, axis=1)
    log = prior.log_weights - 0.5 * square - 0.5 * np.linalg.slogdet(total)[1]
    weight = np.exp(log - log.max())
    evidence = float(log.max() + np.log(weight.sum()))
    likely = weight > NEGLIGIBLE
    weight, centres, gain = weight[likely] / weight[likely].sum(), centres[likely], gain[likely]
    before = scale[likely, None, None] ** 2 * prior.covariances[likely]
    before += BRIGHTNESS**2 * centres[:, :, None] * centres[:, None, :]
    after = before - gain @ inverse[likely] @ gain.transpose(0, 2, 1)
    mean, spread = _mixture(weight, centres + np.einsum("pna,pa->pn", gain, solved[likely]), after)
    return _PriorPosterior(evidence, mean, spread, float(square.min()))


def _mixture(weight: Array, means: Array, covariances: Array) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of a mixture: within its parts and between them."""
    mean = weight @ means
    between = means - mean
    return mean, np.einsum("p,pab->ab", weight, covariances) + (weight[:, None] * between).T @ between


def _within(mean: Array, covariance: Array, upper: float) -> Array:
    """The most likely spectrum within [0, upper], `mean` where that lies within."""
    if (mean >= 0.0).all() and (mean <= upper).all():
        return mean
    from scipy.optimize import lsq_linear

    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    fit = lsq_linear(whiten, whiten @ mean, (0.0, upper), method="bvls", max_iter=BOUNDED_SPECTRUM_STEPS)
    status = scipy_status(fit)
    if not status.converged:
        raise InputError(
            f"{status.remark('a spectrum within its bounds')}: check that the readings and their errors agree"
        )
    return np.clip(fit.x, 0.0, upper)
