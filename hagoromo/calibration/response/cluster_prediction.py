"""Errors that similar spectra share, where nobody tells which do: seen by prediction of whole clusters of spectra.

With such errors, those of a lamp's spectrum for example, the evidence takes them for the camera, and the curve follows
them. The curve from some spectra then predicts others badly, and one with more noise than by evidence predicts better.
Where the lamps of the readings are known, `Groups` does better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.curve_evidence import Found, most_evidence, typical_noise
from hagoromo.calibration.response.curve_mode import laplace
from hagoromo.calibration.response.curve_prior import CurvePrior
from hagoromo.calibration.response.reading_equations import ReadingEquations, ReadingNoise, Rows

CLUSTERS = 5  # of similar spectra; each is predicted from the others
FEWEST_CLUSTERED = 40  # least number of readings for that
FEWEST_CLUSTERS, FEWEST_OF_CLUSTER = 3, 5  # clusters, and readings of each
FAIR_MISFIT = 2.0  # mean square error of predictions, in units of typical noise, up to which the evidence is right
NOISE_FACTORS = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0)  # on the noise, among which the prediction chooses
LARGE_NOISE = 1.5  # times the typical noise, from which readings may share errors
LARGE = 1e300  # misfit of a fit that does not converge
Array = NDArray[np.float64]


def best_predicting(equations: ReadingEquations, best: Found, priors: Sequence[CurvePrior]) -> Found:
    """`best`, the fit by evidence; or, if that predicts clusters of spectra badly, the prior and noise that do better.

    Of the noises that predict as well as the best one, within a standard error, the largest is taken, as the errors are
    fewer than the readings. Hastie et al. 2009, §7.10 (the rule of one standard error).
    """
    count = len(equations.readings)
    clusters = _clusters(equations.matrix) if count >= FEWEST_CLUSTERED else []
    if (
        len(clusters) < FEWEST_CLUSTERS
        or np.exp(_log_misfits(equations, best, 1.0, clusters)).sum() < FAIR_MISFIT * count
    ):
        return best
    searched = [best if best.prior is prior else most_evidence(equations, prior) for prior in priors]
    candidates = [found for found in searched if found is not None]
    factors = NOISE_FACTORS if best.noise.relative > LARGE_NOISE * typical_noise().relative else NOISE_FACTORS[:1]
    scores = np.array([[_log_misfits(equations, one, factor, clusters) for factor in factors] for one in candidates])
    kind = int(np.argmin(scores.mean(axis=2).min(axis=1)))
    if not _certain(scores[0].min(axis=0) - scores[kind].min(axis=0)):
        kind = 0
    least = int(np.argmin(scores[kind].mean(axis=1)))
    as_well = [k for k in range(len(factors)) if not _certain(scores[kind, k] - scores[kind, least])]
    factor = factors[max(as_well)]
    if factor == 1.0:
        return candidates[kind]
    noise = ReadingNoise(*(factor * of for of in candidates[kind].noise))
    return most_evidence(equations, candidates[kind].prior, noise) or candidates[kind]


def _certain(gain: Array) -> bool:
    """Whether clusters gain in the mean by more than its standard error."""
    return bool(gain.sum() > np.sqrt(len(gain)) * gain.std(ddof=1))


def _log_misfits(equations: ReadingEquations, found: Found, factor: float, clusters: Sequence[Rows]) -> Array:
    """(clusters,): ln misfit of each cluster by the curve from the others, which have `factor` times the noise.

    The logarithm, so that a cluster that nothing predicts does not decide.
    """
    noise = ReadingNoise(*(factor * of for of in found.noise))
    misfits, start = np.full(len(clusters), np.log(LARGE)), found.prior.start(equations.wavelengths)
    for k, rows in enumerate(clusters):
        others = equations.where(np.setdiff1d(np.arange(len(equations.readings)), rows))
        mode = laplace(others, found.prior, found.parameters, noise, start)
        if mode is not None:
            own = equations.where(rows)
            misfits[k] = np.log(own.normal(own.inverse(typical_noise())).misfit(mode.curve))
            start = mode.z
    return misfits


def _clusters(matrix: Array) -> list[Rows]:
    """Rows of each cluster of similar spectra (k-means of the spectra, each of norm 1), those of few left out."""
    from scipy.cluster.vq import kmeans2

    shapes = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-30)
    starts = [int(np.argmax(shapes @ shapes.mean(axis=0)))]
    for _ in range(CLUSTERS - 1):  # the spectrum that is furthest from all so far
        starts.append(int(np.argmin((shapes @ shapes[starts].T).max(axis=1))))
    labels = kmeans2(shapes, shapes[starts], minit="matrix", missing="warn")[1]
    rows = [np.flatnonzero(labels == k) for k in range(CLUSTERS)]
    return [of for of in rows if len(of) >= FEWEST_OF_CLUSTER]
