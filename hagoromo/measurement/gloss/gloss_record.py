"""Gloss record: the estimate of a material with the variation of its gloss over the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hagoromo.least_squares.log_interval import log_interval
from hagoromo.measurement.gloss.gloss_spread import DECISIVE_LOG_ODDS, GlossSpread
from hagoromo.measurement.material.quantity import log_albedo
from hagoromo.measurement.parameters import pack_theta
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import OF_LOBES, ROWS


def with_gloss(material: MaterialEstimate, spread: GlossSpread) -> MaterialEstimate:
    """`material` with the record of its gloss; if that varies, with its mean as β, γ and n, and a remark."""
    variation = spread.spread.tolist()
    record: dict[str, Any] = {
        "per_pixel": spread.varies,
        "variation": dict(zip(OF_LOBES, variation, strict=True)),
        "log_evidence": spread.log_evidence,
        "chi_square": {"shared": spread.chi_square[0], "per_pixel": spread.chi_square[1]},
    }
    record["convergence"] = {"pixels": spread.converged, "fits": [status.record() for status in spread.statuses]}
    if spread.log_evidence > DECISIVE_LOG_ODDS:
        material = replace(material, remarks=(*material.remarks, *unsettled_remarks(spread)))
    if spread.follows_angles:
        remark = "pixels differ in gloss as one lobe of another shape would make them: no maps of it are written"
        return replace(material, gloss=record, remarks=(*material.remarks, remark))
    if spread.log_evidence > DECISIVE_LOG_ODDS and not spread.varies:
        remark = (
            f"a gloss per pixel would explain only {100 * spread.explained:.2g} % of the lack of fit: it is not the "
            "gloss that varies, and no maps of it are written"
        )
        return replace(material, gloss=record, remarks=(*material.remarks, remark))
    if not spread.varies:
        return replace(material, gloss=record)
    remark = remark_on_variation(variation, f", ln odds {spread.log_evidence:.3g}")
    return replace(_with_middle(material, spread), gloss=record, remarks=(*material.remarks, remark))


def remark_on_variation(variation: Sequence[float], more: str) -> str:
    """One line for a gloss that varies; variation: standard deviations of ln β and ln γ over the pixels."""
    by = ", ".join(f"{ROWS[key].symbol} by {100 * one:.2g} %" for key, one in zip(OF_LOBES, variation, strict=True))
    means = f"{' and '.join(OF_LOBES)} are its geometric means"
    return f"the gloss varies from pixel to pixel ({by}{more}): it was estimated per pixel; {means}"


def unsettled_remarks(spread: GlossSpread) -> list[str]:
    """One line for each fit of the gloss that did not converge."""
    remarks = [status.remark("the gloss") for status in spread.statuses if not status.converged]
    if spread.converged < 1.0:
        remarks.append(f"the gloss of {100.0 * (1.0 - spread.converged):.2g} % of the pixels did not converge")
    return remarks


def _with_middle(material: MaterialEstimate, spread: GlossSpread) -> MaterialEstimate:
    """β, γ, n and specular albedo of the mean of the law; one shared gloss would fit none of the pixels."""
    n, n_identifiable = spread.n, spread.index.variance > 0.0
    beta, gamma = (np.exp(spread.law.mean) * (spread.beta_per_strength, 1.0)).tolist()
    of_albedo, by = log_albedo(pack_theta(np.ones(len(material.body_colour)), beta, gamma, n, material.nu)[None])
    value = {"beta": beta, "gamma": gamma, "n": n, "specular_albedo": float(np.exp(of_albedo[0]))}
    covariance = np.zeros((3, 3))  # of ln β F₀, ln γ, ln(n − 1)
    covariance[:2, :2], covariance[2, 2] = spread.covariance, spread.index.variance
    slopes = np.array([[1.0, 0.0, -4.0 / (n + 1.0)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, *by[0, -2:]]])
    covariance = slopes @ covariance @ slopes.T
    relative = np.sqrt(np.diag(covariance))
    error, interval = dict(material.standard_error), dict(material.interval_95)
    if spread.index.interval is not None:
        interval["n"] = spread.index.interval
        error["n"] = (n - 1.0) * float(relative[2]) if n_identifiable else None
    for i, key in ((0, "beta"), (1, "gamma"), (3, "specular_albedo")):
        error[key] = value[key] * float(relative[i])
        interval[key] = log_interval(value[key], float(relative[i]))
    if not n_identifiable:  # β holds for the chosen n only: over the interval of n it is proportional to 1/F₀
        strength = np.array([((m + 1.0) / (m - 1.0)) ** 2 for m in interval["n"]]) / spread.beta_per_strength
        interval["beta"] = (interval["beta"][0] * strength.min(), interval["beta"][1] * strength.max())
    identifiable = dict(material.identifiable) | {"beta": n_identifiable, "gamma": True, "n": n_identifiable}
    if spread.index.interval is None:
        identifiable = dict(material.identifiable)
    return replace(
        material,
        standard_error=error,
        interval_95=interval,
        correlation=_correlation(covariance[:3, :3]),
        identifiable=identifiable,
        **value,
    )


def _correlation(covariance: np.ndarray) -> tuple[tuple[float | None, ...], ...]:
    """Correlation of β, γ and n in the order of PARAMETERS; α was not estimated with them."""
    spread = np.sqrt(np.diag(covariance))
    rows: list[list[float | None]] = [[1.0, None, None, None]]
    for i in range(3):
        known = [bool(spread[i] * spread[j] > 0.0) for j in range(3)]
        values = [float(covariance[i, j] / (spread[i] * spread[j])) if known[j] else None for j in range(3)]
        rows.append([None, *values])
    return tuple(tuple(row) for row in rows)
