"""Neighbours: where a pixel's own photographs hardly determine its normal, those of the pixels around it do.

A pixel that few lamps light and in which the shadow of one ends has a normal of a large variance. Its neighbours have
small ones. With their mean n̄ by inverse variance, and the variance of one of them about it, both are joined as two
measurements of one normal. Where normals differ around the pixel, as at an edge, that variance is large, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import correlate

from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.smooth_normals import bodies_at, known_variance
from hagoromo.measurement.normals.views import Array, Views

SIZE = 5  # pixels of a side of the square of neighbours
TIMES = 25.0  # the variance of a neighbour about their mean, from which a normal is joined with it


def with_neighbours(views: Views, fit: Fit, place: Array | None = None) -> Fit:
    """`fit` of `views`, in which normals of variances far above those of their neighbours are joined with these.

    place: (P, 2) of pixels that are part of an object.
    """
    variance = known_variance(fit.variance)
    mean, of_mean = around(views, fit.normals, variance)
    poor = variance > TIMES * of_mean
    if not poor.any():
        return fit
    own, other = 1.0 / variance[:, None], 1.0 / of_mean[:, None]
    joined = own * fit.normals + other * mean
    joined /= np.linalg.norm(joined, axis=1, keepdims=True)
    found = replace(
        fit,
        normals=np.where(poor[:, None], joined, fit.normals),
        variance=np.where(poor, 1.0 / (own + other)[:, 0], fit.variance),
    )
    return replace(found, body=np.where(poor, bodies_at(views, found, place), fit.body))


def around(views: Views, normals: Array, variance: Array) -> tuple[Array, Array]:
    """Mean (P, 3), unit, of the neighbours of each pixel by inverse variance, and the variance (P,) [rad²] of one of
    them about it, infinite where there is none.
    """
    weight, rows, columns = 1.0 / variance, views.rows - views.rows.min(), views.columns - views.columns.min()
    shape, others = (rows.max() + 1, columns.max() + 1), np.ones((SIZE, SIZE))
    others[SIZE // 2, SIZE // 2] = 0.0

    def total(pixels: Array) -> Array:
        whole = np.zeros(shape)
        whole[rows, columns] = pixels
        return np.asarray(correlate(whole, others, mode="constant"))[rows, columns]

    norm, count = total(weight), total(np.ones(len(weight)))
    mean = np.stack([total(weight * part) for part in normals.T], axis=1) / np.maximum(norm, 1e-12)[:, None]
    length = np.linalg.norm(mean, axis=1)
    spread = np.maximum(1.0 - length**2, 0.0)  # mean square distance of unit vectors from their mean
    known = (count > 2.0) & (length > 0.0) & (norm > 1e-12)
    found = np.where(known, spread + count / np.maximum(norm, 1e-12), np.inf)
    return np.where(known[:, None], mean / np.maximum(length, 1e-12)[:, None], normals), found
