"""Sums over walks: the mean of every pixel, its noise, and how many walks it takes to make that as small as asked.

Matter may be in a pixel that the walks so far have missed: pixels beside others that show matter get walks, too, and
have their part in the error. Walks that chose when to stop do not say how large the error is: it is estimated from the
walks since the last choice.

All numbers of a pixel are one row of one table, which is written at once: an interrupt between two launches, or in one,
finds whole rows. They have the same bits however the walks are launched, see `Walked`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from hagoromo.camera.response import Response, response_matrix
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.image.settings import Settings
from hagoromo.image.walked import Walked
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.palette import Palette

FIRST_WALKS = 16  # a pixel, from which the error is estimated first
MOST_WALKS = 1 << 20  # a pixel
TILE = 16  # px a side of the tiles that get walks by their noise
SURE = 1.65  # standard errors of the mean square that are added to it: in 95 of 100 pictures it is less
BESIDE = 5  # px, side of the square around a pixel that shows matter in which others may show some
GROWTH = 1.25  # least factor by which walks grow at a time, so that the new ones tell the error
LEAST_NEW = 8  # new walks of a pixel that tell its variance; of fewer all its walks do
# columns of the table behind the weights: coverage, square of Y, walks, walks that are wanted; and the sum of Y, that
# of its square and the walks at the last choice
BEYOND = 7
COVERED, SQUARE, WALKS, WANTED, OLD_Y, OLD_SQUARE, OLD_WALKS = range(-BEYOND, 0)


class WalkSums:
    """Sums over walks of the weights, the coverage, and the square of Y, of every pixel; and numbers of walks."""

    def __init__(self, height: int, width: int, palette: Palette, white: Spectrum) -> None:
        """`white`: see `luminance`."""
        self.size, self.pixels, self.palette = (height, width), height * width, palette
        columns = palette.channels + BEYOND
        require(8.0 * self.pixels * columns, f"an image of {width} × {height} pixels")
        self.table = np.zeros((self.pixels, columns))
        self.luminance = luminance(palette, white)

    @property
    def walks(self) -> NDArray[np.float64]:
        """Walks of every pixel so far."""
        return self.table[:, WALKS]

    def want(self, walks: NDArray[np.float64] | float) -> None:
        """Ask for a number of walks of each pixel; from here on walks are new."""
        more = self.walks < walks
        old = np.stack([self._y(), self.table[:, SQUARE], self.walks], axis=1)
        self.table[more, OLD_Y:] = old[more]
        self.table[:, WANTED] = walks

    def launches(self, at_once: int) -> Iterator[tuple[NDArray[np.int64], int]]:
        """Pixels, and how many further walks through each of them, of launches of `at_once` walks at most, until all
        that are wanted are there.
        """
        while (lacking := np.flatnonzero(self.walks < self.table[:, WANTED])).size:
            left = (self.table[:, WANTED] - self.walks)[lacking]
            count = int(min(max(at_once // lacking.size, 1), left.min()))
            for begin in range(0, lacking.size, at_once):
                yield lacking[begin : begin + at_once], count

    def add(self, pixels: NDArray[np.int64], walked: Walked, walks: int) -> None:
        """Add the next `walks` of each of some pixels."""
        rows = self.table[pixels]
        rows[:, : SQUARE + 1] = walked.added(rows[:, : SQUARE + 1], self.luminance, walks)
        rows[:, WALKS] += walks
        self.table[pixels] = rows

    def mean(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weights (height, width, channels) and coverage (height, width); 0 where there was no walk."""
        mean = self.table[:, : COVERED + 1] / np.maximum(self.walks, 1.0)[:, None]
        mean = mean.astype(np.float32).reshape(*self.size, -1)
        return mean[..., :-1], mean[..., -1]

    def variance(self) -> NDArray[np.float32] | None:
        """Variance of the mean of Y (height, width); None unless every pixel has two walks."""
        if self.walks.min() < 2.0:
            return None
        return (self.spread() / self.walks).astype(np.float32).reshape(self.size)

    def spread(self) -> NDArray[np.float64]:
        """Variance of Y of one walk through each pixel, by all its walks: (pixels,)."""
        return _variance(self._y(), self.table[:, SQUARE], self.walks)

    def new_spread(self) -> NDArray[np.float64]:
        """The same by its new walks alone, where they are enough: (pixels,)."""
        new = self.walks - self.table[:, OLD_WALKS]
        own = _variance(self._y() - self.table[:, OLD_Y], self.table[:, SQUARE] - self.table[:, OLD_SQUARE], new)
        return np.where(new >= LEAST_NEW, own, self.spread())

    def brightness(self) -> NDArray[np.float64]:
        """Y of each pixel."""
        return self._y() / np.maximum(self.walks, 1.0)

    def _y(self) -> NDArray[np.float64]:
        return self.table[:, :COVERED] @ self.luminance

    def seen(self) -> NDArray[np.bool_]:
        """Which pixels show matter."""
        return self.table[:, COVERED] > 0.0

    def beside(self) -> NDArray[np.bool_]:
        """Which pixels show matter or may show some: those in a square of BESIDE around one that does."""
        near = maximum_filter(self.seen().reshape(self.size), BESIDE)
        return np.asarray(near > 0, np.bool_).ravel()

    def matter(self) -> float:
        """About how many pixels show matter, also those that all walks have missed: of pixels that one walk
        found, and that two found, follows how many none did.
        """
        seen, hits = self.seen(), self.table[:, COVERED]
        one, two = float((hits == 1.0).sum()), float((hits == 2.0).sum())
        return min(float(seen.sum()) + one * (one - 1.0) / (2.0 * (two + 1.0)), float(self.beside().sum()))

    def error(self) -> float:
        """Noise of Y: root mean square over the mean, of the pixels that show matter, which it is below in about 95 of
        100 pictures; 0 where none does.

        The square of the noise of P pixels is the mean of their variances v to √(2 Σ v²) / P, and the mean itself is
        known to √(Σ v²) / P. A pixel that found a rare bright light makes Σ v² large: it counts with its doubt.
        """
        beside = self.beside()
        total, count = float(self.brightness()[beside].sum()), self.matter()
        if not total > 0.0:
            return 0.0
        each = (self.new_spread() / np.maximum(self.walks, 1.0))[beside]
        doubt = SURE * math.sqrt(3.0 * float(np.square(each).sum()))
        return math.sqrt(count * (float(each.sum()) + doubt)) / total

    def walks_for(self, error: float) -> NDArray[np.float64]:
        """About how many walks of each pixel make the noise `error` with the fewest in all: (pixels,).

        Each tile gets walks in proportion to the root of its variance, and of that of the tiles around it.
        """
        beside = self.beside()
        spread = np.where(beside, self.spread(), 0.0)
        now = max(self.error(), 1e-30)
        tile = self._tiles()
        sums = [np.bincount(tile.ravel(), weights=values, minlength=tile.max() + 1) for values in (spread, beside)]
        shape = tile[-1, -1] // self._across() + 1, self._across()
        sums = [uniform_filter(values.reshape(shape), 3, mode="constant") + values.reshape(shape) for values in sums]
        root = np.sqrt(sums[0] / np.maximum(sums[1], 1e-30)).ravel()[tile.ravel()]
        mean_square = (np.square(root) / np.maximum(self.walks, 1.0))[beside].mean()
        allowed = mean_square * (error / now) ** 2  # `error` has doubts in it that fall alike
        return np.where(beside, root * root[beside].mean() / max(allowed, 1e-300), 0.0)

    def _across(self) -> int:
        return -(-self.size[1] // TILE)

    def _tiles(self) -> NDArray[np.int64]:
        """The number of the tile of each pixel (height, width)."""
        rows, columns = (np.arange(n) // TILE for n in self.size)
        return rows[:, None] * self._across() + columns


class Stop:
    """When to stop: after a number of walks a pixel, at an estimated error, or after a time."""

    def __init__(self, settings: Settings, share: float) -> None:
        """`share`: of `settings.seconds`."""
        self.settings, self.begin, self.last = settings, time.monotonic(), float(settings.samples)
        self.seconds = math.inf if settings.seconds is None else share * settings.seconds
        self.walks_before: float | None = None  # of this run

    def goes_on(self, sums: WalkSums) -> bool:
        """Whether more walks are wanted of some pixel, by the `sums`; at most twice as many at a time."""
        walks = sums.walks
        if self.walks_before is None:
            self.walks_before = float(walks.mean())
        if (walks < sums.table[:, WANTED]).any():
            return True  # those of an interrupted run first
        wanted = self._wanted(sums)
        sums.want(np.maximum(wanted, walks))
        self.last = max(self.last, float(sums.table[:, WANTED].mean()))
        return bool((walks < wanted).any())

    def _wanted(self, sums: WalkSums) -> NDArray[np.float64] | float:
        settings, walks, least = self.settings, sums.walks, float(self.settings.samples)
        if settings.error is None and settings.seconds is None:
            return least
        if walks.min() < max(least, FIRST_WALKS):
            return max(least, FIRST_WALKS)
        wanted: NDArray[np.float64] | float = float(MOST_WALKS)
        if settings.error is not None:
            wanted = self._for_error(sums, settings.error)
        wanted = np.minimum(wanted, np.minimum(walks * self._more_in_time(float(walks.mean())), MOST_WALKS))
        self.last = max(float(walks.mean()), float(np.mean(wanted)))
        # of few sizes, so that pixels with as many are launched together
        size = 2.0 ** np.floor(np.log2(np.maximum(walks, 1.0)))
        step = np.maximum(size / FIRST_WALKS, 1.0)
        return np.minimum(np.ceil(wanted / step) * step, 2.0 * walks)

    def _more_in_time(self, done: float) -> float:
        """Walks that the time is enough for, as a multiple of those that are `done` a pixel."""
        spent, here = max(time.monotonic() - self.begin, 1e-9), done - (self.walks_before or 0.0)
        if math.isinf(self.seconds):
            return math.inf
        return 1.0 + here * (self.seconds / spent - 1.0) / done if here > 0.0 else 2.0

    def _for_error(self, sums: WalkSums, error: float) -> NDArray[np.float64] | float:
        now = sums.error()
        if now <= error:
            return 0.0
        wanted = sums.walks_for(error)
        mean = float(wanted.mean())
        if mean > MOST_WALKS and self.settings.seconds is None:
            raise InputError(
                f"an error of {error:g} takes about {mean:.2g} walks a pixel, and {MOST_WALKS} are the most: after "
                f"{sums.walks.mean():.0f} it is {now:.2g}; give a larger error, or a time"
            )
        # those that lack next to none, too: to stop where little light was seen is to keep the
        # pixels whose walks missed it as they are
        lacking = wanted > 0.99 * sums.walks
        lacking = lacking if lacking.any() else wanted > 0.0
        return np.where(lacking, np.maximum(wanted, GROWTH * sums.walks), 0.0)

    def progress(self, sums: WalkSums) -> float:
        """Share that is done, 0…1."""
        return min(float(sums.walks.mean()) / max(self.last, 1.0), 1.0)


def luminance(palette: Palette, white: Spectrum) -> NDArray[np.float64]:
    """Y of `Image.xyz` of one unit of each weight: (channels,); `white`: the spectrum of the picture's first lamp."""
    observer = Response.load("cie1931")
    scale = response_matrix([Spectrum.constant(1.0)], white, observer)[1, 0]
    return np.concatenate([response_matrix(palette.colours, lamp, observer)[1] for lamp in palette.lamps]) / scale


def _variance(y: NDArray[np.float64], square: NDArray[np.float64], walks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance of one walk, without bias, from the sums over `walks` of Y and its square; each (pixels,)."""
    walks = np.maximum(walks, 2.0)
    mean = y / walks
    return np.maximum(square / walks - mean * mean, 0.0) * (walks / (walks - 1.0))
