"""Normal profile: what the photometric fit of an object of unknown shape says of terms of its photographs.

Normals and body colours of the pixels, gloss, lamps and depth are eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hagoromo.measurement.normals.gloss_choice import FINE_GAIN, GlossModel
from hagoromo.measurement.normals.normals import NormalMap, solve_with_one_lobe
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.normals.photometric_rounds import settled, share_of_step
from hagoromo.measurement.normals.photometric_step import PixelProblem, PixelStep
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.term import CaptureTerms, Term
from hagoromo.measurement.photometric.term_fit import TermProfile, fit_terms
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

MOST_PIXELS = 2000  # from which terms are estimated
JOINT_ROUNDS, JOINT_STANDSTILL = 8, 0.1  # of moving terms and all else in turn; standard errors of the last step


def term_step(capture: Capture, solved: NormalMap) -> PixelStep:
    """The least squares of some pixels of `solved`, of `capture`, at its solution.

    Values in shadow count, too, as they show best what is added to all; to leave out dark ones would favour the others.
    """
    count = len(solved.views.rows)
    some = np.unique(np.linspace(0, count - 1, min(count, MOST_PIXELS)).astype(int))
    fit = solved.fit.pixels(some)
    stated = tuple(photograph.lamps[0] for photograph in capture.photographs)
    views = solved.views.pixels(some).under(stated, float(np.exp(-fit.depth)))
    views = replace(views, used=np.stack([one.mask[views.rows, views.columns] for one in capture.photographs]))
    free = np.ones(fit.gloss.rows.shape, bool) if fit.choice is None else fit.choice.free
    problem = PixelProblem(views, solved.views.place[some], 1.0, fit.prior or Prior(), free)
    return PixelStep(replace(problem, share=share_of_step(PixelStep(problem, fit))), fit)


def changes_of_views(capture: Capture, terms: Sequence[Term], views: Views) -> Array:
    """(T, K, C, P) change of the values of `views` of `capture` by a unit of each term."""
    columns = np.zeros((len(terms), *views.values.shape))
    for t, term in enumerate(terms):
        for k, photograph in enumerate(capture.photographs):
            change = term.change(photograph)
            added, share = (np.broadcast_to(one, photograph.values.shape)[views.rows, views.columns] for one in change)
            columns[t, k] = added.T / views.light[k] + share.T * views.values[k]
    return columns


def profile_of_normals(capture: Capture, terms: Sequence[Term], solved: NormalMap) -> TermProfile:
    """The profile of `terms` of `capture`, whose normals were `solved`: its step leads to where all is at a minimum.

    Terms, gloss, lamps and the pixels are moved in turn, at the error of the model and the prior of the solution.
    """
    step = term_step(capture, solved)
    problem, changes, values = step.problem, changes_of_views(capture, terms, step.problem.views), np.zeros(len(terms))
    for _ in range(JOINT_ROUNDS):
        profile, _ = step.profile(changes)
        values = values + profile.step
        without = problem.views.values - np.tensordot(values, changes, 1)
        step = PixelStep(replace(problem, views=replace(problem.views, values=without)), step.fit)
        if float(profile.step @ profile.precision @ profile.step) < JOINT_STANDSTILL**2:
            break
        step, _ = settled(step, FINE_GAIN)
    return TermProfile(values, profile.precision)


def with_term_errors(capture: Capture, found: CaptureTerms, solved: NormalMap) -> NormalMap:
    """`solved` of `capture`, which lacks the terms `found`, with their errors in those of its gloss."""
    step = term_step(capture, solved)
    by_term = step.profile(changes_of_views(capture, found.terms, step.problem.views))[1]
    added = by_term @ found.covariance @ np.swapaxes(by_term, 1, 2)
    return replace(solved, fit=replace(solved.fit, covariance=solved.fit.covariance + added))


def terms_of_unknown_shape(
    capture: Capture, terms: Sequence[Term], distance: float, model: GlossModel, progress: Progress = silent
) -> CaptureTerms:
    """The unknowns of `terms` in `capture`, an object of unknown shape at `distance` [m]; model: see `solve_normals`.

    `InputError` when the photographs do not determine normals, or the rounds do not converge.
    """
    progress(0.0, ", ".join(term.name for term in terms))

    def profiles_of(without: Capture) -> list[TermProfile]:
        if has_near_lamps(capture):
            solved = solve_shape(without, distance, model=model).normal_map
        else:
            solved = solve_with_one_lobe(without, model=model)
        return [profile_of_normals(capture, terms, solved)]

    return fit_terms(capture, terms, profiles_of)
