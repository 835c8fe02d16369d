"""Step: gloss and lamps moved together with all normals and body colours, by robust Gauss–Newton.

Normal and body colour of a pixel depend on no other pixel, so they are eliminated (a Schur complement); gloss, lamps
and the distance of the whole surface affect all pixels. The lamps have a prior: without it a deviation of the body
from Lambert's law would be explained by uneven lamps.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.facets import TAIL_RANGE
from hagoromo.measurement.normals.lamp_shift import Shifted, shifted
from hagoromo.measurement.normals.photometric_model import Fit, Prior, precision
from hagoromo.measurement.normals.shading import TAIL, Gloss, Shading, interface_by_tail, shading, turned
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.parameters import GAMMA_RANGE, contrasts
from hagoromo.measurement.photometric.reading import reading
from hagoromo.measurement.photometric.term_fit import TermProfile, dispersion
from hagoromo.reflectance.parameters import ROWS

LOG_GAMMA_RANGE = (np.log(0.02), np.log(GAMMA_RANGE[1]))  # of ln γ, γ [rad]
ROUGHNESS_RANGE, LOG_EXPONENT_RANGE = ROWS["sigma"].fit.bounds, ROWS["epsilon"].fit.bounds
COLOUR_RANGE = (-3.0, 3.0)  # of each number of the interface colour
LONGEST_STEP = 0.5  # largest step of each number of a row of gloss and of a lamp
OF_LAMP = 6  # parameters of a lamp: ln e, a (2), shift (3)


@dataclass(frozen=True, eq=False)
class PixelProblem:
    """Some pixels and their values in the photographs.

    place: (P, 2) of the pixels on the object. share: effective number of independent values per value. free: (M, G)
    which numbers of the rows of gloss are estimated; the others stay where they are.
    """

    views: Views
    place: Array
    share: float
    prior: Prior
    free: NDArray[np.bool_]


class _Eliminated(NamedTuple):
    """The equations of each pixel: root (P, 2 + C, 2 + C), the inverse of Cholesky's factor of their curvature; and
    border (P, 2 + C, · + 1), products of its slopes with those of what pixels share and, last, with the deviations.
    """

    root: Array
    border: Array

    def after(self, change: Array) -> Array:
        """(P, 2 + C) change of the turns and body colours that goes with the `change` of what pixels share."""
        left = self.border[..., -1:] - self.border[..., :-1] @ change[:, None]
        return np.asarray((np.swapaxes(self.root, 1, 2) @ (self.root @ left))[..., 0], np.float64)


class PixelStep:
    """Residuals of the problem at `fit`, and the Gauss–Newton step from there."""

    def __init__(self, problem: PixelProblem, fit: Fit) -> None:
        self.problem, self.fit, views = problem, fit, problem.views
        self.lamps: Shifted = shifted(views, fit.shift, fit.depth)
        self.shade: Shading = shading(fit.normals, self.lamps.to_lamp, views.to_eye, fit.rows)
        self.even = (fit.evenness(problem.place) * np.exp(self.lamps.light))[:, None]  # (K, 1, P)
        self.colour = fit.interface_colour  # (C, P)
        self.model = self.even * self._reading(self.shade.body, self.shade.interface)
        self.deviation = views.values - self.model
        inverse = precision(views, fit.model_error)
        squared = self.deviation**2 * inverse / CAUCHY_SCALE**2
        self.weight_of_rows = _rows(problem.share * inverse / (1.0 + squared))  # (P, K·C)
        self.cost = 0.5 * (problem.share * CAUCHY_SCALE**2 * float(np.log1p(squared).sum()) + self._prior_loss())

    def _reading(self, lit: Array, interface: Array) -> Array:
        """(K, C, P) the reading of parts (K, P), or of their slopes."""
        return reading(self.fit.body, lit[:, None], self.colour, interface[:, None])

    @property
    def of_lamps(self) -> Array:
        """(K, OF_LAMP) ln e, a and shift."""
        return np.column_stack([self.fit.strength, self.fit.slope, self.fit.shift])

    def _prior_loss(self) -> float:
        prior = self.problem.prior
        centre, spread = prior.gloss(self.fit.gloss.rows.shape[1]).T
        gloss = np.sum(((self.fit.gloss.rows - centre) / spread) ** 2)
        return float(gloss) + prior.loss(self.of_lamps) + (self.fit.depth / prior.distance) ** 2

    @property
    def gradient(self) -> float:
        """Norm of the slope of the cost by gloss, lamps and depth, with the pixels eliminated."""
        return float(np.linalg.norm(self._undamped[1]))

    def trial(self, damping: float) -> tuple[PixelStep, float]:
        """The point after a damped step, and the size of the step in gloss, lamps and depth."""
        after = self.moved(damping)
        before, there = ((fit.gloss.rows, fit.strength, fit.slope, fit.shift) for fit in (self.fit, after))
        parts = [np.sum((b - a) ** 2) for a, b in zip(before, there, strict=True)]
        size = float(np.sqrt(sum(parts) + (after.depth - self.fit.depth) ** 2))
        return PixelStep(self.problem, after), size

    def moved(self, damping: float) -> Fit:
        """One damped step of everything."""
        fit = self.fit
        outer, rhs, local = self._reduced(damping)
        change = np.linalg.solve(outer + damping * np.diag(np.diag(outer)), rhs)
        change = np.clip(change, -LONGEST_STEP, LONGEST_STEP)
        local_change = local.after(np.asarray(change, np.float64))
        normals = turned(fit.normals, np.clip(local_change[:, :2], -0.3, 0.3), self.problem.views.to_eye)
        body = np.maximum(fit.body + local_change[:, 2:].T, 0.1 * fit.body)
        gloss_change, lamps_change, depth_change = unpack_shared(change, fit.gloss.rows.shape)
        rows = fit.gloss.rows + gloss_change
        rows[:, 1] = np.clip(rows[:, 1], *LOG_GAMMA_RANGE)
        rows[:, 2] = np.clip(rows[:, 2], *ROUGHNESS_RANGE)
        rows[:, 3] = np.clip(rows[:, 3], *LOG_EXPONENT_RANGE)
        rows[:, TAIL] = np.clip(rows[:, TAIL], *TAIL_RANGE)
        rows[:, TAIL + 1 :] = np.clip(rows[:, TAIL + 1 :], *COLOUR_RANGE)
        each = self.of_lamps + lamps_change
        return replace(
            fit,
            normals=normals,
            body=body,
            gloss=Gloss(rows),
            strength=each[:, 0],
            slope=each[:, 1:3],
            shift=each[:, 3:],
            depth=fit.depth + depth_change,
        )

    def without(self, lamps: NDArray[np.intp]) -> PixelStep:
        """The same problem without the photographs of some lamps, at the same fit."""
        other, (count, channels, pixels) = copy.copy(self), self.model.shape
        weight = self.weight_of_rows.reshape(pixels, count, channels).copy()
        weight[:, lamps] = 0.0
        other.weight_of_rows = weight.reshape(pixels, -1)
        for name in ("_undamped", "_equations"):
            other.__dict__.pop(name, None)
        return other

    def newton(self, pull: Array) -> tuple[Array, Array]:
        """Changes of the pixels (P, 2 + C), turns and body colours, and of what they share, in a Gauss–Newton step.

        pull: slope of a further prior, of what they share.
        """
        outer, rhs, local = self._reduced(1e-6)
        change = np.linalg.solve(outer, rhs + pull).astype(np.float64)
        return local.after(change), change

    def lamps_left_out(self, ridge: float) -> tuple[Array, Array, Array]:
        """Curvature of each pixel (P, 2 + C, 2 + C); change (P, K, 2 + C) of its turns and body colours when each lamp
        is left out, for fixed gloss and lamps; and the same change by the curvature with all lamps.

        ridge: share of the curvature that is left without the lamp.
        """
        count, channels, pixels = self.model.shape
        local = self._slopes[0].reshape(pixels, count, channels, -1)
        weighed = (
            np.swapaxes(local * self.weight_of_rows.reshape(pixels, count, channels, 1), 2, 3) / self.problem.share
        )
        each = weighed @ local
        bread = each.sum(axis=1) + 1e-9 * np.eye(2 + channels)
        score = -weighed @ _rows(self.deviation).reshape(pixels, count, channels, 1)
        without = (1.0 + ridge) * bread[:, None] - each
        return bread, np.linalg.solve(without, score)[..., 0], np.linalg.solve(bread[:, None], score)[..., 0]

    def covariances(self) -> tuple[Array, Array]:
        """(M, G, G) of each material's row of gloss, (K, OF_LAMP) variance of lamps; the rest is free."""
        outer, _ = self._undamped
        count, numbers = shape = self.fit.gloss.rows.shape
        inverse = np.linalg.inv(outer)
        split = count * numbers
        of_gloss = inverse[:split, :split].reshape(count, numbers, count, numbers)
        of_lamps = unpack_shared(np.diag(inverse), shape)[1].astype(np.float64)
        return np.stack([of_gloss[m, :, m] for m in range(count)]).astype(np.float64), of_lamps

    def relative_variance(self) -> Array:
        """(K, OF_LAMP) variance of lamps, of strength and slope less their means over the lamps.

        What all lamps have in common looks like the bodies' colours, and is known by the prior alone.
        """
        inverse = np.linalg.inv(self._undamped[0])
        count, lamps = self.fit.gloss.rows.size, len(self.fit.strength)
        of_lamps = inverse[count : count + OF_LAMP * lamps, count : count + OF_LAMP * lamps]
        parts = of_lamps.reshape(lamps, OF_LAMP, lamps, OF_LAMP)
        variance = self.covariances()[1]
        for i in range(3):
            own = parts[:, i, :, i]
            variance[:, i] = np.diag(own) - 2.0 * own.mean(axis=1) + own.mean()
        return variance

    def profile(self, changes: Array) -> tuple[TermProfile, Array]:
        """The profile of terms that change the values by `changes` (T, K, C, P), with all that is fitted eliminated;
        and the change (M, G, T) of the gloss by each.
        """
        local, gloss, lamps, depth = self._slopes
        weight = self.weight_of_rows[..., None]
        terms = np.stack([_rows(change) for change in changes], axis=-1)  # (P, K·C, T)
        weighed = np.swapaxes(local * weight, 1, 2)
        inner = weighed @ local + 1e-9 * np.eye(local.shape[2])
        left = terms - local @ np.linalg.solve(inner, weighed @ terms)
        led, (outer, rhs) = left * weight, self._undamped
        cross = self._products(led, gloss, lamps, depth)
        by_shared = np.linalg.solve(outer, cross)
        pull = _rows(self.deviation)[..., None] * led
        bare, scatter = (np.einsum("prt,pru->tu", *pair) for pair in ((led, left), (pull, pull)))
        information = np.einsum("prt,pru->tu", led, terms) - cross.T @ by_shared
        of_gloss = np.asarray(-by_shared[: self.fit.gloss.rows.size], np.float64)
        of_gloss = of_gloss.reshape(*self.fit.gloss.rows.shape, len(changes))
        wider = dispersion(bare, scatter / self.problem.share)
        step = np.linalg.pinv(information, hermitian=True) @ (pull.sum(axis=(0, 1)) - by_shared.T @ rhs)
        return TermProfile(step, information / wider), of_gloss

    def _products(self, led: Array, gloss: Array, lamps: Array, depth: Array) -> Array:
        """(G M + OF_LAMP K + 1, T) products of the slopes by gloss, lamps and depth with columns `led` (P, K·C, T)."""
        count, channels, pixels = self.model.shape
        of_gloss = np.swapaxes(gloss, 1, 2) @ led  # (P, G, T)
        materials = [of_gloss[self.fit.labels == m].sum(axis=0) for m in range(len(self.fit.gloss.rows))]
        each = (pixels, count, channels, -1)
        of_lamps = np.einsum("pkcl,pkct->klt", lamps.reshape(each), led.reshape(each))
        of_depth = np.einsum("prd,prt->dt", depth, led)
        return np.concatenate([*materials, of_lamps.reshape(-1, led.shape[2]), of_depth])

    @cached_property
    def _undamped(self) -> tuple[Array, Array]:
        """Normal equations of gloss, lamps and depth; damped by 1e-6, since some pixels are lit by too few lamps."""
        outer, rhs, _ = self._reduced(1e-6)
        return outer, rhs

    def _reduced(self, damping: float) -> tuple[Array, Array, _Eliminated]:
        """Normal equations of gloss, lamps, depth with the pixels eliminated; and the pixels' own part."""
        inner, border, outer, rhs = self._equations
        one = np.eye(inner.shape[1])
        inner = inner + (damping * inner * one + 1e-9 * one)
        root = np.asarray(np.linalg.inv(np.linalg.cholesky(inner)), np.float64)  # (P, 2 + C, 2 + C), lower
        half = (root @ border).reshape(-1, len(rhs) + 1)
        across = half.T @ half  # a product with itself: half of the work of any other
        return outer - across[:-1, :-1], rhs - across[:-1, -1], _Eliminated(root, border)

    @cached_property
    def _equations(self) -> tuple[Array, Array, Array, Array]:
        """Curvature of each pixel (P, 2 + C, 2 + C), its border, and the normal equations of what pixels share."""
        local, gloss, lamps, depth = self._slopes
        weighed = np.ascontiguousarray(np.swapaxes(local * self.weight_of_rows[..., None], 1, 2))  # (P, 2 + C, K·C)
        pixel_rhs = weighed @ _rows(self.deviation)[..., None]
        border = np.concatenate([self._border(weighed, gloss, lamps), weighed @ depth, pixel_rhs], axis=2)
        return weighed @ local, border, *self._outer(gloss, lamps, depth)

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """Slopes of the values (P, K·C, ·) by own turns and body colours, own material's gloss, own lamp, and depth."""
        shade, (lamps, channels, pixels) = self.shade, self.model.shape
        local = np.zeros((pixels, lamps, channels, 2 + channels))
        for i, (body, interface) in enumerate(zip(shade.body_turned, shade.interface_turned, strict=True)):
            slope = self.even * self._reading(body, interface)
            local[..., i] = np.moveaxis(slope, 2, 0)
        for c in range(channels):
            local[:, :, c, 2 + c] = (self.even[:, 0] * shade.body).T
        return local.reshape(pixels, lamps * channels, 2 + channels), self._by_gloss(), *self._by_lamp()

    def _by_gloss(self) -> Array:
        """Slopes of the values by the numbers of the own material's gloss (P, K·C, G), 0 by those that are held."""
        fit, shade, free = self.fit, self.shade, self.problem.free
        channels, (_, numbers) = self.model.shape[1], fit.gloss.rows.shape
        of_interface = self.even * self.colour
        interface, by_width = (of_interface * part[:, None] for part in (shade.interface, shade.by_width))
        parts = [interface, by_width, *(self.even * fit.body * part[:, None] for part in shade.by_body)]
        slopes = np.zeros((self.model.shape[2], self.model.shape[0] * channels, numbers))
        if free[:, TAIL].any():
            eye, rows = self.problem.views.to_eye, fit.gloss.rows[fit.labels]
            by_tail = interface_by_tail(shade.interface, fit.normals, self.lamps.to_lamp, eye, rows)
            parts.append(of_interface * by_tail[:, None])
        for j, part in enumerate(parts):
            slopes[..., j] = _rows(part)
        for j, contrast in enumerate(contrasts(channels).T):
            slopes[..., TAIL + 1 + j] = _rows(interface * contrast[:, None])
        return slopes if free.all() else slopes * free[fit.labels][:, None]

    def _by_lamp(self) -> tuple[Array, Array]:
        """Slopes of the values by the own lamp's ln e, a and shift (P, K·C, OF_LAMP), and by depth (P, K·C, 1)."""
        fit, place = self.fit, self.problem.place
        level = (1.0 + fit.slope @ place.T)[:, None]
        parts = [self.model, self.model * place[:, 0] / level, self.model * place[:, 1] / level]
        led = [
            self.even * self._reading(body, interface)
            for body, interface in zip(self.shade.body_led, self.shade.interface_led, strict=True)
        ]
        for j in range(4):
            turn = self.lamps.turns[..., j][:, None]  # (K, 1, P, 2)
            parts.append(
                self.model * self.lamps.by_light[:, None, :, j] + led[0] * turn[..., 0] + led[1] * turn[..., 1]
            )
        return np.stack([_rows(part) for part in parts[:-1]], axis=-1), _rows(parts[-1])[..., None]

    def _border(self, weighed: Array, gloss: Array, lamps: Array) -> Array:
        """(P, 2 + C, G M + OF_LAMP K) products of the pixels' own slopes with those of gloss and lamps."""
        count, channels, pixels = self.model.shape
        own = weighed @ gloss
        member = (self.fit.labels[:, None] == np.arange(len(self.fit.gloss.rows))).astype(np.float64)
        of_gloss = (own[:, :, None, :] * member[:, None, :, None]).reshape(pixels, 2 + channels, -1)
        by_lamp = np.moveaxis(weighed.reshape(pixels, 2 + channels, count, channels), 2, 1)  # (P, K, 2 + C, C)
        of_lamps = np.moveaxis(by_lamp @ lamps.reshape(pixels, count, channels, OF_LAMP), 1, 2)
        return np.concatenate([of_gloss, of_lamps.reshape(pixels, 2 + channels, -1)], axis=2)

    def _outer(self, gloss: Array, lamps: Array, depth: Array) -> tuple[Array, Array]:
        """Normal equations of gloss, lamps and depth, with their priors."""
        fit, prior, (count, channels, pixels) = self.fit, self.problem.prior, self.model.shape
        materials, numbers = fit.gloss.rows.shape
        size = numbers * materials
        outer = np.zeros((size + OF_LAMP * count + 1,) * 2)
        rhs = np.zeros(len(outer))
        deviation, of_depth = _rows(self.deviation), depth[..., 0]
        weight = self.weight_of_rows

        def by_lamp(rows: Array) -> Array:
            """(P, K·C, n) or (P, K·C) → (K, P, C, n)."""
            return np.ascontiguousarray(np.moveaxis(rows.reshape(pixels, count, channels, -1), 1, 0))

        each, own_gloss, of_each = by_lamp(lamps), by_lamp(gloss), by_lamp(weight)
        led = each * of_each
        for m in range(materials):
            index, own = slice(numbers * m, numbers * (m + 1)), self.fit.labels == m
            rows, flat = (gloss, weight) if own.all() else (gloss[own], weight[own])
            weighed, flat_rows = (rows * flat[..., None]).reshape(-1, numbers).T, rows.reshape(-1, numbers)
            outer[index, index] = weighed @ flat_rows
            some, theirs = (own_gloss, led) if own.all() else (own_gloss[:, own], led[:, own])
            both = np.swapaxes(some.reshape(count, -1, numbers), 1, 2) @ theirs.reshape(count, -1, OF_LAMP)
            outer[index, size:-1] = np.moveaxis(both, 0, 1).reshape(numbers, -1)
            outer[size:-1, index] = outer[index, size:-1].T
            outer[index, -1] = outer[-1, index] = weighed @ of_depth[own].ravel()
            rhs[index] = weighed @ deviation[own].ravel()
        outer[-1, -1], rhs[-1] = np.sum(weight * of_depth**2), np.sum(weight * of_depth * deviation)
        each, across = each.reshape(count, -1, OF_LAMP), np.swapaxes(led.reshape(count, -1, OF_LAMP), 1, 2)
        left, far = (across @ by_lamp(one).reshape(count, -1, 1) for one in (deviation, of_depth))
        for k, square in enumerate(across @ each):
            index = slice(size + OF_LAMP * k, size + OF_LAMP * (k + 1))
            outer[index, index], rhs[index] = square, left[k, :, 0]
            outer[index, -1] = outer[-1, index] = far[k, :, 0]
        centre, spread = prior.gloss(numbers).T
        of_gloss = np.tile(spread**-2.0, (materials, 1))
        precision_of_prior = pack_shared(of_gloss, prior.precision(self.of_lamps), prior.distance**-2.0)
        away = pack_shared(np.where(self.problem.free, fit.gloss.rows - centre, 0.0), self.of_lamps, fit.depth)
        return outer + np.diag(precision_of_prior), rhs - precision_of_prior * away


def pack_shared(gloss: Array, lamps: Array, depth: float) -> Array:
    """The parameters that all pixels share as one vector: gloss (M, G), lamps (K, OF_LAMP) and depth."""
    return np.r_[gloss.ravel(), lamps.ravel(), depth]


def unpack_shared(shared: NDArray[np.floating], gloss: tuple[int, ...]) -> tuple[Array, Array, float]:
    """Gloss of this shape (M, G), lamps (K, OF_LAMP) and depth of a vector: the inverse of `pack_shared`."""
    split, shared = math.prod(gloss), np.asarray(shared, np.float64)
    return shared[:split].reshape(gloss), shared[split:-1].reshape(-1, OF_LAMP), float(shared[-1])


def _rows(values: Array) -> Array:
    """(K, C, P) → (P, K·C)."""
    return np.ascontiguousarray(values.reshape(-1, values.shape[2]).T)
