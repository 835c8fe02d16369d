"""Highlight shift: how far the strength and width of the highlight in the photographs are from those of its model.

In each bin of the half angle (`highlight_check`) the light of the highlight is the model's times 1 + R, by least
squares of what the model leaves. The model's lobes times 1 + R have a peak and a half width of their own: ln of their
ratios to the model's are errors of ln β and ln γ that the noise does not know. Every value counts in full: the robust
loss takes a highlight that the model lacks for outliers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.facets import facet_density
from hagoromo.measurement.material.misfit_shift import BINS, bin_ratios, peak_and_width
from hagoromo.measurement.normals.highlight_check import angles
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.shading import TAIL
from hagoromo.measurement.normals.views import Array, Views


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
