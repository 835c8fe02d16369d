"""Segmentation by gloss: materials of one colour separated by patches, and their borders by smaller patches.

Gloss patches: the lobes that best explain patches of neighbouring pixels of one colour.

For a facet width γ the interface part of a pixel is linear in its strength, and its own body is eliminated as in
`AlbedoVariationObjective`. Three sums per pixel and width (A, B, D: χ² = A − 2 s B + s² D) are therefore sufficient
statistics of its gloss, and sums over neighbours describe a patch. Patches are assigned to lobes (γ, s) and lobes
fitted to patches by turns; a further lobe is accepted while it lowers Σ over the patches of the smallest χ²
significantly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.gloss.gloss_difference import WIDTHS, TriedLobe, glosses_differ
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.parameters import pack_theta
from hagoromo.measurement.sight import Array, sight_of
from hagoromo.photograph.capture import Capture

INDICES = (1.3, 1.5, 1.8)  # n, which changes the strength of a lobe between lamps; the best one is used
PATCH, FINE_PATCH = 5, 3  # [pixel] side of the patches that find the glosses, and of those that find the borders
FEWEST_PHOTOGRAPHS = 3
MOST_VALUES = 60_000  # pixels times photographs that are used; above, every `step`-th pixel is
STARTS = 8  # patches from which a further material is started
PATCH_TURNS = 20  # largest number of turns; the best assignment so far is used if they do not converge
FAINTEST = 1e-7  # of the largest sum D: smaller ones are rounding errors
MOST_MATERIALS = 4  # of one colour
CHANCE = 30.0  # fall of χ² that a further material reaches by chance: 3 parameters and the choice on the grid
SMALLEST_SHARE = 0.03  # of the patches with significant gloss
DISTINCT_WIDTH, DISTINCT_STRENGTH = 1.25, 1.4  # smallest ratios between two materials, two steps of WIDTHS
SEES_MIDDLE = 0.7  # φ/γ: a material must be measured this near to its peak, or it may be the tail of another lobe
FEWEST_MIDDLES = 3  # patches measured that near to the peak


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


@dataclass(frozen=True, eq=False)
class PatchSums:
    """Per pixel (M,) and width (K,): a (M,) and b, d (K, M) of χ², freedom (M,), nearest (M,) smallest φ [rad]."""

    a: Array
    b: Array
    d: Array
    freedom: Array
    nearest: Array


class GlossPatches:
    """Sums over the size × size pixels around each pixel, and the lobe of each patch."""

    def __init__(self, pixels: Pixels, shape: tuple[int, ...], sums: PatchSums, size: int) -> None:
        from scipy.ndimage import minimum_filter, uniform_filter

        self.index, self.shape, self.size = (pixels.rows, pixels.columns), shape, size
        image = np.zeros(shape)

        def around(values: Array) -> Array:
            image[self.index] = values
            return size**2 * uniform_filter(image, size, mode="constant")[self.index]

        self.d = np.stack([around(row) for row in sums.d])
        significant = self.d > FAINTEST * self.d.max()
        self.b, self.d = (
            np.where(significant, np.stack([around(row) for row in sums.b]), 0.0),
            np.where(significant, self.d, 0.0),
        )
        a, freedom = around(sums.a), around(sums.freedom)
        self.a = a
        image[:] = np.pi
        image[self.index] = sums.nearest
        self.nearest = minimum_filter(image, size, mode="nearest")[self.index]
        best = np.divide(self.b, self.d, out=np.zeros_like(self.b), where=significant)
        least = a - np.max(np.maximum(best, 0.0) ** 2 * self.d, axis=0)
        # patches that share no pixel
        self.apart = (pixels.rows % size == size // 2) & (pixels.columns % size == size // 2) & (freedom > 0.0)
        self.noise = float(np.median((least / np.maximum(freedom, 1.0))[self.apart])) if self.apart.any() else 1.0
        self.best = best

    def cost(self, width: int, strength: float) -> Array:
        """χ² (M,) of a lobe over the noise, relative to no lobe."""
        fall = strength * (2.0 * self.b[width] - strength * self.d[width])
        return -fall / max(self.noise, 1.0)

    def lack(self, lobes: list[TriedLobe]) -> float:
        """χ² over the independent patches, in units of the stated noise."""
        fall = np.min([self.cost(*lobe)[self.apart] for lobe in lobes], axis=0)
        return float(np.sum(self.a[self.apart] + max(self.noise, 1.0) * fall))

    def lobes(self) -> list[TriedLobe]:
        """The glosses; one, or none, where a second is not significant."""
        one, cost = self._settled([self._alone(np.flatnonzero(self.apart))])
        lobes = one
        while len(lobes) < MOST_MATERIALS:
            tried = [self._settled([*lobes, start]) for start in self._starts(lobes)]
            if not tried:
                break
            more, total = min(tried, key=lambda pair: pair[1])
            if cost - total < CHANCE or not self._apart_enough(more):
                break
            lobes, cost = more, total
        return lobes

    def _alone(self, patches: NDArray[np.intp]) -> TriedLobe:
        """The lobe that fits all of `patches` best."""
        rhs, weight = self.b[:, patches].sum(axis=1), self.d[:, patches].sum(axis=1)
        strength = np.maximum(np.divide(rhs, weight, out=np.zeros_like(rhs), where=weight > 0.0), 0.0)
        width = int(np.argmax(strength * (2.0 * rhs - strength * weight)))
        return TriedLobe(width, float(strength[width]))

    def _starts(self, lobes: list[TriedLobe]) -> list[TriedLobe]:
        """Starts for a further lobe: the best lobes of patches that fit `lobes` badly, and no gloss."""
        explained = np.min([self.cost(*lobe) for lobe in lobes], axis=0)
        own = np.argmax(self.b * self.best, axis=0)
        index = np.arange(len(explained))
        missed = explained + np.maximum(self.best[own, index], 0.0) * self.b[own, index] / max(self.noise, 1.0)
        worst = np.flatnonzero(self.apart & (missed > CHANCE))
        order = worst[np.argsort(-missed[worst])][: STARTS**2 : STARTS]
        return [TriedLobe(int(own[i]), float(max(self.best[own[i], i], 0.0))) for i in order] + [TriedLobe(0, 0.0)]

    def _settled(self, lobes: list[TriedLobe]) -> tuple[list[TriedLobe], float]:
        """`lobes` after assignment and fit by turns, and Σ of the smallest χ² of the patches."""
        patches = np.flatnonzero(self.apart)
        for _ in range(PATCH_TURNS):
            costs = np.stack([self.cost(*lobe)[patches] for lobe in lobes])
            nearest = np.argmin(costs, axis=0)
            moved = [self._alone(patches[nearest == i]) if (nearest == i).any() and lobe.strength > 0.0 else lobe
                     for i, lobe in enumerate(lobes)]  # fmt: skip
            if moved == lobes:
                break
            lobes = moved
        costs = np.stack([self.cost(*lobe)[patches] for lobe in lobes])
        return lobes, float(costs.min(axis=0).sum())

    def labels(self, lobes: list[TriedLobe], known: NDArray[np.int64]) -> NDArray[np.int64]:
        """(h, w) index of the best lobe of each pixel.

        Where patches are not significant, labels of `known` remain; if there are none (all 0), the nearest significant
        patch decides.
        """
        from scipy.ndimage import median_filter

        costs = np.stack([self.cost(*lobe) for lobe in lobes])
        best = np.argmin(costs, axis=0)
        ordered = np.sort(costs, axis=0)
        sure = ordered[1] - ordered[0] > CHANCE
        labels = np.full(self.shape, -1)
        labels[self.index] = np.where(sure, best, -1)
        if known.any():
            labels = np.where(labels < 0, known, labels)
        elif (labels >= 0).any():
            labels = labels[nearest_known(labels >= 0)]
        return np.asarray(median_filter(np.maximum(labels, 0), self.size, mode="nearest"), np.int64)

    def _apart_enough(self, lobes: list[TriedLobe]) -> bool:
        """Whether each lobe has its own patches, differs from the others, and was measured near its peak."""
        costs = np.stack([self.cost(*lobe)[self.apart] for lobe in lobes])
        best, ordered = np.argmin(costs, axis=0), np.sort(costs, axis=0)
        sure = ordered[1] - ordered[0] > CHANCE
        for i, (width, strength) in enumerate(lobes):
            mine = sure & (best == i)
            if mine.sum() < max(SMALLEST_SHARE * sure.sum(), 4):
                return False
            reach = SEES_MIDDLE * (WIDTHS[width] if strength > 0.0 else max(WIDTHS[k] for k, _ in lobes))
            if np.sum(self.nearest[self.apart][mine] < reach) < FEWEST_MIDDLES:
                return False
            for other_width, other in lobes[:i]:
                by_width = max(WIDTHS[width] / WIDTHS[other_width], WIDTHS[other_width] / WIDTHS[width])
                by_strength = max(strength, other) / max(min(strength, other), 1e-300)
                if by_width < DISTINCT_WIDTH and by_strength < DISTINCT_STRENGTH:
                    return False
        return True


def sums_of(capture: Capture, pixels: Pixels, n: float) -> PatchSums:
    """The sums of each pixel over its photographs, with its body eliminated."""
    count, index = len(pixels), (pixels.rows, pixels.columns)
    channels, widths = capture.photographs[0].values.shape[2], len(WIDTHS)
    vv, bb, bv = np.zeros(count), np.zeros((count, channels)), np.zeros((count, channels))
    sv, ss, bs = np.zeros((widths, count)), np.zeros((widths, count)), np.zeros((widths, count, channels))
    freedom, nearest = np.zeros(count), np.full(count, np.pi)
    log_index = np.full(widths, pack_theta(np.ones(channels), 1.0, 1.0, n)[-1])
    for photograph in capture.photographs:
        geometry = sight_of(photograph, pixels.points, pixels.normals)
        used = geometry.fit_to_use & photograph.mask[index]
        weight = np.where(used[:, None], 1.0 / np.where(used[:, None], photograph.variance[index], 1.0), 0.0)
        values, body = np.where(used[:, None], photograph.values[index], 0.0), geometry.body
        lobe = geometry.interface(np.log(WIDTHS), log_index)[0]
        vv += (weight * values**2).sum(axis=1)
        bb += weight * body**2
        bv += weight * body * values
        sv += np.einsum("mc,kmc->km", weight * values, lobe)
        ss += np.einsum("mc,kmc->km", weight, lobe**2)
        bs += weight * body * lobe
        freedom += channels * used
        nearest = np.where(used, np.minimum(nearest, geometry.least_half_angle), nearest)
    inverse = np.divide(1.0, bb, out=np.zeros_like(bb), where=bb > 0.0)
    a = vv - (bv**2 * inverse).sum(axis=1)
    b = sv - np.einsum("kmc,mc->km", bs, bv * inverse)
    d = ss - np.einsum("kmc,mc->km", bs**2, inverse)
    return PatchSums(a, b, np.maximum(d, 0.0), np.maximum(freedom - channels, 0.0), nearest)
