"""Spectra from colours: readings of a surface under known lamps → its reflectance spectrum with its covariance.

Three channels leave most of a spectrum free (metamers). The prior determines the rest, and the covariance states how
uncertain that is. Several priors are weighted by their evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.camera.response import Response, camera_white, response_matrix
from hagoromo.errors import InputError
from hagoromo.least_squares import scipy_status
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior

BRIGHTNESS = 0.3  # standard deviation of the brightness, relative to the mean of the readings
BOUNDED_SPECTRUM_STEPS: int | None = None  # largest number of steps; None is SciPy's own
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
    """

    wavelengths: Array
    values: Array
    covariance: Array
    log_evidence: Mapping[str, float]
    probability: Mapping[str, float]

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

    priors: of the classes that it may belong to, with equal prior probability; "surfaces" and "smooth" by default.
    upper: bound of the spectrum; infinite where readings are relative. Raises `InputError` without a reading, for
    readings whose mean is not above 0, and when the bounded fit does not converge.

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
    return estimate_spectrum(matrix, np.concatenate([r.values for r in readings]), covariance, priors, upper)


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
    evidence = np.array([log for log, _, _ in posteriors])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    mean, spread = _mixture(weight, np.array([m for _, m, _ in posteriors]), np.array([c for _, _, c in posteriors]))
    mean, spread = brightness * mean, brightness**2 * spread
    log_evidence = {name: float(log) for name, log in zip(names, evidence, strict=True)}
    probability = {name: float(share) for name, share in zip(names, weight, strict=True)}
    return SpectrumEstimate(WAVELENGTHS, _within(mean, spread, upper), spread, log_evidence, probability)


def _posterior(prior: ReflectancePrior, matrix: Array, values: Array, covariance: Array) -> tuple[float, Array, Array]:
    """Log evidence, mean (n,) and covariance (n, n) of the spectrum under one prior; `values` have mean 1."""
    scale = 1.0 / (prior.centres @ matrix.T).mean(axis=1)  # each centre as bright as the readings
    centres = prior.centres * scale[:, None]
    expected = centres @ matrix.T
    # Wiener: K Aᵀ, A K Aᵀ + noise, with the brightness free along each centre
    gain = scale[:, None, None] ** 2 * (prior.covariances @ matrix.T)
    gain += BRIGHTNESS**2 * centres[:, :, None] * expected[:, None, :]
    total = matrix @ gain + covariance
    inverse = np.linalg.inv(total)
    solved = np.einsum("pab,pb->pa", inverse, values - expected)
    log = -0.5 * np.sum((values - expected) * solved, axis=1) - 0.5 * np.linalg.slogdet(total)[1]
    weight = np.exp(log - log.max())
    evidence = float(log.max() + np.log(weight.mean()))
    likely = weight > NEGLIGIBLE
    weight, centres, gain = weight[likely] / weight[likely].sum(), centres[likely], gain[likely]
    before = scale[likely, None, None] ** 2 * prior.covariances[likely]
    before += BRIGHTNESS**2 * centres[:, :, None] * centres[:, None, :]
    after = before - gain @ inverse[likely] @ gain.transpose(0, 2, 1)
    return evidence, *_mixture(weight, centres + np.einsum("pna,pa->pn", gain, solved[likely]), after)


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
    fit = lsq_linear(whiten, whiten @ mean, (0.0, upper), max_iter=BOUNDED_SPECTRUM_STEPS)
    status = scipy_status(fit)
    if not status.converged:
        raise InputError(
            f"{status.remark('a spectrum within its bounds')}: check that the readings and their errors agree"
        )
    return np.clip(fit.x, 0.0, upper)
