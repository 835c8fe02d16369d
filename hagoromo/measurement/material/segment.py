"""Segmentation: pixels labelled by the chromaticity of their body colour.

Materials differ in colour, not in brightness: one colour in several shades is one material. So is a colour that goes
over into another smoothly: two materials are separated by an edge, or do not touch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.measurement.material.cast_shadow import MATTE, PixelLight
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import Array
from hagoromo.photograph.capture import Capture

SHARE_OF_ANGLE = 0.8  # of the largest φ of a pixel: photographs above it show its body
SMALLEST_SHARE = 0.01  # smallest share of the pixels that a material may have
FINEST = 0.004  # chromaticity, standard deviation of the smoothing: half a step of an 8-bit photograph
NOISIEST = 3.0  # times the median noise of the chromaticity: noisier pixels start no material
VALLEY = np.log(2.0)  # smallest fall of ln density between two materials
MOST_BINS = 512
ACROSS = 2  # [px] between the two pixels of a pair across a border: the one between them may be mixed
LEAST_STEP = 0.5  # of the difference of two colours, over ACROSS pixels of their border: below, it is a gradient
FEWEST_PAIRS = 5  # across a border, for its step to be known
LEAST_BORDER = 0.25  # length over the side of the smaller material as a square; stray pixels have shorter borders


class BodyColour(NamedTuple):
    """Per pixel: value (M, C), its variance (M, C), and matte (M,) where a photograph shows it outside highlights."""

    value: Array
    variance: Array
    matte: NDArray[np.bool_]


def segment(capture: Capture) -> NDArray[np.int64]:
    """Labels (h, w): 0, 1, … by falling size, −1 where no material is known.

    The density of the chromaticities of pixels outside their highlights is smoothed by their noise. Each maximum that
    rises above its saddles by VALLEY, and significantly, is a material, so the data give the number of materials.
    Maxima whose colours go over into each other without an edge are one material.
    A pixel that is only seen in its highlight takes the label of the maximum of its colour, else the nearest pixel's.
    `InputError` when no pixel shows its body colour.
    """
    region = known_shape(capture)
    pixels = Pixels.where(capture, region)
    body = body_colours(capture, pixels)
    total = body.value.sum(axis=1)
    lit = (total > 3.0 * np.sqrt(body.variance.sum(axis=1))) & np.isfinite(total)
    sure = lit & body.matte if np.sum(lit & body.matte) > 0.2 * np.sum(lit) else lit
    if not sure.any():
        raise InputError("no valid pixel shows its body colour: all are masked, saturated, dark or grazing")
    labels = np.full(region.shape, -1)
    if body.value.shape[1] == 1:
        labels[pixels.rows[lit], pixels.columns[lit]] = 0
        return _tidied(labels, pixels, lit)
    chromaticity, noise = _chromaticity(body.value[lit], body.variance[lit])
    labels[pixels.rows[lit], pixels.columns[lit]] = _hills(chromaticity, noise, sure[lit])
    labels = _tidied(labels, pixels, lit)
    colours = np.full((*region.shape, chromaticity.shape[1]), np.nan)
    colours[pixels.rows[lit], pixels.columns[lit]] = np.where(sure[lit, None], chromaticity, np.nan)
    return _joined(labels, colours)


def body_colours(capture: Capture, pixels: Pixels) -> BodyColour:
    """Σ values / Σ Lambertian irradiance over the photographs far from the highlight: noise does not bias it."""
    index, light_on = (pixels.rows, pixels.columns), PixelLight.on(capture, pixels)
    angles = np.where(light_on.usable & ~light_on.darker_than_the_others(), light_on.least_half_angle, -1.0)
    chosen = (angles >= SHARE_OF_ANGLE * angles.max(axis=0)) & (angles >= 0.0)
    value = np.zeros((len(pixels), capture.photographs[0].values.shape[2]))
    variance, light = value.copy(), value.copy()
    for body, photograph, taken in zip(light_on.bodies, capture.photographs, chosen, strict=True):
        value += np.where(taken[:, None], photograph.values[index], 0.0)
        variance += np.where(taken[:, None], photograph.variance[index], 0.0)
        light += np.where(taken[:, None], body, 0.0)
    light = np.where(light > 0.0, light, np.nan)
    return BodyColour(value / light, variance / light**2, angles.max(axis=0) >= MATTE)


def interior(labels: NDArray[np.integer], number: int) -> NDArray[np.bool_]:
    """(h, w) pixels of one material that touch no other material, since border pixels may be mixed."""
    from scipy.ndimage import binary_dilation

    others = (labels >= 0) & (labels != number)
    return (labels == number) & ~np.asarray(binary_dilation(others, np.ones((3, 3))), np.bool_)


def _hills(chromaticity: Array, noise: Array, sure: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Label of the density maximum that each chromaticity (M, 1 or 2) belongs to: 0, 1, … by falling size.

    The density is that of the `sure` colours. −1 for noisy colours, too small maxima, and colours that are not sure
    and lie outside the maxima.
    """
    from scipy.ndimage import gaussian_filter
    from skimage.measure import label
    from skimage.morphology import h_maxima
    from skimage.segmentation import watershed

    typical = float(np.median(noise[sure]))
    quiet = noise <= NOISIEST * typical
    firm = sure & quiet
    width = max(typical, FINEST)
    low, high = chromaticity[firm].min(axis=0) - 4 * width, chromaticity[firm].max(axis=0) + 4 * width
    bins = np.clip(np.ceil((high - low) / (width / 2)), 8, MOST_BINS).astype(int)
    cell = np.clip(((chromaticity - low) / (high - low) * bins).astype(int), 0, bins - 1)
    count = np.zeros(bins)
    np.add.at(count, tuple(cell[firm].T), 1.0)
    spread = width / ((high - low) / bins)
    # a smoothed count × 4π σ² (in bins) is the number of pixels that a place of the density rests on
    resting = gaussian_filter(count, spread, mode="constant") * (4 * np.pi) ** (len(bins) / 2) * np.prod(spread)
    floor = max(0.5 * SMALLEST_SHARE * firm.sum(), 1.0)
    density = np.log(np.maximum(resting, floor))
    prominence = max(VALLEY, 4.0 / np.sqrt(floor)) if floor < 30.0 else VALLEY
    peaks = label(h_maxima(density, prominence) * (density > density.min()))
    hills = np.asarray(watershed(-density, peaks, mask=resting > 0.0)) - 1
    inside = ((chromaticity > low) & (chromaticity < high)).all(axis=1) & (resting[tuple(cell.T)] > floor)
    hill = np.where(firm | (quiet & inside), hills[tuple(cell.T)], -1)
    return _by_size(hill, SMALLEST_SHARE * firm.sum())


def _chromaticity(value: Array, variance: Array) -> tuple[Array, Array]:
    """Chromaticities (M, 1 or 2) on their main axes and the standard deviation (M,) of their noise."""
    total = value.sum(axis=1, keepdims=True)
    share = value / total
    axes = np.linalg.svd(np.eye(share.shape[1]) - 1.0 / share.shape[1])[0][:, : share.shape[1] - 1]
    if axes.shape[1] > 2:
        centred = (share - np.median(share, axis=0)) @ axes
        axes = axes @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    # d(share·a) = (a − share·a)·dv / Σv
    slope = (axes[None] - (share @ axes)[:, None, :]) / total[:, :, None]
    noise = np.sqrt(np.einsum("mca,mc->m", slope**2, variance) / axes.shape[1])
    return share @ axes, noise


def _joined(labels: NDArray[np.int64], colours: Array) -> NDArray[np.int64]:
    """`labels` (h, w) with those joined between whose colours (h, w, 1 or 2), NaN where unknown, there is no edge."""
    same = np.arange(labels.max() + 1)
    middle = [np.nanmedian(colours[labels == number], axis=0) for number in same]
    for other in range(len(same)):
        for one in range(other):
            if _step(labels, colours, (one, other), middle[other] - middle[one]) < LEAST_STEP:
                same[same == same[other]] = same[one]
    return _by_size(np.append(same, -1)[labels], 0.0)


def _step(labels: NDArray[np.int64], colours: Array, pair: tuple[int, int], difference: Array) -> float:
    """Median change of colour from one label to another over ACROSS pixels, over their `difference`; inf if unknown."""
    steps = []
    for axis in range(2):
        ends = [np.moveaxis(labels, axis, 0), np.moveaxis(colours, axis, 0)]
        (before, after), (first, last) = ((one[:-ACROSS], one[ACROSS:]) for one in ends)
        change = (last - first) @ difference / max(float(difference @ difference), 1e-300)
        forth, back = ((before == a) & (after == b) for a, b in (pair, pair[::-1]))
        steps += [change[forth], -change[back]]
    known = np.concatenate(steps)
    known = known[np.isfinite(known)]
    side = np.sqrt(min(np.sum(labels == number) for number in pair))
    return float(np.median(known)) if len(known) >= max(FEWEST_PAIRS, ACROSS * LEAST_BORDER * side) else np.inf


def _by_size(labels: NDArray, least: float) -> NDArray[np.int64]:
    """Labels (…) renumbered by falling size; those of fewer than `least` pixels become −1."""
    names, sizes = np.unique(labels[labels >= 0], return_counts=True)
    retained = names[np.argsort(-sizes, kind="stable")][: int(np.sum(sizes >= least))]
    number = np.full(int(labels.max(initial=0)) + 2, -1)
    number[retained] = np.arange(len(retained))
    return number[labels]


def _tidied(labels: NDArray[np.int64], pixels: Pixels, lit: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lit pixels without a label take the nearest one's; then each takes the majority label of its 3 × 3."""
    from scipy.ndimage import uniform_filter

    near_rows, near_columns = nearest_known(labels >= 0)
    rows, columns = pixels.rows[lit], pixels.columns[lit]
    labels[rows, columns] = labels[near_rows[rows, columns], near_columns[rows, columns]]
    votes = [uniform_filter((labels == number).astype(np.float64), 3) for number in range(labels.max() + 1)]
    return np.where(labels >= 0, np.argmax(votes, axis=0), -1) if votes else labels
