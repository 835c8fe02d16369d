"""Pixel fit: the normal and body colour of every pixel, gloss and lamps known; one thread of the device per pixel.

Levenberg–Marquardt with Cauchy's loss on the residuals of `photometric_fit`, each pixel with a damping of its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.least_squares import CAUCHY_SCALE, Status
from hagoromo.measurement.normals.shading import GRAZING, N, body_of
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow

PIXEL_FIT_STEPS = 15
SETTLED = 1e-4  # of its loss, gain of a step from which on a pixel has settled
FEW = 2e-4  # share of the pixels that may still be moving at the end
STALLED_DAMPING = 1e3  # of a pixel: five rejected trials or more in a row brought it there
LONGEST_TURN = 0.3  # rad, of a normal in one step
WEAKEST = 1e-3  # rad⁻²: curvature that keeps the step of a pixel finite that hardly any lamp lights
DIMMEST = 0.1  # of its body colour that a step may leave


class Light(NamedTuple):
    """What the fit of the pixels takes as known.

    gloss: (P, 4) rows of `Gloss`. evenness: (K, P) factor of the lamps. precision: (K, C, P) inverse variance of the
    values, 0 where they are not used.
    """

    gloss: Array
    evenness: Array
    precision: Array


class Equations(NamedTuple):
    """Loss of each pixel and its normal equations: turns aa, ab, bb; turns × body; body; and the pulls on all."""

    loss: Any
    aa: Any
    ab: Any
    bb: Any
    a_body: list[Any]
    b_body: list[Any]
    body: list[Any]
    pull_a: Any
    pull_b: Any
    pull_body: list[Any]


class PixelFit(NamedTuple):
    """normals (P, 3), body colours (C, P), variance of the normals (P,) [rad²], and the `Status` (P,) of each pixel."""

    normals: Array
    body: Array
    variance: Array
    status: NDArray[np.int8]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(P,)"""
        return self.status == Status.CONVERGED


def fit_pixels(seen: Views, light: Light, normals: Array, body: Array) -> PixelFit:
    """The normal and body colour of every pixel, from where they start.

    A pixel has converged when its last accepted step lowered its loss by less than a share SETTLED of it, or none of
    its trials does. It has stalled when its damping grew to STALLED_DAMPING before any step did; else, when the steps
    are used up, it is out of steps.
    """
    data = PixelData(seen, light)
    normal, colour = data.vectors(normals), [data.floats(channel) for channel in body]
    at, damping = data.equations(normal, colour), dr.full(arrays().Float, 1e-2, len(normals))
    settled = dr.full(arrays().Bool, False, len(normals))
    dr.make_opaque(damping, settled)
    for _ in range(PIXEL_FIT_STEPS):
        tried, tried_colour = data.moved(normal, colour, at, damping)
        dr.eval(tried, tried_colour)  # one kernel for the equations, compiled once
        there = data.equations(tried, tried_colour)
        better = there.loss < at.loss
        moving = better & (at.loss - there.loss > SETTLED * at.loss)
        settled = dr.select(better, ~moving, settled)
        normal = dr.select(better, tried, normal)
        colour = [dr.select(better, new, old) for new, old in zip(tried_colour, colour, strict=True)]
        at = Equations(*_chosen(better, there, at))
        damping = dr.select(better, dr.fmax(0.2 * damping, 1e-5), 5.0 * damping)
        dr.eval(normal, colour, damping, moving, settled, *at)
        if int(dr.count(moving)[0]) <= FEW * len(normals):
            break
    stalled = damping.numpy() >= STALLED_DAMPING
    status = np.where(settled.numpy(), Status.CONVERGED, np.where(stalled, Status.STALLED, Status.OUT_OF_STEPS))
    colours = np.array([c.numpy() for c in colour], np.float64)
    return PixelFit(normal.numpy().T.astype(np.float64), colours, _variance(at).numpy(), status.astype(np.int8))


class PixelData:
    """Views and light on the device."""

    def __init__(self, seen: Views, light: Light) -> None:
        lamps, self.channels, self.pixels = seen.values.shape
        # opaque: captures of other sizes run the same kernel
        self.lamps, self.width = (dr.opaque(arrays().UInt, count) for count in (lamps, self.pixels))
        self.values, self.precision = self.floats(seen.values), self.floats(light.precision)
        self.evenness, self.to_lamp = self.floats(light.evenness), self.floats(seen.to_lamp)
        self.to_eye = self.vectors(seen.to_eye)
        self.gloss = [self.floats(row) for row in np.maximum(light.gloss, -80.0).T]

    def floats(self, values: NDArray) -> Any:
        """The values as one array of the device."""
        return arrays().Float(np.ascontiguousarray(values, np.float32).ravel())

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
            at = lamp * self.width + pixel
            scale = dr.gather(jit.Float, self.evenness, at)
            to_lamp = dr.gather(jit.Array3f, self.to_lamp, at)
            shade, turned = self.shade(normal, to_lamp, (first, second))
            new = list(sums)
            by_body = scale * shade[0]
            for i in range(c):
                place = (lamp * c + i) * self.width + pixel
                deviation = dr.gather(jit.Float, self.values, place) - scale * (body[i] * shade[0] + shade[1])
                precision = dr.gather(jit.Float, self.precision, place)
                squared = deviation * deviation * precision * (1.0 / CAUCHY_SCALE**2)
                weight = precision / (1.0 + squared)
                a, b = (scale * (body[i] * by[0] + by[1]) for by in turned)
                terms = (CAUCHY_SCALE**2 * dr.log(1.0 + squared), weight * a * a, weight * a * b, weight * b * b)
                pulls = (weight * a * deviation, weight * b * deviation)
                for j, term in enumerate((*terms, *pulls)):
                    new[j] += term
                mixed = (weight * a * by_body, weight * b * by_body, weight * by_body * by_body)
                for j, term in enumerate((*mixed, weight * by_body * deviation)):
                    new[6 + j * c + i] += term
            return lamp + 1, *new

        state = (dr.zeros(jit.UInt, self.pixels), *start)
        _, loss, aa, ab, bb, pull_a, pull_b, *rest = dr.while_loop(state, lambda lamp, *_: lamp < self.lamps, add)
        a_body, b_body, own, pull = (rest[j * c : j * c + c] for j in range(4))
        found = Equations(loss, aa, ab, bb, a_body, b_body, own, pull_a, pull_b, pull)
        dr.eval(*found)
        return found

    def moved(self, normal: Any, body: list[Any], at: Equations, damping: Any) -> tuple[Any, list[Any]]:
        """Where a damped Gauss–Newton step leads, the body colours eliminated."""
        own = [dr.fma(h, damping, h) + 1e-12 for h in at.body]
        ridge = 1.0 + damping
        aa, bb, ab = at.aa * ridge + WEAKEST, at.bb * ridge + WEAKEST, at.ab
        pull_a, pull_b = at.pull_a, at.pull_b
        for a, b, h, pull in zip(at.a_body, at.b_body, own, at.pull_body, strict=True):
            aa, ab, bb = aa - a * a / h, ab - a * b / h, bb - b * b / h
            pull_a, pull_b = pull_a - a * pull / h, pull_b - b * pull / h
        determinant = dr.fmax(aa * bb - ab * ab, 1e-12)
        turn_a, turn_b = (bb * pull_a - ab * pull_b) / determinant, (aa * pull_b - ab * pull_a) / determinant
        short = dr.fmin(1.0, LONGEST_TURN * dr.rsqrt(turn_a * turn_a + turn_b * turn_b + 1e-20))
        turn_a, turn_b = short * turn_a, short * turn_b
        colours = [
            dr.fmax(colour + (pull - a * turn_a - b * turn_b) / h, DIMMEST * colour)
            for colour, a, b, h, pull in zip(body, at.a_body, at.b_body, own, at.pull_body, strict=True)
        ]
        first, second = frame(normal)
        tried = dr.normalize(normal + turn_a * first + turn_b * second)
        behind = dr.fmax(GRAZING - dr.dot(tried, self.to_eye), 0.0)
        return dr.normalize(tried + behind * self.to_eye), colours

    def shade(self, normal: Any, to_lamp: Any, turns: tuple[Any, Any]) -> tuple[Any, list[Any]]:
        """(body, interface) weights, and their slopes as the normal turns either way."""
        slopes, weights = [], ()
        for turn in turns:
            angle = arrays().Float(0)
            dr.enable_grad(angle)
            n = dr.normalize(normal + angle * turn)
            weights = torrance_sparrow(n, to_lamp, self.to_eye, 1.0, dr.exp(self.gloss[0]), dr.exp(self.gloss[1]), N)
            body = body_of(weights.body, dr.dot(n, self.to_eye), dr.dot(to_lamp, self.to_eye), self.gloss[2:])
            weights = body, weights.interface
            dr.set_grad(angle, 1.0)
            slopes.append(dr.forward_to(*weights))
        return tuple(dr.detach(weight) for weight in weights), slopes


def frame(normal: Any) -> tuple[Any, Any]:
    """Two unit vectors that make a right-handed frame with `normal` (Array3f), for Dr.Jit."""
    aside = dr.select(dr.abs(normal.x) < 0.6, arrays().Array3f(1, 0, 0), arrays().Array3f(0, 1, 0))
    first = dr.normalize(dr.cross(aside, normal))
    return first, dr.cross(normal, first)


def _chosen(better: Any, there: Equations, here: Equations) -> list[Any]:
    return [
        [dr.select(better, new, old) for new, old in zip(a, b, strict=True)]
        if isinstance(a, list)
        else dr.select(better, a, b)
        for a, b in zip(there, here, strict=True)
    ]


def _variance(at: Equations) -> Any:
    """Trace of the inverse curvature of the two turns, the body colours free."""
    aa, ab, bb = at.aa + WEAKEST, at.ab, at.bb + WEAKEST
    for a, b, own in zip(at.a_body, at.b_body, at.body, strict=True):
        h = own + 1e-12
        aa, ab, bb = aa - a * a / h, ab - a * b / h, bb - b * b / h
    return (aa + bb) / dr.fmax(aa * bb - ab * ab, 1e-12)
