"""Gloss step: β, γ and n of the material by the pixels of all views, whatever the body colours of places are.

A place that is too bright may have a brighter body or more gloss. So what the body colour of a place can explain is
taken out of a pixel's residual and of its slopes before the gloss is solved for (Golub & Pereyra 1973). The covariance
of the gloss comes from the same slopes.
"""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float
from hagoromo_recovery.descent.pixel_table import ROBUST, Drawn
from hagoromo_recovery.descent.rendering import Rendering
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.shading.shading import GLOSS, TWO_GLOSSES

Array = NDArray[np.float64]

GLOSS_DIFFERENCE, COLOUR_DIFFERENCE, SHARE_DIFFERENCE = 0.02, 0.01, 0.1  # of logarithms; of body colours and shares
GLOSS_CHANGE = 0.4  # of the logarithms, of a step, at most
GLOSS_RANGE = np.log([[1e-3, 1e3], [0.01, 1.2], [0.15, 2.0]])  # of β, γ and n − 1
N_USUAL, N_SPREAD = 1.5, 0.3  # of dielectrics, and standard deviation of ln(n − 1)
CORRELATED = 200.0  # values whose errors are alike, as neighbours have them: so many count as one
HIT = 0.5  # opacity from which a pixel shows a place


class Slopes(NamedTuple):
    """Of the pixels that show a place, all times the root of their weight: slopes by the numbers of the gloss and, of
    two glosses, by the share behind them (pixels, 3, numbers), by the body colour (pixels, 3), and residuals (pixels,
    3). node: the one nearest to the place. photograph: its number.
    """

    by_gloss: Array
    by_colour: Array
    rest: Array
    node: NDArray[np.int64]
    photograph: NDArray[np.int64]


class Eliminated(NamedTuple):
    """Slopes (pixels, 3, numbers) and residuals (pixels, 3), without what body colours of places explain."""

    by_gloss: Array
    rest: Array


def robust(drawn: Drawn, rest: list[Float], limit: float = ROBUST) -> Float:
    """Weight of pixels that nothing explains, such as stray light: Cauchy's. limit: [standard deviations]."""
    square = sum(w * r * r for w, r in zip(drawn.weights, rest, strict=True)) / COLOURS
    return dr.rcp(1.0 + square * (1.0 / limit**2))


def slopes_of(rendering: Rendering, drawn: Drawn, shown: list[Float] | None = None) -> Slopes:
    """Slopes of the light of pixels, by differences. shown: the light of their residuals, if not that of their rays."""
    base = rendering.light(drawn)
    rest = [value - light for value, light in zip(drawn.values, shown or base.channels, strict=True)]
    weight = robust(drawn, rest)
    roots = _columns([dr.sqrt(w * weight) for w in drawn.weights])
    hit = (np.array(base.seen.depth) > -np.log(1.0 - HIT)) & (roots[:, 1] > 0.0)
    shading, field, light = rendering.shading, rendering.field, _columns(base.channels)
    gloss, columns = np.array(shading.gloss, np.float64), []
    for k in range(len(gloss) if shading.lamps.each else 0):
        moved = gloss.copy()
        moved[k] += GLOSS_DIFFERENCE
        shading.set_gloss(moved)
        columns.append((_columns(rendering.light(drawn).channels) - light) * (roots / GLOSS_DIFFERENCE))
    shading.set_gloss(gloss)
    held, field.colours = field.colours, field.colours + COLOUR_DIFFERENCE
    dr.eval(field.colours)
    by_colour = (_columns(rendering.light(drawn).channels) - light) * (roots / COLOUR_DIFFERENCE)
    field.colours = held
    if field.shares is not None:
        shares, field.shares = field.shares, field.shares + SHARE_DIFFERENCE
        dr.eval(field.shares)
        columns.append((_columns(rendering.light(drawn).channels) - light) * (roots / SHARE_DIFFERENCE))
        field.shares = shares
    by_gloss = np.stack(columns, axis=2) if columns else np.zeros((len(hit), COLOURS, 0))
    place = dr.fma(drawn.rays.direction, base.seen.way, drawn.rays.origin)
    node, photograph = field.nearest_node(place), np.array(drawn.photograph, np.int64)
    return Slopes(by_gloss[hit], by_colour[hit], (_columns(rest) * roots)[hit], node[hit], photograph[hit])


def _columns(channels: list[Float]) -> Array:
    return np.stack([np.array(each, np.float64) for each in channels], axis=1)


def without_colours(slopes: Slopes) -> Eliminated:
    """What is left where each place has the body colour that explains its pixels best."""
    free, left = np.empty_like(slopes.by_gloss), np.empty_like(slopes.rest)
    for c in range(COLOURS):
        by = slopes.by_colour[:, c]

        def out(values: Array, by: Array = by) -> Array:
            share = np.bincount(slopes.node, by * values) / np.maximum(np.bincount(slopes.node, by * by), 1e-30)
            return values - by * share[slopes.node]

        left[:, c] = out(slopes.rest[:, c])
        for k in range(free.shape[2]):
            free[:, c, k] = out(slopes.by_gloss[:, c, k])
    return Eliminated(free, left)


def gloss_step(gloss: NDArray[np.floating], slopes: Slopes, copies: float) -> Array:
    """The gloss after a step from one by the slopes of some pixels, of which there are `copies` times as many.

    What is known beforehand of n (that of most matter) decides where the photographs do not.
    """
    free, left = without_colours(slopes)
    free = free[:, :, : len(gloss)]
    known, share = beforehand(len(gloss)), copies / CORRELATED
    matrix = share * np.einsum("nck,ncl->kl", free, free)
    slope = share * np.einsum("nck,nc->k", free, left) + known * (np.log(N_USUAL - 1.0) - gloss)
    damped = matrix + np.diag(known) + np.diag(1e-3 * np.diag(matrix) + 1e-9)
    change = np.clip(np.linalg.solve(damped, slope), -GLOSS_CHANGE, GLOSS_CHANGE)
    low, high = np.array([GLOSS_RANGE[GLOSS.index(TWO_GLOSSES[k])] for k in range(len(gloss))]).T
    return np.clip(gloss + change, low, high)


def beforehand(count: int) -> Array:
    """(count,) what is known of the numbers of glosses, as reciprocals of variances: of n alone."""
    known = np.zeros(count)
    known[GLOSS.index("n")] = 1.0 / N_SPREAD**2
    return known
