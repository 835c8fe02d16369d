"""Pixel fit: normal and body colour of every pixel for known gloss and lamps, one thread of the device per pixel.

Levenberg–Marquardt with Cauchy's loss on the residuals of `photometric_fit`; each pixel has its own damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo.least_squares.fit_status import Status
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.shading import LEAST_COSINE, TAIL, N, body_of, colour_of, exponent_of
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.reading import reading
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow

PIXEL_FIT_STEPS = 15
CONVERGED_GAIN = 1e-4  # relative to the loss of a pixel: a step that gains less has converged
STILL_MOVING_SHARE = 2e-4  # share of the pixels that may still be moving when the loop ends
STALLED_DAMPING = 1e3  # of a pixel: reached by five or more rejected trials in a row
LONGEST_TURN = 0.3  # [rad] largest turn of a normal in one step
SMALLEST_CURVATURE = 1e-3  # [rad⁻²] added, so that the step of a pixel that hardly any lamp lights stays finite
LEAST_BODY_RATIO = 0.1  # smallest ratio of a body colour after a step to the one before


class PixelConditions(NamedTuple):
    """The known quantities of the pixel fit.

    gloss: (P, G) rows of `Gloss`. evenness: (K, P) factor of the lamps. precision: (K, C, P) inverse variance of the
    values, 0 where they are not used. further: of each further lobe (P, 2) ln β and ln γ [rad] of its Gaussian facets.
    lower: (K, C, P) inverse variance of clipped values, which are lower bounds: residuals count where the model lies
    below; 0 for all others. None: no value is clipped.
    """

    gloss: Array
    evenness: Array
    precision: Array
    further: tuple[Array, ...] = ()
    lower: Array | None = None


class Equations(NamedTuple):
    """Loss of each pixel and its normal equations: turns aa, ab, bb; turns × body; body; and the right-hand sides."""

    loss: Any
    aa: Any
    ab: Any
    bb: Any
    a_body: list[Any]
    b_body: list[Any]
    body: list[Any]
    rhs_a: Any
    rhs_b: Any
    rhs_body: list[Any]

    def reduced(self, damping: Any) -> Turns:
        """The equations of the two turns, damped, with the body colours eliminated."""
        bodies, ridge = [dr.fma(h, damping, h) + 1e-12 for h in self.body], 1.0 + damping
        aa, bb, ab = self.aa * ridge + SMALLEST_CURVATURE, self.bb * ridge + SMALLEST_CURVATURE, self.ab
        rhs_a, rhs_b = self.rhs_a, self.rhs_b
        for a, b, h, rhs in zip(self.a_body, self.b_body, bodies, self.rhs_body, strict=True):
            aa, ab, bb = aa - a * a / h, ab - a * b / h, bb - b * b / h
            rhs_a, rhs_b = rhs_a - a * rhs / h, rhs_b - b * rhs / h
        return Turns(aa, ab, bb, rhs_a, rhs_b, bodies)


class Turns(NamedTuple):
    """Normal equations of the two turns of a normal, and the curvature by the body colours that were eliminated."""

    aa: Any
    ab: Any
    bb: Any
    rhs_a: Any
    rhs_b: Any
    bodies: list[Any]

    @property
    def determinant(self) -> Any:
        """Of the curvature of the turns, above 0."""
        return dr.fmax(self.aa * self.bb - self.ab * self.ab, 1e-12)


class NormalFit(NamedTuple):
    """normals (P, 3), body colours (C, P), variance of the normals (P,) [rad²], and the `Status` (P,) of each pixel."""

    normals: Array
    body: Array
    variance: Array
    status: NDArray[np.int8]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(P,)"""
        return self.status == Status.CONVERGED


def fit_pixels(
    views: Views, light: PixelConditions, normals: Array, body: Array, steps: int | None = None
) -> NormalFit:
    """The normal and body colour of every pixel, from the start `normals` (P, 3) and `body` (C, P).

    A pixel has converged when its last accepted step, or an undamped step from where it is, lowers its loss by less
    than the share CONVERGED_GAIN. The loop ends when at most STILL_MOVING_SHARE of the pixels are moving, or after
    `steps`, by default PIXEL_FIT_STEPS. Of the pixels that have not converged then, those whose damping reached
    STALLED_DAMPING, or whose last trial was rejected although steps were left, have stalled; the others are out of
    steps.
    """
    data = PixelData(*_that_count(views, light))
    normal, colour = data.vectors(normals), [data.floats(channel) for channel in body]
    equations, damping = data.equations(normal, colour), dr.full(arrays().Float, 1e-2, len(normals))
    settled = dr.full(arrays().Bool, False, len(normals))
    dr.make_opaque(damping, settled)
    exhausted, moving = True, ~settled
    for _ in range(PIXEL_FIT_STEPS if steps is None else steps):
        trial_normal, trial_colour = data.moved(normal, colour, equations, damping)
        dr.eval(trial_normal, trial_colour)  # one kernel for the equations, compiled once
        trial = data.equations(trial_normal, trial_colour)
        better = trial.loss < equations.loss
        moving = better & (equations.loss - trial.loss > CONVERGED_GAIN * equations.loss)
        settled = dr.select(better, ~moving, settled)
        normal = dr.select(better, trial_normal, normal)
        colour = [dr.select(better, new, old) for new, old in zip(trial_colour, colour, strict=True)]
        equations = Equations(*_chosen(better, trial, equations))
        damping = dr.select(better, dr.fmax(0.2 * damping, 1e-5), 5.0 * damping)
        dr.eval(normal, colour, damping, moving, settled, *equations)
        if int(dr.count(moving)[0]) <= STILL_MOVING_SHARE * len(normals):
            exhausted = False
            break
    settled |= _decrement(equations) <= CONVERGED_GAIN * equations.loss
    stalled = (damping >= STALLED_DAMPING) | (~moving & (not exhausted))
    unsettled = np.where(stalled.numpy(), Status.STALLED, Status.OUT_OF_STEPS)
    status = np.where(settled.numpy(), Status.CONVERGED, unsettled)
    colours = np.array([c.numpy() for c in colour], np.float64)
    return NormalFit(normal.numpy().T.astype(np.float64), colours, _variance(equations).numpy(), status.astype(np.int8))


class PixelData:
    """Views and light on the device."""

    def __init__(self, views: Views, light: PixelConditions) -> None:
        lamps, self.channels, self.pixels = views.values.shape
        # opaque: captures of other sizes run the same compiled kernel
        self.lamps, self.width = (dr.opaque(arrays().UInt, count) for count in (lamps, self.pixels))
        # of lower bounds negative
        precision = light.precision if light.lower is None else light.precision - light.lower
        self.values, self.precision = self.floats(views.values), self.floats(precision)
        self.bounds = light.lower is not None
        self.evenness, self.to_lamp = self.floats(light.evenness), self.floats(views.to_lamp)
        self.to_eye = self.vectors(views.to_eye)
        self.gloss = [self.floats(row) for row in np.maximum(light.gloss[:, :TAIL], -80.0).T]
        self.further = [[self.floats(row) for row in np.maximum(lobe, -80.0).T] for lobe in light.further]
        nu = exponent_of(light.gloss)
        self.tails = {} if nu is None else {"nu": self.floats(nu)}
        colours = colour_of(light.gloss).T
        self.colours = [self.floats(colour) for colour in colours] if np.any(colours != 1.0) else None

    def floats(self, values: NDArray) -> Any:
        """The values as one array of the device."""
        return column(arrays().Float, np.asarray(values, np.float32))

    def vectors(self, values: NDArray) -> Any:
        """The vectors (P, 3) on the device."""
        return arrays().Array3f(np.ascontiguousarray(values.T, np.float32))

    def equations(self, normal: Any, body: list[Any]) -> Equations:
        """Sums over lamps and channels, at `normal` and `body`."""
        jit, c = arrays(), self.channels
        pixel = dr.arange(jit.UInt, self.pixels)
        first, second = frame(normal)
        start = [dr.zeros(jit.Float, self.pixels) for _ in range(6 + 4 * c)]

        def add(lamp: Any, *sums: Any) -> tuple[Any, ...]:
            index = lamp * self.width + pixel
            scale = dr.gather(jit.Float, self.evenness, index)
            to_lamp = dr.gather(jit.Array3f, self.to_lamp, index)
            shade, turned = self.shade(normal, to_lamp, (first, second))
            new = list(sums)
            by_body = scale * shade[0]
            for i in range(c):
                sample = (lamp * c + i) * self.width + pixel
                deviation = dr.gather(jit.Float, self.values, sample) - scale * self.value(body, i, shade)
                precision = dr.gather(jit.Float, self.precision, sample)
                if self.bounds:
                    precision = dr.select(deviation > 0.0, dr.abs(precision), dr.fmax(precision, 0.0))
                squared = deviation * deviation * precision * (1.0 / CAUCHY_SCALE**2)
                weight = precision / (1.0 + squared)
                a, b = (scale * self.value(body, i, by) for by in turned)
                terms = (CAUCHY_SCALE**2 * dr.log(1.0 + squared), weight * a * a, weight * a * b, weight * b * b)
                sides = (weight * a * deviation, weight * b * deviation)
                for j, term in enumerate((*terms, *sides)):
                    new[j] += term
                mixed = (weight * a * by_body, weight * b * by_body, weight * by_body * by_body)
                for j, term in enumerate((*mixed, weight * by_body * deviation)):
                    new[6 + j * c + i] += term
            return lamp + 1, *new

        state = (dr.zeros(jit.UInt, self.pixels), *start)
        _, loss, aa, ab, bb, rhs_a, rhs_b, *rest = dr.while_loop(state, lambda lamp, *_: lamp < self.lamps, add)
        a_body, b_body, own, rhs = (rest[j * c : j * c + c] for j in range(4))
        equations = Equations(loss, aa, ab, bb, a_body, b_body, own, rhs_a, rhs_b, rhs)
        dr.eval(*equations)
        return equations

    def moved(self, normal: Any, body: list[Any], equations: Equations, damping: Any) -> tuple[Any, list[Any]]:
        """The point after a damped Gauss–Newton step, with the body colours eliminated."""
        aa, ab, bb, rhs_a, rhs_b, own = turns = equations.reduced(damping)
        turn_a, turn_b = (bb * rhs_a - ab * rhs_b) / turns.determinant, (aa * rhs_b - ab * rhs_a) / turns.determinant
        short = dr.fmin(1.0, LONGEST_TURN * dr.rsqrt(turn_a * turn_a + turn_b * turn_b + 1e-20))
        turn_a, turn_b = short * turn_a, short * turn_b
        colours = [
            dr.fmax(colour + (rhs - a * turn_a - b * turn_b) / h, LEAST_BODY_RATIO * colour)
            for colour, a, b, h, rhs in zip(
                body, equations.a_body, equations.b_body, own, equations.rhs_body, strict=True
            )
        ]
        first, second = frame(normal)
        tried = dr.normalize(normal + turn_a * first + turn_b * second)
        behind = dr.fmax(LEAST_COSINE - dr.dot(tried, self.to_eye), 0.0)
        return dr.normalize(tried + behind * self.to_eye), colours

    def value(self, body: list[Any], channel: int, weights: Sequence[Any]) -> Any:
        """The value of a channel for `weights` of body and interface; for their slopes, its slope."""
        return reading(body[channel], weights[0], self.colours and self.colours[channel], weights[1])

    def shade(self, normal: Any, to_lamp: Any, turns: tuple[Any, Any]) -> tuple[Any, list[Any]]:
        """(body, interface) weights, and their slopes by the two turns of the normal."""
        slopes, weights = [], ()
        for turn in turns:
            angle = arrays().Float(0)
            dr.enable_grad(angle)
            n = dr.normalize(normal + angle * turn)
            beta, gamma = (dr.exp(row) for row in self.gloss[:2])
            weights = torrance_sparrow(n, to_lamp, self.to_eye, 1.0, beta, gamma, N, **self.tails)
            body = body_of(weights.body, dr.dot(n, self.to_eye), dr.dot(to_lamp, self.to_eye), self.gloss[2:])
            weights = body, weights.interface
            for lobe in self.further:
                beta, gamma = (dr.exp(row) for row in lobe)
                more = torrance_sparrow(n, to_lamp, self.to_eye, 1.0, beta, gamma, N).interface
                weights = body, weights[1] + more
            dr.set_grad(angle, 1.0)
            slopes.append(dr.forward_to(*weights))
        return tuple(dr.detach(weight) for weight in weights), slopes


def _that_count(views: Views, light: PixelConditions) -> tuple[Views, PixelConditions]:
    """Both without lamps that no pixel uses."""
    used = light.precision.any(axis=(1, 2))
    if light.lower is not None:
        used |= light.lower.any(axis=(1, 2))
    if used.all():
        return views, light
    lower = None if light.lower is None else light.lower[used]
    light = light._replace(evenness=light.evenness[used], precision=light.precision[used], lower=lower)
    return replace(views, values=views.values[used], to_lamp=views.to_lamp[used]), light


def frame(normal: Any) -> tuple[Any, Any]:
    """Two unit vectors that make a right-handed frame with `normal` (Array3f), for Dr.Jit."""
    aside = dr.select(dr.abs(normal.x) < 0.6, arrays().Array3f(1, 0, 0), arrays().Array3f(0, 1, 0))
    first = dr.normalize(dr.cross(aside, normal))
    return first, dr.cross(normal, first)


def _chosen(better: Any, trial: Equations, current: Equations) -> list[Any]:
    """Of each pixel the equations of its better point."""
    return [
        [dr.select(better, new, old) for new, old in zip(a, b, strict=True)]
        if isinstance(a, list)
        else dr.select(better, a, b)
        for a, b in zip(trial, current, strict=True)
    ]


def _variance(equations: Equations) -> Any:
    """Trace of the inverse curvature of the two turns, with the body colours free."""
    turns = equations.reduced(0.0)
    return (turns.aa + turns.bb) / turns.determinant


def _decrement(equations: Equations) -> Any:
    """Fall of the loss that an undamped Gauss–Newton step predicts: gᵀH⁻¹g over turns and body colours."""
    turns, fall = equations.reduced(0.0), dr.zeros(arrays().Float, dr.width(equations.loss))
    for rhs, h in zip(equations.rhs_body, turns.bodies, strict=True):
        fall = fall + rhs * rhs / h
    a, b = turns.rhs_a, turns.rhs_b
    return fall + (turns.bb * a * a - 2.0 * turns.ab * a * b + turns.aa * b * b) / turns.determinant
