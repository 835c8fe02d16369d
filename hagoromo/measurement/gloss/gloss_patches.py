"""What patches of neighbouring pixels say of their gloss, and the lobes that go best with all of them.

For a facet width γ the interface part of a pixel is linear in its strength, and its own body is eliminated as in
`textured_objective`, so three sums per pixel and width (A, B, D: χ² = A − 2 s B + s² D) hold all that its photographs
say of its gloss. Sums of neighbours stand for a patch. Patches and lobes (γ, s) are fitted to each other by turns; a
further lobe is taken as long as it lowers Σ over the patches of the least χ² by more than chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.gloss.gloss_difference import WIDTHS, Lobe
from hagoromo.measurement.material.quantity import theta_of
from hagoromo.measurement.observations import Pixels
from hagoromo.measurement.sight import Array, sight
from hagoromo.photograph.capture import Capture

STARTS = 8  # patches that a further material is tried from
PATCH_TURNS = 20
FAINTEST = 1e-7  # of the most that a patch says of a lobe: less is rounding
MOST_MATERIALS = 4  # of one colour
CHANCE = 30.0  # fall of χ² beyond which a further material is none by chance: 3 numbers and the choice among the grid's
SMALLEST_SHARE = 0.03  # of the patches that tell gloss
DISTINCT_WIDTH, DISTINCT_STRENGTH = 1.25, 1.4  # ratios, of two steps of WIDTHS, that materials differ by at least
SEES_MIDDLE = 0.7  # of γ: a material must be seen this near to the middle of its lobe, or it may be another's tail
FEWEST_MIDDLES = 3  # patches that see it


@dataclass(frozen=True, eq=False)
class Sums:
    """Of each pixel (M,) and width (K,): a (M,) and b, d (K, M) of χ², freedom (M,), nearest (M,) least φ [rad]."""

    a: Array
    b: Array
    d: Array
    freedom: Array
    nearest: Array


class Patches:
    """Sums over the size × size pixels around each pixel, and what they say of gloss."""

    def __init__(self, pixels: Pixels, shape: tuple[int, ...], sums: Sums, size: int) -> None:
        from scipy.ndimage import minimum_filter, uniform_filter

        self.at, self.shape, self.size = (pixels.rows, pixels.columns), shape, size
        image = np.zeros(shape)

        def around(values: Array) -> Array:
            image[self.at] = values
            return size**2 * uniform_filter(image, size, mode="constant")[self.at]

        self.d = np.stack([around(row) for row in sums.d])
        told = self.d > FAINTEST * self.d.max()
        self.b, self.d = np.where(told, np.stack([around(row) for row in sums.b]), 0.0), np.where(told, self.d, 0.0)
        a, freedom = around(sums.a), around(sums.freedom)
        self.a = a
        image[:] = np.pi
        image[self.at] = sums.nearest
        self.nearest = minimum_filter(image, size, mode="nearest")[self.at]
        best = np.divide(self.b, self.d, out=np.zeros_like(self.b), where=told)
        least = a - np.max(np.maximum(best, 0.0) ** 2 * self.d, axis=0)
        # patches that share no pixel
        self.apart = (pixels.rows % size == size // 2) & (pixels.columns % size == size // 2) & (freedom > 0.0)
        self.noise = float(np.median((least / np.maximum(freedom, 1.0))[self.apart])) if self.apart.any() else 1.0
        self.best = best

    def cost(self, width: int, strength: float) -> Array:
        """χ² (M,) of a lobe, over the noise, less that of no lobe."""
        fall = strength * (2.0 * self.b[width] - strength * self.d[width])
        return -fall / max(self.noise, 1.0)

    def lack(self, lobes: list[Lobe]) -> float:
        """χ² over the independent patches, in units of the stated noise."""
        fall = np.min([self.cost(*lobe)[self.apart] for lobe in lobes], axis=0)
        return float(np.sum(self.a[self.apart] + max(self.noise, 1.0) * fall))

    def lobes(self) -> list[Lobe]:
        """The glosses; one, or none, where a second is no better than chance."""
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

    def _alone(self, patches: NDArray[np.intp]) -> Lobe:
        """The lobe that goes best with all of `patches`."""
        pull, weight = self.b[:, patches].sum(axis=1), self.d[:, patches].sum(axis=1)
        strength = np.maximum(np.divide(pull, weight, out=np.zeros_like(pull), where=weight > 0.0), 0.0)
        width = int(np.argmax(strength * (2.0 * pull - strength * weight)))
        return Lobe(width, float(strength[width]))

    def _starts(self, lobes: list[Lobe]) -> list[Lobe]:
        """Lobes to start a further material from: what single patches say that go badly with `lobes`, and no gloss."""
        held = np.min([self.cost(*lobe) for lobe in lobes], axis=0)
        own = np.argmax(self.b * self.best, axis=0)
        at = np.arange(len(held))
        missed = held + np.maximum(self.best[own, at], 0.0) * self.b[own, at] / max(self.noise, 1.0)
        worst = np.flatnonzero(self.apart & (missed > CHANCE))
        order = worst[np.argsort(-missed[worst])][: STARTS**2 : STARTS]
        return [Lobe(int(own[i]), float(max(self.best[own[i], i], 0.0))) for i in order] + [Lobe(0, 0.0)]

    def _settled(self, lobes: list[Lobe]) -> tuple[list[Lobe], float]:
        """`lobes` after patches and lobes were fitted to each other by turns, and Σ of the patches' least χ²."""
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

    def labels(self, lobes: list[Lobe], known: NDArray[np.int64]) -> NDArray[np.int64]:
        """(h, w) number of the lobe that goes best with each pixel.

        Where patches do not tell, those of `known` stay; without any (all 0) the nearest patch that does tell decides.
        """
        from scipy.ndimage import distance_transform_edt, median_filter

        costs = np.stack([self.cost(*lobe) for lobe in lobes])
        best = np.argmin(costs, axis=0)
        ordered = np.sort(costs, axis=0)
        sure = ordered[1] - ordered[0] > CHANCE
        found = np.full(self.shape, -1)
        found[self.at] = np.where(sure, best, -1)
        if known.any():
            found = np.where(found < 0, known, found)
        elif (found >= 0).any():
            nearest = np.asarray(distance_transform_edt(found < 0, return_distances=False, return_indices=True))
            found = found[tuple(nearest)]
        return np.asarray(median_filter(np.maximum(found, 0), self.size, mode="nearest"), np.int64)

    def _apart_enough(self, lobes: list[Lobe]) -> bool:
        """Whether each lobe has patches of its own, differs from the others, and is seen near its middle there."""
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


def sums_of(capture: Capture, pixels: Pixels, n: float) -> Sums:
    """What each pixel's photographs say of its gloss, its body eliminated."""
    count, at = len(pixels), (pixels.rows, pixels.columns)
    channels, widths = capture.photographs[0].values.shape[2], len(WIDTHS)
    vv, bb, bv = np.zeros(count), np.zeros((count, channels)), np.zeros((count, channels))
    sv, ss, bs = np.zeros((widths, count)), np.zeros((widths, count)), np.zeros((widths, count, channels))
    freedom, nearest = np.zeros(count), np.full(count, np.pi)
    log_index = np.full(widths, theta_of(np.ones(channels), 1.0, 1.0, n)[-1])
    for photograph in capture.photographs:
        seen = sight(photograph, pixels.points, pixels.normals)
        used = seen.fit_to_use & photograph.mask[at]
        weight = np.where(used[:, None], 1.0 / np.where(used[:, None], photograph.variance[at], 1.0), 0.0)
        values, body = np.where(used[:, None], photograph.values[at], 0.0), seen.body
        lobe = seen.interface(np.log(WIDTHS), log_index)[0]
        vv += (weight * values**2).sum(axis=1)
        bb += weight * body**2
        bv += weight * body * values
        sv += np.einsum("mc,kmc->km", weight * values, lobe)
        ss += np.einsum("mc,kmc->km", weight, lobe**2)
        bs += weight * body * lobe
        freedom += channels * used
        nearest = np.where(used, np.minimum(nearest, seen.least_half_angle), nearest)
    inverse = np.divide(1.0, bb, out=np.zeros_like(bb), where=bb > 0.0)
    a = vv - (bv**2 * inverse).sum(axis=1)
    b = sv - np.einsum("kmc,mc->km", bs, bv * inverse)
    d = ss - np.einsum("kmc,mc->km", bs**2, inverse)
    return Sums(a, b, np.maximum(d, 0.0), np.maximum(freedom - channels, 0.0), nearest)
