"""Prediction of a photograph under a held-out lamp from the fit to the photographs under the other lamps.

Three forecasts, each on top of the one before: the reflectance on the normals; cast shadows of the integrated surface;
and what model and photographs disagreed on under the neighbouring lamps, interpolated over the lamps' directions
(simple kriging), which carries shadows, interreflection and the model's own errors to where they are likely again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.photometric_model import Fit, predicted

Array = NDArray[np.float64]
RANGES = np.radians([6.0, 9.0, 13.0, 18.0, 26.0, 38.0])  # candidates for the kernel's standard deviation
NUGGETS = (0.03, 0.1, 0.3)  # variance of noise over that of the disagreement


def forecast(fit: Fit, pixels: hg.Views, to_lamp: Array) -> Array:
    """(C, P) values under an even far lamp of strength 1 in direction `to_lamp` (3,): attached shadows only."""
    lamp = np.broadcast_to(to_lamp, (1, len(pixels.rows), 3))
    return predicted(fit, lamp, pixels.to_eye)[0]


def disagreement(fit: Fit, pixels: hg.Views, to_lamp: Array) -> Array:
    """(C, P) what the photographs in `seen` lead one to add to `forecast` under `to_lamp` (3,).

    Range and nugget of the kernel are those that best predict each of the photographs from the others.
    """
    lamps = pixels.to_lamp.mean(axis=1)
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    even = fit.evenness(pixels.place)[:, None]
    left = pixels.values / even - predicted(fit, pixels.to_lamp, pixels.to_eye)
    rows = left.reshape(len(lamps), -1)
    angle = np.arccos(np.clip(lamps @ lamps.T, -1.0, 1.0))
    best, chosen = np.inf, (RANGES[0], NUGGETS[0])
    spread = rows @ rows.T
    for reach in RANGES:
        for nugget in NUGGETS:
            inverse = np.linalg.inv(_kernel(angle, reach) + nugget * np.eye(len(lamps)))
            # leave-one-out residuals of kriging: [K⁻¹ r]_i / [K⁻¹]_ii (Dubrule 1983)
            error = float(np.sum(np.diag(inverse @ spread @ inverse) / np.diag(inverse) ** 2))
            if error < best:
                best, chosen = error, (reach, nugget)
    towards = np.arccos(np.clip(lamps @ to_lamp, -1.0, 1.0))
    matrix = _kernel(angle, chosen[0]) + chosen[1] * np.eye(len(lamps))
    weights = np.linalg.solve(matrix, _kernel(towards, chosen[0]))
    return np.tensordot(weights, left, axes=1)


def _kernel(angle: Array, reach: float) -> Array:
    return np.exp(-0.5 * (angle / reach) ** 2)
