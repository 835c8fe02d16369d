"""Segmentation by gloss: materials of one colour separated by patches, and their borders by smaller patches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.gloss.gloss_difference import TriedLobe, glosses_differ
from hagoromo.measurement.gloss.gloss_patches import CHANCE, GlossPatches, PatchSums, sums_of
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.photograph.capture import Capture

INDICES = (1.3, 1.5, 1.8)  # n, which changes the strength of a lobe between lamps; the best one is used
PATCH, FINE_PATCH = 5, 3  # [pixel] side of the patches that find the glosses, and of those that find the borders
FEWEST_PHOTOGRAPHS = 3
MOST_VALUES = 60_000  # pixels times photographs that are used; above, every `step`-th pixel is


def split_by_gloss(capture: Capture, labels: NDArray[np.int64]) -> NDArray[np.int64]:
    """`labels` (h, w) with each colour divided by gloss: new labels by falling size, −1 unknown.

    A gloss must be wider than two patches somewhere. Colours with fewer than FEWEST_PHOTOGRAPHS photographs are not
    divided.
    """
    if len(capture.photographs) < FEWEST_PHOTOGRAPHS:
        return labels
    parted, count = labels.copy(), 0
    for number in range(labels.max() + 1):
        region = (labels == number) & known_shape(capture)
        glosses = _glosses(capture, region) if region.any() else np.zeros(labels.shape, np.int64)
        parted[labels == number] = glosses[labels == number] + count
        count += int(glosses[labels == number].max(initial=0)) + 1
    names, sizes = np.unique(parted[parted >= 0], return_counts=True)
    rank = np.full(count + 1, -1)
    rank[names[np.argsort(-sizes, kind="stable")]] = np.arange(len(names))
    return rank[parted]


def _glosses(capture: Capture, region: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Labels (h, w) 0, 1, … of the glosses within one colour's `region`; of every `step`-th pixel where it is large."""
    pixels = Pixels.where(capture, region)
    step = max(int(np.ceil(np.sqrt(len(pixels) * len(capture.photographs) / MOST_VALUES))), 1)
    coarse = np.zeros(region.shape, bool)
    coarse[::step, ::step] = region[::step, ::step]
    chosen = Pixels.where(capture, coarse)
    if not len(chosen):
        return np.zeros(region.shape, np.int64)
    coarse_pixels = replace(chosen, rows=chosen.rows // step, columns=chosen.columns // step)
    labels, lobes = _parted(region[::step, ::step], coarse_pixels, [sums_of(capture, chosen, n) for n in INDICES])
    if len(lobes) > 1 and not glosses_differ(capture, chosen, labels[coarse_pixels.rows, coarse_pixels.columns], lobes):
        return np.zeros(region.shape, np.int64)
    return np.repeat(np.repeat(labels, step, axis=0), step, axis=1)[: region.shape[0], : region.shape[1]]


def _parted(
    region: NDArray[np.bool_], pixels: Pixels, sums: list[PatchSums]
) -> tuple[NDArray[np.int64], list[TriedLobe]]:
    """Labels (h, w) of the glosses in `region`, and the lobes, from sums of its pixels for each of INDICES."""
    shape = region.shape
    tried = [GlossPatches(pixels, shape, of, PATCH) for of in sums]
    glosses = [patches.lobes() for patches in tried]
    lack = [patches.lack(lobes) + CHANCE * len(lobes) for patches, lobes in zip(tried, glosses, strict=True)]
    best = int(np.argmin(lack))
    patches, lobes = tried[best], glosses[best]
    while len(lobes) > 1:
        labels = patches.labels(lobes, np.zeros(shape, np.int64))
        wide = [_is_wide(region & (labels == i)) for i in range(len(lobes))]
        if all(wide):
            return GlossPatches(pixels, shape, sums[best], FINE_PATCH).labels(lobes, labels), lobes
        lobes = [
            lobe for lobe, is_wide in zip(lobes, wide, strict=True) if is_wide
        ]  # patches across a border can form one
    return np.zeros(shape, np.int64), lobes[:1]


def _is_wide(region: NDArray[np.bool_]) -> bool:
    """Whether a part of `region` is wider than two patches."""
    from scipy.ndimage import binary_erosion

    return bool(np.asarray(binary_erosion(region, np.ones((2 * PATCH + 1, 2 * PATCH + 1)))).any())
