"""Gloss map: β and γ of every pixel where there is evidence for variation, each with its error; n is per material.

Enters: a capture of known shape, its materials and their labels. Leaves: maps, and in each material a record of the
variation; no map if one gloss fits every material. A pixel that no lamp shows near its highlight has the mean of its
material, with the spread over the material as its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import log_interval
from hagoromo.measurement.gloss.gloss_difference import WIDTHS, TriedLobe, glosses_differ
from hagoromo.measurement.gloss.gloss_spread import DECISIVE_LOG_ODDS, GlossSpread, gloss_spread
from hagoromo.measurement.gloss.pixel_gloss import LobeShape, PixelGlossFit
from hagoromo.measurement.material.quantity import log_albedo
from hagoromo.measurement.material.segment import interior
from hagoromo.measurement.observations import Observations, Pixels, known_shape, observe, observe_pixels
from hagoromo.measurement.parameters import pack_theta
from hagoromo.measurement.photometric.gloss_posterior import PixelGloss
from hagoromo.measurement.sight import Array
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import OF_LOBES, ROWS
from hagoromo.reflectance.torrance_sparrow import normal_fresnel

Channel = NDArray[np.floating]
GLOSS_CHANNELS = (*OF_LOBES, *(f"error.{key}" for key in OF_LOBES))  # channels of gloss.exr
TAIL_CHANNELS = ("nu", "error.nu")  # further ones, where facets have tails: ν is 0 for Gaussian ones
FEWEST_PHOTOGRAPHS = 6  # β, γ and a body colour need three angles per pixel: fewer lamps give them to a few pixels
MOST_VALUES = 1_000_000  # solved at once: 0.5 GiB
SEED = 0  # of the random choice of pixels from which the spread is estimated


@dataclass(frozen=True, eq=False)
class GlossMap:
    """Gloss (h, w), NaN where unknown: β [1/sr] and γ [rad], their standard errors, and α c_b with its own (h, w, C).

    Errors are those of a logarithm times the value: the 95 % interval of β is β exp(±1.96 error/β). Where photographs
    carry little information, the errors rely on the prior of the material: intervals are too narrow for a region whose
    gloss is so low that it is hardly measurable.
    nu: of the tails of the facets, infinite where they are Gaussian, and its standard error; on a solved shape of each
    pixel where it varies, else one for all pixels of a material. None: all facets are Gaussian.
    """

    beta: Array
    gamma: Array
    beta_error: Array
    gamma_error: Array
    body: Array
    body_error: Array
    nu: Array | None = None
    nu_error: Array | None = None

    def of_size(self, height: int, width: int) -> GlossMap:
        """The maps of an image of another size: that of the pixel at the same place."""
        rows = np.arange(height) * self.beta.shape[0] // height
        columns = np.arange(width) * self.beta.shape[1] // width
        parts = {key: None if one is None else one[np.ix_(rows, columns)] for key, one in vars(self).items()}
        return replace(self, **parts)

    def channels(self) -> dict[str, NDArray[np.float32]]:
        """The channels of an EXR: 0 where unknown; `nu`, where a material has tails, is 0 for Gaussian facets."""
        maps = dict(zip(GLOSS_CHANNELS, (self.beta, self.gamma, self.beta_error, self.gamma_error), strict=True))
        if self.nu is not None and self.nu_error is not None:
            maps |= zip(TAIL_CHANNELS, (self.nu, self.nu_error), strict=True)
        return {name: np.where(np.isfinite(one), one, 0.0).astype(np.float32) for name, one in maps.items()}


def gloss_from_channels(
    maps: Sequence[Channel], tails: Sequence[Channel] | None, body: Array, body_error: Array | None
) -> GlossMap:
    """The maps whose `channels` are GLOSS_CHANNELS and, with tails, TAIL_CHANNELS; body: α c_b (h, w, C)."""
    has_gloss = maps[0] > 0.0
    beta, gamma, beta_error, gamma_error = (np.where(has_gloss, one, np.nan).astype(np.float64) for one in maps)
    errors = np.full(body.shape, np.nan) if body_error is None else body_error
    found = GlossMap(beta, gamma, beta_error, gamma_error, body, errors)
    if tails is None:
        return found
    nu = np.where(has_gloss, np.where(tails[0] > 0.0, tails[0], np.inf), np.nan).astype(np.float64)
    return replace(found, nu=nu, nu_error=np.where(np.isfinite(nu) & (tails[1] > 0.0), tails[1], np.nan).astype(float))


def gloss_map(
    capture: Capture, labels: NDArray[np.integer], materials: Sequence[MaterialEstimate], white: Array | None = None
) -> tuple[tuple[MaterialEstimate, ...], GlossMap | None]:
    """The materials with records of their gloss, and the maps if gloss varies in at least one of them.

    labels: (h, w) index into `materials`. white: (C,) colour of the lamps if it was estimated.
    """
    spreads = [_spread(capture, labels, number, material, white) for number, material in enumerate(materials)]
    updated = tuple(
        material if spread is None else with_gloss(material, spread)
        for material, spread in zip(materials, spreads, strict=True)
    )
    if not any(spread is not None and spread.varies for spread in spreads):
        return updated, None
    shape = (*labels.shape, capture.photographs[0].values.shape[2])
    maps = GlossMap(*(np.full(shape[:2], np.nan) for _ in range(4)), *(np.full(shape, np.nan) for _ in range(2)))
    for number, (material, spread) in enumerate(zip(updated, spreads, strict=True)):
        pixels = Pixels.where(capture, (labels == number) & known_shape(capture))
        if spread is not None and spread.varies:
            _fill(maps, capture, pixels, spread, LobeShape.of(material), white)
        else:
            index = pixels.rows, pixels.columns
            for key in OF_LOBES:
                getattr(maps, key)[index] = getattr(material, key)
                getattr(maps, f"{key}_error")[index] = material.standard_error.get(key) or np.nan
    return updated, with_tails(maps, updated, labels)


def with_tails(maps: GlossMap, materials: Sequence[MaterialEstimate], labels: NDArray[np.integer]) -> GlossMap:
    """`maps` with ν of the material of each pixel, where a material has tails."""
    if not any(np.isfinite(material.nu) for material in materials):
        return maps
    of_material = [(material.nu, material.standard_error.get("nu") or np.nan) for material in materials]
    each = np.array([*of_material, (np.nan, np.nan)])[labels]  # the last one is that of label −1
    return replace(maps, nu=each[..., 0], nu_error=each[..., 1])


def _spread(
    capture: Capture, labels: NDArray[np.integer], number: int, material: MaterialEstimate, white: Array | None
) -> GlossSpread | None:
    """The spread of the gloss of a material; None where there are too few photographs or pixels."""
    if len(capture.photographs) < FEWEST_PHOTOGRAPHS or not material.identifiable["gamma"]:
        return None
    region = known_shape(capture) & interior(labels, number)
    samples = observe(capture, region, white, SEED)
    facing = normal_fresnel(material.n)
    start = np.log([material.beta * facing, material.gamma])
    spread = gloss_spread(samples, start, material.n, not material.identifiable["n"], LobeShape.of(material))
    if spread is None or not spread.varies:
        return spread
    return replace(spread, follows_angles=not _is_of_the_pixels(capture, samples, spread, LobeShape.of(material)))


def _is_of_the_pixels(capture: Capture, samples: Observations, spread: GlossSpread, shape: LobeShape) -> bool:
    """Whether pixels of high and of low gloss differ at the same angles; an unsuitable lobe shape does not cause that.

    The pixels are divided into halves by β, then by γ, and `glosses_differ` compares the facet densities of the halves.
    """
    fit = PixelGlossFit(samples, spread.n, spread.noise, shape)
    gloss, region = fit.solve(spread.law).gloss, np.zeros(capture.photographs[0].mask.shape, bool)
    region.flat[fit.pixels] = True
    pixels = Pixels.where(capture, region)  # in the order of the pixels of `fit`
    for quantity in range(2):
        half = (gloss[:, quantity] > np.median(gloss[:, quantity])).astype(np.int64)
        lobes = [_lobe(gloss[half == i].mean(axis=0)) for i in range(2)]
        if glosses_differ(capture, pixels, half, lobes):
            return True
    return False


def _lobe(gloss: Array) -> TriedLobe:
    return TriedLobe(int(np.argmin(np.abs(np.log(WIDTHS) - gloss[1]))), float(np.exp(gloss[0])))


def _fill(
    maps: GlossMap, capture: Capture, pixels: Pixels, spread: GlossSpread, shape: LobeShape, white: Array | None
) -> None:
    """Solve `pixels` of one material and write them into `maps`; the error of n is added to theirs."""
    index = pixels.rows, pixels.columns
    mean = np.exp(spread.law.mean) * (spread.beta_per_strength, 1.0)
    error = mean * np.sqrt(np.diag(spread.law.covariance) + spread.variance_by_n)
    for k, key in enumerate(OF_LOBES):
        getattr(maps, key)[index], getattr(maps, f"{key}_error")[index] = mean[k], error[k]
    values = len(capture.photographs) * maps.body.shape[2]
    size = max(MOST_VALUES // values, 1)
    for start in range(0, len(pixels), size):
        samples = observe_pixels(capture, pixels[np.arange(start, min(start + size, len(pixels)))], white)
        if not samples.used.any():
            continue
        fit = PixelGlossFit(samples, spread.n, spread.noise, shape)
        _put(maps, np.divmod(fit.pixels, maps.beta.shape[1]), fit.solve(spread.law), spread)


def _put(maps: GlossMap, index: tuple[NDArray, NDArray], estimates: PixelGloss, spread: GlossSpread) -> None:
    value = np.exp(estimates.gloss) * (spread.beta_per_strength, 1.0)
    error = value * np.sqrt(np.einsum("pii->pi", estimates.covariance) + spread.variance_by_n)
    maps.beta[index], maps.gamma[index] = value.T
    maps.beta_error[index], maps.gamma_error[index] = error.T
    known = estimates.body_error > 0.0  # 0 where a channel was not measured
    maps.body[index] = np.where(known, estimates.body, np.nan)
    maps.body_error[index] = np.where(known, estimates.body_error, np.nan)


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
