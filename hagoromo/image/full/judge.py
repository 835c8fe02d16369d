"""Full judge: from walks through some pixels of a picture of mode full, how far it is off, as solved and as mended.

The interval of the mean is that of the walks. It stays that of the mended mean: the two differ by a number that is
known. The difference of blocks is judged by walks that the fit did not see, as the product of two means of walks apart
from each other, whose noise has the mean 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.full.mend import Mender, MendFit
from hagoromo.image.full.walks import FOLDS
from hagoromo.image.picture.full_error import BLOCK, FullError, Off

SURE = 1.96  # standard errors on each side of an interval of 95 %
DRAWS = 400  # of the worst block
Array = NDArray[np.float64]


class Judge:
    """What walks say of a picture, and of fits to them."""

    def __init__(self, mender: Mender) -> None:
        self.mender, self.sums, self.blocks = mender, mender.sums, mender.blocks
        self.y = self.blocks.y
        self.count = self.sums.walks.sum(axis=1)
        self.totals = np.einsum("bfc,c->bf", self.sums.total, self.y)  # of Y
        self.off = self.totals.sum(axis=1) / np.maximum(self.count, 1)  # truth − full
        self.pixels = self.sums.stand_for
        matter = self.blocks.matter
        self.area = float(self.blocks.sizes[matter].sum())
        light = self.blocks.sizes[matter] * self.blocks.all_y[matter]
        self.missing, self.deviation = mender.missing(mender.all)  # sum over pixels of truth − full, of Y
        self.mean_y = max((float(light.sum()) + self.missing) / self.area, 1e-30)  # true, about

    def error(self, fit: MendFit) -> FullError:
        """The whole statement; fit: to all walks."""
        change = np.einsum("bc,c->b", self.mender.change(fit), self.y)
        solved, mended = self.squares(self.off_by_fold(np.zeros(len(self.off)))), self.squares_unseen()
        spread = self._spread(max(self._over(mended) / self.area, 0.0))
        places = [int(np.argmax(np.abs(values))) if values.size else 0 for values in (change, spread)]
        at = [(BLOCK * (place // self.blocks.grid[1]), BLOCK * (place % self.blocks.grid[1])) for place in places]
        return FullError(
            self.sums.count,
            self._off(np.zeros_like(change), solved, change, spread),
            self._off(change, mended, np.zeros_like(change), spread),
            (at[0], at[1]),
        )

    def _over(self, values: Array) -> float:
        """Sum over pixels of values of walked blocks, with the same bits on any number of cores."""
        return float((self.pixels * values).sum())

    def off_by_fold(self, change: Array) -> Array:
        """Truth less what a changed picture has, by the walks of each fold: (walked, FOLDS); NaN without walks."""
        n = self.sums.walks
        return np.where(n > 0, self.totals / np.maximum(n, 1), np.nan) - change[:, None]

    def squares(self, off: Array) -> Array:
        """Squares of differences of walked blocks without their noise, by pairs of folds: (walked,)."""
        there = np.isfinite(off)
        values, n = np.where(there, off, 0.0), there.sum(axis=1)
        return (values.sum(axis=1) ** 2 - (values**2).sum(axis=1)) / np.maximum(n * (n - 1), 1)

    def squares_unseen(self) -> Array:
        """The same of the mended picture, each by walks that its fit did not see."""
        if self.sums.side > 1:
            return self._squares_of_unseen_blocks()
        total, pairs = np.zeros(len(self.off)), np.zeros(len(self.off))
        for one in range(FOLDS):
            for other in range(one):
                taken = np.ones(self.sums.walks.shape, bool)
                taken[:, [one, other]] = False
                off = self.off_by_fold(self._change_of(taken))
                product = off[:, one] * off[:, other]
                there = np.isfinite(product)
                total += np.where(there, product, 0.0)
                pairs += there
        return total / np.maximum(pairs, 1)

    def _squares_of_unseen_blocks(self) -> Array:
        squares = np.zeros(len(self.off))
        for one in range(FOLDS):
            seen = self.mender.part != one
            squares = np.where(seen[:, 0], squares, self.squares(self.off_by_fold(self._change_of(seen))))
        return squares

    def _change_of(self, taken: NDArray[np.bool_]) -> Array:
        change = self.mender.change(self.mender.fitted(taken))
        return np.einsum("bc,c->b", change[self.sums.chosen], self.y)

    def _spread(self, square: float) -> Array:
        """About the deviations of blocks of the mended picture, (blocks,), whose mean square is `square`: in proportion
        to the noise of their walks.
        """
        walks = np.zeros(self.blocks.matter.size)
        noise = np.einsum("bc,c->b", self.mender.noise, self.y**2)
        walks[self.sums.chosen] = noise / np.maximum(self.count, 1)
        mean = self._over(walks[self.sums.chosen]) / self.area
        return np.sqrt(walks * (square / max(mean, 1e-300)))

    def _off(self, change: Array, squares: Array, known: Array, spread: Array) -> Off:
        """Of a picture changed by `change`; known: what blocks are off, `spread`: deviations of what is not known."""
        pixels, mean_y = self.pixels, self.mean_y
        added = float((change * self.blocks.sizes)[self.blocks.matter].sum())
        mean = (added - self.missing) / self.area / mean_y
        half = SURE * self.deviation / self.area / mean_y
        square = self._over(squares) / self.area
        variance = float(np.sum((pixels * (squares - square)) ** 2))
        if change.any():  # what the walks of the fit happened to bring, which the others do not see
            variance += 2.0 * float(np.sum((pixels * spread[self.sums.chosen] ** 2) ** 2))
        error = SURE * math.sqrt(variance) / self.area
        low, middle, high = (math.sqrt(max(s, 0.0)) / mean_y for s in (square - error, square, square + error))
        seen = self.sums.chosen
        draws = np.random.default_rng(0).standard_normal((DRAWS, len(seen)))
        most = np.abs(known[seen] + draws * spread[seen]).max(axis=1, initial=0.0) / mean_y
        ends = np.quantile(most, [0.025, 0.5, 0.975])
        return Off(
            mean, (mean - half, mean + half), middle, (low, high), float(ends[1]), (float(ends[0]), float(ends[2]))
        )
