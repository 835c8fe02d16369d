"""Full refined: a picture of mode full is mended by walks until its error is small enough, and says what it is.

Enters: the picture as it was solved. Leaves: the picture with other light of higher orders, and `FullError` in its
metadata.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.full_error import BLOCK, KEY, FullError
from hagoromo.image.full_judge import Judge
from hagoromo.image.full_mend import Mender
from hagoromo.image.full_walks import FEWEST_BLOCKS, MOST_BLOCKS, BlockSums, PictureBlocks, WalkThrough
from hagoromo.image.image import Image
from hagoromo.image.settings import MOST_FULL_WALKS, Settings
from hagoromo.progress import Progress, silent

FIRST_WALKS = 1 << 18  # of a picture, after which its error is looked at first
MOST_WALKS = 1 << 20  # without an error that is asked for
GOOD = 0.01  # error that is not made smaller unasked
BAD = 0.05  # error of which a picture warns
AT_MOST = 4.0  # times as many walks from one look to the next

# Gives what the matter of a pixel is called: number of the pixel.
NameOf = Callable[[int], str]


def mended(
    image: Image,
    walk: Callable[[], WalkThrough],
    name_of: NameOf,
    settings: Settings,
    progress: Progress = silent,
) -> Image:
    """A picture of mode full, mended by walks, with what they say of it in its metadata.

    image: without the lights that its camera sees. walk: gives walks that are ready. They are `settings.walks`,
    or as many as bring the error to `settings.error`, or else to GOOD, MOST_WALKS at most. `InputError` for an error
    that takes more than MOST_FULL_WALKS, with the part of the picture that is in the way.
    """
    if not image.palette.bands:
        return image
    sums = BlockSums(PictureBlocks.of(image), settings.seed, _blocks(settings))
    if not sums.chosen.size:
        return image
    through, wanted = walk(), settings.walks or FIRST_WALKS
    while True:
        sums.walk_on(wanted - sums.count, through)
        mender = Mender(sums)
        fit = mender.fitted(mender.all)
        error = Judge(mender).error(fit)
        wanted = _wanted(error, settings, name_of, image.alpha.shape[1])
        progress(min(sums.count / max(wanted, 1), 1.0), "walks")
        if wanted <= sums.count or (settings.error is None and wanted < sums.count + sums.least):
            break
        wanted = max(wanted, sums.count + sums.least)
    if error.mended.at_most > BAD:
        warnings.warn(error.line() + "; more walks, or mode path, bring it nearer", stacklevel=4)
    return replace(_with_factors(image, mender.factors(fit)), metadata=image.metadata | {KEY: error.record()})


def _blocks(settings: Settings) -> int:
    """Blocks that are walked at most: all where an error is asked for, as many as walks are enough for."""
    if settings.error is not None:
        return sys.maxsize
    enough = MOST_BLOCKS if settings.walks is None else settings.walks // BLOCK**2
    return min(max(enough, FEWEST_BLOCKS), MOST_BLOCKS)


def _wanted(error: FullError, settings: Settings, name_of: NameOf, width: int) -> int:
    """Walks that a picture should have in all."""
    asked, now = settings.error or GOOD, error.mended.at_most
    if settings.walks is not None or now <= asked:
        return 0
    needed = error.walks * (now / asked) ** 2
    if settings.error is None:
        return min(int(min(needed, AT_MOST * error.walks)), MOST_WALKS)
    if needed > MOST_FULL_WALKS:
        (row, column), matter = error.worst_at[1], name_of(error.worst_at[1][0] * width + error.worst_at[1][1])
        raise InputError(
            f"an error of {asked:g} takes about {needed:.2g} walks, and {MOST_FULL_WALKS:.2g} are the most: after "
            f"{error.walks:.2g} it is {now:.2g}, most of all at rows {row} to {row + BLOCK}, columns {column} to "
            f"{column + BLOCK}{matter}; give a larger error, or render by path"
        )
    return int(min(1.2 * needed, AT_MOST * error.walks)) + 1


def _with_factors(image: Image, factors: np.ndarray) -> Image:
    """The picture with its light of higher orders times `factors`, (height, width, groups · bands)."""
    groups, bands = len(image.palette.lamps), len(image.palette.bands)
    shape = image.alpha.shape
    weights = image.weights.reshape(*shape, groups, -1).copy()
    weights[..., -bands:] *= factors.reshape(*shape, groups, bands).astype(np.float32)
    return replace(image, weights=weights.reshape(*shape, -1))
