"""Lobe fit: further lobes of the interface, on solved normals, where photographs that are left out need them.

The photometric fit has one lobe, and its robust loss takes a narrow spike above a wide haze for outliers: the normals
are right, but the highlight is missing. Here the density of the facets is a sum of Gaussians of many widths, all with β
of 0 or more (non-negative least squares), and body colours are eliminated pixel by pixel. Light in excess of the model
counts in full, as it is what is sought; light that is missing counts little, as shadows do. A clipped value is a lower
bound. The lobes stay where they predict photographs that were left out better, and each where there is evidence for it.

Lobe evidence: whether the photographs hold each lobe of a highlight, or do as well without it.

A lobe can lower the squared error of a few bright or clipped values and still be unknown: what the values weigh leaves
it free. The evidence for a lobe is what the likelihood loses without it, the others refined (Schwarz 1978):

    ln odds = ½ (D without − D with)/κ − ½ · 2 ln N,   D = loss + Σ ln variance.

Each side has the noise that errors of the normals make on the flanks of its own lobes. κ is how much more the sums of
residuals over a part of the object, under one lamp and in all channels, vary than those of independent noise: errors of
the model are alike there. N is the number of independent values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float
from hagoromo.measurement.gloss.gloss_spread import DECISIVE_LOG_ODDS
from hagoromo.measurement.normals.lobe_samples import Samples, Trust, inner_products, samples_of, total_of, trust_of
from hagoromo.measurement.normals.lobe_shape import (
    LobeShapes,
    cost_of,
    fewest,
    interface_of,
    refined,
    tiles_of,
    weighed_residuals,
    widened,
    with_covariance,
    with_errors_of_normals,
)
from hagoromo.measurement.normals.photometric_model import Fit, LobeParameters
from hagoromo.measurement.normals.shading import EXPONENT, SIGMA, TAIL, Gloss
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.reflectance import MOST_LOBES

WIDTHS = np.radians(np.geomspace(0.5, 45.0, 16))  # [rad] of the candidates
DISTINCT = 1.25  # ratio of a candidate's width to γ of the first lobe, at least
LOBE_PIXELS = 6000  # pixels of a material, at most, from which its lobes are estimated
LOBE_VALUES, FEWEST_OF_LOBES = 190_000, 1000  # lamps × pixels of them, at most, and pixels that are taken in any case
FEWEST_PIXELS = 200
FOLDS = 3  # parts of the lamps, each left out once
LEAST_GAIN = 0.05  # of the squared error of lamps left out: with less the lobes are not kept
LEAST_SHARE = 1e-3  # of the light of all lobes: a lobe with less is dropped
PASSES = 2  # of re-weighting
LAST_PASSES = 6  # of the lobes that are kept: their spike rises until clipped values are reached
RIDGE = 1e-8  # relative, of the normal equations
NUMBERS = 2  # of a lobe: β and γ


@dataclass(frozen=True, eq=False)
class FoundLobes:
    """The lobes of a material, whether its interface stays coloured, and their gain: see `LobeParameters`."""

    shapes: LobeShapes
    coloured: bool
    gain: float

    def widened(self, fit: Fit, own: NDArray[np.intp]) -> FoundLobes:
        """With the errors that the model, and the normals of the material's `own` pixels, make."""
        known = fit.variance[own][np.isfinite(fit.variance[own])]
        normal_error = float(np.sqrt(np.median(known) / 2.0)) if len(known) else 0.0
        return replace(self, shapes=widened(self.shapes, normal_error, fit.model_error))


def with_lobes(capture: Capture, views: Views, fit: Fit, seed: int = 0) -> Fit:
    """`fit` with further lobes of each material whose highlight needs them, and body colours that go with them.

    Pixels of materials without further lobes stay as they are. capture: of `views`, whose masks are used here.
    """
    trust = trust_of(capture, views)
    each = find_lobes(views, fit, views.place, trust, seed)
    return with_bodies(views, fit_with(fit, each), views.place, trust, each) if any(each) else fit


def find_lobes(views: Views, fit: Fit, place: Array, trust: Trust, seed: int = 0) -> list[FoundLobes | None]:
    """Of each material its lobes where its highlight needs further ones; place: (P, 2) of the pixels."""
    random, each = np.random.default_rng(seed), []
    for number in range(len(fit.gloss.rows)):
        own = np.flatnonzero(fit.labels == number)
        if len(own) < FEWEST_PIXELS or len(views.values) < 2 * FOLDS or not np.exp(fit.gloss.rows[number, 0]) > 0.0:
            each.append(None)
            continue
        some = np.sort(random.choice(own, min(len(own), most_pixels(len(views.values))), replace=False))
        samples = samples_of(views.pixels(some), fit.pixels(some), place[some], trust.pixels(some))
        found = lobes_of(samples, fit.gloss.rows[number], fit.variance[some], place[some], random)
        each.append(None if found is None else found.widened(fit, own))
    return each


def with_lobes_refined(capture: Capture, views: Views, fit: Fit, seed: int = 0) -> Fit:
    """`fit`, whose normals moved since its lobes were found, with lobes and body colours that fit best there."""
    trust, random, place, each = trust_of(capture, views), np.random.default_rng(seed), views.place, []
    assert fit.lobes is not None
    for number, further in enumerate(fit.lobes.each):
        if not further:
            each.append(None)
            continue
        own, row = np.flatnonzero(fit.labels == number), fit.gloss.rows[number]
        some = np.sort(random.choice(own, min(len(own), most_pixels(len(views.values))), replace=False))
        samples = samples_of(views.pixels(some), fit.pixels(some), place[some], trust.pixels(some))
        shapes = LobeShapes(np.concatenate([row[None, :2], np.log(further)]), float(row[TAIL]))
        for _ in range(PASSES):
            samples = with_errors_of_normals(samples, shapes, fit.variance[some])
            shapes = refined(samples, shapes)
        found = FoundLobes(with_covariance(samples, shapes, place[some]), samples.coloured, fit.lobes.gains[number])
        each.append(found.widened(fit, own))
    return with_bodies(views, fit_with(fit, each), place, trust, each)


def most_pixels(lamps: int) -> int:
    """The most pixels of a material from which lobes are estimated: of many lamps, many say the same."""
    return min(LOBE_PIXELS, max(LOBE_VALUES // lamps, FEWEST_OF_LOBES))


def with_bodies(views: Views, fit: Fit, place: Array, trust: Trust, each: Sequence[FoundLobes | None]) -> Fit:
    """`fit`, which has the lobes `each`, with the body colours that go with them."""
    body = fit.body.copy()
    for number, one in enumerate(each):
        own = np.flatnonzero(fit.labels == number)
        if one is not None and len(own):
            for part in np.array_split(own, -(-len(own) // LOBE_PIXELS)):  # bounded memory
                here = samples_of(views.pixels(part), fit.pixels(part), place[part], trust.pixels(part))
                here = with_errors_of_normals(here, one.shapes, fit.variance[part])
                body[:, part] = here.numbers(here.bodies(interface_of(here, one.shapes)))
    return replace(fit, body=body)


def lobes_of(
    samples: Samples, row: Array, variance: Array, place: Array, random: np.random.Generator
) -> FoundLobes | None:
    """The lobes of a material whose gloss is `row`, the one with tails or else the widest first; None where that of
    the fit is enough. One lobe of other tails or width may do. variance: (P,) of the normals of the
    samples [rad²]; place: (P, 2) of them.
    """
    widths = WIDTHS[np.abs(np.log(WIDTHS) - row[1]) > np.log(DISTINCT)]
    weights, kept = _fewest(samples, *_lobes(samples, widths))
    if _gain(samples, samples, weights, kept) < LEAST_GAIN:  # not even of the photographs that it was fitted to
        return None
    gain = _cross_validated(samples, widths, random)
    if gain < LEAST_GAIN:
        return None
    weights, kept = _lobes(samples, kept, LAST_PASSES, weights)
    weights[0] = max(weights[0], LEAST_SHARE)
    more = np.stack([np.log(np.maximum(weights[1:], 1e-30)), np.log(kept)], axis=1)[weights[1:] > 0.0]
    start = np.concatenate([[[row[0] + np.log(weights[0]), row[1]]], more])
    shapes, samples = fewest(samples, LobeShapes(start, float(row[TAIL])), LEAST_GAIN)
    for _ in range(PASSES):
        if len(shapes.each) > 1:
            shapes, samples = fewest(with_errors_of_normals(samples, shapes, variance), shapes, LEAST_GAIN)
    shapes, samples = held(samples, shapes, variance, place)
    if shapes.tail == 0.0:
        shapes = replace(shapes, each=shapes.each[np.argsort(-shapes.each[:, 1])])
    return FoundLobes(with_covariance(samples, shapes, place), samples.coloured, gain)


def fit_with(fit: Fit, each: Sequence[FoundLobes | None]) -> Fit:
    """`fit` with the lobes of each material, and their errors; as it is where none has further ones."""
    if not any(each):
        return fit
    rows, covariance = fit.gloss.rows.copy(), fit.covariance.copy()
    choice = fit.choice
    if choice is not None:
        choice = replace(choice, free=choice.free.copy(), tails=choice.tails.copy(), coloured=choice.coloured.copy())
    for number, found in enumerate(each):
        if found is None:
            continue
        shapes = found.shapes
        rows[number, :2], rows[number, TAIL] = shapes.each[0], shapes.tail
        kept = np.ones(rows.shape[1], bool)
        kept[: TAIL + 1] = False
        kept[TAIL + 1 :] = found.coloured
        covariance[number] *= kept[:, None] & kept
        numbers, places = np.array([0, 1, TAIL, SIGMA, EXPONENT]), np.array([0, 1, -3, -2, -1])
        covariance[number][np.ix_(numbers, numbers)] = shapes.covariance[np.ix_(places, places)]
        rows[number, [SIGMA, EXPONENT]] += shapes.law
        rows[number, TAIL + 1 :] *= found.coloured
        if choice is not None:
            choice.free[number, TAIL] = shapes.tail > 0.0
            choice.free[number, TAIL + 1 :] &= found.coloured
            choice.tails[number] = choice.coloured[number] = np.nan  # tested against one lobe
    lobes = LobeParameters(
        tuple(() if one is None else one.shapes.lobes for one in each),
        tuple(0.0 if one is None else one.gain for one in each),
        tuple(np.zeros((0, 0)) if one is None else one.shapes.covariance[2:-3, 2:-3] for one in each),
    )
    several = lobes if any(lobes.each) else None
    return replace(fit, gloss=Gloss(rows), covariance=covariance, choice=choice, lobes=several)


def _cross_validated(samples: Samples, widths: Array, random: np.random.Generator) -> float:
    """Median, over parts of the lamps that are left out, of the `_gain` of lobes of some of the `widths`."""
    lamps, gains = random.permutation(samples.shape[0]), []
    for fold in range(FOLDS):
        left_out = np.zeros(len(lamps), bool)
        left_out[lamps[fold::FOLDS]] = True
        rest = samples.lamps(~left_out)
        gains.append(_gain(rest, samples.lamps(left_out), *_fewest(rest, *_lobes(rest, widths))))
    return float(np.median(gains))


def _gain(rest: Samples, test: Samples, weights: Array, widths: Array) -> float:
    """Share of the squared error of `test` by which these lobes beat the first alone; bodies are those of `rest`."""
    alone, none = np.array([1.0]), np.zeros(0)
    one, several = (
        test.squared_error(test.interface(*lobes), rest.bodies(rest.interface(*lobes)))
        for lobes in ((alone, none), (weights, widths))
    )
    return 1.0 - several / max(one, 1e-300)


def _lobes(samples: Samples, widths: Array, passes: int = PASSES, start: Array | None = None) -> tuple[Array, Array]:
    """Factor of the first lobe and β of lobes of `widths`, by non-negative least squares; and the widths."""
    weights = np.r_[1.0, np.zeros(len(widths))] if start is None else start
    columns = [samples.first, *(samples.column(float(width)) for width in widths)]
    for turn in range(passes):
        interface = samples.interface(weights, widths)
        known = turn or start is not None
        root, _ = samples.weighed(interface if known else None, samples.bodies(interface) if known else None)
        weights = _non_negative(samples, columns, root)
    return weights, widths


def _non_negative(samples: Samples, columns: list[Float], root: Float) -> Array:
    """Weights of `columns` (K, P), 0 or more, with the body colours of all pixels eliminated, at weights root²."""
    from scipy.optimize import nnls

    parts = samples.beside_bodies([(one, samples.colour) for one in columns], root)
    products, count = inner_products([*parts, samples.numbers(root * samples.values)]), len(columns)
    matrix, rhs = products[:-1, :-1], products[:-1, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    root = np.linalg.cholesky(matrix * scale[:, None] * scale + RIDGE * np.eye(count))
    found, _ = nnls(root.T, np.linalg.solve(root, rhs * scale))
    return np.asarray(found * scale, np.float64)


def _fewest(samples: Samples, weights: Array, widths: Array) -> tuple[Array, Array]:
    """The MOST_LOBES lobes with most light, estimated anew without the others; the first lobe is always kept."""
    light = [weight * total_of(samples.column(float(w))) for weight, w in zip(weights[1:], widths, strict=True)]
    total = sum(light) + weights[0] * total_of(samples.first)
    order = sorted(range(len(widths)), key=lambda i: -light[i])[:MOST_LOBES]
    kept = np.array(sorted(i for i in order if light[i] > LEAST_SHARE * total), np.intp)
    weights, widths = _lobes(samples, widths[kept])
    weights[0] = max(weights[0], LEAST_SHARE)
    return weights, widths


class Side(NamedTuple):
    """Lobes, the samples with the noise that goes with them, and the deviance D."""

    shapes: LobeShapes
    samples: Samples
    deviance: float


def held(samples: Samples, found: LobeShapes, variance: Array, place: Array) -> tuple[LobeShapes, Samples]:
    """Those of the lobes `found` that the photographs hold, refined, and the samples with the noise of their flanks.

    variance: (P,) of the normals [rad²]. place: (P, 2) of the samples, in radii of the object. The lobe that has tails
    stays, and so does the last one.
    """
    side = _side(samples, found, variance)
    while len(side.shapes.each) > 1:
        shorter = [side.shapes.without(number) for number in range(int(side.shapes.tail > 0.0), len(side.shapes.each))]
        others = [_side(samples, one, variance) for one in shorter]
        least = min(others, key=lambda one: one.deviance)
        if log_odds(side, least, place) > DECISIVE_LOG_ODDS:
            break
        side = least
    return side.shapes, side.samples


def log_odds(several: Side, fewer: Side, place: Array) -> float:
    """ln of the odds of several lobes against one less."""
    samples, tile = several.samples, tiles_of(place)
    root, left = weighed_residuals(samples, several.shapes)
    parts = np.sum([np.bincount(tile, lamp.sum(axis=0)) ** 2 for lamp in left])
    counted = max(int(np.count_nonzero(root)), 1)
    alike = max(float(parts) / counted, 1.0)
    return 0.5 * (fewer.deviance - several.deviance) / alike - 0.5 * NUMBERS * float(np.log(max(counted / alike, 1.0)))


def _side(samples: Samples, start: LobeShapes, variance: Array) -> Side:
    """The lobes near `start`, refined, with their own noise."""
    samples = with_errors_of_normals(samples, start, variance)
    shapes = refined(samples, start)
    samples = with_errors_of_normals(samples, shapes, variance)
    return Side(shapes, samples, cost_of(samples, shapes) + samples.log_spread())
