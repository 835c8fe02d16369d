"""Normals from photographs under many lamps (MODEL §7.3): robust Lambertian first, then with gloss and uneven lamps.

Enters: a Capture whose lamps are known. Leaves: a normal with its variance and a body colour per pixel, and how
unevenly each lamp lights the object.

Photometric fit: gloss, lamps and model error from a subset of the pixels, then normal and body of every pixel.

Model errors are correlated over large parts of an object, so each photograph enters with its effective number of
independent values (`independent_share`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.gloss.solved_gloss import with_solved_gloss
from hagoromo.measurement.material.segment import segment
from hagoromo.measurement.normals.drawn_errors import independent_variance, own_errors
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel, choose_gloss
from hagoromo.measurement.normals.lamp_shift import shifted_lamps
from hagoromo.measurement.normals.lobe_fit import with_lobes, with_lobes_refined
from hagoromo.measurement.normals.neighbours import with_neighbours
from hagoromo.measurement.normals.normal_errors import with_errors
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision
from hagoromo.measurement.normals.photometric_rounds import independent_share
from hagoromo.measurement.normals.photometric_step import PixelProblem
from hagoromo.measurement.normals.pixel_fit import PixelConditions, fit_pixels
from hagoromo.measurement.normals.shading import LEAST_COSINE, TAIL, Gloss
from hagoromo.measurement.normals.smooth_normals import conditions, with_smooth_normals
from hagoromo.measurement.normals.views import Array, Views, views_from_capture
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, part_of, silent

START_GLOSS = (np.log(1.0), np.log(0.3), 0.0, 0.0)  # ln β, ln γ [rad], σ, ln(1 + ε) at the start
START_ERROR = 0.02  # relative error of Lambert's law in the weights of the start
LAMBERT_REWEIGHTINGS = 10
SUBSET = 2000  # pixels, at most, from which gloss and lamps are estimated
SUBSET_VALUES, FEWEST_OF_SUBSET = 80_000, 600  # lamps × pixels of it, at most, and pixels that it has in any case


@dataclass(frozen=True, eq=False, repr=False)
class NormalMap:
    """Solved normals of h × w pixels in C channels.

    normals: (h, w, 3) unit, world axes, 0 where unknown. variance: (h, w) of their direction [rad²], inf where unknown:
    what each pixel has of its own (`own_variance`), and what all share (`modes`).
    body: (h, w, C) α c_b of each pixel [1/sr], 0 where unknown. labels: (h, w) of the materials, −1 unknown.
    fit, views: the photometric fit and the pixels that it was made from.
    """

    normals: NDArray[np.float32]
    variance: NDArray[np.float32]
    body: NDArray[np.float32]
    labels: NDArray[np.integer]
    fit: Fit
    views: Views

    @property
    def own_variance(self) -> NDArray[np.float32]:
        """(h, w) variance of the direction [rad²] that is independent between pixels, inf where unknown.

        Smoothed normals err less, but as their neighbours do: in sums over pixels they count as before.
        """
        return self.views.image(independent_variance(self.fit).astype(np.float32), np.inf)

    def own_errors(self) -> Callable[[np.random.Generator], Array]:
        """What draws errors (h, w, 3) [rad] of the normals that are their own, as neighbours share them; world axes."""
        draw = own_errors(self.views, self.fit)
        return lambda random: self.views.image(draw(random))

    @property
    def modes(self) -> NDArray[np.float32] | None:
        """(m, h, w, 3) changes of the normals [rad] by errors that all pixels share, each of variance 1; world axes."""
        errors = self.fit.errors
        if errors is None:
            return None
        return np.stack([self.views.image(mode.astype(np.float32)) for mode in (*errors.modes, *errors.width)])

    @property
    def body_error(self) -> Array | None:
        """(h, w, C) standard error of `body` [1/sr] beside those of other pixels, NaN where unknown."""
        errors = self.fit.errors
        if errors is None:
            return None
        return self.views.image((self.fit.body * np.sqrt(errors.body_variance)).T, np.nan)

    def of(self, fit: Fit) -> NormalMap:
        """The same pixels with another fit."""
        return replace(
            self,
            fit=fit,
            normals=self.views.image(fit.normals.astype(np.float32)),
            variance=self.views.image(fit.variance.astype(np.float32), np.inf),
            body=self.views.image(fit.body.T.astype(np.float32)),
        )

    def __repr__(self) -> str:
        height, width = self.labels.shape
        return f"NormalMap({width} × {height} px, {int(np.isfinite(self.variance).sum())} normals known)"


def solve_normals(
    capture: Capture,
    labels: NDArray[np.integer] | None = None,
    prior: Prior | None = None,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
) -> NormalMap:
    """Normals of the surface in `capture` by photometric stereo with gloss: one view, four known lamps or more.

    Robust Lambertian normals are the start. A joint fit then adds the gloss of each material and how unevenly the lamps
    light the object. Far lamps need nothing else; for near lamps the capture must have points (see `solve_shape`).

    labels: (h, w) materials 0, 1, …, −1 unknown; by default they follow from the body colours. prior: standard
    deviations of the lamps' strengths and places and of the bodies' parameters before the photographs are used. model:
    whether facets have tails, and the interface a colour of its own: never, always, or by evidence. Further lobes of
    the interface, and a gloss of each pixel, are found where photographs that are left out need them.
    Raises `InputError` when the photographs do not determine the normals (see `views_from_capture`).
    """
    solved = solve_with_one_lobe(capture, labels, prior, part_of(progress, 0.0, 0.8), model)
    progress(0.8, "lobes")
    solved = with_normals_of_lobes(capture, with_further_lobes(capture, smooth(solved)))
    progress(0.9, "gloss")
    return with_shared_errors(with_own_gloss(solved))


def smooth(solved: NormalMap) -> NormalMap:
    """`solved` with the normals of a smooth surface where those are nearer: see `smooth_normals`."""
    return solved.of(_smoothed(solved.views, solved.fit))


def _smoothed(views: Views, fit: Fit) -> Fit:
    """`fit`, of each pixel by itself, with what neighbours say: joined with them, then of a smooth surface."""
    return with_smooth_normals(views, with_neighbours(views, fit))


def with_normals_of_lobes(capture: Capture, solved: NormalMap) -> NormalMap:
    """`solved` with the normals that go with all its lobes, and these lobes where they fit best there; as it is where
    every material has one.

    A spike above a haze is an outlier to a fit of one lobe, and pulls its normals.
    """
    views, fit = solved.views, solved.fit
    if fit.lobes is None:
        return solved
    pixels = fit_pixels(views, conditions(views, fit), fit.normals, fit.body)
    moved = replace(
        fit,
        normals=pixels.normals,
        body=pixels.body,
        variance=pixels.variance,
        pixel_status=pixels.status,
        smooth=None,
    )
    return solved.of(with_lobes_refined(capture, views, _smoothed(views, moved)))


def with_shared_errors(solved: NormalMap) -> NormalMap:
    """`solved` with errors that also hold where lamps and reflectance are not as stated: see `normal_errors`."""
    fit = with_errors(solved.views, solved.fit)
    return replace(solved, fit=fit, variance=solved.views.image(fit.variance.astype(np.float32), np.inf))


def with_further_lobes(capture: Capture, solved: NormalMap) -> NormalMap:
    """`solved`, normals of `capture`, with further lobes of the interface and body colours that go with them."""
    fit = with_lobes(capture, solved.views, solved.fit)
    return replace(solved, fit=fit, body=solved.views.image(fit.body.T.astype(np.float32)))


def with_own_gloss(solved: NormalMap) -> NormalMap:
    """`solved` with the gloss of each pixel where it varies over a material, and the normals that go with it: those of
    a smooth surface where they are nearer.
    """
    views, fit = solved.views, with_solved_gloss(solved.views, solved.fit)
    if fit.own is None:
        return solved.of(fit)
    varies = np.array([test is not None and test.varies for test in fit.own_tests])[fit.labels]
    pixels = fit_pixels(views, conditions(views, fit), fit.normals, fit.body)
    moved = replace(
        fit,
        normals=np.where(varies[:, None], fit.normals, pixels.normals),
        body=np.where(varies, fit.body, pixels.body),
        variance=np.where(varies, fit.variance, pixels.variance),
        smooth=None,
    )
    return solved.of(_smoothed(views, moved))


def solve_with_one_lobe(
    capture: Capture,
    labels: NDArray[np.integer] | None = None,
    prior: Prior | None = None,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
) -> NormalMap:
    """As `solve_normals`, with one lobe of each material."""
    progress(0.0, "normals")
    views = views_from_capture(capture)
    normals, body = robust_lambert(views)
    progress(0.2, "materials")
    if labels is None:
        labels = _segmented(capture, views, normals)
    views, fit = solve_fit(views, labels, normals, body, prior, model)
    progress(1.0, "")
    return NormalMap(
        views.image(fit.normals.astype(np.float32)),
        views.image(fit.variance.astype(np.float32), np.inf),
        views.image(fit.body.T.astype(np.float32)),
        labels,
        fit,
        views,
    )


def solve_fit(
    views: Views,
    labels: NDArray[np.integer],
    normals: Array,
    body: Array,
    prior: Prior | None = None,
    model: GlossModel = BY_EVIDENCE,
) -> tuple[Views, Fit]:
    """The photometric fit from robust Lambertian `normals` (P, 3) and `body` (C, P); labels (h, w), −1 joins 0.

    The views that it gives are `views` under lamps where the fit has them.
    """
    material = np.maximum(labels[views.rows, views.columns], 0)
    names, numbers = np.unique(material, return_inverse=True)
    gloss = Gloss.alike(START_GLOSS, len(names), views.values.shape[1])
    start = replace(_without_gloss(views, normals, body), labels=numbers.astype(np.intp), gloss=gloss)
    return photometric_fit(views, start, prior, model)


def least_squares_lambert(views: Views) -> tuple[Array, Array]:
    """Plain least squares of Lambert's law over all lamps: normals (P, 3) and body (C, P). A baseline to compare with.

    The normal follows from the mean of the channels, the body of each channel then from that normal.
    """
    every = np.ones_like(views.used, np.float64)
    return _split(views, _weighted(views, every), every)


def least_squares_fit(views: Views) -> Fit:
    """`least_squares_lambert` as a Fit without gloss under even lamps."""
    normals, body = least_squares_lambert(views)
    return _without_gloss(views, normals, body)


def robust_lambert(views: Views) -> tuple[Array, Array]:
    """Lambert's law with Cauchy's weights, shadows excluded: normals (P, 3) and body (C, P)."""
    grey, noise = views.values.mean(axis=1), views.variance.mean(axis=1) / views.values.shape[1]
    spread = noise + (START_ERROR * np.maximum(grey, grey.mean(axis=0))) ** 2
    weight = np.where(views.used, 1.0, 1e-6)
    scaled = _weighted(views, weight)
    for _ in range(LAMBERT_REWEIGHTINGS):
        model = np.maximum(np.einsum("kpi,pi->kp", views.to_lamp, scaled), 0.0)
        squared = (grey - model) ** 2 / (spread * CAUCHY_SCALE**2)
        weight = np.where(views.used, 1.0, 1e-6) / (1.0 + squared)
        scaled = _weighted(views, weight)
    return _split(views, scaled, weight)


def _without_gloss(views: Views, normals: Array, body: Array) -> Fit:
    """A Fit of one Lambertian material under even lamps; errors are unknown."""
    lamps, pixels = len(views.values), len(views.rows)
    return Fit(
        normals,
        body,
        np.zeros(pixels, np.intp),
        Gloss.none(1, len(body)),
        np.zeros(lamps),
        np.zeros((lamps, 2)),
        np.zeros((lamps, 3)),
        0.0,
        START_ERROR,
        np.full(pixels, np.inf),
        np.full((1, TAIL + len(body), TAIL + len(body)), np.nan),
    )


def _weighted(views: Views, weight: Array) -> Array:
    """Scaled normals (P, 3) by weighted least squares of the channels' mean."""
    matrix = np.empty((len(views.rows), 3, 3))
    weighed = [weight * views.to_lamp[..., i] for i in range(3)]
    for i in range(3):
        for j in range(i, 3):
            matrix[:, i, j] = matrix[:, j, i] = np.sum(weighed[i] * views.to_lamp[..., j], axis=0)
    grey = views.values.mean(axis=1)
    rhs = np.stack([np.sum(part * grey, axis=0) for part in weighed], axis=1)
    return np.linalg.solve(matrix + 1e-9 * np.eye(3), rhs[..., None])[..., 0].astype(np.float64)


def _split(views: Views, scaled: Array, weight: Array) -> tuple[Array, Array]:
    """Scaled normals → unit ones, turned towards the eye where they face away, and the matching body colours."""
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    normals = np.where(length > 1e-6, scaled / np.maximum(length, 1e-12), views.to_eye)
    short = np.maximum(LEAST_COSINE - np.einsum("pi,pi->p", normals, views.to_eye), 0.0)
    normals = normals + short[:, None] * views.to_eye
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    incidence = np.maximum(np.einsum("kpi,pi->kp", views.to_lamp, normals), 0.0)
    light = np.einsum("kp,kp->p", weight, incidence**2)
    body = np.einsum("kp,kp,kcp->cp", weight, incidence, views.values) / np.maximum(light, 1e-9)
    return normals, np.maximum(body, 1e-4 * views.values.mean())


def _segmented(capture: Capture, views: Views, normals: Array) -> NDArray[np.integer]:
    """Materials by body colour, on a shape that is accurate enough for that."""
    camera = capture.photographs[0].camera
    points = capture.points
    if points is None:
        points = camera.position + camera.pixel_directions()
    known = replace(capture, points=points, normals=views.image(normals.astype(np.float32)))
    return np.asarray(segment(known))


def photometric_fit(
    views: Views, start: Fit, prior: Prior | None = None, model: GlossModel = BY_EVIDENCE, seed: int = 0
) -> tuple[Views, Fit]:
    """Gloss, lamps and model error from a subset of the pixels, then normals and body of all pixels.

    The returned views are `views` under the fitted lamps and at the fitted distance.
    """
    fit = fit_together(views, start, prior or Prior(), model, seed)
    views = views.under(shifted_lamps(views, fit.shift), float(np.exp(fit.depth)))
    light = PixelConditions(fit.gloss.rows[fit.labels], fit.evenness(views.place), precision(views, fit.model_error))
    pixels = fit_pixels(views, light, start.normals, start.body)
    return views, replace(
        fit, normals=pixels.normals, body=pixels.body, variance=pixels.variance, pixel_status=pixels.status
    )


def fit_together(views: Views, start: Fit, prior: Prior, model: GlossModel = BY_EVIDENCE, seed: int = 0) -> Fit:
    """Gloss, lamps and model error from some pixels of `views`; normals and body of all pixels are not changed."""
    count = len(views.rows)
    size = min(SUBSET, max(SUBSET_VALUES // len(views.values), FEWEST_OF_SUBSET), count)
    chosen = np.sort(np.random.default_rng(seed).choice(count, size, replace=False))
    share = independent_share(views, start) * count / len(chosen)
    every = np.ones(start.gloss.rows.shape, bool)  # numbers of gloss; which of them are free is chosen next
    problem = PixelProblem(views.pixels(chosen), views.place[chosen], share, prior, every)
    (step, status), choice = choose_gloss(problem, start.pixels(chosen), model)
    fit, covariance = step.fit, step.covariances()[0]
    return replace(
        start,
        gloss=fit.gloss,
        strength=fit.strength,
        slope=fit.slope,
        shift=fit.shift,
        depth=fit.depth,
        model_error=fit.model_error,
        covariance=covariance,
        lamp_variance=step.relative_variance(),
        prior=step.problem.prior,
        share=share * len(chosen) / count,
        choice=choice,
        status=status,
    )
