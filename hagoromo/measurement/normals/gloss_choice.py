"""Gloss choice: which materials of unknown shape have facets with tails, or an interface with a colour, by evidence.

The fit with Gaussian facets and a neutral interface is extended by what is allowed. Each extension is then taken away
from each material again, at the same model error and prior; it stays where χ² rises by more than noise would make it
rise with probability CHANCE. For this test residuals count as little as in the fit of the start, which lacks gloss
(`independent_share`): on real objects light from part to part, which the model lacks, looks like faint tails or colour,
and a test that trusts each pixel finds it; such extensions predicted photographs under other lamps worse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hagoromo.measurement.material.model_choice import CHANCE, FIRST_TAIL, Facets, Interface
from hagoromo.measurement.normals.photometric_model import Fit, GlossChoice
from hagoromo.measurement.normals.photometric_rounds import Rounds, rounds, settled, share_of_step
from hagoromo.measurement.normals.photometric_step import PixelProblem, PixelStep
from hagoromo.measurement.normals.shading import TAIL, Gloss
from hagoromo.measurement.normals.views import Array

FINE_GAIN = 1e-6  # relative to the cost: a step that gains less is the last, where two costs are compared
EXTENSIONS = np.s_[TAIL : TAIL + 1], np.s_[TAIL + 1 :]  # places of the tail and of the colour in a row of gloss
# rise of χ² above which there are tails: a tail is 0 or more, so that half of the noise of it does not count
TAIL_EVIDENCE = float(chi2.isf(2.0 * CHANCE, 1))


@dataclass(frozen=True)
class GlossModel:
    """facets: Gaussian, with tails, or by evidence; interface: neutral, coloured, or by evidence."""

    facets: Facets = "auto"
    interface: Interface = "auto"


BY_EVIDENCE = GlossModel()


def choose_gloss(problem: PixelProblem, fit: Fit, model: GlossModel = BY_EVIDENCE) -> tuple[Rounds, GlossChoice]:
    """Gloss and lamps from `fit`, with the extensions that are asked for, or for which there is evidence.

    Where one is found, the others are tested once more, against the residuals of the better fit. An extension that does
    not converge, and was not asked for, is left out.
    """
    shape, stated = fit.gloss.rows.shape, problem.prior
    asked = _free(shape, model.facets == "student-t", model.interface == "coloured")
    wanted = _free(shape, model.facets != "gaussian", model.interface != "neutral")
    base = rounds(replace(problem, free=asked), _opened(fit, asked), stated)
    choice = _choice(base.step, asked, np.full((2, shape[0]), np.nan))
    while (wanted != choice.free).any():
        before = choice.free
        problem = base.step.problem
        wide, _ = settled(PixelStep(replace(problem, free=wanted), _opened(base.step.fit, wanted)), FINE_GAIN)
        rises = _rises(wide, before, base.step.cost)
        tested = _choice(wide, before, rises)
        kept = np.where(np.isnan(rises), (choice.tails, choice.coloured), rises)
        choice = replace(tested, free=before, tails=kept[0], coloured=kept[1])
        if (tested.free == before).all():
            break
        # what only the facets and the interface before could not explain does not count any more
        share = max(share_of_step(wide), problem.share)
        found = rounds(replace(problem, free=tested.free, share=share), _held(wide.fit, tested.free), stated)
        if not found.status.converged:
            return base, replace(choice, failure="their fit did not converge")
        base, choice = found, replace(choice, free=tested.free)
    return base, choice


def _free(shape: tuple[int, ...], tails: bool, coloured: bool) -> NDArray[np.bool_]:
    """(M, G) which numbers of gloss a model has."""
    free = np.ones(shape, bool)
    free[:, TAIL], free[:, TAIL + 1 :] = tails, coloured
    return free


def _opened(fit: Fit, free: NDArray[np.bool_]) -> Fit:
    """`fit` with the tails from which a search for them starts, where they are `free`."""
    rows = fit.gloss.rows.copy()
    rows[:, TAIL] = np.where(free[:, TAIL], np.maximum(rows[:, TAIL], FIRST_TAIL), rows[:, TAIL])
    return replace(fit, gloss=Gloss(rows))


def _held(fit: Fit, free: NDArray[np.bool_]) -> Fit:
    """`fit` with Gaussian facets and a neutral interface where these are not `free`."""
    return replace(fit, gloss=Gloss(np.where(free, fit.gloss.rows, 0.0)))


def _rises(wide: PixelStep, asked: NDArray[np.bool_], cost: float) -> Array:
    """(2, M) rise of χ² from `wide` without tails, and without a colour, of each material; NaN where not tested.

    cost: without all of them. Where that is too near to give evidence for any, it stands for each.
    """
    free = wide.problem.free
    rises, total = np.full((2, len(free)), np.nan), 2.0 * (cost - wide.cost)
    for rise, places in zip(rises, EXTENSIONS, strict=True):
        for m in np.flatnonzero((free & ~asked)[:, places].any(axis=1)):
            rise[m] = total
            if total > TAIL_EVIDENCE:
                without = free.copy()
                without[m, places] = False
                held, _ = settled(PixelStep(replace(wide.problem, free=without), _held(wide.fit, without)), FINE_GAIN)
                rise[m] = 2.0 * (held.cost - wide.cost)
    return rises


def _choice(wide: PixelStep, asked: NDArray[np.bool_], rises: Array) -> GlossChoice:
    """What the `rises` of χ² give evidence for."""
    free, (tails, coloured) = asked.copy(), rises
    free[:, TAIL] |= tails > TAIL_EVIDENCE
    numbers = free.shape[1] - TAIL - 1
    if numbers:
        free[:, TAIL + 1 :] |= (coloured > float(chi2.isf(CHANCE, numbers)))[:, None]
    return GlossChoice(free, tails, coloured, wide.fit.gloss.rows, wide.covariances()[0])
