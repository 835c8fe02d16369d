"""Full's mend: the factor on light of higher orders that brings a picture of mode full to what walks bring, smoothed.

First the share that features of pixels explain, all over the picture; then what is left over squares of blocks, ever
smaller ones. Each step is shrunk by its own noise (empirical Bayes: a prior as wide as the walks show it to be), so
that nothing is changed where they show nothing, and with many walks the picture has their means. Every sum is in a
fixed order: no routine here has other bits on another number of cores.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, gaussian_filter, map_coordinates

from hagoromo.image.full_error import BLOCK
from hagoromo.image.full_walks import BlockSums, in_blocks

SCALES = 8.0, 4.0, 2.0, 1.0, 0.0  # standard deviations of smoothing [blocks]; the last one is each block alone
POOLED = 1.5  # that by which the noise of walks is smoothed
PRIORS = 0.0, 0.003, 0.01, 0.03, 0.1, 0.3  # standard deviations of the share of a feature that are tried
FACTORS = 0.1, 10.0  # on light, at least and at most
LITTLE = 1e-3  # of the mean light, below which noise is no smaller
WIDE_SHARE = 0.1  # of all blocks in the noise of each
TINY = 1e-150  # whose square is above 0
SHARPER = 4  # steps by which factors between blocks are given the means of blocks
Array = NDArray[np.float64]


class MendFit(NamedTuple):
    """shares: (features, channels) of light, of features; own: (blocks, channels) of light, of blocks."""

    shares: Array
    own: Array


class Mender:
    """What all fits to walks through one picture share."""

    def __init__(self, sums: BlockSums) -> None:
        self.sums, self.blocks = sums, sums.blocks
        self.light = self.blocks.means  # (blocks, channels)
        higher = np.moveaxis(self.blocks.higher, 2, 0)[..., None]
        # (channels, blocks, features): what a feature's share of 1 adds to blocks
        self.designs = np.stack([in_blocks(each * self.features) for each in higher]) / self.blocks.sizes[:, None]

    @cached_property
    def features(self) -> Array:
        """(height, width, features) of pixels, of mean 0 and variance 1 over their light; the first one is 1."""
        blocks = self.blocks
        higher = np.einsum("hwc,c->hw", blocks.higher, blocks.y)
        around = [gaussian_filter(values, BLOCK / 2) for values in (higher, blocks.first)]
        least = 1e-6 * max(float(higher.mean()), 1e-30)
        columns = [
            higher / np.maximum(higher + blocks.first, least),
            around[0] / np.maximum(around[0] + around[1], least),
            np.log(np.maximum(higher, least) / np.maximum(around[0], least)).clip(-2.0, 2.0),
            np.log(np.maximum(around[0], least) / max(float(higher.mean()), least)).clip(-4.0, 4.0),
        ]
        weight = higher / max(float(higher.sum()), 1e-30)
        made = [np.ones_like(higher)]
        for column in columns:
            column = column - float((weight * column).sum())
            deviation = float(np.sqrt((weight * column**2).sum()))
            made.append(column / deviation if deviation > 1e-9 else np.zeros_like(column))
        return np.stack(made, axis=-1)

    @cached_property
    def noise(self) -> Array:
        """Variance of one walk in each walked block, (walked, channels): that of the blocks around it, in proportion to
        the square of their light.
        """
        sums, n = self.sums, self.sums.walks.sum(axis=1)[:, None]
        about = sums.square[:, :-1] - sums.total.sum(axis=1) ** 2 / np.maximum(n, 1)
        light = np.maximum(self.light[sums.chosen], LITTLE * self.light.mean(axis=0) + TINY)
        pairs = (about, (n - 1) * light**2)
        near = [self._smoothed(each, POOLED)[sums.chosen] for each in pairs]
        wide = [each.sum(axis=0) for each in pairs]
        one, other = (above / np.maximum(below, TINY) for above, below in (near, wide))
        return light**2 * ((1.0 - WIDE_SHARE) * one + WIDE_SHARE * other)

    def _smoothed(self, values: Array, scale: float, squared: bool = False) -> Array:
        """Sums (blocks, channels) over walked blocks around each block by a bell, or by its square; see SCALES."""
        grid = np.zeros((*self.blocks.grid, values.shape[1]))
        grid.reshape(-1, values.shape[1])[self.sums.chosen] = values
        if scale > 0.0:
            reach = np.arange(-np.ceil(3.0 * scale), np.ceil(3.0 * scale) + 1.0)
            bell = np.exp(-(1.0 if squared else 0.5) * (reach / scale) ** 2)
            for axis in (0, 1):
                grid = correlate1d(grid, bell, axis, mode="constant")
        return grid.reshape(-1, values.shape[1])

    def fitted(self, taken: NDArray[np.bool_]) -> MendFit:
        """The fit to some of the walks; taken: (walked, FOLDS) of them."""
        sums = self.sums
        n = np.where(taken, sums.walks, 0).sum(axis=1)[:, None]
        off = np.where(taken[..., None], sums.total, 0.0).sum(axis=1) / np.maximum(n, 1)
        light, weight = self.light[sums.chosen], n / np.maximum(self.noise, TINY)
        designs = self.designs[:, sums.chosen]
        shares = np.stack([ridge(*each) for each in zip(designs, off.T, weight.T, strict=True)], axis=1)
        left = off - np.einsum("cbf,fc->bc", designs, shares)
        own = np.zeros_like(self.light)
        for scale in SCALES if sums.side == 1 else SCALES[:-1]:
            step = self._step(left, light, weight, scale)
            own += step
            left = left - light * step[sums.chosen]
        return MendFit(shares, own)

    def _step(self, left: Array, light: Array, weight: Array, scale: float) -> Array:
        """What is left by blocks, as shares (blocks, channels) of their light smoothed by `scale`, and shrunk."""
        known = weight * light**2
        above, below = (self._smoothed(each, scale) for each in (weight * light * left, known))
        share = above / np.maximum(below, TINY)
        noise = self._smoothed(known, scale, squared=True) / np.maximum(below, TINY) ** 2
        seen = np.where(known > 0.0, 1.0 / np.maximum(noise[self.sums.chosen], TINY), 0.0)
        signal = (seen * (share**2 - noise)[self.sums.chosen]).sum(axis=0) / np.maximum(seen.sum(axis=0), TINY)
        signal = np.maximum(signal, 0.0)
        return np.where(below > 0.0, share * signal / np.maximum(signal + noise, TINY), 0.0)

    def change(self, fit: MendFit) -> Array:
        """What a fit adds to the means of blocks: (blocks, channels)."""
        return self.light * fit.own + np.einsum("cbf,fc->bc", self.designs, fit.shares)

    def factors(self, fit: MendFit) -> Array:
        """Factors on the channels of higher orders of every pixel, (height, width, channels)."""
        share = np.einsum("hwf,fc->hwc", self.features, fit.shares) + self._between(fit.own)
        return np.clip(1.0 + share, *FACTORS)

    def _between(self, own: Array) -> Array:
        """Shares between the middles of blocks, (height, width, channels), whose light in blocks is as asked."""
        rows, columns = self.blocks.grid
        ends = ((np.arange(side) + 0.5) / BLOCK - 0.5 for side in self.blocks.first.shape)
        places = np.meshgrid(*ends, indexing="ij")
        light = np.maximum(in_blocks(self.blocks.higher), TINY)
        given, left, made = own, own, np.zeros(self.blocks.higher.shape)
        for _ in range(SHARPER):
            for k in range(own.shape[1]):
                made[..., k] = map_coordinates(given[:, k].reshape(rows, columns), places, order=1, mode="nearest")
            left = own - in_blocks(self.blocks.higher * made) / light
            given = given + left
        down, across = (np.arange(side) // BLOCK for side in self.blocks.first.shape)
        block = np.add.outer(down * columns, across)
        return made + left[block]


def ridge(design: Array, off: Array, weight: Array) -> Array:
    """Shares of features, (features,), least squares with the prior of PRIORS by which the walks are likeliest."""
    gram = np.einsum("bf,b,bg->fg", design, weight, design)
    right = np.einsum("bf,b,b->f", design, weight, off)
    best, chosen = 0.0, np.zeros(len(right))
    for one in PRIORS:
        for others in PRIORS:
            prior = np.array([one] + [others] * (len(right) - 1))
            matrix = np.eye(len(right)) + prior[:, None] * gram * prior
            mean = prior * np.linalg.solve(matrix, prior * right)
            likelihood = float(right @ mean) - float(np.linalg.slogdet(matrix)[1])
            if likelihood > best:
                best, chosen = likelihood, mean
    return chosen
