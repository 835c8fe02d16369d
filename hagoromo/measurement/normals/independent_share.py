"""Independent share: how many independent values a photograph has per pixel.

It is Σ r² over Σ (Σ r)² of tiles half the object's radius wide: 1/C for residuals r that are noise, and one a tile for
an error of the model that is the same all over a tile and in all C channels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import NORMAL_MEDIAN
from hagoromo.measurement.normals.photometric_model import Fit, predicted, size
from hagoromo.measurement.normals.photometric_step import PixelStep
from hagoromo.measurement.normals.views import Array, Views

FARTHEST = 3.0  # robust standard deviations to which residuals are cut off


def independent_share(views: Views, fit: Fit) -> float:
    """The share of all pixels of `views`, by the residuals of `fit` under even lamps."""
    deviation = views.values - predicted(fit, views.to_lamp, views.to_eye)
    side = max(int(0.5 * np.sqrt(len(views.rows) / np.pi)), 1)
    tile = (views.rows // side) * (views.shape[1] // side + 1) + views.columns // side
    return _share(views, deviation, tile)


def share_of_step(step: PixelStep) -> float:
    """The share of the pixels of the problem of `step`, by its residuals."""
    tile = np.floor(2.0 * step.problem.place).astype(np.int64)  # radii of the object
    tile -= tile.min(axis=0)
    return _share(step.problem.views, step.deviation, tile[:, 1] * (int(tile[:, 0].max()) + 1) + tile[:, 0])


def _share(views: Views, deviation: Array, tile: NDArray[np.integer]) -> float:
    scale = np.maximum(size(views)[:, 0], 1e-30)  # 0 for a pixel that is dark in all photographs
    relative = np.where(views.used, deviation.mean(axis=1) / scale, 0.0)
    limit = FARTHEST * np.sqrt(np.median(relative[views.used] ** 2) / NORMAL_MEDIAN)
    relative = np.clip(relative, -limit, limit)
    sums = sum(float(np.sum(np.bincount(tile, row) ** 2)) for row in relative)
    return float(min(np.sum(relative**2) / max(sums, 1e-30), 1.0)) / views.values.shape[1]
