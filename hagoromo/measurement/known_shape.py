"""Reflectance of the materials of a capture whose points, normals and lamps are known.

The pixels are grouped into materials by body colour and gloss. Robust least squares then gives α, β, γ, n and the body
colour of each, every parameter with its standard error, its 95 % interval and whether it is identifiable.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.measurement.gloss.gloss_map import gloss_map
from hagoromo.measurement.gloss.gloss_segment import split_by_gloss
from hagoromo.measurement.material.body_map import BodyMap, Separation, body_map, separated
from hagoromo.measurement.material.cast_shadow import without_cast_shadows
from hagoromo.measurement.material.clipped import clipped, without_clipped_gloss, without_plateaus
from hagoromo.measurement.material.estimate import estimate_material
from hagoromo.measurement.material.lamp_colour import LampColour, lamp_colour
from hagoromo.measurement.material.model_choice import Facets, Interface, check_model, choose_fit
from hagoromo.measurement.material.sandwich import MaterialFit
from hagoromo.measurement.material.segment import interior, segment
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.observations import Observations, known_shape, observe, shape
from hagoromo.measurement.parameters import check_index
from hagoromo.measurement.photometric.term import CaptureTerms, Term
from hagoromo.measurement.photometric.term_fit import TermProfile, dispersion, fit_terms
from hagoromo.measurement.sight import Array
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

SEED = 0  # of the choice of pixels; the same capture gives the same measurement
MOST_LEVERAGE = 0.9  # of a value in the body of its pixel, by which its residual is made whole
Observe = Callable[[Capture], Observations]


def measure_known_shape(
    capture: Capture,
    labels: NDArray[np.integer] | None = None,
    n: float | None = None,
    colour_from_highlights: bool = False,
    progress: Progress = silent,
    facets: Facets = "auto",
    interface: Interface = "auto",
    terms: CaptureTerms | None = None,
) -> Measurement:
    """Reflectance of every material of `capture`, whose points and normals are known.

    labels: (h, w) materials 0, 1, …, −1 unknown; by default they follow from body colours and gloss. n: refractive
    index where it is known. colour_from_highlights: measure the colour of the lamps, which the capture then does not
    know; without it the spectra of the lamps and the camera's response are used (without a response, white is 1).
    facets, interface: whether tails of the facets and a colour of the interface are estimated: by evidence, never, or
    always (`choose_fit`). Highlights that give the colour of the lamps give none of the interface: it is neutral then.
    terms: what was taken out of the photographs (`terms_of_known_shape`): its errors join those of the materials.
    Raises `InputError` when the shape or the lamps are missing, no pixel is usable, or a fit does not converge.
    """
    _check(capture, labels, n)
    model = _model(facets, interface, colour_from_highlights)
    capture = without_plateaus(capture)
    progress(0.0, "materials")
    labels = _labels(capture, labels)
    whole, (capture, shadows) = capture, without_cast_shadows(capture, labels)
    colour = lamp_colour(capture, labels) if colour_from_highlights else None
    materials, labels = _materials(capture, labels, _Fitting(n, model, colour, terms), progress)
    white = None if colour is None else colour.value
    materials, gloss = gloss_map(capture, labels, materials, white)
    body = body_map(capture, labels, materials, white, gloss)
    materials = tuple(_with_shadows(one, shadows[:, labels == k]) for k, one in enumerate(materials))
    predicted, separation = _separated(capture, body)
    residuals = tuple(_residual(*pair) for pair in zip(whole.photographs, predicted, strict=True))
    normals = np.where(known_shape(capture)[..., None], np.nan_to_num(shape(capture)[1]), 0.0).astype(np.float32)
    progress(1.0, "")
    return Measurement(
        materials, labels, predicted, residuals, normals, body=body, separation=separation, lamp_colour=colour
    )


def terms_of_known_shape(
    capture: Capture,
    terms: Sequence[Term],
    labels: NDArray[np.integer] | None = None,
    n: float | None = None,
    colour_from_highlights: bool = False,
    facets: Facets = "auto",
    interface: Interface = "auto",
) -> CaptureTerms:
    """The unknowns of `terms` in `capture`, from the fits of all its materials; settings as in `measure_known_shape`.

    `InputError` when no material can be fitted, or the rounds do not converge.
    """
    _check(capture, labels, n)
    model = _model(facets, interface, colour_from_highlights)
    capture = without_plateaus(capture)
    labels = _labels(capture, labels)
    capture = without_cast_shadows(capture, labels)[0]

    def profiles_of(without: Capture) -> list[TermProfile]:
        colour = lamp_colour(without, labels) if colour_from_highlights else None
        how, found = _Fitting(n, model, colour), []
        for number in np.unique(labels[labels >= 0]):
            observed = how.observed(without, labels, number)
            try:
                fit = choose_fit(samples := observed(without), n, *model).fitted.fit
            except InputError:
                continue  # a material that cannot be measured says nothing; `measure_known_shape` warns of it
            found.append(profile_of_material(fit, changes_of(capture, terms, samples, observed)))
        if not found:
            raise InputError(f"{', '.join(term.name for term in terms)}: no material can be fitted to estimate it from")
        return found

    return fit_terms(capture, terms, profiles_of)


def with_separation(capture: Capture, measurement: Measurement) -> Measurement:
    """`measurement` with the diffuse and specular parts of the photograph of `capture` that has most gloss.

    `capture` must have points and normals. Body colours are those of the materials.
    """
    body = body_map(capture, measurement.labels, measurement.materials, None, measurement.gloss)
    return replace(measurement, separation=_separated(capture, body)[1])


def _check(capture: Capture, labels: NDArray[np.integer] | None, n: float | None) -> None:
    points, _ = shape(capture)
    check_index(n)
    for photograph in capture.photographs:
        if not photograph.lamps:
            raise InputError(f"photograph {photograph.name!r} has no lamp: calibrate the lamps first")
        if photograph.values.shape != capture.photographs[0].values.shape:
            raise InputError(f"photograph {photograph.name!r} has another size than the first: give photographs of one")
    if labels is not None and np.shape(labels) != points.shape[:2]:
        raise InputError(f"labels of shape {np.shape(labels)} for photographs of {points.shape[:2]} pixels")
    if not known_shape(capture).any():
        raise InputError(f"capture {capture.name!r} has no pixel with a point and a unit normal: give its shape")


def _model(facets: Facets, interface: Interface, colour_from_highlights: bool) -> tuple[Facets, Interface]:
    check_model(facets, interface)
    if not colour_from_highlights:
        return facets, interface
    if interface == "coloured":
        raise InputError("interface is 'coloured' and the lamps' colour is measured from highlights: give one of them")
    return facets, "neutral"


def _labels(capture: Capture, labels: NDArray[np.integer] | None) -> NDArray[np.int64]:
    """Labels (h, w) as they are given, or by colour and gloss; shadows would make glosses differ."""
    if labels is not None:
        return np.asarray(labels, np.int64)
    by_colour = segment(capture)
    return np.asarray(split_by_gloss(without_cast_shadows(capture, by_colour)[0], by_colour), np.int64)


@dataclass(frozen=True, eq=False)
class _Fitting:
    """How materials are fitted: see `measure_known_shape`. colour: of the lamps, where it was measured."""

    n: float | None
    model: tuple[Facets, Interface]
    colour: LampColour | None
    terms: CaptureTerms | None = None

    def observed(self, capture: Capture, labels: NDArray[np.integer], number: int) -> Observe:
        """How the samples of material `number` are taken; the same ones of every capture of this shape."""
        region = known_shape(capture) & interior(labels, number)
        white = None if self.colour is None else self.colour.value
        return lambda of: observe(of, region, white, SEED)

    def samples(self, capture: Capture, labels: NDArray[np.integer], number: int) -> Observations:
        """The samples of material `number`, with the errors that the terms of the capture give all values."""
        observed = self.observed(capture, labels, number)
        samples = observed(capture)
        if self.terms is None:
            return samples
        changes = changes_of(capture, self.terms.terms, samples, observed)
        return replace(samples, shared=changes @ np.linalg.cholesky(self.terms.covariance))


def _materials(
    capture: Capture, labels: NDArray[np.integer], how: _Fitting, progress: Progress
) -> tuple[tuple[MaterialEstimate, ...], NDArray[np.integer]]:
    """The estimate of each label that can be measured, and the labels (h, w) as indices into the estimates.

    The pixels of a label that cannot be measured become unknown, with a warning; `InputError` when none can be.
    """
    numbers = [number for number in np.unique(labels) if number >= 0]
    estimates: dict[int, MaterialEstimate] = {}
    refused = []
    for i, number in enumerate(numbers):
        progress((i + 1) / (len(numbers) + 2), f"material {i + 1} of {len(numbers)}")
        try:
            estimates[number] = _material(capture, labels, number, how)
        except InputError as error:
            refused.append(str(error))
    if not estimates:
        raise InputError("; ".join(refused) or "labels name no material: give a number from 0 on to its pixels")
    for reason in refused:
        warnings.warn(f"{reason}: its pixels stay unknown", stacklevel=3)
    index = np.full(labels.max() + 2, -1)
    index[list(estimates)] = np.arange(len(estimates))
    progress((len(numbers) + 1) / (len(numbers) + 2), "residuals")
    return tuple(estimates.values()), index[np.where(labels >= 0, labels, -1)]


def _material(capture: Capture, labels: NDArray[np.integer], number: int, how: _Fitting) -> MaterialEstimate:
    samples = how.samples(capture, labels, number)
    error = None if how.colour is None else how.colour.relative_covariance
    cut = clipped(capture, known_shape(capture) & interior(labels, number))
    try:
        pixels = int(np.sum(labels == number))
        estimate = estimate_material(samples, f"material {number + 1}", pixels, how.n, error, *how.model)
    except InputError as wrong:
        if cut.hidden > np.sum(samples.used.any(axis=1)):
            raise InputError(f"{wrong}; {cut.hidden} of its values are clipped: expose shorter") from wrong
        raise
    return without_clipped_gloss(estimate, cut)


def _with_shadows(estimate: MaterialEstimate, shadows: NDArray[np.bool_]) -> MaterialEstimate:
    """`estimate` with a remark on its values in cast shadow (K, M)."""
    if not shadows.any():
        return estimate
    remark = (
        f"{100.0 * shadows.mean():.2g} % of its values are far darker than other photographs of their pixels let "
        "expect, as in cast shadow: they take no part"
    )
    return replace(estimate, remarks=(*estimate.remarks, remark))


def _separated(capture: Capture, body: BodyMap) -> tuple[tuple[NDArray[np.float32], ...], Separation]:
    """Predicted values of each photograph, NaN where there are none, and the parts of the one with most gloss."""
    predicted, most, glossiest = [], -1.0, None
    for number, photograph in enumerate(capture.photographs):
        parts = body.parts(capture, photograph)
        predicted.append(parts.sum.astype(np.float32))
        gloss = float(np.nansum(parts.interface) / max(float(np.nansum(parts.sum)), 1e-300))
        if gloss > most:
            most, glossiest = gloss, (photograph, parts, number)
    assert glossiest is not None  # a capture has a photograph
    return tuple(predicted), separated(*glossiest)


def _residual(photograph: Photograph, predicted: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values − predicted, in stated standard deviations: (h, w, C), NaN where nothing is predicted or valid."""
    known = photograph.mask[..., None] & np.isfinite(predicted)
    deviation = np.where(known, photograph.values - predicted, np.nan)
    return (deviation / np.sqrt(np.where(known, photograph.variance, 1.0))).astype(np.float32)


def changes_of(capture: Capture, terms: Sequence[Term], samples: Observations, observed: Observe) -> Array:
    """(N, C, T) change of the values of `samples` of `capture` by a unit of each term; observed: how they are taken."""
    columns = []
    for term in terms:
        changes = [term.change(photograph) for photograph in capture.photographs]
        added = observed(_with_values(capture, [one.added for one in changes])).values
        share = observed(_with_values(capture, [one.share for one in changes])).values
        columns.append(added + share * samples.values)
    return np.stack(columns, axis=-1)


def _with_values(capture: Capture, each: Sequence[NDArray | float]) -> Capture:
    photographs = (
        replace(photograph, values=np.broadcast_to(values, photograph.values.shape))
        for photograph, values in zip(capture.photographs, each, strict=True)
    )
    return replace(capture, photographs=tuple(photographs))


def profile_of_material(fit: MaterialFit, changes: Array) -> TermProfile:
    """The profile of terms that change the values by `changes` (N, C, T): a sandwich, as that of the fit itself.

    The parameters of the material, and body colours of pixels, are eliminated.
    """
    objective, used = fit.objective, fit.objective.observations.used
    root = np.sqrt(objective.variance[used])
    r = (objective.observations.values - objective.model(fit.theta))[used] / root
    j = objective.jacobian(fit.theta)[used][:, fit.inside] / root[:, None]
    x = objective.within(changes)[used] / root[:, None]
    weight, curved = objective.loss.weight(r), objective.loss.curvature(r)
    # the step with weights of the loss never goes too far, however wrong the model is; the error has its curvature
    outer = _without(x, j, weight)
    step = np.linalg.pinv(outer.T @ (weight[:, None] * outer), hermitian=True) @ (outer.T @ (weight * r))
    left = _without(x, j, curved)
    information = left.T @ (curved[:, None] * left)
    leverage = np.clip(objective.own_leverage()[used], 0.0, MOST_LEVERAGE)
    each = (left * (weight * r / np.sqrt(1.0 - leverage))[:, None]).T
    scores = np.stack([np.bincount(fit.group, one).astype(np.float64) for one in each], axis=1)
    return TermProfile(step, information / dispersion(information, scores.T @ scores))


def _without(columns: Array, others: Array, weight: Array) -> Array:
    """Columns (V, T) less their weighted projection on `others` (V, P)."""
    weighed = others * weight[:, None]
    return columns - others @ (np.linalg.pinv(weighed.T @ others, hermitian=True) @ (weighed.T @ columns))
