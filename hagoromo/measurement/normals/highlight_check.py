"""Highlight check: whether the residuals of solved normals still depend on the half angle: lack of fit of the lobes.

The angle φ between normal and half vector is cut into BINS of the lobe's half width. Errors of a real object are alike
over parts of it, so in each bin the means over tiles of the object are taken for independent, and their mean is tested
against 0 (Student's t); the smallest p-value counts, times the number of bins (Bonferroni).
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from hagoromo.measurement.material.lack_of_fit import LEVEL, LackOfFit
from hagoromo.measurement.material.misfit_shift import BINS
from hagoromo.measurement.normals.photometric_model import Fit, predicted, size
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
