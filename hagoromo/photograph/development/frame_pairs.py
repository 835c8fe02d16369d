"""Frame pairs: the variance of differences of two frames of one scene, which do not contain it.

For exposures 1 : r the difference a − b/r has the variance V(a) + V(b)/r². What the scene leaves in it, as the lamp
drifted, the camera moved or black was off, is fitted and removed: a constant, a share of the scene that varies over the
picture, and its gradients. All this is taken from the neighbours of a sample, whose noise is not its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from hagoromo.photograph.development.exposure import Exposure, planes
from hagoromo.photograph.development.noise import PARTS, NoiseBin

BINS = 12  # of the signal, per pair and colour
FEWEST = 200  # least number of samples of a bin, or of a part of one
CLIPPING_DISTANCE = 5.0  # least distance of a bin from the clipping level [standard deviations]
OUTLIER = 5.0  # standard deviations from which a sample is no noise: hot, or struck by a particle
CUT_OFF = 0.01  # share of samples below the least number of a frame, where they are cut off, which leaves a mean right
SAME_RATIO = 0.12  # largest relative difference of the ratio of two frames from that of their times
SAME_SCENE = 0.15  # largest relative difference of two frames of one scene, over blocks
FLATTENED = 0.005  # relative error of a slope, by noise of what it is taken over, up to which it is used
BLACK_OFF = 1.2  # [DN] by which black may be off in either
BLOCK = 16  # samples of a colour along each side of a block
BAND_ROWS, MOST_SAMPLES = 128, 500_000  # of a colour of a large frame: bands of rows, and samples in them
Array = NDArray[np.float64]


def pair_rows(one: Exposure, other: Exposure, number: int) -> list[NoiseBin]:
    """The rows of a pair, `other` with as much light as `one` or more; number: of the pair."""
    good = ~(one.full | other.full)
    ratio = ratio_of(one, other, good)
    roundings = (np.broadcast_to(np.float32(frame.rounding), frame.signal.shape) for frame in (one, other))
    parts = (planes(a, one.mosaic) for a in (one.signal, other.signal, good, *roundings))
    rows = []
    for a, b, ok, near, far in zip(*parts, strict=True):
        for band in _bands(a.shape):
            rows += _rows_of_plane(a[band], b[band], ok[band], (near[band] + far[band] / ratio**2), ratio, one.white)
    return [row._replace(pair=number) for row in rows]


def cut_share(around: Array, deviation: Array | float, least: float, rounding: float) -> Array:
    """Share of samples with such noise that is cut off at `least`, the least number of a frame.

    around: means of the neighbours of the samples. deviation: of their noise; no less than half a step is taken, as it
    is too small where noise is cut off. All [DN]. rounding: its variance [DN²].
    """
    half = np.sqrt(3.0 * rounding)  # of the step between numbers
    return np.asarray(ndtr((least - half - around) / np.maximum(deviation, max(half, 1e-30))), np.float64)


def ratio_of(one: Exposure, other: Exposure, good: NDArray[np.bool_]) -> float:
    """other/one by the light of all colours, where `good`; that of the stated times where the light is far from it.

    By the slope of one over the other, on which no black level acts, unless the scene has too little contrast for it.
    """
    first, second = (float(frame.signal[good].sum(dtype=np.float64)) for frame in (one, other))
    measured = _slope(one, other, good) or (second / first if first > 0.0 and second > 0.0 else np.nan)
    if one.exif.exposure_s is None or other.exif.exposure_s is None:
        return measured if np.isfinite(measured) else 1.0
    stated = other.seconds / one.seconds
    return measured if abs(np.log(measured / stated)) < SAME_RATIO else stated


def _slope(one: Exposure, other: Exposure, good: NDArray[np.bool_]) -> float | None:
    """Slope of `other` over `one` by means over blocks of each colour; None where noise flattens it."""
    squares, products, by_noise = 0.0, 0.0, 0.0
    for a, b, ok in zip(*(planes(part, one.mosaic) for part in (one.signal, other.signal, good)), strict=True):
        share, first, second, power = (_blocks(part) for part in (ok, a * ok, b * ok, a * a * ok))
        known = share > 0.5
        first, second, power = (part[known] / share[known] for part in (first, second, power))
        if first.size > 1:
            off = first - first.mean()
            squares, products = squares + float(np.sum(off**2)), products + float(np.sum(off * second))
            by_noise += float(np.sum(np.maximum(power - first**2, 0.0))) / BLOCK**2
    return products / squares if products > 0.0 and by_noise < FLATTENED * squares else None


def one_scene(one: Exposure, other: Exposure) -> bool:
    """Whether both frames show one scene in one light: means over blocks of each colour have one ratio.

    It is that of the stated times, where both have one.
    """
    if one.signal.shape != other.signal.shape or one.mosaic != other.mosaic:
        return False
    good = ~(one.full | other.full)
    ratio = ratio_of(one, other, good)
    squares, off, by_noise = 0.0, 0.0, 0.0
    for a, b, ok in zip(*(planes(part, one.mosaic) for part in (one.signal, other.signal, good)), strict=True):
        share, first, second, *powers = (_blocks(part) for part in (ok, a * ok, b * ok, a * a * ok, b * b * ok))
        known = share > 0.5
        first, second, *powers = (part[known] / share[known] for part in (first, second, *powers))
        left = second - ratio * first
        if left.size:
            left = left - np.clip(np.median(left), -BLACK_OFF * (1.0 + ratio), BLACK_OFF * (1.0 + ratio))
        squares, off = squares + float(np.sum((ratio * first) ** 2)), off + float(np.sum(left**2))
        spread = powers[1] - second**2 + ratio**2 * (powers[0] - first**2)
        by_noise += float(np.sum(np.maximum(spread, 0.0))) / BLOCK**2
    return squares > 0.0 and off < SAME_SCENE**2 * squares + 2.0 * by_noise < squares


def _blocks(plane: NDArray) -> Array:
    """Means over blocks of BLOCK × BLOCK samples."""
    rows, columns = (max(size // BLOCK, 1) for size in plane.shape)
    high, wide = (plane.shape[0] // rows * rows, plane.shape[1] // columns * columns)
    whole = plane[:high, :wide].astype(np.float64)
    return whole.reshape(rows, high // rows, columns, wide // columns).mean(axis=(1, 3))


def _rows_of_plane(
    a: NDArray, b: NDArray, ok: NDArray[np.bool_], rounding: NDArray, ratio: float, white: float
) -> list[NoiseBin]:
    if np.count_nonzero(ok) < FEWEST or min(a.shape) < 2:
        return []
    a, b = a.astype(np.float64), b.astype(np.float64)
    near, far = neighbours(a), neighbours(b)
    level, own, difference = (a + b) / (1.0 + ratio), (near + far) / (1.0 + ratio), a - b / ratio
    left, steep = _without_scene(level, own, difference, ok), _steepness(level)
    shares = 1.0 + 1.0 / ratio, 1.0 + 1.0 / ratio**2
    least, longer, rows = (float(a[ok].min()), float(b[ok].min())), max(ratio, 1.0), []
    level, own, left, steep = (part[ok] for part in (level, own, left, steep))
    rounding, near, far = (part[ok] for part in (rounding, near, far))
    for chosen in np.array_split(np.argsort(own, kind="stable"), max(1, min(BINS, len(own) // (PARTS * FEWEST)))):
        mean, spread = float(own[chosen].mean()), float(left[chosen].std())
        if longer * (mean + CLIPPING_DISTANCE * spread) > white:
            continue
        step = float(rounding[chosen].mean()) / shares[1]
        first = cut_share(near[chosen], spread, least[0], step)
        if max(float(first.mean()), float(cut_share(far[chosen], ratio * spread, least[1], step).mean())) > CUT_OFF:
            continue
        smooth = chosen[np.argsort(steep[chosen], kind="stable")]
        for part, few in enumerate(np.array_split(smooth, PARTS if len(smooth) >= PARTS * FEWEST else 1)):
            variance, count = _variance(left[few])
            if variance > 0.0 and count >= FEWEST:
                mean, rough = max(float(level[few].mean()), 0.0), float(np.mean(steep[few] ** 2))
                whole = float(rounding[few].mean())
                rows.append(NoiseBin(mean * shares[0], shares[1], variance, whole, count, rough, part=part))
    return rows


def _without_scene(level: Array, own: Array, difference: Array, ok: NDArray[np.bool_]) -> Array:
    """`difference` less a constant, a share of the scene that varies over the picture, and its gradients.

    The shares are fitted to the level that the neighbours give, `own`, and taken from that of the sample.
    """
    rows, columns = (np.linspace(-1.0, 1.0, size) for size in level.shape)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    fields = [np.ones_like(level), x, y, x * x, x * y, y * y]
    gradients = [np.asarray(np.gradient(level, axis=axis)) for axis in (0, 1)]
    weight = 1.0 / np.sqrt(np.maximum(own, 0.0) + 0.02 * max(float(own[ok].mean()), 0.0) + 1.0)
    design = np.stack([np.ones_like(level), *(field * own for field in fields), *gradients])[:, ok] * weight[ok]
    found = np.linalg.lstsq(design.T, difference[ok] * weight[ok], rcond=None)[0]
    scene = sum(share * field for share, field in zip(found[1:7], fields, strict=True)) * level
    return (
        difference
        - found[0]
        - scene
        - sum(move * gradient for move, gradient in zip(found[7:], gradients, strict=True))
    )


def _steepness(level: Array) -> Array:
    """Gradient of the scene, smoothed without the sample's own noise."""
    across, down = (neighbours(np.asarray(np.gradient(level, axis=axis))) for axis in (1, 0))
    return np.hypot(across, down)


def _variance(samples: Array) -> tuple[float, float]:
    """Variance of the samples that are noise, and how many these are."""
    for _ in range(2):
        samples = samples[np.abs(samples - samples.mean()) <= OUTLIER * max(float(samples.std()), 1e-30)]
    return float(samples.var(ddof=1)) if len(samples) > 1 else 0.0, float(len(samples))


def neighbours(samples: Array) -> Array:
    """Mean of the eight neighbours of each sample, whose noise is independent of its own."""
    from scipy.ndimage import uniform_filter

    return (9.0 * uniform_filter(samples, 3, mode="reflect") - samples) / 8.0


def _bands(shape: tuple[int, ...]) -> list[slice]:
    """Bands of rows over a large plane, or all of a small one."""
    rows, columns = shape
    most = max(1, MOST_SAMPLES // (BAND_ROWS * columns))
    if rows <= BAND_ROWS * most:
        return [slice(0, rows)]
    return [slice(start, start + BAND_ROWS) for start in np.linspace(0, rows - BAND_ROWS, most).astype(int)]
