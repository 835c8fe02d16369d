"""Noise of a sensor, estimated from frames by the photon transfer curve.

The variance of a linear signal S [DN] is S/g + (r/g)² + rounding, with the gain g [e⁻/DN] and the read noise r [e⁻]
(Janesick 2007, "Photon Transfer"). The difference of two frames of one exposure does not contain the scene. In a single
frame the noise is measured at the highest spatial frequencies of smooth regions, which a lens passes least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import robust_scale
from hagoromo.photograph.development.exposure import Exposure, planes

SIGNAL_BINS = 24  # number of bins of the signal, per pair and colour
FEWEST_PER_BIN = 200  # least number of samples of a bin
CLIPPING_DISTANCE = 5.0  # least distance of a bin from the clipping level [standard deviations]
LEAST_SIGNIFICANCE = 5.0  # standard errors by which 1/gain must exceed 0; just significant ones are too large
LEAST_NOISE = 3.0  # least variance of a bin, in those of rounding: where noise is below 0.4 DN, rounding is no noise
NOISE_REWEIGHTINGS = 5
# Order of the differences of rows and of columns that suppress the scene, and the share of the samples of a level that
# is used, those of least gradient; from the most precise to the one that suppresses texture best.
DIFFERENCES = ((2, 1.0), (4, 0.5), (8, 0.25), (12, 0.25))
TEXTURE_TOLERANCE = 0.03  # excess over the last of these, beyond its error, from which a difference is texture
MEDIAN_EFFICIENCY = 0.37  # of a variance by the median absolute value, relative to the mean square (Hampel 1974)
BAND_ROWS, MOST_SAMPLES = 128, 1_000_000  # of a colour of a large frame: bands of rows, and samples in them


class NoiseBin(NamedTuple):
    """A bin of samples: mean signal [DN], their variance and that of rounding [DN²], number of independent samples."""

    level: float
    variance: float
    rounding: float
    count: float


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
        roundings = (np.broadcast_to(np.float32(frame.rounding), frame.signal.shape) for frame in (one, other))
        parts = (planes(a, one.mosaic) for a in (one.signal, other.signal, good, *roundings))
        for a, b, ok, near, far in zip(*parts, strict=True):
            sums = [float(signal[ok].sum(dtype=np.float64)) for signal in (a, b)]
            if other.seconds > one.seconds and min(sums) <= 0.0:
                continue  # a colour without light has no ratio
            r = sums[1] / sums[0] if other.seconds > one.seconds else 1.0
            both = 1.0 + 1.0 / r**2
            level = (a + b) / (1.0 + r) * (1.0 + 1.0 / r) / both
            difference = (a - b / r) / np.sqrt(both)
            rounding = (near + far / r**2) / both
            rows += _binned(_neighbours(level)[ok], level[ok], difference[ok], rounding[ok], one.white)
    if not rows:
        raise InputError("two exposures share no signal above black: state gain and read_noise (--gain, --read-noise)")
    return _fit(rows, "pairs of frames")


def noise_from_frames(frames: Sequence[Exposure]) -> Noise:
    """Gain and read noise from single frames: differences of high order between neighbours of one colour.

    The n-th difference of rows and columns passes noise and suppresses what a lens has blurred, the more the larger n
    is (n = 2: Immerkær 1996, "Fast noise variance estimation"), and the fewer independent samples remain. The lowest
    order is taken whose variance is that of the highest.
    """
    every: list[dict[tuple[int, int, int], NoiseBin]] = [{} for _ in DIFFERENCES]
    for number, frame in enumerate(frames):
        rounding = np.broadcast_to(np.float32(frame.rounding), frame.signal.shape)
        colours = zip(*(planes(a, frame.mosaic) for a in (frame.signal, frame.full, rounding)), strict=True)
        for colour, parts in enumerate(colours):
            samples, full, coarse = (_bands(part) for part in parts)
            for rows, (order, share) in zip(every, DIFFERENCES, strict=True):
                for k, row in _difference_rows(samples, full, coarse, frame.white, order, share).items():
                    rows[number, colour, k] = row
    return _fit(_without_texture(every), "single frames (strong texture adds to it)")


def _without_texture(every: Sequence[dict[tuple[int, int, int], NoiseBin]]) -> list[NoiseBin]:
    """Of the rows by each of `DIFFERENCES`, the most precise that have no more variance than those of highest order.

    If only the highest order will do, its texture is removed as well: the leak falls as 1/order, because the power of
    the difference is a Gaussian of variance 2/order around the highest frequency.
    """
    usable = [(order, rows) for (order, _), rows in zip(DIFFERENCES, every, strict=True) if rows]
    if not usable:
        return []
    n, strict = usable[-1]
    error = 1.25 * np.sqrt(2.0 / sum(row.count for row in strict.values()))  # of a median of their ratios
    for _, rows in usable[:-1]:
        common = [rows[key].variance / strict[key].variance for key in strict.keys() & rows.keys()]
        if common and np.median(common) < 1.0 + TEXTURE_TOLERANCE + error:
            return list(rows.values())
    if len(usable) == 1:
        return list(strict.values())
    m, weaker = usable[-2]
    a, b = n / (n - m), m / (n - m)  # V at 1/order → 0, linear through both
    return [
        row._replace(
            variance=a * row.variance - b * weaker[key].variance,
            count=1.0 / (a**2 / row.count + b**2 / weaker[key].count),
        )
        for key, row in strict.items()
        if key in weaker
    ]


def _bands(samples: NDArray) -> NDArray:
    """(bands, rows, columns): bands of rows over a large frame, or all of a small one."""
    rows, columns = samples.shape
    most = max(1, MOST_SAMPLES // (BAND_ROWS * columns))
    if rows <= BAND_ROWS * most:
        return samples[None]
    starts = np.linspace(0, rows - BAND_ROWS, most).astype(int)
    return np.stack([samples[start : start + BAND_ROWS] for start in starts])


def _difference_rows(
    samples: NDArray, full: NDArray, coarse: NDArray, white: float, order: int, share: float
) -> dict[int, NoiseBin]:
    """Number of the bin → signal and variance of the smoothest `share` of the samples in that bin of the signal."""
    from scipy.ndimage import convolve1d, maximum_filter1d

    if min(samples.shape[1:]) <= 2 * order:
        return {}
    difference = np.array([1.0])
    for _ in range(order):
        difference = np.convolve(difference, [1.0, -1.0])
    mean = np.abs(difference) / np.abs(difference).sum()  # passes nothing at the frequency where the difference peaks
    difference /= np.linalg.norm(difference)
    values = samples.astype(np.float64)
    rough, level = (convolve1d(convolve1d(values, of, 1), of, 2) for of in (difference, mean))
    slope = np.hypot(np.gradient(level, axis=1), np.gradient(level, axis=2))
    fine = np.logical_not(maximum_filter1d(maximum_filter1d(full, order + 1, 1), order + 1, 2))
    edge = order // 2
    fine[:, :edge] = fine[:, -edge:] = fine[:, :, :edge] = fine[:, :, -edge:] = False
    rough, level, slope, coarse = rough[fine], level[fine], slope[fine], coarse[fine]
    # the power of the difference is about a Gaussian of standard deviation √(2/order) in both frequencies
    independent, rows = MEDIAN_EFFICIENCY * 2.0 / (np.pi * order), {}
    bins = int(np.clip(DIFFERENCES[-1][1] * len(level) / FEWEST_PER_BIN, 1, SIGNAL_BINS))
    for k, part in enumerate(np.array_split(np.argsort(level, kind="stable"), bins)):
        chosen = part[np.argsort(slope[part], kind="stable")[: int(np.ceil(share * len(part)))]]
        if len(chosen) < FEWEST_PER_BIN:
            continue
        variance = robust_scale(rough[chosen]) ** 2
        count, at = independent * len(chosen), float(level[chosen].mean())
        if variance > 0.0 and at + CLIPPING_DISTANCE * np.sqrt(variance) < white:
            rows[k] = NoiseBin(at, variance, float(coarse[chosen].mean()), count)
    return rows


def _neighbours(samples: NDArray) -> NDArray[np.float64]:
    """Mean of the eight neighbours of each sample, whose noise is independent of its own."""
    from scipy.ndimage import uniform_filter

    return (9.0 * uniform_filter(samples.astype(np.float64), 3, mode="reflect") - samples) / 8.0


def _binned(by: NDArray, mean: NDArray, deviation: NDArray, rounding: NDArray, white: float) -> list[NoiseBin]:
    """Bins of equally many samples, sorted `by` a quantity without their noise."""
    order, rows = np.argsort(by, kind="stable"), []
    for part in np.array_split(order, max(1, min(SIGNAL_BINS, len(order) // FEWEST_PER_BIN))):
        if len(part) < FEWEST_PER_BIN:
            continue
        level, variance = float(mean[part].mean()), float(deviation[part].var(ddof=1))
        if level + CLIPPING_DISTANCE * np.sqrt(variance) < white and variance > 0.0:
            rows.append(NoiseBin(level, variance, float(rounding[part].mean()), float(len(part))))
    return rows


def _fit(rows: list[NoiseBin], source: str) -> Noise:
    from scipy.optimize import nnls

    rows = [row for row in rows if row.variance > LEAST_NOISE * row.rounding]
    if len(rows) < 2:
        raise InputError(
            "the frames have too few unclipped pixels to estimate their noise: state gain and read_noise (--gain, "
            "--read-noise)"
        )
    level, variance, rounding, count = np.array(rows, np.float64).T
    design, known = np.stack([level, np.ones_like(level)], axis=1), np.maximum(rounding, 1e-3 * np.median(variance))
    model, covariance, slope, floor = np.maximum(variance, known), np.eye(2), 0.0, 0.0
    for _ in range(NOISE_REWEIGHTINGS):  # the weights follow the model, not the noise of each bin
        weight = count / (2.0 * model**2)
        root, scale = np.sqrt(weight), np.linalg.norm(np.sqrt(weight)[:, None] * design, axis=0)
        # neither part of the variance is below 0, and rounding is always in it: no weight can explode
        slope, floor = (float(k) for k in nnls(root[:, None] * design / scale, root * (variance - rounding))[0] / scale)
        covariance = np.linalg.pinv(design.T @ (weight[:, None] * design))
        model = np.maximum(design @ (slope, floor) + rounding, known)
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
