"""Noise of a sensor, estimated from frames by the photon transfer curve.

The variance of a linear signal S [DN] is S/g + (r/g)² + rounding, with the gain g [e⁻/DN] and the read noise r [e⁻]
(Janesick 2007, "Photon Transfer"). The difference of two frames of one exposure does not contain the scene. In a single
frame the noise is measured between neighbours of the same colour, where texture adds to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares import robust_scale
from hagoromo.photograph.development.exposure import Exposure, planes

SIGNAL_BINS = 24  # number of bins of the signal, per pair and colour
FEWEST_PER_BIN = 200  # least number of samples of a bin
CLIPPING_DISTANCE = 5.0  # least distance of a bin from the clipping level [standard deviations]
LEAST_SIGNIFICANCE = 3.0  # standard errors by which 1/gain must exceed 0
NOISE_REWEIGHTINGS = 5
SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0]) / 6.0  # of unit variance
SMOOTH_SHARE = 0.25  # share of the samples of a level that is used: those where the scene varies least
SAMPLES_PER_INDEPENDENT = 2.0  # samples per independent sample, because differences share neighbours


@dataclass(frozen=True)
class Noise:
    """gain [e⁻/DN] and read_noise [e⁻] with standard errors (0 if the user stated them); source: their origin."""

    gain: float
    read_noise: float
    gain_error: float = 0.0
    read_error: float = 0.0
    source: str = "stated"

    def __post_init__(self) -> None:
        """Check the figures once."""
        if not (np.isfinite(self.gain) and self.gain > 0.0 and np.isfinite(self.read_noise) and self.read_noise >= 0.0):
            raise InputError(
                f"gain {self.gain} e⁻/DN and read noise {self.read_noise} e⁻: the gain must be above 0, "
                "the read noise 0 or more"
            )

    def variance(self, signal: NDArray, rounding: NDArray | float) -> NDArray[np.float64]:
        """Variance [DN²] of a signal with expectation `signal` [DN]; one electron² is added, so that it is never 0."""
        return (np.maximum(signal, 0.0) + (1.0 + self.read_noise**2) / self.gain) / self.gain + rounding


def noise_from_pairs(pairs: Sequence[tuple[Exposure, Exposure]]) -> Noise:
    """Gain and read noise from pairs of frames of one scene, of equal or different exposure: flats, darks, a bracket.

    For exposures 1 : r the difference S₁ − S₂/r does not contain the scene; it has (1 + 1/r²) times the variance of a
    signal S₁ (1 + 1/r)/(1 + 1/r²). `InputError` if the signals do not determine the gain.
    """
    rows = []
    for one, other in pairs:
        good = ~(one.full | other.full)
        sums = (float(frame.signal[good].sum(dtype=np.float64)) for frame in (one, other))
        r = _ratio(*sums) if other.seconds > one.seconds else 1.0
        both = 1.0 + 1.0 / r**2
        roundings = (np.broadcast_to(np.float32(frame.rounding), frame.signal.shape) for frame in (one, other))
        parts = (planes(a, one.mosaic) for a in (one.signal, other.signal, good, *roundings))
        for a, b, ok, coarse, coarser in zip(*parts, strict=True):
            level = (a[ok] + b[ok]) / (1.0 + r) * (1.0 + 1.0 / r) / both
            difference = (a[ok] - b[ok] / r) / np.sqrt(both)
            rows += _binned(level, difference, (coarse[ok] + coarser[ok] / r**2) / both, one.white, robust=False)
    return _fit(rows, "pairs of frames")


def noise_from_frames(frames: Sequence[Exposure]) -> Noise:
    """Gain and read noise from smooth regions of single frames, between neighbours of the same colour.

    Uses the second difference of rows and columns (Immerkær 1996, "Fast noise variance estimation"), which suppresses
    the scene; remaining texture adds to the noise.
    """
    rows = []
    for frame in frames:
        rounding = np.broadcast_to(np.float32(frame.rounding), frame.signal.shape)
        parts = (planes(a, frame.mosaic) for a in (frame.signal, frame.full, rounding))
        for samples, full, coarse in zip(*parts, strict=True):
            around = _neighbours(samples)
            rough = np.tensordot(SECOND_DIFFERENCE, np.stack(around), axes=1)
            # without texture, differences of opposite neighbours are independent of the second difference
            across = np.max([np.abs(around[k] - around[8 - k]) for k in range(4)], axis=0)
            level = np.mean(around, axis=0)
            smooth = ~np.any(_neighbours(full), axis=0) & (across <= _local_quantile(level, across))
            rows += _binned(level[smooth], rough[smooth], coarse[1:-1, 1:-1][smooth], frame.white, robust=True)
    return _fit(rows, "single frames (texture adds to it)")


def _ratio(one: float, other: float) -> float:
    if not (one > 0.0 and other > 0.0):
        raise InputError("two exposures share no signal above black: state gain and read_noise (--gain, --read-noise)")
    return other / one


def _neighbours(samples: NDArray) -> list[NDArray]:
    """The 3 × 3 neighbourhood of each inner sample, by rows."""
    rows, columns = samples.shape
    return [samples[i : rows - 2 + i, j : columns - 2 + j] for i in range(3) for j in range(3)]


def _local_quantile(level: NDArray, spread: NDArray) -> NDArray:
    """The quantile SMOOTH_SHARE of `spread` among samples of about the same level."""
    edges = np.unique(np.quantile(level, np.linspace(0.0, 1.0, SIGNAL_BINS + 1)[1:-1]))
    place = np.digitize(level, edges)
    parts = (spread[place == k] for k in range(len(edges) + 1))
    return np.array([np.quantile(part, SMOOTH_SHARE) if part.size else 0.0 for part in parts])[place]


def _binned(
    mean: NDArray, deviation: NDArray, rounding: NDArray, white: float, robust: bool
) -> list[tuple[float, float, float]]:
    """(signal, variance without rounding, independent samples) of bins of equally many samples."""
    order, rows = np.argsort(mean, kind="stable"), []
    for part in np.array_split(order, max(1, min(SIGNAL_BINS, len(order) // FEWEST_PER_BIN))):
        if len(part) < FEWEST_PER_BIN:
            continue
        level, off = float(mean[part].mean()), deviation[part] - np.median(deviation[part])
        if robust:
            variance, count = robust_scale(off) ** 2, len(part) / SAMPLES_PER_INDEPENDENT
        else:
            variance, count = float(off.var(ddof=1)), float(len(part))
        if level + CLIPPING_DISTANCE * np.sqrt(variance) < white and variance > 0.0:
            rows.append((level, variance - float(rounding[part].mean()), count))
    return rows


def _fit(rows: list[tuple[float, float, float]], source: str) -> Noise:
    if len(rows) < 2:
        raise InputError(
            "the frames have too few unclipped pixels to estimate their noise: state gain and read_noise (--gain, "
            "--read-noise)"
        )
    level, variance, count = np.array(rows, np.float64).T
    design, model = np.stack([level, np.ones_like(level)], axis=1), np.maximum(variance, np.median(variance) * 1e-3)
    slope, floor, covariance = 0.0, 0.0, np.eye(2)
    for _ in range(NOISE_REWEIGHTINGS):  # the weights follow the model, not the noise of each bin
        weight = count / (2.0 * model**2)
        covariance = np.linalg.pinv(design.T @ (weight[:, None] * design))
        slope, floor = (float(k) for k in covariance @ (design.T @ (weight * variance)))
        model = np.maximum(design @ (slope, floor), 1e-3 * np.median(model))
    misfit = float((count / (2.0 * model**2) * (variance - model) ** 2).sum()) / max(len(rows) - 2, 1)
    covariance = covariance * max(misfit, 1.0)
    error = float(np.sqrt(covariance[0, 0]))
    if not slope > LEAST_SIGNIFICANCE * error:
        raise InputError(
            "the frames' noise does not grow with their signal: state gain and read_noise (--gain, --read-noise)"
        )
    gain, read = 1.0 / slope, np.sqrt(max(floor, 0.0)) / slope
    # r = √floor / slope; if the floor is 0 or less, the read noise is below its standard error
    gradient = np.array([-read / slope, 0.5 / (slope * np.sqrt(floor)) if floor > 0.0 else 0.0])
    spread = np.sqrt(gradient @ covariance @ gradient) if floor > 0.0 else np.sqrt(np.sqrt(covariance[1, 1])) / slope
    return Noise(float(gain), float(read), float(error / slope**2), float(spread), source)
