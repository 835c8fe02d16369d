"""From the photometric fit to a Measurement: materials whose body colour varies from pixel to pixel, gloss shared."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.least_squares import Status
from hagoromo.measurement.material.quantity import log_albedo, theta_of
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.shading import N
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.robust_fit import N_RANGE
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

RELATIVE_LIMIT = 0.25  # largest relative standard error of a parameter that counts as told
NORMAL_95 = 1.959964
PARTS = 4.0 * math.pi  # independent parts of an object, half its radius wide
NOTABLE = 2.0  # standard errors by which σ must miss 0 to be remarked upon


def measurement_of(capture: Capture, found: NormalMap) -> Measurement:
    """The Measurement that the normals of `capture` amount to.

    alpha and body_colour of a material are medians over its pixels. n is not told by lamps and eye on one side: 1.5 by
    choice. `InputError` when `found` is of another capture.
    """
    fit, seen = found.fit, found.seen
    if len(capture.photographs) != len(seen.values):
        raise InputError("the normals are of another capture: solve them for this one")
    model = fit.evenness(seen.place)[:, None] * predicted(fit, seen.to_lamp, seen.to_eye)
    masks = np.stack([photograph.mask[seen.rows, seen.columns] for photograph in capture.photographs])
    left = np.where(masks[:, None], (seen.values - model) / np.sqrt(seen.variance), np.nan)
    predictions, residuals = (
        tuple(seen.image(one.T.astype(np.float32), np.nan) for one in values) for values in (model * seen.light, left)
    )
    materials = tuple(_material(found, left, number) for number in range(len(fit.gloss.rows)))
    labels = np.full(seen.shape, -1)
    labels[seen.rows, seen.columns] = fit.labels
    return Measurement(materials, labels, predictions, residuals, found.normals)


def _material(found: NormalMap, left: Array, number: int) -> MaterialEstimate:
    """The estimate of one material; left: (K, C, P) residuals in standard deviations of the noise."""
    fit = found.fit
    mine = fit.labels == number
    body = np.median(fit.body[:, mine], axis=1)
    alpha, parts = float(body.mean()), max(PARTS * float(mine.mean()), 1.0)
    varies = float(np.std(fit.body[:, mine].mean(axis=0))) / alpha
    scatter = np.std(fit.body[:, mine] / fit.body[:, mine].mean(axis=0), axis=1) / math.sqrt(parts)
    colour, covariance = body / alpha, fit.covariance[number]
    beta, gamma = np.exp(fit.gloss.rows[number, :2]).tolist()
    log_of_albedo, gradient = log_albedo(theta_of(body, beta, gamma, N)[None])
    slope = np.array([1.0, float(gradient[0, -2]), 0.0, 0.0])
    value = {"alpha": alpha, "beta": beta, "gamma": gamma, "specular_albedo": math.exp(float(log_of_albedo[0]))}
    relative = {
        "alpha": math.hypot(varies / math.sqrt(parts), fit.model_error),
        "beta": math.sqrt(covariance[0, 0]),
        "gamma": math.sqrt(covariance[1, 1]),
        "specular_albedo": math.sqrt(slope @ covariance @ slope),
    }
    error: dict[str, Any] = {key: value[key] * relative[key] for key in value}
    interval: dict[str, Any] = {key: _log_interval(value[key], relative[key]) for key in value}
    of_colour = tuple(
        (c - NORMAL_95 * s, c + NORMAL_95 * s) for c, s in zip(colour.tolist(), scatter.tolist(), strict=True)
    )
    told = {key: relative[key] <= RELATIVE_LIMIT for key in ("alpha", "beta", "gamma")} | {"n": False}
    both = float(covariance[0, 1]) / (relative["beta"] * relative["gamma"])
    return MaterialEstimate(
        name=f"material {number + 1}",
        pixels=int(mine.sum()),
        body_colour=tuple(colour.tolist()),
        interface_colour=(1.0,) * len(body),
        n=N,
        standard_error=error | {"n": None, "body_colour": tuple(scatter.tolist())},
        interval_95=interval | {"n": N_RANGE, "body_colour": of_colour},
        correlation=((1.0, None, None, None), (None, 1.0, both, None), (None, both, 1.0, None), (None,) * 4),
        identifiable=told,
        chi_square=float(np.nanmean(left[:, :, mine] ** 2)),
        remarks=(
            f"body colours are measured pixel by pixel: they vary by {100 * varies:.0f} % over the material",
            *_remarks(fit, number, told),
        ),
        convergence=None if fit.status is None else fit.status.record(),
        **value,
    )


def _remarks(fit: Fit, number: int, told: dict[str, bool]) -> list[str]:
    """What the photographs say of the model, and what they do not tell."""
    remarks = [
        *_unsettled(fit, number),
        f"the model is off by {100 * fit.model_error:.1f} % beside the noise",
        f"n is not told by lamps on the eye's side: {N} was chosen, and beta belongs to it",
    ]
    sigma, error = float(fit.gloss.rows[number, 2]), math.sqrt(fit.covariance[number, 2, 2])
    if abs(sigma) > NOTABLE * error:
        way = "more" if sigma > 0.0 else "less"
        remarks.append(f"its body sends {way} light back than Lambert's law: roughness {sigma:.2f} ± {error:.2f}")
    unknown = [key for key in ("alpha", "beta", "gamma") if not told[key]]
    if unknown:
        remarks.append(f"not told by these photographs: {', '.join(unknown)}")
    return remarks


def _unsettled(fit: Fit, number: int) -> list[str]:
    """One line for the fit of gloss and lamps, and one for the normals, where they did not converge."""
    remarks = []
    if fit.status is not None and not fit.status.converged:
        remarks.append(fit.status.remark("gloss and lamps"))
    if fit.shape_status is not None and not fit.shape_status.converged:
        remarks.append(fit.shape_status.remark("the surface under near lamps"))
    if fit.pixel_status is not None:
        share = float(np.mean(fit.pixel_status[fit.labels == number] != Status.CONVERGED))
        if share > 0.0:
            remarks.append(f"the normal of {100.0 * share:.2g} % of its pixels did not converge")
    return remarks


def _log_interval(value: float, relative: float) -> tuple[float, float]:
    """95 % interval of a number above 0 with this standard error of its logarithm."""
    return value * math.exp(-NORMAL_95 * relative), value * math.exp(NORMAL_95 * relative)
