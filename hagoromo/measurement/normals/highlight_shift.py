"""Highlight shift: how far the strength and width of the highlight in the photographs are from those of its model.

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

from hagoromo.measurement.facets import facet_density
from hagoromo.measurement.normals.highlight_check import BINS, angles
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.shading import TAIL
from hagoromo.measurement.normals.views import Array, Views

LEAST_LIGHT = 0.05  # of the model: a bin of the highlight is not taken to be darker


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
    places, ratios = [], []
    for low, high in itertools.pairwise(BINS):
        here = np.where(known & (width >= low) & (width < high), 1.0, 0.0)[:, None]
        square = float(np.sum(here * lobes**2))
        if square > 0.0:
            ratios.append(1.0 + float(np.sum(here * lobes * np.nan_to_num(left))) / square)
            places.append(float(np.sum(here * lobes**2 * width[:, None])) / square)
    if not places:
        return np.zeros(2)
    at = np.linspace(0.0, BINS[-1], 2001)  # half widths
    shape = _shape(fit, number, at)
    seen = shape * np.interp(at, places, np.maximum(ratios, LEAST_LIGHT))
    widths = [at[np.argmax(one < 0.5 * one[0])] or BINS[-1] for one in (seen, shape)]
    return np.log([seen[0] / shape[0], widths[0] / widths[1]])


def _shape(fit: Fit, number: int, at: Array) -> Array:
    """β D of all lobes of a material, at angles in half widths of the first one."""
    row = fit.gloss.rows[number]
    lobes = () if fit.lobes is None else fit.lobes.each[number]
    angle2 = (at * np.exp(row[1])) ** 2
    first = np.exp(row[0]) * facet_density(angle2, row[1], row[TAIL], with_tail=False).value
    return first + sum(beta * facet_density(angle2, np.log(gamma), np.zeros(1)).value for beta, gamma in lobes)
