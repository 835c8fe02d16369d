"""The bench of the study of responses: lights and charts that a camera reads, the priors without it, and its score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.calibration.response.calibrate_response import overlap_matrix
from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.curve_process import NODES, published_process
from hagoromo.calibration.response.published_curves import COMPONENTS, MEANS
from studies.response_prior import latent

READING_NOISE = 0.01  # standard deviation of a reading, relative to it
CURVE_WAVELENGTHS = np.arange(400.0, 721.0, 10.0)  # [nm], those of the measured curves
PUBLISHED = 39  # number of cameras in the mean of the prior
LEAST_PEAK_SHARE = 0.05  # of a curve's peak, above which coverage is counted by itself
Array = NDArray[np.float64]


def known_lights() -> Array:
    """(115, wavelengths): colour-science's illuminants and light sources, of mean 1."""
    import colour

    sources = [*colour.SDS_ILLUMINANTS.values(), *colour.SDS_LIGHT_SOURCES.values()]
    spectra = np.array([hg.Spectrum(of.wavelengths, of.values).at(CURVE_WAVELENGTHS) for of in sources])
    return spectra / spectra.mean(axis=1, keepdims=True)


def chart_under(lamps: tuple[str, ...]) -> Array:
    """(24 · lamps, wavelengths): matrix of the readings of a ColorChecker under `lamps`, each of mean 1."""
    patches = np.array([patch.at(CURVE_WAVELENGTHS) for patch in hg.chart_spectra()])
    lights = [hg.Spectrum.named(lamp).at(CURVE_WAVELENGTHS) for lamp in lamps]
    return np.concatenate([patches * light / light.mean() for light in lights]) @ overlap_matrix(CURVE_WAVELENGTHS)


def priors_without(camera: hg.Response, channel: str, wavelengths: Array) -> list[CurvePrior]:
    """The priors of a channel, `camera` left out of the mean of the published cameras."""
    figures, inside = MEANS[channel], (NODES >= CURVE_WAVELENGTHS[0]) & (NODES <= CURVE_WAVELENGTHS[-1])
    own = camera.curve("RGB".index(channel)).at(NODES)
    mean = np.array(figures.mean)
    mean[inside] -= (latent(own / own[inside].mean())[inside] - mean[inside]) / (PUBLISHED - 1)
    process = published_process(wavelengths, mean, np.array(COMPONENTS[channel]), figures)
    published, smooth = priors_of(channel, wavelengths)
    return [replace(published, mean=process[0], kernel=process[1]), smooth]


def correlation(curve: Array, true: Array) -> float:
    """Of a fitted curve with the true one; 0 for a fit that is 0."""
    return float(np.corrcoef(curve, true)[0, 1]) if curve.any() else 0.0


def summary(values: Array) -> dict[str, dict[str, float]]:
    """Channel → median and 10th percentile of values (cameras, 3)."""
    ends = zip(np.median(values, axis=0), np.percentile(values, 10, axis=0), strict=True)
    return {name: {"median": float(m), "p10": float(p)} for name, (m, p) in zip("RGB", ends, strict=True)}
