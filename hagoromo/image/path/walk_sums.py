"""Sums over walks: the mean of every pixel, its noise, and how many walks it takes to make that as small as asked.

A pixel gets walks by the noise of the pixels around it, not by its own: so means have no bias, and neither has the
noise, at the moment when it ends the walks, too. Matter may be in a pixel that all walks so far have missed: it has its
part in the error.

All numbers of a pixel are one row of one table, which is written at once: an interrupt between two launches, or in one,
finds whole rows. They have the same bits however the walks are launched, see `Walked`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from hagoromo.camera.response import Response, response_matrix
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.image.path.walked import Walked
from hagoromo.image.scene.settings import Settings
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.palette import Palette

FIRST_WALKS = 16  # a pixel, from which the error is estimated first
MOST_WALKS = 1 << 20  # a pixel
SURE = 2.0  # standard errors of the mean square that are added to it: in 98 of 100 pictures it is less
UNMET = 3  # pixels whose matter no walk has met, for each whose matter one walk has met
NEAR, WIDE = 3, 17  # px a side of the squares around a pixel by whose noise it gets walks
WIDE_SHARE = 0.1  # of the wide square in that noise
LEAST_NOISE = 1.0 / 32.0  # of that of all matter together: walks of what shows none are as for this
BEYOND = 4  # columns of the table behind the weights: coverage, square of Y, walks, walks that are wanted
COVERED, SQUARE, WALKS, WANTED = range(-BEYOND, 0)


class PixelSums:
    """Sums over walks of the weights, the coverage, and the square of Y, of some pixels; and numbers of walks."""

    def __init__(self, table: NDArray[np.float64], luminance: NDArray[np.float64]) -> None:
        """`table`: a row of each pixel. `luminance`: (channels,), see there."""
        self.table, self.luminance = table, luminance

    @property
    def walks(self) -> NDArray[np.float64]:
        """Walks of every pixel so far."""
        return self.table[:, WALKS]

    def lacking(self) -> NDArray[np.int64]:
        """The rows of pixels that have fewer walks than are wanted."""
        return np.flatnonzero(self.walks < self.table[:, WANTED])

    def launches(self, at_once: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Pixels, and how many further walks through each of them, of launches of `at_once` walks at most, until all
        that are wanted are there. All pixels get walks in turn, so that an unfinished picture is a whole one.
        """
        while (lacking := self.lacking()).size:
            left = (self.table[:, WANTED] - self.walks)[lacking].astype(np.int64)
            counts = np.minimum(left, max(at_once // lacking.size, 1))
            for begin in range(0, lacking.size, at_once):
                yield lacking[begin : begin + at_once], counts[begin : begin + at_once]

    def add(self, pixels: NDArray[np.int64], walked: Walked, counts: NDArray[np.int64]) -> None:
        """Add the next walks of some pixels, `counts` of each."""
        rows = self.table[pixels]
        rows[:, : SQUARE + 1] = walked.added(rows[:, : SQUARE + 1], self.luminance, counts)
        rows[:, WALKS] += counts
        self.table[pixels] = rows


class WalkSums(PixelSums):
    """The sums of every pixel of a picture."""

    def __init__(self, height: int, width: int, palette: Palette, white: Spectrum) -> None:
        """`white`: see `luminance`."""
        self.size, self.pixels, self.palette = (height, width), height * width, palette
        columns = palette.channels + BEYOND
        require(8.0 * self.pixels * columns, f"an image of {width} × {height} pixels")
        super().__init__(np.zeros((self.pixels, columns)), luminance(palette, white))

    def want(self, walks: NDArray[np.float64] | float) -> None:
        """Ask for a number of walks of each pixel."""
        self.table[:, WANTED] = walks

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
        """Variance of Y of one walk through each pixel: (pixels,)."""
        walks = np.maximum(self.walks, 2.0)
        mean = self.brightness()
        return np.maximum(self.table[:, SQUARE] / walks - mean * mean, 0.0) * (walks / (walks - 1.0))

    def brightness(self) -> NDArray[np.float64]:
        """Y of each pixel."""
        return self.table[:, :COVERED] @ self.luminance / np.maximum(self.walks, 1.0)

    def seen(self) -> NDArray[np.bool_]:
        """Which pixels show matter."""
        return self.table[:, COVERED] > 0.0

    def error(self) -> float:
        """Noise of Y: root mean square over the mean, of the pixels that show matter, which it is below in more than 95
        of 100 pictures; 0 where none does.

        The square of the noise of P pixels is the mean of their variances v to √(2 Σ v²) / P. A pixel that found a rare
        bright light makes Σ v² large: it counts with its doubt. Pixels whose matter no walk has met have a variance,
        too: it is in those of pixels like them, that one walk has met, as all of these get as many walks.
        """
        seen = self.seen()
        light = float(self.brightness()[seen].sum())
        if not light > 0.0:
            return 0.0
        each = (self.spread() / np.maximum(self.walks, 1.0))[seen]
        doubt = SURE * math.sqrt(2.0 * float(np.square(each).sum()))
        return math.sqrt((float(each.sum()) + doubt) * self.pixels_with_matter()) / light

    def pixels_with_matter(self) -> float:
        """About how many pixels show matter: those where walks met it, and UNMET more for each of one such walk."""
        met = self.table[:, COVERED]
        return float(np.count_nonzero(met) + UNMET * np.count_nonzero(met == 1.0))

    def walks_for(self, error: float) -> NDArray[np.float64]:
        """About how many walks of each pixel make the noise `error` with the fewest in all: (pixels,).

        A pixel gets them in proportion to the root of the variance of those around it. Its own is hardly in that: a
        pixel that gets more walks because it found light, and fewer because it found none, is too dark in the mean.
        """
        spread = np.where(self.seen(), self.spread(), 0.0)
        root = np.sqrt(np.maximum(self._around(spread), LEAST_NOISE**2 * spread[self.seen()].mean()))
        now = float((spread / np.maximum(self.walks, 1.0)).sum())
        allowed = now * (error / max(self.error(), 1e-30)) ** 2  # `error` has doubts in it that fall alike
        return root * (float((spread / root).sum()) / max(allowed, 1e-300))

    def _around(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean of the eight pixels next to each one, and a share of that of a wide square with it: (pixels,)."""
        values, ones = values.reshape(self.size), np.ones(self.size)

        def square(of: NDArray[np.float64], side: int) -> NDArray[np.float64]:
            return uniform_filter(of, side, mode="constant") * side**2

        near = (square(values, NEAR) - values) / np.maximum(square(ones, NEAR) - ones, 1.0)
        wide = square(values, WIDE) / square(ones, WIDE)
        return np.maximum((1.0 - WIDE_SHARE) * near + WIDE_SHARE * wide, 0.0).ravel()


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
        # a step at least, where rounding wants none
        return wanted if (wanted > sums.walks).any() else np.where(wanted > 0.0, sums.walks * 1.1, 0.0)

    def progress(self, sums: WalkSums) -> float:
        """Share that is done, 0…1."""
        return min(float(sums.walks.mean()) / max(self.last, 1.0), 1.0)


def luminance(palette: Palette, white: Spectrum) -> NDArray[np.float64]:
    """Y of `Image.xyz` of one unit of each weight: (channels,); `white`: the spectrum of the picture's first lamp."""
    observer = Response.load("cie1931")
    scale = response_matrix([Spectrum.constant(1.0)], white, observer)[1, 0]
    return np.concatenate([response_matrix(palette.colours, lamp, observer)[1] for lamp in palette.lamps]) / scale
