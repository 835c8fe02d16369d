"""Term fit: the unknowns that photographs have in common, from all fits of them with their own unknowns eliminated.

Every fit, whether its unknowns are those of a material or those of pixels, gives a `TermProfile`: where it would
have the unknowns of the terms, and how firmly, when its own follow (profile likelihood). A round takes the terms out
of the photographs, fits, and moves the terms to where all profiles and what was known before meet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.measurement.photometric.term import Array, CaptureTerms, Term
from hagoromo.photograph.capture import Capture

TERM_ROUNDS = 10
TERM_STANDSTILL = 1 / 3  # standard errors: two smaller steps are the last; one left out would add 5 % to the error
ROOM = 4.0  # times the spread of what is known before, in which the rounds look for the unknowns


class TermProfile(NamedTuple):
    """What one fit says of T unknowns when all of its own follow.

    step: (T,) by which it alone would move them. precision: (T, T) inverse covariance of where that leads.
    """

    step: Array
    precision: Array


def dispersion(information: Array, scatter: Array) -> float:
    """Mean ratio of the variance of a score (T, T), by the residuals, to the information (T, T); at least 1.

    It is 1 where residuals are as large as stated and independent: a fit of a wrong model counts as little as its
    residuals ask for (quasi-likelihood, Wedderburn 1974).
    """
    ratio = float(np.trace(np.linalg.pinv(information, hermitian=True) @ scatter)) / len(scatter)
    return max(ratio, 1.0)


def fit_terms(
    capture: Capture, terms: Sequence[Term], profiles_of: Callable[[Capture], Sequence[TermProfile]]
) -> CaptureTerms:
    """The unknowns of `terms` in `capture`. profiles_of: profiles of all fits to a capture that lacks the terms.

    What is known before joins at the end: a fit that lacks a term says less than it does once the term is there. Steps
    that turn back are halved until they go on, as fits choose anew between models and losses in every round.
    `InputError` where the rounds do not converge.
    """
    at = CaptureTerms.before(terms)
    mean, prior, wide = at.values, np.linalg.inv(at.covariance), np.linalg.inv(ROOM**2 * at.covariance)
    low, high = np.array([term.range for term in terms]).T
    factor, last, away = 1.0, np.zeros(len(terms)), np.inf
    for turn in range(TERM_ROUNDS):
        profiles = profiles_of(at.without(capture))
        precision = sum((profile.precision for profile in profiles), np.zeros_like(prior))
        pull = sum((profile.precision @ profile.step for profile in profiles), np.zeros_like(mean))
        covariance = np.linalg.inv(precision + wide)
        step = np.clip(at.values + covariance @ (pull - wide @ (at.values - mean)), low, high) - at.values
        before, away = away, float(np.max(np.abs(step) / np.sqrt(np.diag(covariance))))
        if max(before, away) < TERM_STANDSTILL:
            covariance = np.asarray(np.linalg.inv(precision + prior), np.float64)
            values = at.values + covariance @ (pull - prior @ (at.values - mean))
            return CaptureTerms(at.terms, np.clip(values, low, high), covariance, turn + 1)
        factor = 0.5 * factor if step @ last < 0.0 else min(2.0 * factor, 1.0)
        last = factor * step
        at = replace(at, values=at.values + last)
    names = ", ".join(term.name for term in terms)
    raise InputError(
        f"{names}: the estimate is still {away:.2g} standard errors from its place after {TERM_ROUNDS} rounds: "
        "do not estimate it"
    )
