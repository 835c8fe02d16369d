"""Misfit shift: how far a material in the photographs is from the model that was fitted, as errors of its parameters.

The model's highlight times 1 + R, with R per bin of the half angle, has a peak and a half width of its own, and tails:
ln of their ratios to the model's, and the change of 1/ν, are errors of the fit that the noise does not know. So is what
the light of the body, in bins of the angle of incidence, is off after that. They count as far as there is evidence for
them: a shift v has the second moment (2 P − 1) s v vᵀ, with P the probability that the model is wrong, by its test at
even odds, and s the share of the R² that is not noise (James & Stein 1961).
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.facets import TAIL_RANGE, facet_density
from hagoromo.measurement.material.lack_of_fit import LackOfFit
from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.parameters import LOG_GAMMA, STRENGTH, TAIL, channels_of
from hagoromo.measurement.sight import Array

BINS = (0.0, 0.15, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0)  # edges, in half widths γ
LEAST_LIGHT = 0.05  # of the model: a bin of the highlight is not taken to be darker
INCIDENCE_BINS = np.cos(np.radians([90.0, 75.0, 60.0, 45.0, 30.0, 0.0]))  # edges, cosines
TAILS = np.linspace(*TAIL_RANGE, 200)


def evidence_of_misfit(p_value: float) -> float:
    """2 P − 1, 0 without evidence and 1 where a model is certainly wrong; P: probability of that, at even odds before.

    The test of the model has this p-value p. The evidence for the model is at least −e p ln p times that against it
    where p < 1/e (Sellke, Bayarri & Berger 2001); at larger p there is none against it.
    """
    p = min(max(p_value, 1e-300), 1.0 / np.e)
    odds = -np.e * p * np.log(p)
    return float((1.0 - odds) / (1.0 + odds))


def with_misfit(fit: MaterialFit, tested: LackOfFit | None) -> MaterialFit:
    """`fit` with the errors that its model makes in its covariance, as far as the test `tested` shows any."""
    if tested is None:
        return fit
    moments = np.zeros_like(fit.covariance)
    observations, theta, c = fit.objective.observations, fit.theta, channels_of(fit.theta)
    left = np.where(observations.used, observations.values - fit.objective.model(theta), 0.0)
    if theta[STRENGTH] > 0.0:
        shift, seen = _highlight(fit, left)
        left = left - seen
        moments += np.outer(shift, shift)
    body = _body(fit, left)
    moments[:c, :c] += body * np.outer(theta[:c], theta[:c])
    moments *= np.outer(fit.inside, fit.inside)
    return replace(fit, covariance=fit.covariance + evidence_of_misfit(tested.p_value) * moments)


class BinRatios(NamedTuple):
    """Light in the photographs over that of the model, in B bins of the highlight.

    place: (B,) [half widths]. ratio: (B,) 1 + R. sure: s, the share of the R² that is not noise.
    """

    place: Array
    ratio: Array
    sure: float


def bin_ratios(width: Array, lobes: Array, left: Array, pixel: NDArray[np.integer]) -> BinRatios:
    """The ratios of the highlight `lobes` (..., C) at `width` (...) half widths from its peak.

    left: (..., C) what the model leaves of the values, 0 where a value does not count. pixel: (...) its number.
    """
    places, ratios, noise = [], [], []
    for low, high in itertools.pairwise(BINS):
        here = (width >= low) & (width < high)
        square = float(np.sum(lobes[here] ** 2))
        if square > 0.0:
            scores = np.bincount(pixel[here], np.sum(lobes[here] * left[here], axis=1))
            ratios.append(1.0 + float(scores.sum()) / square)
            noise.append(float(np.sum(scores**2)) / square**2)
            places.append(float(np.sum(lobes[here] ** 2 * width[here][:, None])) / square)
    ratio = np.array(ratios)
    return BinRatios(np.array(places), ratio, _not_noise(ratio - 1.0, np.array(noise)))


def _not_noise(value: Array, noise: Array) -> float:
    """Share of Σ value²/noise that `noise` (the variances) does not explain."""
    power = float(np.sum(value**2 / np.maximum(noise, 1e-300)))
    return max(1.0 - len(value) / power, 0.0) if power > 0.0 else 0.0


def peak_and_width(shape: Array, at: Array, bins: BinRatios) -> tuple[Array, Array]:
    """(2,) ln of the peak and of the half width of a lobe times the ratios, less those of the lobe, and the
    lobe so changed (A,).

    shape: (A,) the lobe at angles `at` [half widths], from 0 on.
    """
    if not len(bins.place):
        return np.zeros(2), shape
    seen = shape * np.interp(at, bins.place, np.maximum(bins.ratio, LEAST_LIGHT))
    widths = [at[np.argmax(one < 0.5 * one[0])] or BINS[-1] for one in (seen, shape)]
    return np.log([seen[0] / shape[0], widths[0] / widths[1]]), seen


def _highlight(fit: MaterialFit, left: Array) -> tuple[Array, Array]:
    """(P,) shift of the parameters of the highlight, and what the highlight adds to the model's values (N, C)."""
    observations, theta = fit.objective.observations, fit.theta
    bare = np.where(np.arange(len(theta)) < channels_of(theta), 0.0, theta)
    lobes = np.where(observations.used, fit.objective.interface(bare[None])[0][0], 0.0)
    width = observations.sight.least_half_angle / np.exp(theta[LOG_GAMMA])
    bins = bin_ratios(width, lobes, left, observations.pixel)
    at = np.linspace(0.0, BINS[-1], 2001)
    shape = facet_density(at**2, np.zeros(1), theta[TAIL, None]).value
    (peak, log_width), seen = peak_and_width(shape, at, bins)
    shift = np.zeros_like(theta)
    shift[STRENGTH], shift[LOG_GAMMA] = theta[STRENGTH] * peak, log_width
    if fit.inside[TAIL]:
        shift[TAIL] = _tail(seen, at / np.exp(log_width)) - theta[TAIL]
    changed = np.interp(width, bins.place, bins.ratio, right=1.0) if len(bins.place) else np.ones_like(width)
    return np.sqrt(bins.sure) * shift, lobes * (changed - 1.0)[:, None]


def _tail(seen: Array, at: Array) -> float:
    """1/ν of the facets that are most like `seen` (A,), at angles in its own half widths."""
    density = facet_density(np.tile(at**2, (len(TAILS), 1)), np.zeros(1), TAILS[:, None]).value
    return float(TAILS[np.argmin(np.sum(at * (density - seen / seen[0]) ** 2, axis=1))])


def _body(fit: MaterialFit, left: Array) -> Array:
    """(C, C) second moment of the relative error of the body over ranges of the angle of incidence, without noise."""
    observations, c = fit.objective.observations, channels_of(fit.theta)
    light = np.where(observations.used, fit.theta[:c] * observations.sight.body / np.sqrt(fit.objective.variance), 0.0)
    score = light * left / np.sqrt(fit.objective.variance)
    incidence = observations.sight.cosines.incidence.max(axis=1)
    pixel, moments, ranges = np.unique(observations.pixel, return_inverse=True)[1], np.zeros((c, c)), 0
    for low, high in itertools.pairwise(INCIDENCE_BINS):
        here = (incidence > low) & (incidence <= high)
        power = np.sum(light[here] ** 2, axis=0)
        if not np.all(power > 0.0):
            continue
        scores = np.stack([np.bincount(pixel[here], column) for column in score[here].T], axis=1) / power
        moments, ranges = moments + np.outer(scores.sum(axis=0), scores.sum(axis=0)) - scores.T @ scores, ranges + 1
    values, vectors = np.linalg.eigh(moments / max(ranges, 1))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
