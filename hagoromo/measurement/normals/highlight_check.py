"""Highlight check: whether the residuals of solved normals still depend on the half angle: lack of fit of the lobes.

The angle φ between normal and half vector is cut into BINS of the lobe's half width. Errors of a real object are alike
over parts of it, so in each bin the means over tiles of the object are taken for independent, and their mean is tested
against 0 (Student's t); the smallest p-value counts, times the number of bins (Bonferroni).

Highlight shift: how far the strength and width of the highlight in the photographs are from those of its model.

In each bin of the half angle (`highlight_check`) the light of the highlight is the model's times 1 + R, by least
squares of what the model leaves. The model's lobes times 1 + R have a peak and a half width of their own: ln of their
ratios to the model's are errors of ln β and ln γ that the noise does not know. Every value counts in full: the robust
loss takes a highlight that the model lacks for outliers.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from hagoromo.measurement.facets import facet_density
from hagoromo.measurement.material.lack_of_fit import LEVEL, LackOfFit
from hagoromo.measurement.material.misfit_shift import BINS, bin_ratios, peak_and_width
from hagoromo.measurement.normals.photometric_model import Fit, predicted, size
from hagoromo.measurement.normals.shading import TAIL
from hagoromo.measurement.normals.views import Array, Views

TILES = 4.0  # in a radius of the object
FEWEST_TILES = 8


def highlight_check(fit: Fit, views: Views, known: NDArray[np.bool_], number: int) -> LackOfFit | None:
    """The test of material `number`; known: (K, P) valid values that are not in shadow.

    None where too few tiles show a highlight.
    """
    own = np.flatnonzero(fit.labels == number)
    part, place, known = views.pixels(own), views.place[own], known[:, own]
    mine = fit.pixels(own)
    model = mine.evenness(place)[:, None] * predicted(mine, part.to_lamp, part.to_eye)
    spread = np.sqrt(part.variance + (fit.model_error * size(part)) ** 2)
    missing = (part.values - model).mean(axis=1)
    known = known & np.isfinite(missing) & np.isfinite(spread).all(axis=1) & (model > 0.0).all(axis=1)
    deviation = np.where(known, missing / np.where(known, spread.mean(axis=1), 1.0), 0.0)
    width = angles(mine.normals, part) / np.exp(mine.rows[:, 1])
    tile = np.floor(TILES * place).astype(np.int64)
    tile -= tile.min(axis=0)
    tile_of = np.broadcast_to(tile[:, 1] * (int(tile[:, 0].max()) + 1) + tile[:, 0], known.shape)
    tests, missed = [], 0.0
    for low, high in itertools.pairwise(BINS):
        here = known & (width >= low) & (width < high)
        if here.any():
            missed += here.sum() * float(np.mean(missing[here])) ** 2
        found = _student(deviation[here], tile_of[here])
        if found is not None:
            tests.append((*found, low, high))
    if not tests:
        return None
    p_value, statistic, rest, low, high = min(tests)
    p_value = min(p_value * len(tests), 1.0)
    rms = float(np.sqrt(missed / max(np.sum(np.where(known, model.mean(axis=1), 0.0) ** 2), 1e-300)))
    gamma = float(np.degrees(np.exp(fit.gloss.rows[number, 1])))
    way = "brighter" if statistic > 0.0 else "darker"
    where = f"the highlight is {way} than the model at {low * gamma:.2g}° to {high * gamma:.2g}° from its peak"
    return LackOfFit(statistic**2, (1, rest), p_value, p_value < LEVEL, rms, where)


def angles(normals: Array, views: Views) -> Array:
    """(K, P) φ [rad] between normals and half vectors."""
    half = views.to_lamp + views.to_eye
    cosine = np.einsum("kpi,pi->kp", half, normals) / np.maximum(np.linalg.norm(half, axis=2), 1e-12)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _student(values: Array, tile: NDArray[np.integer]) -> tuple[float, float, int] | None:
    """p-value, t and degrees of freedom of the means of `values` over each `tile`; None for too few tiles."""
    count = np.bincount(tile)
    if np.sum(count > 0) < FEWEST_TILES:
        return None
    means = np.bincount(tile, values)[count > 0] / count[count > 0]
    rest = len(means) - 1
    statistic = float(means.mean() / max(means.std(ddof=1) / np.sqrt(len(means)), 1e-12))
    return float(2.0 * student.sf(abs(statistic), rest)), statistic, rest


def highlight_shift(fit: Fit, views: Views, known: NDArray[np.bool_], number: int) -> Array:
    """(2,) ln β and ln γ of the highlight of material `number` in the photographs, less those of its model.

    known: (K, P) valid values that are not in shadow.
    """
    own = np.flatnonzero(fit.labels == number)
    part, known, mine = views.pixels(own), known[:, own], fit.pixels(own)
    even = mine.evenness(views.place[own])[:, None]
    lobes = even * predicted(replace(mine, body=np.zeros_like(mine.body)), part.to_lamp, part.to_eye)
    left = part.values - even * predicted(mine, part.to_lamp, part.to_eye)
    known = known & np.isfinite(left).all(axis=1)
    width = angles(mine.normals, part) / np.exp(mine.rows[:, 1])
    left = np.where(known[:, None], np.nan_to_num(left), 0.0).swapaxes(1, 2)
    lobes = np.where(known[:, None], lobes, 0.0).swapaxes(1, 2)
    pixel = np.broadcast_to(np.arange(len(own)), width.shape)
    bins = bin_ratios(width, lobes, left, pixel)
    at = np.linspace(0.0, BINS[-1], 2001)  # half widths
    return np.sqrt(bins.sure) * peak_and_width(_shape(fit, number, at), at, bins)[0]


def _shape(fit: Fit, number: int, at: Array) -> Array:
    """β D of all lobes of a material, at angles in half widths of the first one."""
    row = fit.gloss.rows[number]
    lobes = () if fit.lobes is None else fit.lobes.each[number]
    angle2 = (at * np.exp(row[1])) ** 2
    first = np.exp(row[0]) * facet_density(angle2, row[1], row[TAIL], with_tail=False).value
    return first + sum(beta * facet_density(angle2, np.log(gamma), np.zeros(1)).value for beta, gamma in lobes)
