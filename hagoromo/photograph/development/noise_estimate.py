"""Noise estimate: gain and read noise of one sensor from all its frames together.

Frames of one scene in one light, a bracket or flats, are compared in pairs, each with the next longer one; darks with
each other. Where no two frames show one scene, each is taken by itself.

Single frames: noise where no two frames show one scene, by differences of high order between neighbours.

In a single frame the noise is measured at the highest spatial frequencies of smooth regions, which a lens passes least.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import robust_scale
from hagoromo.photograph.development.exposure import Exposure, planes
from hagoromo.photograph.development.frame_pairs import one_scene, pair_rows
from hagoromo.photograph.development.noise import Noise, NoiseBin, noise_of_rows
from hagoromo.photograph.transforms import ASSUMED_FULL_WELL, ASSUMED_READ_NOISE

LIT = 5.0  # least signal of samples that have light [standard deviations]
PAIRS, SINGLE = "pairs of frames", "single frames (strong texture adds to it)"
SIGNAL_BINS = 24  # number of bins of the signal, per frame and colour
FEWEST_PER_BIN = 200  # least number of samples of a bin
CLIPPING_DISTANCE = 5.0  # least distance of a bin from the clipping level [standard deviations]
LEAST_NOISE = 3.0  # least variance of a bin, in those of rounding: where noise is below 0.4 DN, rounding is no noise
# Order of the differences of rows and of columns that suppress the scene, and the share of the samples of a level that
# is used, those of least gradient; from the most precise to the one that suppresses texture best.
DIFFERENCES = ((2, 1.0), (4, 0.5), (8, 0.25), (12, 0.25))
TEXTURE_TOLERANCE = 0.03  # excess over the last of these, beyond its error, from which a difference is texture
MEDIAN_EFFICIENCY = 0.37  # of a variance by the median absolute value, relative to the mean square (Hampel 1974)
BAND_ROWS, MOST_SAMPLES = 128, 1_000_000  # of a colour of a large frame: bands of rows, and samples in them
BLOOM_PX = 3  # [px] clipped samples flood neighbours up to this distance: these are treated as clipped


def usual_noise(exposure: Exposure) -> Noise:
    """The noise of a typical sensor."""
    return Noise(ASSUMED_FULL_WELL / exposure.white, ASSUMED_READ_NOISE, source="a usual sensor: assumed")


def estimated_noise(
    scenes: Sequence[Sequence[Exposure]], others: Sequence[Exposure] = (), darks: Sequence[Exposure] = ()
) -> tuple[Noise, str]:
    """Noise of the camera of all frames, and why it is not known, where it is not, else "".

    scenes: frames that show one scene in one light each, such as a bracket, or flats. others: frames of any scenes;
    which of them show one is looked for. What a typical sensor has takes part where frames say little, or is all.
    """
    others = [without_bloom(frame, across=True) for frame in others]
    lit = [pair for scene in scenes for pair in successive(scene)] + pairs_of(others)
    dark = [(one, other) for one, other in successive(darks) if one.seconds == other.seconds]
    frames = [frame for scene in (*scenes, others) for frame in scene]
    try:
        found = noise_from_pairs([*lit, *dark]) if lit else noise_from_frames(frames)
    except InputError as error:
        return usual_noise(frames[0]), f"{error}; the noise of a typical sensor is assumed"
    if found.determined:
        return found, ""
    low, high = found.gain_interval
    why = (
        f"the frames hardly determine the noise of the sensor (gain {low:.3g} to {high:.3g} e⁻/DN): state gain and "
        "read_noise (--gain, --read-noise), or give further frames of this camera (--noise-from)"
    )
    return replace(found, source=f"{found.source}, and what is usual of sensors"), why


def noise_from_pairs(pairs: Sequence[tuple[Exposure, Exposure]]) -> Noise:
    """Gain and read noise from pairs of frames of one scene, of equal or rising exposure: flats, darks, a bracket.

    Together with what is usual of sensors where the pairs say little: see `Noise.determined`. `InputError` if they
    share no light.
    """
    rows = [row for number, (one, other) in enumerate(pairs) for row in pair_rows(one, other, number)]
    if not any(_lit(row) for row in rows):
        raise InputError("two exposures share no signal above black: state gain and read_noise (--gain, --read-noise)")
    frames = len({id(frame) for pair in pairs for frame in pair})
    return noise_of_rows(rows, usual_noise(pairs[0][0]), PAIRS if frames == 2 else f"{PAIRS}, {frames} of them")


def noise_from_frames(frames: Sequence[Exposure]) -> Noise:
    """Gain and read noise from single frames; `InputError` if they do not determine the gain."""
    found = noise_of_rows(frame_rows(frames), usual_noise(frames[0]), SINGLE)
    if not found.determined:
        raise InputError(
            "the frames' noise does not grow with their signal: state gain and read_noise (--gain, --read-noise)"
        )
    return found


def scenes_of(frames: Iterable[Exposure]) -> list[list[Exposure]]:
    """The frames by the scene and light that they show; one that shows none of the others' is alone."""
    scenes: list[list[Exposure]] = []
    for frame in frames:
        same = next((scene for scene in reversed(scenes) if _shows(scene, frame)), None)
        if same is None:
            scenes.append([frame])
        else:
            same.append(frame)
    return scenes


def pairs_of(frames: Iterable[Exposure]) -> list[tuple[Exposure, Exposure]]:
    """Pairs of `frames` that show one scene in one light, each frame with the next brighter one."""
    return [pair for scene in scenes_of(frames) for pair in successive(scene)]


def successive(scene: Sequence[Exposure]) -> list[tuple[Exposure, Exposure]]:
    """Each frame of one scene with the next brighter one."""
    return list(pairwise(sorted(scene, key=_brightness)))


def _shows(scene: Sequence[Exposure], frame: Exposure) -> bool:
    """Whether `frame` shows the scene of the last frame of `scene`, or of the first."""
    return any(
        one_scene(*_by_light(other, frame)) for other in {id(one): one for one in (scene[-1], scene[0])}.values()
    )


def _by_light(one: Exposure, other: Exposure) -> tuple[Exposure, Exposure]:
    """Both, the darker one first."""
    return (one, other) if _brightness(one) <= _brightness(other) else (other, one)


def _brightness(frame: Exposure) -> float:
    """What frames are sorted by: the exposure time, or the light where that is not stated."""
    return frame.seconds if frame.exif.exposure_s is not None else float(frame.signal.mean())


def _lit(row: NoiseBin) -> bool:
    """Whether a row has light: more signal than the means of eight neighbours have by noise, by which it is chosen."""
    return row.shot > LIT * (row.variance / 8.0) ** 0.5


def frame_rows(frames: Iterable[Exposure]) -> list[NoiseBin]:
    """The rows of single frames: differences of high order between neighbours of one colour.

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
    return [row for row in _without_texture(every) if row.variance > LEAST_NOISE * row.rounding]


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
            rows[k] = NoiseBin(max(at, 0.0), 1.0, variance, float(coarse[chosen].mean()), count)
    return rows


def without_bloom(one: Exposure, across: bool) -> Exposure:
    """With the neighbours of clipped samples marked as clipped; across: those of other colours of a mosaic, too."""
    from scipy.ndimage import binary_dilation

    full = np.array(one.full, np.bool_)
    if full.any():
        if one.mosaic and across:
            full |= np.asarray(binary_dilation(one.full, np.ones((2 * BLOOM_PX + 1,) * 2)), np.bool_)
        reach = -(-BLOOM_PX // 2) if one.mosaic else BLOOM_PX
        for plane, grown in zip(planes(one.full, one.mosaic), planes(full, one.mosaic), strict=True):
            grown |= np.asarray(binary_dilation(plane, np.ones((2 * reach + 1,) * 2)), np.bool_)
    return replace(one, full=full)
