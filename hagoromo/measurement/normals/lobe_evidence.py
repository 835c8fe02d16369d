"""Lobe evidence: whether the photographs hold each lobe of a highlight, or do as well without it.

A lobe can lower the squared error of a few bright or clipped values and still be unknown: what the values weigh leaves
it free. The evidence for a lobe is what the likelihood loses without it, the others refined (Schwarz 1978):

    ln odds = ½ (D without − D with)/κ − ½ · 2 ln N,   D = loss + Σ ln variance.

Each side has the noise that errors of the normals make on the flanks of its own lobes. κ is how much more the sums of
residuals over a part of the object, under one lamp and in all channels, vary than those of independent noise: errors of
the model are alike there. N is the number of independent values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hagoromo.measurement.gloss.gloss_spread import DECISIVE_LOG_ODDS
from hagoromo.measurement.normals.lobe_samples import Samples
from hagoromo.measurement.normals.lobe_shape import (
    LobeShapes,
    cost_of,
    model_of,
    refined,
    tiles_of,
    with_errors_of_normals,
)
from hagoromo.measurement.normals.views import Array

NUMBERS = 2  # of a lobe: β and γ


class Side(NamedTuple):
    """Lobes, the samples with the noise that goes with them, and the deviance D."""

    shapes: LobeShapes
    samples: Samples
    deviance: float


def held(samples: Samples, found: LobeShapes, variance: Array, place: Array) -> tuple[LobeShapes, Samples]:
    """Those of the lobes `found` that the photographs hold, refined, and the samples with the noise of their flanks.

    variance: (P,) of the normals [rad²]. place: (P, 2) of the samples, in radii of the object. The lobe that has tails
    stays, and so does the last one.
    """
    side = _side(samples, found, variance)
    while len(side.shapes.each) > 1:
        shorter = [side.shapes.without(number) for number in range(int(side.shapes.tail > 0.0), len(side.shapes.each))]
        others = [_side(samples, one, variance) for one in shorter]
        least = min(others, key=lambda one: one.deviance)
        if log_odds(side, least, place) > DECISIVE_LOG_ODDS:
            break
        side = least
    return side.shapes, side.samples


def log_odds(several: Side, fewer: Side, place: Array) -> float:
    """ln of the odds of several lobes against one less."""
    samples, tile = several.samples, tiles_of(place)
    model = model_of(samples, several.shapes)
    weight = samples.weights(model)
    left = np.sqrt(weight) * (samples.values - model)
    parts = np.sum([np.bincount(tile, lamp.sum(axis=0)) ** 2 for lamp in left])
    counted = max(int(np.count_nonzero(weight)), 1)
    alike = max(float(parts) / counted, 1.0)
    return 0.5 * (fewer.deviance - several.deviance) / alike - 0.5 * NUMBERS * float(np.log(max(counted / alike, 1.0)))


def _side(samples: Samples, start: LobeShapes, variance: Array) -> Side:
    """The lobes near `start`, refined, with their own noise."""
    samples = with_errors_of_normals(samples, start, variance)
    shapes = refined(samples, start)
    samples = with_errors_of_normals(samples, shapes, variance)
    known = samples.trusted[:, None] & np.isfinite(samples.noise)
    spread = 1.0 / np.maximum(samples.weights(None), 1e-300)
    return Side(shapes, samples, cost_of(samples, shapes) + float(np.sum(np.log(spread), where=known)))
