"""Full's mend: the factor on light of higher orders that brings a picture of mode full to what walks bring, smoothed.

First the share that features of pixels explain, all over the picture; then what is left over squares of blocks, ever
smaller ones. How much of each step is taken is found by walks that it did not see: each eighth of them judges a step
that was made of the others. A step is taken only in so far as it surely brings the picture nearer to them, so that
nothing is changed where walks show nothing, and with many the picture has their means.

Means are ratios of sums, and no weight depends on what a walk brought. Few walks bring much: were blocks that found one
weighed less, for their noise, the mean would be too dark. Every sum is in a fixed order: no routine here has other bits
on another number of cores.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, gaussian_filter, map_coordinates

from hagoromo.image.full.walks import FOLDS, BlockSums, in_blocks
from hagoromo.image.picture.full_error import BLOCK

SCALES = 8.0, 4.0, 2.0, 1.0, 0.0  # standard deviations of smoothing [blocks]; the last one is each block alone
HOLDS = 0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0  # of a step that are tried
STEP_DOUBT = 4.0  # variances of what a step gains that are taken off it
MEAN_DOUBT = 2.0  # variances of the mean that are taken off what it is off, squared
POOLED = 1.5  # blocks by which the noise of walks is smoothed
FACTORS = 0.0, 10.0  # on light, at least and at most: where there is none, what full has is taken away
LITTLE = 1e-3  # of the mean light, below which noise is no smaller
WIDE_SHARE = 0.1  # of all blocks in the noise of each
TINY = 1e-150  # whose square is above 0
SHARPER = 4  # steps by which factors between blocks are given the means of blocks
Array = NDArray[np.float64]
Taken = NDArray[np.bool_]  # (walked, FOLDS): which walks


class MendFit(NamedTuple):
    """shares: (features, channels) of light, of features; own: (blocks, channels) of light, of blocks."""

    shares: Array
    own: Array


class MendStep(NamedTuple):
    """A step of a fit. scale: one of SCALES; None: features. hold: how far it is held back where few walks say it.
    strength: the part of it that is taken, 0…1.
    """

    scale: float | None
    hold: float
    strength: float


class FitColumns(NamedTuple):
    """Fits side by side, one a column: channels of a fit, or Y of fits to some of the walks.

    light: (blocks, columns). designs: (columns, blocks, features), what a feature's share of 1 adds to blocks. walks,
    off: (walked, columns), how many there are and what full lacks by them.
    """

    light: Array
    designs: Array
    walks: Array
    off: Array


class WalksAround(NamedTuple):
    """What walks say around blocks. share: (blocks, columns) of light that full lacks. known: (blocks, columns) light
    of the walks that say it, as if all had the same weight. typical: (columns,) its mean over light.
    """

    share: Array
    known: Array
    typical: Array


class Mender:
    """What all fits to walks through one picture share.

    part: (walked, FOLDS) number of the part of a walk, of FOLDS. Parts judge what was made of the others. Where not all
    blocks are walked they are of other blocks, as it is blocks without walks that count.
    """

    def __init__(self, sums: BlockSums) -> None:
        self.sums, self.blocks = sums, sums.blocks
        self.light = self.blocks.means  # (blocks, channels)
        higher = np.moveaxis(self.blocks.higher, 2, 0)[..., None]
        self.designs = np.stack([in_blocks(each * self.features) for each in higher]) / self.blocks.sizes[:, None]
        shape, fold = sums.walks.shape, np.arange(FOLDS)
        of_blocks = np.arange(shape[0])[:, None] % FOLDS
        self.part = np.broadcast_to(fold if sums.side == 1 else of_blocks, shape)
        self.all = np.ones(shape, bool)

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
        """Sums (blocks, columns) over walked blocks around each block by a bell, or by its square; see SCALES."""
        grid = np.zeros((*self.blocks.grid, values.shape[1]))
        grid.reshape(-1, values.shape[1])[self.sums.chosen] = values
        if scale > 0.0:
            reach = np.arange(-np.ceil(3.0 * scale), np.ceil(3.0 * scale) + 1.0)
            bell = np.exp(-(1.0 if squared else 0.5) * (reach / scale) ** 2)
            for axis in (0, 1):
                grid = correlate1d(grid, bell, axis, mode="constant")
        return grid.reshape(-1, values.shape[1])

    def fitted(self, taken: Taken) -> MendFit:
        """The fit to some of the walks."""
        walks, off = self._means(taken, self.sums.total)
        columns = FitColumns(self.light, self.designs, np.broadcast_to(walks, off.shape), off)
        fit = MendFit(np.zeros((self.features.shape[2], off.shape[1])), np.zeros_like(self.light))
        for step in self._steps(taken):
            part = self._made(step, columns)
            fit = MendFit(fit.shares + part.shares, fit.own + part.own)
            columns = columns._replace(off=columns.off - self._added(columns, part)[self.sums.chosen])
        fit.shares[0] += self._share_of_mean(fit, taken)
        return fit

    def _means(self, taken: Taken, total: Array) -> tuple[Array, Array]:
        """How many walks are taken in each walked block, (walked, 1), and their mean of what full lacks."""
        count = np.where(taken, self.sums.walks, 0).sum(axis=1)[:, None].astype(float)
        some = np.where(taken.reshape(*taken.shape, *[1] * (total.ndim - 2)), total, 0.0).sum(axis=1)
        return count, some.reshape(len(count), -1) / np.maximum(count, 1)

    def _steps(self, taken: Taken) -> list[MendStep]:
        """Which steps to take, as each part of the walks that are `taken` judges what the others made; all are of Y."""
        sums, y = self.sums, self.blocks.y
        total = np.einsum("bfc,c->bf", sums.total, y)
        parts = [taken & (self.part == number) for number in range(FOLDS)]
        parts = [part for part in parts if part.any()]
        if len(parts) < 2:
            return []
        seen, unseen = ([self._means(one, total) for one in some] for some in ([taken & ~p for p in parts], parts))
        held, judged = (np.concatenate(each, axis=1) for each in zip(*unseen, strict=True))
        light = np.repeat(np.einsum("bc,c->b", self.light, y)[:, None], len(parts), axis=1)
        designs = np.repeat(np.einsum("cbf,c->bf", self.designs, y)[None], len(parts), axis=0)
        columns = FitColumns(light, designs, *(np.concatenate(each, axis=1) for each in zip(*seen, strict=True)))
        weight = np.where(held > 0, sums.stand_for[:, None], 0.0)
        steps = []
        for scale in (None, *SCALES) if sums.side == 1 else (None, *SCALES[:-1]):
            said = None if scale is None else self._said(scale, columns)
            steps_of_scale = [MendStep(scale, hold, 1.0) for hold in HOLDS]
            trials = [
                (step, self._added(columns, self._made(step, columns, said))[sums.chosen]) for step in steps_of_scale
            ]
            found = [strength_of(weight * judged * change, weight * change**2) for _, change in trials]
            best = int(np.argmax([gain for gain, _ in found]))
            strength = found[best][1]
            if strength > 0.0:
                step, change = trials[best]
                steps.append(step._replace(strength=strength))
                judged = judged - strength * change
                columns = columns._replace(off=columns.off - strength * change)
        return steps

    def _said(self, scale: float, columns: FitColumns) -> WalksAround:
        """What walks say around every block by a bell of a scale: ratios of sums over them."""
        chosen = self.sums.chosen
        light = columns.light[chosen]
        lit = columns.walks * light
        above, below = (self._smoothed(values, scale) for values in (columns.walks * columns.off, lit))
        known = below**2 / np.maximum(self._smoothed(lit, scale, squared=True), TINY)
        typical = (known[chosen] * light).sum(axis=0) / np.maximum(light.sum(axis=0), TINY)
        return WalksAround(np.where(below > 0.0, above / np.maximum(below, TINY), 0.0), known, typical)

    def _made(self, step: MendStep, columns: FitColumns, said: WalksAround | None = None) -> MendFit:
        """A step of fits to what full lacks, as shares of light. said: of its scale, where it is known already."""
        chosen = self.sums.chosen
        if step.scale is None:
            light = columns.light[chosen]
            weight = columns.walks / np.maximum(light, np.maximum(LITTLE * light.mean(axis=0), TINY))
            each = zip(columns.designs[:, chosen], columns.off.T, weight.T, strict=True)
            shares = np.stack([held_back(design, off, w, step.hold) for design, off, w in each], axis=1)
            return MendFit(step.strength * shares, np.zeros_like(columns.light))
        share, known, typical = said or self._said(step.scale, columns)
        own = step.strength * share * known / np.maximum(known + step.hold * typical, TINY)
        return MendFit(np.zeros((columns.designs.shape[2], own.shape[1])), own)

    def _added(self, columns: FitColumns, fit: MendFit) -> Array:
        """What fits add to the means of blocks: (blocks, columns)."""
        return columns.light * fit.own + np.einsum("cbf,fc->bc", columns.designs, fit.shares)

    def _share_of_mean(self, fit: MendFit, taken: Taken) -> float:
        """The share that brings the mean of a picture that a fit changed to that of the walks, but for its doubt."""
        sizes, y = np.where(self.blocks.matter, self.blocks.sizes, 0.0), self.blocks.y
        total, deviation = self.missing(taken)
        left = total - float((sizes * np.einsum("bc,c->b", self.change(fit), y)).sum())
        sure = max(1.0 - MEAN_DOUBT * deviation**2 / max(left**2, TINY), 0.0)
        return sure * left / max(float((sizes * np.einsum("bc,c->b", self.light, y)).sum()), TINY)

    def missing(self, taken: Taken) -> tuple[float, float]:
        """Sum over pixels of truth − full, of Y, by some of the walks, and its standard error.

        In proportion to light of higher orders where not all blocks are walked.
        """
        sums, y = self.sums, self.blocks.y
        count, off = (each[:, 0] for each in self._means(taken, np.einsum("bfc,c->bf", sums.total, y)))
        pixels = np.where(count > 0, sums.stand_for, 0.0)
        if sums.side > 1:
            light = np.einsum("bc,c->b", self.light, y)
            seen = light[sums.chosen]
            ratio = float((pixels * off).sum()) / max(float((pixels * seen).sum()), TINY)
            everywhere = float((light * self.blocks.sizes)[self.blocks.matter].sum())
            noise = np.sqrt(np.sum((pixels * (off - ratio * seen)) ** 2)) / max(float((pixels * seen).sum()), TINY)
            return ratio * everywhere, float(noise) * everywhere
        n = np.maximum(count, 2.0)
        square = sums.square[:, -1] * count / np.maximum(sums.walks.sum(axis=1), 1)
        variance = np.maximum(square / n - off**2, 0.0) / (n - 1.0)
        return float((pixels * off).sum()), float(np.sqrt(np.sum(pixels**2 * variance)))

    def change(self, fit: MendFit) -> Array:
        """What a fit adds to the means of blocks, (blocks, channels), whose factors are kept within FACTORS."""
        change = self.light * fit.own + np.einsum("cbf,fc->bc", self.designs, fit.shares)
        least, most = (self.light * (factor - 1.0) for factor in FACTORS)
        return np.clip(change, least, most)

    def factors(self, fit: MendFit) -> Array:
        """Factors on the channels of higher orders of every pixel, (height, width, channels).

        Where some of a block's are kept within FACTORS, the others make up for it: it has the light that was judged.
        """
        share = np.einsum("hwf,fc->hwc", self.features, fit.shares) + self._between(fit.own)
        factors = np.clip(1.0 + share, *FACTORS)
        wanted = self.light + self.change(fit)
        made = in_blocks(self.blocks.higher * factors) / self.blocks.sizes[:, None]
        scale = np.where(made > 0.0, wanted / np.maximum(made, TINY), 1.0)
        return np.clip(factors * scale[self._block_of_pixels], *FACTORS)

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
        return made + left[self._block_of_pixels]

    @cached_property
    def _block_of_pixels(self) -> NDArray[np.int64]:
        """Number of the block of every pixel, (height, width)."""
        down, across = (np.arange(side) // BLOCK for side in self.blocks.first.shape)
        return np.add.outer(down * self.blocks.grid[1], across)


def held_back(design: Array, off: Array, weight: Array, hold: float) -> Array:
    """Shares of features, (features,), by least squares; those beside the first are held back."""
    gram = np.einsum("bf,b,bg->fg", design, weight, design)
    right = np.einsum("bf,b,b->f", design, weight, off)
    back = np.full(len(right), hold + 1e-9)
    back[0] = 0.0
    return np.linalg.solve(gram + np.diag(back * gram[0, 0] + TINY), right)


def strength_of(products: Array, squares: Array) -> tuple[float, float]:
    """What a change gains by walks that it did not see, and the part of it to take, 0…1; both without their doubt.

    products: (walked, parts) of the change and what the walks find it off; squares: of the change. Their sums are P and
    S: the part a takes 2 a P − a² S off the squares of what is off, most at P/S. The variance of P is from blocks.
    """
    product, square = float(products.sum()), float(squares.sum())
    if product <= 0.0 or square <= 0.0:
        return 0.0, 0.0
    noise = (products - (product / square) * squares).sum(axis=1)
    product *= max(1.0 - STEP_DOUBT * float((noise**2).sum()) / product**2, 0.0)
    strength = min(product / square, 1.0)
    return strength * (2.0 * product - strength * square), strength
