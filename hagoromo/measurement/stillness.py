"""Stillness: photographs of one view that moved, or are blurred, beside what the others make of them.

Photographs of a matte surface under far lamps are, but for shadows, sums of three of them (Shashua 1997), and with
shadows and some gloss nearly so of a few more (Basri & Jacobs 2003). So each photograph is predicted as a sum of the
others, without a word of the lamps. The factors come from the photographs smoothed, where a small shift or blur changes
nothing; whether the prediction is then nearer to the photograph when it is shifted, or blurred, shows in fine detail
(Lucas & Kanade 1981). Highlights and cast shadows, which the others do not have, count little (Huber's loss).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import ROBUST_SCALE, Loss
from hagoromo.measurement.linearity import LEAST_SIGNAL, one_view
from hagoromo.measurement.squares import square_means
from hagoromo.measurement.trials import Trials, tried
from hagoromo.photograph.photograph import Photograph

Array = NDArray[Any]

FEWEST = 3  # photographs
COMPARED_PIXELS = 160_000  # largest number of pixels that are compared; larger photographs are binned
SIDE = 400  # px, at most, of the part whose blur is looked at; it is not binned
MARGIN = 8  # px around the object that are looked at, too
OUTLINE = 3.0  # px over which the object's outline counts
BORDER = 4  # px of the picture's border that do not count
COARSE, FINE = 3.0, 5.0  # [px] factors are found above this scale, shifts and blur below that one
STRENGTH, FAINT = 8.0, 0.05  # [px] over which the strength of edges is made alike, and the share of the largest left
SHADE, DARK = 1.5, 0.2  # [px], and share of its largest light below which a place is in shadow, and does not count
EMPTY = 0.005  # share of what bright places show at most, below which a place is empty
TERMS = 4  # of the sums
FEWEST_PIXELS = 10 * TERMS  # of a photograph, that give its factors
THINNED = 2  # each so many pixels, along rows and columns, give the factors
LOSS = Loss("huber", 1.5)
ROUNDS = 4  # of reweighting
STEPS, SETTLED, STRAYED = 8, 0.03, 0.3  # of a shift, the last one [px], and a last one that leads nowhere
FARTHEST = 2.0  # px of a step, and beyond which edges are compared from afar, too
LEAST_FACTOR = 0.3  # of the prediction, in the size of a step
BLOCKS = 4  # along each side, that are left out one after the other (jackknife)
FEW = 6  # photographs from which sums of the others are near to each
# Misfit of the prediction shifted or blurred over that without, from which it is said: of few photographs, and of many,
# less so much for each: cast shadows and gloss that the others lack look like shifts where few are summed.
BETTER_OF_FEW, BETTER, BETTER_EACH = 0.5, 0.85, 0.6
SHIFT_PX = (0.35, 0.6)  # least shift that is said, of photographs that stand still otherwise, and of any
UNUSUAL = 4.0  # times the usual shift (as a standard deviation along an axis)
CERTAIN = 5.0  # standard errors of a shift
BLURS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0)  # [px] standard deviations of a Gaussian
BLUR_PX, LEFT_OUT_PX = 1.5, 1.0  # least blur that is said, with all blocks and without any one
TRIED_SHIFT, TRIED_BLUR = 1.0, 2.0  # px, of trials
LEAST_SHOWN = 0.01  # share of the pixels that must show the scene; a photograph nearly black says nothing
MOST_NAMED = 6  # photographs after which no further rounds are made


@dataclass(frozen=True)
class Stillness:
    """shifts: name → (x, y) [px] of photographs that are shifted against the others. blurs: name → standard deviation
    [px] of those that are less sharp. shift_trials, blur_trials: how often a shift of one pixel, a blur of two, would
    be said.
    """

    shifts: Mapping[str, tuple[float, float]]
    blurs: Mapping[str, float]
    shift_trials: Trials
    blur_trials: Trials


def stillness(photographs: Sequence[Photograph]) -> Stillness | None:
    """Which photographs moved or are blurred; None for fewer than three, and for those of several views."""
    shots = [shot for shot in photographs if _shows_scene(shot)] if one_view(photographs) else []
    if len(shots) < FEWEST:
        return None
    mask = np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots)
    if not mask.any():
        return None
    whole = _object(mask)
    height, width = (part.stop - part.start for part in whole)
    step = max(int(np.ceil(np.sqrt(height * width / COMPARED_PIXELS))), 1)
    views = _Views(shots, mask, whole, step)
    shifts, shift_trials = _moved(views)
    sharp = views if step == 1 and max(height, width) <= SIDE else _Views(shots, mask, _finest(shots, mask, whole), 1)
    blurs, blur_trials = _blurred(sharp, {k: step * shift for k, shift in shifts.items()})
    return Stillness(
        {shots[k].name: (step * float(x), step * float(y)) for k, (y, x) in sorted(shifts.items())},
        {shots[k].name: blur for k, blur in sorted(blurs.items())},
        shift_trials,
        blur_trials,
    )


class _Views:
    """The grey photographs (K, h, w) of a `part` of the picture, binned by `step`, and those smoothed."""

    def __init__(self, shots: Sequence[Photograph], mask: Array, part: tuple[slice, slice], step: int) -> None:
        from scipy.ndimage import gaussian_filter

        self.grey = np.stack([square_means(_grey(shot.values[part]), step) for shot in shots])
        clipped = np.stack([square_means((mask & ~shot.mask)[part].astype(np.float64), step) > 0.0 for shot in shots])
        near = square_means(gaussian_filter(mask[part].astype(np.float64), OUTLINE), step) > 0.02
        inner = np.zeros_like(near)
        inner[BORDER:-BORDER, BORDER:-BORDER] = True
        softened = gaussian_filter(self.grey, (0.0, SHADE, SHADE))
        largest = softened.max(axis=0)
        lit = (softened > DARK * largest) & (largest > EMPTY * np.quantile(largest, 0.9))
        self.usable = ~clipped & lit & (near & inner)
        self.smooth = np.stack([gaussian_filter(grey, COARSE)[::THINNED, ::THINNED] for grey in self.grey])
        fine = np.stack([_fine(grey) for grey in self.grey])
        floor = FAINT * max(float(np.quantile(np.abs(fine), 0.99)), 1e-30)
        self.edges = fine / (np.sqrt(gaussian_filter(fine**2, (0.0, STRENGTH, STRENGTH))) + floor)
        flat = self.smooth.reshape(len(shots), -1).astype(np.float64)
        self.products = flat @ flat.T
        rows, columns = (np.arange(size) * BLOCKS // size for size in self.grey.shape[1:])
        self.block = rows[:, None] * BLOCKS + columns

    def count(self, number: int) -> int:
        """Pixels of a photograph that give its factors."""
        return int(np.count_nonzero(self.usable[number, ::THINNED, ::THINNED]))

    def with_picture(self, number: int, picture: Array) -> _Views:
        """The same with another picture (h, w) for one photograph."""
        changed = copy(self)
        changed.grey = self.grey.copy()
        changed.grey[number] = picture
        return changed

    def coarse_shift(self, number: int, among: Sequence[int]) -> Array:
        """(2,) (down, across) [px] by which edges are shifted against those of the others, however far: whole pixels,
        by phase correlation.
        """
        from skimage.registration import phase_cross_correlation

        window = np.outer(*(np.hanning(n + 2)[1:-1] for n in self.grey.shape[1:]))
        others = self.edges[[k for k in among if k != number]].sum(axis=0) * window
        own = self.edges[number] * window
        return np.asarray(phase_cross_correlation(own, others)[0], np.float64) if own.any() else np.zeros(2)

    def prediction(self, number: int, among: Sequence[int], shift: Array | None = None) -> Array:
        """(h, w) the photograph as a sum of the others in `among`; shift: far, by which it is moved back for that."""
        others = [k for k in among if k != number]
        size, vectors = np.linalg.eigh(self.products[np.ix_(others, others)])
        main = vectors[:, ::-1][:, :TERMS]
        usable = self.usable[number, ::THINNED, ::THINNED]
        terms = main.T @ self.smooth[others][:, usable].astype(np.float64)
        own = self.smooth[number].astype(np.float64)
        own = (own if shift is None else _shifted(own, -shift / THINNED))[usable]
        weight, factor = np.ones_like(own), np.zeros(len(terms))
        for _ in range(ROUNDS):
            squares = (terms * weight) @ terms.T + (1e-9 * size[-1] + 1e-300) * np.eye(len(terms))
            factor = np.linalg.solve(squares, (terms * weight) @ own)
            weight = _weight(own - factor @ terms)
        return np.asarray(np.tensordot(main @ factor, self.grey[others], axes=(0, 0)), np.float64)


class _Pair(NamedTuple):
    """Fine detail of a photograph and of its prediction (h, w), where they count (h, w), and the blocks (h, w)."""

    own: Array
    prediction: Array
    usable: Array
    block: Array

    def misfits(self, predictions: Sequence[Array]) -> Array:
        """(N, BLOCKS²) sums of Huber's loss of the photograph to each of N predictions, each with a factor."""
        own = self.own[self.usable]
        offered = [one[self.usable] for one in predictions]
        scale = min(_scale(own - one) for one in offered)
        block, sums = self.block[self.usable], []
        for one in offered:
            factor = 1.0
            for _ in range(ROUNDS):
                weight = LOSS.weight((own - factor * one) / scale)
                factor = float(np.sum(weight * one * own) / max(float(np.sum(weight * one * one)), 1e-300))
            sums.append(np.bincount(block, LOSS.value((own - factor * one) / scale), BLOCKS**2))
        return np.array(sums)

    def shift(self, start: Array) -> tuple[Array, float]:
        """(2,) (down, across) [px] by which the photograph is shifted against the prediction, and how many standard
        errors that is, by leaving out blocks.
        """
        shift = start.copy()
        for _ in range(STEPS):
            there = _shifted(self.prediction, shift)
            down, across = np.gradient(there)
            columns = np.stack([part[self.usable] for part in (-down, -across, there)], axis=1)
            own, weight = self.own[self.usable], np.ones(np.count_nonzero(self.usable))
            found = np.zeros(3)
            for _ in range(ROUNDS):
                found = _solved(columns.T @ (columns * weight[:, None]), columns.T @ (weight * own))
                weight = _weight(own - columns @ found)
            step = np.clip(found[:2] / max(found[2], LEAST_FACTOR), -FARTHEST, FARTHEST)
            if np.hypot(*step) < SETTLED:
                break
            shift = shift + step
        return shift, self._certainty(shift + step, columns, weight) if np.hypot(*step) < STRAYED else 0.0

    def _certainty(self, shift: Array, columns: Array, weight: Array) -> float:
        own, block = self.own[self.usable], self.block[self.usable]

        def of_blocks(values: Array) -> Array:
            return np.bincount(block, values, BLOCKS**2)

        squares = np.array([[of_blocks(weight * a * b) for b in columns.T] for a in columns.T]).transpose(2, 0, 1)
        right = np.array([of_blocks(weight * a * own) for a in columns.T]).T
        detail = squares[:, 0, 0] + squares[:, 1, 1]
        blocks = np.flatnonzero(detail > 1e-3 * detail.sum())
        if len(blocks) < 2:
            return 0.0
        without = [_solved(squares.sum(axis=0) - squares[k], right.sum(axis=0) - right[k]) for k in blocks]
        steps = np.array([one[:2] / max(one[2], LEAST_FACTOR) for one in without])
        off = steps - steps.mean(axis=0)
        covariance = (len(blocks) - 1) / len(blocks) * off.T @ off + 1e-4 * np.eye(2)
        return float(np.sqrt(shift @ np.linalg.solve(covariance, shift)))


def _pair(views: _Views, number: int, prediction: Array) -> _Pair:
    own = _fine(views.grey[number].astype(np.float64))
    return _Pair(own, _fine(prediction), views.usable[number], views.block)


class _Found(NamedTuple):
    """What is found of a photograph. value: its shift (2,) or blur. misfit: of the prediction changed by it over that
    of the prediction as it is. certain: of a shift, its standard errors; of a blur, the least without one block.
    """

    value: Any
    misfit: float
    certain: float


Look = Callable[[_Views, int, Sequence[int]], _Found]  # at a photograph, beside some others


def _moved(views: _Views) -> tuple[dict[int, Array], Trials]:
    """Shifts (down, across) [px of `views`] of photographs that moved, and how often one of TRIED_SHIFT is said."""
    found = _looked(views, _look_at_shift)
    usual = np.median([np.hypot(*one.value) for one in found.values()]) if found else 0.0
    limit = np.clip(UNUSUAL * usual / np.sqrt(2.0 * np.log(2.0)), *SHIFT_PX)  # the median of a Rayleigh distribution

    better = _better(len(views.grey))

    def said(one: _Found) -> bool:
        return bool(one.misfit < better and one.certain > CERTAIN and np.hypot(*one.value) > limit)

    def spoil(picture: Array) -> Array:
        return _shifted(picture, np.full(2, TRIED_SHIFT / np.sqrt(2.0)))

    return _named(views, found, _look_at_shift, said), _trials(views, found, _look_at_shift, said, spoil)


def _look_at_shift(views: _Views, number: int, among: Sequence[int]) -> _Found:
    pair = _pair(views, number, views.prediction(number, among))
    tries = [(pair.prediction, *pair.shift(np.zeros(2)))]
    far = views.coarse_shift(number, among)
    if np.hypot(*far) > FARTHEST:
        moved = pair._replace(prediction=_fine(views.prediction(number, among, far)))
        tries.append((moved.prediction, *moved.shift(far)))
    changed = [_shifted(prediction, shift) for prediction, shift, _ in tries]
    plain, *misfits = pair.misfits([pair.prediction, *changed]).sum(axis=1) + 1e-300
    best = int(np.argmin(misfits))
    _, shift, certain = tries[best]
    return _Found(shift, misfits[best] / plain, certain)


def _blurred(views: _Views, shifts: Mapping[int, Array]) -> tuple[dict[int, float], Trials]:
    """Blurs [px of `views`] of photographs that are less sharp, and how often one of TRIED_BLUR is said."""
    from scipy.ndimage import gaussian_filter

    def look(views: _Views, number: int, among: Sequence[int]) -> _Found:
        return _look_at_blur(views, number, among, shifts.get(number))

    better = _better(len(views.grey))

    def said(one: _Found) -> bool:
        return one.misfit < better and one.certain >= LEFT_OUT_PX and one.value >= BLUR_PX

    def spoil(picture: Array) -> Array:
        return np.asarray(gaussian_filter(picture, TRIED_BLUR))

    found = _looked(views, look)
    return _named(views, found, look, said), _trials(views, found, look, said, spoil)


def _look_at_blur(views: _Views, number: int, among: Sequence[int], shift: Array | None) -> _Found:
    from scipy.ndimage import gaussian_filter

    whole = views.prediction(number, among)
    whole = whole if shift is None else _shifted(whole, shift)
    pair = _pair(views, number, whole)

    def misfits(blurs: Sequence[float]) -> Array:
        return pair.misfits([_fine(gaussian_filter(whole, blur)) for blur in blurs]) + 1e-300

    plain, tried = misfits((0.0, TRIED_BLUR)).sum(axis=1)
    if tried > plain:  # most photographs: no blur of that size or more
        return _Found(0.0, 1.0, 0.0)
    each = misfits(BLURS)
    total = each.sum(axis=1)
    best, without = int(np.argmin(total)), np.argmin(total[:, None] - each, axis=0)
    return _Found(BLURS[best], total[best] / total[0], min(BLURS[k] for k in without))


def _better(count: int) -> float:
    """Of `count` photographs: misfit from which a shift or blur is said."""
    return BETTER_OF_FEW if count < FEW else BETTER - BETTER_EACH / count


def _looked(views: _Views, look: Look) -> dict[int, _Found]:
    among = range(len(views.grey))
    return {k: look(views, k, among) for k in among if views.count(k) > FEWEST_PIXELS}


def _named(views: _Views, found: Mapping[int, _Found], look: Look, said: Callable[[_Found], bool]) -> dict[int, Any]:
    """Values of the photographs of which something is said; the clearest first, and the others again without it."""
    among, named = list(found), {}
    while True:
        candidates = {k: one for k, one in found.items() if said(one)}
        if not candidates or len(named) == MOST_NAMED or len(among) <= FEWEST:
            return named | {k: one.value for k, one in candidates.items()}
        worst = min(candidates, key=lambda k: candidates[k].misfit)
        named[worst] = candidates.pop(worst).value
        among.remove(worst)
        found = {k: look(views, k, among) for k in candidates}


def _trials(
    views: _Views, found: Mapping[int, _Found], look: Look, said: Callable[[_Found], bool],
    spoil: Callable[[Array], Array],
) -> Trials:  # fmt: skip
    """How often something is said of a photograph that was spoilt; nothing is of one that shows too little."""
    among = list(found)
    spoilt = ((k, views.with_picture(k, spoil(views.grey[k]))) for k in tried(len(views.grey)))
    return Trials.of(k in found and said(look(there, k, among)) for k, there in spoilt)


def _fine(picture: Array) -> Array:
    """Without what is coarser than FINE."""
    from scipy.ndimage import gaussian_filter

    return picture - gaussian_filter(picture, FINE)


def _shifted(picture: Array, shift: Array) -> Array:
    """Down and across [px]."""
    from scipy import ndimage

    return ndimage.shift(picture, shift, order=3, mode="nearest") if np.any(shift) else picture


def _scale(residual: Array) -> float:
    """Standard deviation by the median, above 0."""
    return ROBUST_SCALE * float(np.median(np.abs(residual))) + 1e-9 * float(np.abs(residual).max(initial=0.0)) + 1e-300


def _weight(residual: Array) -> Array:
    return LOSS.weight(residual / _scale(residual))


def _solved(squares: Array, right: Array) -> Array:
    size = len(right)
    return np.asarray(np.linalg.solve(squares + (1e-9 * np.trace(squares) + 1e-300) * np.eye(size), right))


def _object(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of the object, with a margin."""
    parts = []
    for axis in (1, 0):
        some = np.flatnonzero(mask.any(axis=axis))
        parts.append(slice(max(some[0] - MARGIN, 0), some[-1] + 1 + MARGIN))
    rows, columns = (slice(one.start, min(one.stop, size)) for one, size in zip(parts, mask.shape, strict=True))
    return rows, columns


def _finest(shots: Sequence[Photograph], mask: Array, whole: tuple[slice, slice]) -> tuple[slice, slice]:
    """Rows and columns of the part of the object, at most SIDE px wide and high, with the strongest fine detail."""
    from scipy.ndimage import uniform_filter

    mean = np.mean([_grey(shot.values[whole]) for shot in shots], axis=0)
    detail = uniform_filter(np.where(mask[whole], np.abs(_fine(mean)), 0.0), SIDE, mode="constant")
    middle = np.unravel_index(np.argmax(detail), detail.shape)
    parts = []
    for centre, part, length in zip(middle, whole, detail.shape, strict=True):
        start = part.start + int(np.clip(centre - SIDE // 2, 0, max(length - SIDE, 0)))
        parts.append(slice(start, min(start + SIDE, part.stop)))
    return parts[0], parts[1]


def _shows_scene(photograph: Photograph) -> bool:
    """Whether enough pixels, binned, exceed the noise of the mean of the colours."""
    height, width, channels = photograph.values.shape
    step = max(int(np.ceil(np.sqrt(height * width / COMPARED_PIXELS))), 1)
    signal, variance = (square_means(_grey(layer), step) for layer in (photograph.values, photograph.variance))
    shown = signal > LEAST_SIGNAL * np.sqrt(np.maximum(variance, 0.0) / channels) / step
    return bool(shown.mean() > LEAST_SHOWN)


def _grey(values: Array) -> Array:
    """(h, w) mean over the channels of (h, w, channels), 0 where it is not finite."""
    mean = values @ np.full(values.shape[2], 1.0 / values.shape[2], values.dtype)
    return np.where(np.isfinite(mean), mean, 0.0)
