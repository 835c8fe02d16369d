"""Estimated terms: unknowns that all photographs of a capture have in common, from fits of materials or of pixels."""

from __future__ import annotations

from collections.abc import Sequence

from hagoromo.measurement.normals.gloss_choice import GlossModel
from hagoromo.measurement.normals.normal_profile import profile_of_normals
from hagoromo.measurement.normals.normals import solve_with_one_lobe
from hagoromo.measurement.photometric.term import CaptureTerms, Term
from hagoromo.measurement.photometric.term_fit import Profile, fit_terms
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent


def terms_of_unknown_shape(
    capture: Capture, terms: Sequence[Term], distance: float, model: GlossModel, progress: Progress = silent
) -> CaptureTerms:
    """The unknowns of `terms` in `capture`, an object of unknown shape at `distance` [m]; model: see `solve_normals`.

    `InputError` when the photographs do not determine normals, or the rounds do not converge.
    """
    progress(0.0, ", ".join(term.name for term in terms))

    def profiles_of(without: Capture) -> list[Profile]:
        if has_near_lamps(capture):
            solved = solve_shape(without, distance, model=model).normal_map
        else:
            solved = solve_with_one_lobe(without, model=model)
        return [profile_of_normals(capture, terms, solved)]

    return fit_terms(capture, terms, profiles_of)
