"""Full refined: a picture of mode full is mended by walks until its error is small enough, and says what it is.

Enters: the picture as it was solved. Leaves: the picture with other light of higher orders, and `FullError` in its
metadata.
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.full.judge import Judge
from hagoromo.image.full.mend import Mender
from hagoromo.image.full.walks import FEWEST_BLOCKS, MOST_BLOCKS, BlockSums, PictureBlocks, WalkThrough
from hagoromo.image.picture.full_error import BLOCK, KEY, FullError
from hagoromo.image.picture.image import Image
from hagoromo.image.scene.settings import MOST_FULL_WALKS, Settings
from hagoromo.progress import Progress, silent

FIRST_WALKS = 1 << 18  # of a picture, after which its error is looked at first
MOST_WALKS = 1 << 20  # without an error that is asked for
GOOD = 0.01  # error that is not made smaller unasked
BAD = 0.05  # error of which a picture warns
AT_MOST = 4.0  # times as many walks from one look to the next
FORECAST = 0.5, 4.0  # times what noise alone says of walks to come: of seven in eight forecasts
LONGEST_UNASKED = 600.0  # [s] of walks that an error may take for which no time is given

# Gives what the matter of a pixel is called: number of the pixel.
NameOf = Callable[[int], str]


class WalkTime:
    """The time that the walks of a picture may take, and their pace. seconds: from now on."""

    def __init__(self, settings: Settings) -> None:
        unasked = math.inf if settings.error is None else LONGEST_UNASKED
        self.seconds = unasked if settings.seconds is None else settings.seconds
        self.begin, self.walking = time.monotonic(), 0.0

    def walk_on(self, sums: BlockSums, wanted: float, through: WalkThrough) -> None:
        """Further walks until there are `wanted`, or as many as the time is enough for."""
        if math.isfinite(self.seconds) and sums.count == 0:
            self._walked(sums, min(wanted, sums.least), through)  # shows the pace
        self._walked(sums, min(wanted, self.enough_for(sums)), through)

    def _walked(self, sums: BlockSums, wanted: float, through: WalkThrough) -> None:
        begin = time.monotonic()
        if wanted > sums.count:
            sums.walk_on(int(wanted) - sums.count, through)
        self.walking += time.monotonic() - begin

    def enough_for(self, sums: BlockSums) -> float:
        """Walks in all that the time is enough for."""
        left = self.seconds - (time.monotonic() - self.begin)
        return math.inf if math.isinf(left) else sums.count + max(left, 0.0) * sums.count / max(self.walking, 1e-9)

    def takes(self, sums: BlockSums, walks: float) -> float:
        """About how long it takes until there are so many walks [s], from the first one on."""
        return self.walking * walks / max(sums.count, 1)


def mended(
    image: Image,
    walk: Callable[[], WalkThrough],
    name_of: NameOf,
    settings: Settings,
    progress: Progress = silent,
) -> Image:
    """A picture of mode full, mended by walks, with what they say of it in its metadata.

    image: without the lights that its camera sees. walk: gives walks that are ready. They are `settings.walks`,
    or as many as `settings.seconds` are enough for, or bring the error to `settings.error`, or else to GOOD, MOST_WALKS
    at most. `InputError` for an error that takes more than MOST_FULL_WALKS or, where no time is given, LONGEST_UNASKED,
    with the part of the picture that is in the way.
    """
    if not image.palette.bands:
        return image
    sums = BlockSums(PictureBlocks.of(image), settings.seed, _blocks(settings))
    if not sums.chosen.size:
        return image
    through, wanted = walk(), float(settings.walks or FIRST_WALKS)
    clock = WalkTime(settings)
    while True:
        clock.walk_on(sums, wanted, through)
        mender = Mender(sums)
        fit = mender.fitted(mender.all)
        error = Judge(mender).error(fit)
        wanted = _wanted(error, settings, sums, clock, partial(_place, name_of=name_of, width=image.alpha.shape[1]))
        left = clock.takes(sums, max(wanted - sums.count, 0.0))
        asked, now = settings.error, error.mended.at_most
        if asked is not None and now > asked:
            left = clock.takes(sums, _walks_for(asked, error) - error.walks)
        words = f"{spread(left)} s" if asked is not None else f"about {left:.0f} s"
        progress(min(sums.count / max(wanted, 1.0), 1.0), f"walks, {words} more" if left > 1.0 else "walks")
        if wanted <= sums.count or (settings.error is None and wanted < sums.count + sums.least):
            break
        wanted = max(wanted, sums.count + sums.least)
    _warn(error, settings, sums, clock)
    return replace(_with_factors(image, mender.factors(fit)), metadata=image.metadata | {KEY: error.record()})


def _warn(error: FullError, settings: Settings, sums: BlockSums, clock: WalkTime) -> None:
    """Warn of an error that is large, or that the time was not enough for."""
    now, asked = error.mended.at_most, settings.error
    if asked is not None and now > asked:
        warnings.warn(
            f"the time of {clock.seconds:g} s has ended the walks of mode full: their error is {now:.2g}, and "
            f"{asked:g} takes {spread(clock.takes(sums, _walks_for(asked, error)))} s",
            stacklevel=5,
        )
    elif now > BAD:
        warnings.warn(error.line() + "; more walks, or mode path, bring it nearer", stacklevel=5)


def _blocks(settings: Settings) -> int:
    """Blocks that are walked at most: all where an error is asked for, as many as walks are enough for."""
    if settings.error is not None:
        return sys.maxsize
    enough = MOST_BLOCKS if settings.walks is None else settings.walks // BLOCK**2
    return min(max(enough, FEWEST_BLOCKS), MOST_BLOCKS)


def _wanted(
    error: FullError, settings: Settings, sums: BlockSums, clock: WalkTime, place: Callable[[FullError], str]
) -> float:
    """Walks that a picture should have in all. place: gives words for the part of it that is in the way."""
    asked, now = settings.error or GOOD, error.mended.at_most
    enough = clock.enough_for(sums)
    if enough < sums.count + sums.least and settings.seconds is not None:
        return 0.0
    if settings.error is None and settings.seconds is not None:
        return min(enough, AT_MOST * error.walks)
    if settings.walks is not None or now <= asked:
        return 0.0
    needed = _walks_for(asked, error)
    if settings.error is None:
        return float(min(int(min(needed, AT_MOST * error.walks)), MOST_WALKS))
    if settings.seconds is None and (needed > MOST_FULL_WALKS or needed > enough):
        seconds = clock.takes(sums, needed)
        most = f"{MOST_FULL_WALKS:.2g} walks" if needed > MOST_FULL_WALKS else f"{LONGEST_UNASKED:g} s"
        raise InputError(
            f"an error of {asked:g} takes {spread(needed)} walks, {spread(seconds)} s here, and without a time {most} "
            f"are the most: after {error.walks:.2g} it is {now:.2g}, most of all {place(error)}; give a larger error, "
            "or a time"
        )
    return float(min(int(min(1.2 * needed, AT_MOST * error.walks)) + 1, MOST_FULL_WALKS))


def _walks_for(asked: float, error: FullError) -> float:
    """Walks in all that an error takes by noise alone."""
    return error.walks * (error.mended.at_most / asked) ** 2


def spread(middle: float) -> str:
    """Words for how many walks or seconds an error takes, where noise alone says `middle`.

    >>> spread(120.0)
    '60 to 480'
    """
    low, high = (float(f"{factor * middle:.2g}") for factor in FORECAST)
    return f"{low:.7g} to {high:.7g}"


def _place(error: FullError, name_of: NameOf, width: int) -> str:
    """Words for the part of a picture that is farthest off."""
    row, column = error.worst_at[1]
    matter = name_of(row * width + column)
    return f"at rows {row} to {row + BLOCK}, columns {column} to {column + BLOCK}{matter}"


def _with_factors(image: Image, factors: np.ndarray) -> Image:
    """The picture with its light of higher orders times `factors`, (height, width, groups · bands)."""
    groups, bands = len(image.palette.lamps), len(image.palette.bands)
    shape = image.alpha.shape
    weights = image.weights.reshape(*shape, groups, -1).copy()
    weights[..., -bands:] *= factors.reshape(*shape, groups, bands).astype(np.float32)
    return replace(image, weights=weights.reshape(*shape, -1))
