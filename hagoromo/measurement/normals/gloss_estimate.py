"""Gloss estimate: the Measurement of a photometric fit; body colour varies from pixel to pixel, gloss is shared."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.least_squares import NORMAL_95, Status
from hagoromo.measurement.material.quantity import log_albedo
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.pixel_fit import STILL_MOVING_SHARE
from hagoromo.measurement.normals.shading import N
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.parameters import pack_theta
from hagoromo.measurement.robust_fit import N_RANGE
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.facets import LEAST_NU
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

RELATIVE_LIMIT = 0.25  # largest relative standard error of an identifiable parameter
PARTS = 4.0 * math.pi  # independent parts of an object, each half its radius wide
NOTABLE = 2.0  # standard errors by which σ must differ from 0 to be remarked upon


def measurement_of(capture: Capture, normal_map: NormalMap) -> Measurement:
    """The Measurement of `capture` from its normals.

    alpha and body_colour of a material are medians over its pixels. n is not identifiable with lamps and eye on one
    side; it is set to 1.5. `InputError` when `normal_map` is of another capture.
    """
    fit, views = normal_map.fit, normal_map.views
    if len(capture.photographs) != len(views.values):
        raise InputError("the normals are of another capture: solve them for this one")
    model = fit.evenness(views.place)[:, None] * predicted(fit, views.to_lamp, views.to_eye)
    masks = np.stack([photograph.mask[views.rows, views.columns] for photograph in capture.photographs])
    residual = np.where(masks[:, None], (views.values - model) / np.sqrt(views.variance), np.nan)
    predictions, residuals = (
        tuple(views.image(one.T.astype(np.float32), np.nan) for one in values)
        for values in (model * views.light, residual)
    )
    materials = tuple(_material(normal_map, residual, number) for number in range(len(fit.gloss.rows)))
    labels = np.full(views.shape, -1)
    labels[views.rows, views.columns] = fit.labels
    return Measurement(materials, labels, predictions, residuals, normal_map.normals)


def _material(normal_map: NormalMap, residual: Array, number: int) -> MaterialEstimate:
    """The estimate of one material; left: (K, C, P) residuals in standard deviations of the noise."""
    fit = normal_map.fit
    mine = fit.labels == number
    body = np.median(fit.body[:, mine], axis=1)
    alpha, parts = float(body.mean()), max(PARTS * float(mine.mean()), 1.0)
    varies = float(np.std(fit.body[:, mine].mean(axis=0))) / alpha
    scatter = np.std(fit.body[:, mine] / fit.body[:, mine].mean(axis=0), axis=1) / math.sqrt(parts)
    colour, covariance = body / alpha, fit.covariance[number]
    beta, gamma = np.exp(fit.gloss.rows[number, :2]).tolist()
    log_of_albedo, gradient = log_albedo(pack_theta(body, beta, gamma, N)[None])
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
    identifiable = {key: relative[key] <= RELATIVE_LIMIT for key in ("alpha", "beta", "gamma")}
    identifiable |= dict.fromkeys(("n", "nu", "interface_colour"), False)
    both = float(covariance[0, 1]) / (relative["beta"] * relative["gamma"])
    return MaterialEstimate(
        name=f"material {number + 1}",
        pixels=int(mine.sum()),
        body_colour=tuple(colour.tolist()),
        interface_colour=(1.0,) * len(body),
        n=N,
        standard_error=error | {"n": None, "body_colour": tuple(scatter.tolist())},
        interval_95=interval | {"n": N_RANGE, "nu": (LEAST_NU, math.inf), "body_colour": of_colour},
        correlation=((1.0, None, None, None), (None, 1.0, both, None), (None, both, 1.0, None), (None,) * 4),
        identifiable=identifiable,
        chi_square=float(np.nanmean(residual[:, :, mine] ** 2)),
        remarks=(
            f"body colours are estimated per pixel: they vary by {100 * varies:.0f} % over the material",
            *_remarks(fit, number, identifiable),
        ),
        convergence=None if fit.status is None else fit.status.record(),
        **value,
    )


def _remarks(fit: Fit, number: int, identifiable: dict[str, bool]) -> list[str]:
    """Remarks on fits that did not converge, on the error of the model, and on parameters that are not identifiable."""
    remarks = [
        *_unsettled(fit, number),
        f"the error of the model is {100 * fit.model_error:.1f} %, in addition to the noise",
        f"n is not identifiable with all lamps on the camera's side: {N} was chosen, and beta holds for it",
        "without a given shape, tails of the facets and a colour of the interface are not estimated",
    ]
    sigma, error = float(fit.gloss.rows[number, 2]), math.sqrt(fit.covariance[number, 2, 2])
    if abs(sigma) > NOTABLE * error:
        way = "more" if sigma > 0.0 else "less"
        remarks.append(f"its body sends {way} light back than Lambert's law: roughness {sigma:.2f} ± {error:.2f}")
    unknown = [key for key in ("alpha", "beta", "gamma") if not identifiable[key]]
    if unknown:
        remarks.append(f"not identifiable from these photographs: {', '.join(unknown)}")
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
        if share > STILL_MOVING_SHARE:
            remarks.append(f"the normal of {100.0 * share:.2g} % of its pixels did not converge")
    return remarks


def _log_interval(value: float, relative: float) -> tuple[float, float]:
    """95 % interval of a number above 0 with this standard error of its logarithm."""
    return value * math.exp(-NORMAL_95 * relative), value * math.exp(NORMAL_95 * relative)
