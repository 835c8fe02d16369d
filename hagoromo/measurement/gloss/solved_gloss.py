"""Solved gloss: the gloss of each pixel of a surface whose normals were solved, where photographs give evidence for it.

Enters: the photometric fit, with one gloss for each material. Leaves: the fit with ln β and ln γ of every pixel, its
tail 1/ν where that varies, too, and the normals and body colours that go with them. The glosses of a material follow a
normal law, whose mean and spread maximise the likelihood (empirical Bayes, `gloss_law`). They stay where photographs
that are left out are predicted better with them, over parts of the object that are independent of each other: an error
of the model that only looks like gloss does not do that.

Solved tails: the tail 1/ν of the facets of each pixel of a solved surface, under a normal law of the tails.

Tail and width of a pixel are known together or not at all, and what is known of a tail is far from a normal
distribution. So the gloss of every pixel is solved at each of TAILS, its likelihood is integrated over β and γ there
(Laplace), and the posterior of the tail is taken from these numbers, between which they are interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from hagoromo.measurement.gloss.gloss_spread import DECISIVE_LOG_ODDS, WIDEST, log_odds, trimmed_odds
from hagoromo.measurement.gloss.solved_pixels import SolvedPixels, State
from hagoromo.measurement.normals.highlight_check import angles
from hagoromo.measurement.normals.own_gloss import OWN, OwnGloss, OwnGlossTest
from hagoromo.measurement.normals.photometric_model import Fit, size
from hagoromo.measurement.normals.shading import TAIL, Gloss
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.gloss_posterior import GlossLaw, PixelGloss, deviance, likeliest

SOLVED_GLOSS_PIXELS = 1000  # of a material, at most, from which the law is estimated
FEWEST_PIXELS, FEWEST_LAMPS = 100, 6
ROUNDS = 3  # of law and estimates, which depend on each other
LARGEST_SHARED_ERROR = 0.25  # of ln β and ln γ of one gloss: a faint highlight shows no variation
FOLDS = 3  # parts of the lamps, each left out once
TILES = 4.0  # in a radius of the object: means over them are taken for independent
FEWEST_TILES = 8
CHANCE = 0.01  # probability that noise predicts photographs left out as much better
LEAST_GAIN = 0.02  # of their loss in the highlights
HIGHLIGHT, WITH_TAILS = 2.0, 5.0  # φ/γ up to which a value is one of a highlight, and of one with its tails
MOST_VALUES = 1_000_000  # solved at once: 0.5 GiB
ONE_GLOSS = 1e-4  # standard deviation of ln β and ln γ of a law of one gloss for all pixels
TAILS = np.array([0.0, 0.15, 0.3, 0.45, 0.65, 0.9, 1.2, 1.6, 2.2])  # 1/ν at which pixels are solved
BETWEEN = 12  # parts of each of their intervals
WIDEST_TAIL, NARROWEST_TAIL = 0.4, 0.02  # standard deviation of the law of 1/ν: at the start, and the least
TAIL_ROUNDS = 2  # of the laws of gloss and tails, which depend on each other
TAIL_LAW_STEPS = 300  # of expectation maximisation
SETTLED = 1e-4  # change of mean and deviation of the law in a step: below it the search has ended
NUMBERS = 5  # of the laws: three of the covariance of the gloss, mean and deviation of the tails


@dataclass(frozen=True, eq=False)
class Spread:
    """The law of (ln β, ln γ) of a material, that of its tails where they vary, and the test for both."""

    law: GlossLaw
    tails: TailLaw | None
    test: OwnGlossTest


def with_solved_gloss(views: Views, fit: Fit, seed: int = 0) -> Fit:
    """`fit` of `views` with the gloss of each pixel where it varies, and the normals and bodies that go with it.

    Materials of one gloss, of too few pixels or lamps, or without a highlight stay as they are.
    """
    random = np.random.default_rng(seed)
    spreads = [_spread(views, fit, number, random) for number in range(len(fit.gloss.rows))]
    tests = tuple(None if spread is None else spread.test for spread in spreads)
    if not any(test is not None and test.varies for test in tests):
        return replace(fit, own_tests=tests)
    found = replace(
        fit,
        normals=fit.normals.copy(),
        body=fit.body.copy(),
        variance=fit.variance.copy(),
        own=OwnGloss(fit.gloss.rows[:, OWN][fit.labels], fit.covariance[:, OWN[:, None], OWN][fit.labels]),
        own_tests=tests,
    )
    for number, spread in enumerate(spreads):
        if spread is not None and spread.test.varies:
            found = _filled(views, found, number, spread)
    return found


def _spread(views: Views, fit: Fit, number: int, random: np.random.Generator) -> Spread | None:
    """The variation of the gloss of a material; None where it has no highlight, or too few pixels or lamps show it."""
    pixels, shared = np.flatnonzero(fit.labels == number), fit.gloss.rows[number, :2]
    if len(pixels) < FEWEST_PIXELS or len(views.values) < FEWEST_LAMPS or not np.exp(shared[0]) > 0.0:
        return None
    if not np.all(np.diag(fit.covariance[number])[:2] <= LARGEST_SHARED_ERROR**2):
        return None
    some = np.sort(random.choice(pixels, min(SOLVED_GLOSS_PIXELS, len(pixels)), replace=False))
    data, part = data_of(views, fit, number, some), fit.pixels(some)
    one = GlossLaw(shared, ONE_GLOSS**2 * np.eye(2))
    start, alone = data.solve(one, data.state(np.tile(shared, (len(some), 1)), part.normals, part.body.T))
    law, state, own = GlossLaw(shared, WIDEST**2 * np.eye(2)), start, alone
    law = likeliest(alone, law)[0]
    if log_odds(alone, law, alone.chi_square) > DECISIVE_LOG_ODDS:
        law = GlossLaw(shared, WIDEST**2 * np.eye(2))
        for _ in range(ROUNDS):
            state, own = data.solve(law, state)
            law = likeliest(own, law)[0]
    odds, width = log_odds(own, law, alone.chi_square), float(np.exp(shared[1]))
    gain, p_value = 0.0, 1.0
    if odds > DECISIVE_LOG_ODDS:
        gain, p_value = _left_out(data, views.place[some], start, _Laws(one), _Laws(law), HIGHLIGHT * width, random)
    spread = Spread(law, None, _test(alone, own, law, (odds, gain, p_value), data))
    if not fit.gloss.rows[number, TAIL] > 0.0:
        return spread
    rival = _Laws(law if spread.test.varies else one)
    law, tails, found = likeliest_tails(data, law, float(fit.gloss.rows[number, TAIL]), state)
    more = tail_odds(found, alone.chi_square)
    if more - max(odds, 0.0) < DECISIVE_LOG_ODDS:
        return spread
    gain, p_value = _left_out(data, views.place[some], start, rival, _Laws(law, tails), WITH_TAILS * width, random)
    test = _test(alone, found.own, law, (more, gain, p_value), data, tails.deviation)
    return Spread(law, tails, test) if test.varies else spread


def _test(
    alone: PixelGloss,
    own: PixelGloss,
    law: GlossLaw,
    evidence: tuple[float, float, float],
    data: SolvedPixels,
    of_tails: float = 0.0,
) -> OwnGlossTest:
    """The test of `law` by its evidence: ln odds, and gain and p-value of lamps that were left out."""
    odds, gain, p_value = evidence
    values = max(float(np.isfinite(data.variance).sum()), 1.0)
    spread = np.sqrt(np.diag(law.covariance))
    return OwnGlossTest(
        odds > DECISIVE_LOG_ODDS and gain > LEAST_GAIN and p_value < CHANCE,
        (float(spread[0]), float(spread[1]), of_tails),
        odds,
        gain,
        p_value,
        (float(alone.chi_square.sum()) / values, float(own.chi_square.sum()) / values),
        float(np.mean(own.converged)),
    )


@dataclass(frozen=True, eq=False)
class _Laws:
    """Law of the gloss, and of the tails; None: all pixels have that of the material."""

    gloss: GlossLaw
    tails: TailLaw | None = None

    def solved(self, data: SolvedPixels, start: State) -> tuple[SolvedPixels, State]:
        """The pixels of `data` with their tails, and their state under the laws."""
        if self.tails is None:
            return data, data.solve(self.gloss, start)[0]
        found = pixel_tails(data, self.gloss, self.tails, start)
        return data.with_tails(found.tail), found.state


def data_of(views: Views, fit: Fit, number: int, pixels: NDArray[np.intp]) -> SolvedPixels:
    """The data of some `pixels` of material `number`.

    An error of the model is alike in all C channels of a value, so that it counts C times.
    """
    part, channels = views.pixels(pixels), views.values.shape[1]
    rows = [fit.gloss.rows[number]]
    for beta, gamma in () if fit.lobes is None else fit.lobes.each[number]:
        rows.append(np.concatenate([np.log([beta, gamma]), rows[0][2:TAIL], np.zeros(len(rows[0]) - TAIL)]))
    variance = part.variance + channels * (fit.model_error * size(part)) ** 2
    variance = np.where(part.used[:, None] & np.isfinite(variance), variance, np.inf)
    if part.lower is not None:
        variance = np.where(part.lower, channels * (fit.model_error * size(part)) ** 2, variance)
    return SolvedPixels(part, np.stack(rows), fit.gloss.colour[number], fit.evenness(views.place[pixels]), variance)


def _left_out(
    data: SolvedPixels,
    place: Array,
    start: State,
    plain: _Laws,
    laws: _Laws,
    reach: float,
    random: np.random.Generator,
) -> tuple[float, float]:
    """Share by which `laws` lower the loss of `plain` in lamps that are left out, within `reach` [rad] of the
    highlights, and its p-value by Student's t of tiles of the object.
    """
    lamps, fall, total = random.permutation(len(data.evenness)), np.zeros(len(place)), np.zeros(len(place))
    for fold in range(FOLDS):
        left_out = np.zeros(len(lamps), bool)
        left_out[lamps[fold::FOLDS]] = True
        losses = []
        for one in (plain, laws):
            solved, state = one.solved(data.without(left_out), start)
            losses.append(_loss(replace(data.without(~left_out), tail=solved.tail), state, reach))
        fall += losses[0] - losses[1]
        total += losses[0]
    tile = np.floor(TILES * place).astype(np.int64)
    tile -= tile.min(axis=0)
    names = np.unique(tile[:, 1] * (int(tile[:, 0].max()) + 1) + tile[:, 0], return_inverse=True)[1]
    light = np.bincount(names, total)  # of tiles with highlights
    means = (np.bincount(names, fall) / np.bincount(names))[light > 0.0]
    if len(means) < FEWEST_TILES:
        return 0.0, 1.0
    statistic = float(means.mean() / max(means.std(ddof=1) / np.sqrt(len(means)), 1e-300))
    return float(fall.sum() / max(total.sum(), 1e-300)), float(student.sf(statistic, len(means) - 1))


def _loss(data: SolvedPixels, state: State, reach: float) -> Array:
    """(P,) loss of the values of `data` within `reach` [rad] of the highlights, as `state` predicts them."""
    near = angles(state.normals, data.views) < reach
    here = replace(data, variance=np.where(near[:, None], data.variance, np.inf))
    return here.state(state.gloss, state.normals, state.body).loss


def _filled(views: Views, fit: Fit, number: int, spread: Spread) -> Fit:
    """`fit` with the gloss of all pixels of a material, whose own becomes the mean of its law."""
    assert fit.own is not None
    pixels, law = np.flatnonzero(fit.labels == number), spread.law
    for part in np.array_split(pixels, -(-len(pixels) * views.values[:, :, 0].size // MOST_VALUES)):
        data, here = data_of(views, fit, number, part), fit.pixels(part)
        start = data.state(np.tile(law.mean, (len(part), 1)), here.normals, here.body.T)
        if spread.tails is None:
            state, own = data.solve(law, start)
            fit.own.covariance[part, :2, 2] = fit.own.covariance[part, 2, :2] = 0.0
            fit.own.covariance[part, :2, :2] = own.covariance
        else:
            found = pixel_tails(data, law, spread.tails, start)
            state, own = found.state, found.own
            fit.own.value[part, 2], fit.own.covariance[part] = found.tail, found.covariance
        fit.own.value[part, :2] = own.gloss
        fit.normals[part], fit.body[:, part] = state.normals, state.body.T
        fit.variance[part] = state.normal_variance(law)
    rows, moved = fit.gloss.rows.copy(), np.exp(law.mean - fit.gloss.rows[number, :2])
    rows[number, :2] = law.mean
    if spread.tails is not None:
        rows[number, TAIL] = spread.tails.mean
    if fit.lobes is None:
        return replace(fit, gloss=Gloss(rows))
    each = list(fit.lobes.each)
    each[number] = tuple((float(beta * moved[0]), float(gamma * moved[1])) for beta, gamma in each[number])
    return replace(fit, gloss=Gloss(rows), lobes=replace(fit.lobes, each=tuple(each)))


@dataclass(frozen=True)
class TailLaw:
    """Normal law of the tails 1/ν over the pixels of a material, cut off at the ends of TAILS."""

    mean: float
    deviation: float


@dataclass(frozen=True, eq=False)
class PixelTails:
    """Tails of P pixels and what goes with them.

    tail: (P,) mean of the posterior. state, own: of pixels that have this tail. covariance: (P, 3, 3) of ln β, ln γ and
    1/ν. deviance: (P,) −2 ln of the likelihood, integrated over gloss and tail.
    """

    tail: Array
    state: State
    own: PixelGloss
    covariance: Array
    deviance: Array


def pixel_tails(data: SolvedPixels, law: GlossLaw, tails: TailLaw, start: State) -> PixelTails:
    """The tails of the pixels of `data` under both laws."""
    return _Grid(data, law, start).under(tails)


def likeliest_tails(
    data: SolvedPixels, law: GlossLaw, mean: float, start: State
) -> tuple[GlossLaw, TailLaw, PixelTails]:
    """Laws of gloss and tails of highest likelihood, from tails about `mean` on, and the pixels under them."""
    tails, state = TailLaw(mean, WIDEST_TAIL), start
    for _ in range(TAIL_ROUNDS):
        grid = _Grid(data, law, state)
        tails = grid.likeliest(tails)
        found = grid.under(tails)
        state, law = found.state, likeliest(found.own, law)[0]
    return law, tails, pixel_tails(data, law, tails, state)


def tail_odds(found: PixelTails, shared: Array) -> float:
    """Logarithm of the odds of laws of gloss and tails against one gloss with χ² `shared` (P,)."""
    return trimmed_odds(0.5 * (shared - found.deviance), NUMBERS)


class _Grid:
    """The gloss of P pixels at each of TAILS, and what their photographs say of the tails between them."""

    def __init__(self, data: SolvedPixels, law: GlossLaw, start: State) -> None:
        self.data, self.law, self.state = data, law, start
        gloss, deviances = [], []
        for tail in TAILS:
            _, own = data.with_tails(np.full(len(start.loss), tail)).solve(law, start)
            gloss.append(own.gloss)
            deviances.append(deviance(own, law))
        self.gloss = np.stack(gloss, axis=1)
        parts = np.arange(BETWEEN * (len(TAILS) - 1) + 1) / BETWEEN
        self.tails = np.interp(parts, np.arange(len(TAILS)), TAILS)
        self.share = np.stack([np.interp(parts, np.arange(len(TAILS)), one) for one in np.eye(len(TAILS))], axis=1)
        from scipy.interpolate import PchipInterpolator

        self.deviance = np.asarray(PchipInterpolator(TAILS, np.stack(deviances, axis=1), axis=1)(self.tails))

    def likeliest(self, law: TailLaw) -> TailLaw:
        """The law of tails of highest likelihood near `law`, by expectation maximisation."""
        for _ in range(TAIL_LAW_STEPS):
            share = self._posterior(law)[0]
            mean = float(np.mean(share @ self.tails))
            spread = max(float(np.sqrt(np.mean(share @ (self.tails - mean) ** 2))), NARROWEST_TAIL)
            change, law = max(abs(mean - law.mean), abs(spread - law.deviation)), TailLaw(mean, spread)
            if change < SETTLED:
                break
        return law

    def under(self, law: TailLaw) -> PixelTails:
        """The pixels under a law of tails."""
        share, of_all = self._posterior(law)
        tail = share @ self.tails
        state, own = self.data.with_tails(tail).solve(self.law, self.state)
        parts = share @ self.share  # (P, T) of the posterior, at each of TAILS
        off = self.gloss - np.einsum("pt,pti->pi", parts, self.gloss)[:, None]
        covariance = np.zeros((len(tail), 3, 3))
        covariance[:, :2, :2] = own.covariance + np.einsum("pt,pti,ptj->pij", parts, off, off)
        covariance[:, :2, 2] = covariance[:, 2, :2] = np.einsum("pt,pti,pt->pi", parts, off, TAILS - tail[:, None])
        covariance[:, 2, 2] = np.einsum("pt,pt->p", share, (self.tails - tail[:, None]) ** 2)
        return PixelTails(tail, state, own, covariance, of_all)

    def _posterior(self, law: TailLaw) -> tuple[Array, Array]:
        """(P, F) of the tails, and −2 ln of their integral (P,)."""
        prior = -0.5 * ((self.tails - law.mean) / law.deviation) ** 2 + np.log(np.gradient(self.tails))
        prior -= np.log(np.exp(prior - prior.max()).sum()) + prior.max()
        logarithm = prior - 0.5 * self.deviance
        most = logarithm.max(axis=1, keepdims=True)
        share = np.exp(logarithm - most)
        total = share.sum(axis=1, keepdims=True)
        return share / total, -2.0 * (np.log(total) + most)[:, 0]
