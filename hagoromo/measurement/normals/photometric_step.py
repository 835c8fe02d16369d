"""Step: gloss and lamps moved together with all normals and body colours, by robust Gauss–Newton.

The normal and the body colour of a pixel touch nobody else, so they are eliminated (a block arrow); gloss, lamps and
the distance of the whole surface touch all. The lamps have a prior: without it a departure of the body from Lambert's
law would pass for uneven lamps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hagoromo.least_squares import CAUCHY_SCALE
from hagoromo.measurement.normals.lamp_shift import Shifted, shifted
from hagoromo.measurement.normals.photometric_model import Fit, precision
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.normals.shading import Gloss, Shading, shading, turned
from hagoromo.measurement.normals.views import Array, Views

WIDTHS = (np.log(0.02), np.log(1.2))  # range of ln γ
ROUGHNESSES, EXPONENTS = (-0.2, 1.0), (np.log(0.3), np.log(2.0))  # ranges of σ and ln ε
LONGEST = 0.5  # of a step in ln β, ln γ, σ, ln ε and the lamps' numbers
OF_GLOSS = 4  # numbers of a material
OF_LAMP = 6  # numbers of a lamp: ln e, a, shift


@dataclass(frozen=True, eq=False)
class Problem:
    """Some pixels as the photographs show them.

    place: (P, 2) of the pixels on the object. share: independent values that one value stands for.
    """

    seen: Views
    place: Array
    share: float
    prior: Prior


class Step:
    """Residuals of the problem at `fit`, and the Gauss–Newton step from there."""

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem, self.fit, seen = problem, fit, problem.seen
        self.lamps: Shifted = shifted(seen, fit.shift, fit.depth)
        gloss = fit.gloss.rows[fit.labels]
        self.shade: Shading = shading(fit.normals, self.lamps.to_lamp, seen.to_eye, gloss)
        self.even = (fit.evenness(problem.place) * np.exp(self.lamps.light))[:, None]  # (K, 1, P)
        self.model = self.even * (fit.body * self.shade.body[:, None] + self.shade.interface[:, None])
        self.deviation = seen.values - self.model
        inverse = precision(seen, fit.model_error)
        squared = self.deviation**2 * inverse / CAUCHY_SCALE**2
        self.weight_of_rows = _rows(problem.share * inverse / (1.0 + squared))  # (P, K·C)
        self.cost = 0.5 * (problem.share * CAUCHY_SCALE**2 * float(np.log1p(squared).sum()) + self._prior_loss())

    @property
    def of_lamps(self) -> Array:
        """(K, OF_LAMP) ln e, a and shift."""
        return np.column_stack([self.fit.strength, self.fit.slope, self.fit.shift])

    def _prior_loss(self) -> float:
        prior = self.problem.prior
        gloss = np.sum(((self.fit.gloss.rows - prior.gloss[:, 0]) / prior.gloss[:, 1]) ** 2)
        return float(gloss) + prior.loss(self.of_lamps) + (self.fit.depth / prior.distance) ** 2

    @property
    def gradient(self) -> float:
        """Norm of the slope of the cost by gloss, lamps and depth, the pixels following."""
        return float(np.linalg.norm(self._undamped[1]))

    def trial(self, damping: float) -> tuple[Step, float]:
        """The point after a damped step, and the size of the step in gloss, lamps and depth."""
        after = self.moved(damping)
        before, there = ((fit.gloss.rows, fit.strength, fit.slope, fit.shift) for fit in (self.fit, after))
        parts = [np.sum((b - a) ** 2) for a, b in zip(before, there, strict=True)]
        size = float(np.sqrt(sum(parts) + (after.depth - self.fit.depth) ** 2))
        return Step(self.problem, after), size

    def moved(self, damping: float) -> Fit:
        """One damped step of everything."""
        fit, split = self.fit, OF_GLOSS * len(self.fit.gloss.rows)
        outer, push, solved = self._reduced(damping)
        change = np.linalg.solve(outer + damping * np.diag(np.diag(outer)), push)
        change = np.clip(change, -LONGEST, LONGEST)
        local_change = solved[..., -1] - solved[..., :-1] @ change
        normals = turned(fit.normals, np.clip(local_change[:, :2], -0.3, 0.3), self.problem.seen.to_eye)
        body = np.maximum(fit.body + local_change[:, 2:].T, 0.1 * fit.body)
        rows = fit.gloss.rows + change[:split].reshape(-1, OF_GLOSS)
        rows[:, 1] = np.clip(rows[:, 1], *WIDTHS)
        rows[:, 2] = np.clip(rows[:, 2], *ROUGHNESSES)
        rows[:, 3] = np.clip(rows[:, 3], *EXPONENTS)
        each = self.of_lamps + change[split:-1].reshape(-1, OF_LAMP)
        return replace(
            fit,
            normals=normals,
            body=body,
            gloss=Gloss(rows),
            strength=each[:, 0],
            slope=each[:, 1:3],
            shift=each[:, 3:],
            depth=fit.depth + float(change[-1]),
        )

    def covariances(self) -> tuple[Array, Array]:
        """(M, OF_GLOSS, OF_GLOSS) of each material's row of gloss, (K, OF_LAMP) variance of lamps; all else free."""
        outer, _ = self._undamped
        count = len(self.fit.gloss.rows)
        inverse = np.linalg.inv(outer)
        split = OF_GLOSS * count
        of_gloss = inverse[:split, :split].reshape(count, OF_GLOSS, count, OF_GLOSS)
        of_lamps = np.diag(inverse)[split:-1].reshape(-1, OF_LAMP).astype(np.float64)
        return np.stack([of_gloss[m, :, m] for m in range(count)]).astype(np.float64), of_lamps

    @cached_property
    def _undamped(self) -> tuple[Array, Array]:
        """Normal equations of gloss, lamps and depth; damped by 1e-6, as some pixels are lit by too few lamps."""
        outer, push, _ = self._reduced(1e-6)
        return outer, push

    def _reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Normal equations of gloss, lamps, depth with the pixels eliminated; the pixels' part (P, 2 + C, · + 1)."""
        channels = self.model.shape[1]
        local, gloss, lamps, depth = self._slopes()
        weighed = np.ascontiguousarray(np.swapaxes(local * self.weight_of_rows[..., None], 1, 2))  # (P, 2 + C, K·C)
        inner = weighed @ local
        inner += damping * inner * np.eye(2 + channels) + 1e-9 * np.eye(2 + channels)
        pull = weighed @ _rows(self.deviation)[..., None]
        border = np.concatenate([self._border(weighed, gloss, lamps), weighed @ depth], axis=2)
        outer, push = self._outer(gloss, lamps, depth)
        solved = np.linalg.solve(inner, np.concatenate([border, pull], axis=2))
        across = border.reshape(-1, len(push)).T @ solved.reshape(-1, len(push) + 1)
        return outer - across[:, :-1], push - across[:, -1], solved.astype(np.float64)

    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """Slopes of the values (P, K·C, ·) by own turns and body colours, own material's gloss, own lamp, and depth."""
        fit, shade, (lamps, channels, pixels) = self.fit, self.shade, self.model.shape
        local = np.zeros((pixels, lamps, channels, 2 + channels))
        for i, (body, interface) in enumerate(zip(shade.body_turned, shade.interface_turned, strict=True)):
            local[..., i] = np.moveaxis(self.even * (fit.body * body[:, None] + interface[:, None]), 2, 0)
        for c in range(channels):
            local[:, :, c, 2 + c] = (self.even[:, 0] * shade.body).T
        by_width = np.broadcast_to(self.even * shade.by_width[:, None], self.model.shape)
        interface = np.broadcast_to(self.even * shade.interface[:, None], self.model.shape)
        by_body = [self.even * fit.body * part[:, None] for part in shade.by_body]
        gloss = np.stack([_rows(part) for part in (interface, by_width, *by_body)], axis=-1)
        return local.reshape(pixels, lamps * channels, 2 + channels), gloss, *self._by_lamp()

    def _by_lamp(self) -> tuple[Array, Array]:
        """Slopes of the values by the own lamp's ln e, a and shift (P, K·C, OF_LAMP), and by depth (P, K·C, 1)."""
        fit, place = self.fit, self.problem.place
        level = (1.0 + fit.slope @ place.T)[:, None]
        parts = [self.model, self.model * place[:, 0] / level, self.model * place[:, 1] / level]
        led = [
            self.even * (fit.body * body[:, None] + interface[:, None])
            for body, interface in zip(self.shade.body_led, self.shade.interface_led, strict=True)
        ]
        for j in range(4):
            turn = self.lamps.turns[..., j][:, None]  # (K, 1, P, 2)
            parts.append(
                self.model * self.lamps.by_light[:, None, :, j] + led[0] * turn[..., 0] + led[1] * turn[..., 1]
            )
        return np.stack([_rows(part) for part in parts[:-1]], axis=-1), _rows(parts[-1])[..., None]

    def _border(self, weighed: Array, gloss: Array, lamps: Array) -> Array:
        """(P, 2 + C, OF_GLOSS M + OF_LAMP K) products of the pixels' own slopes with those of gloss and lamps."""
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
        materials = len(fit.gloss.rows)
        size = OF_GLOSS * materials
        outer = np.zeros((size + OF_LAMP * count + 1,) * 2)
        push = np.zeros(len(outer))
        deviation = _rows(self.deviation)
        weighed = gloss * self.weight_of_rows[..., None]
        each = (pixels, count, channels)
        by_lamp = np.moveaxis(lamps.reshape(*each, OF_LAMP), 1, 0)  # (K, P, C, OF_LAMP)
        of_lamp = np.moveaxis((lamps * self.weight_of_rows[..., None]).reshape(*each, OF_LAMP), 1, 0)
        gloss_of_lamp = np.moveaxis(weighed.reshape(*each, OF_GLOSS), 1, 0)
        for m in range(materials):
            at, own = slice(OF_GLOSS * m, OF_GLOSS * (m + 1)), fit.labels == m
            outer[at, at] = weighed[own].reshape(-1, OF_GLOSS).T @ gloss[own].reshape(-1, OF_GLOSS)
            both = np.swapaxes(gloss_of_lamp[:, own].reshape(count, -1, OF_GLOSS), 1, 2) @ by_lamp[:, own].reshape(
                count, -1, OF_LAMP
            )
            outer[at, size:-1] = np.moveaxis(both, 0, 1).reshape(OF_GLOSS, -1)
            outer[size:-1, at] = outer[at, size:-1].T
            outer[at, -1] = outer[-1, at] = weighed[own].reshape(-1, OF_GLOSS).T @ depth[own].ravel()
            push[at] = weighed[own].reshape(-1, OF_GLOSS).T @ deviation[own].ravel()
        left, by_depth = (np.moveaxis(part.reshape(each), 1, 0).reshape(count, -1) for part in (deviation, depth))
        pulled = depth[..., 0] * self.weight_of_rows
        outer[-1, -1], push[-1] = np.sum(pulled * depth[..., 0]), np.sum(pulled * deviation)
        for k in range(count):
            at, own = slice(size + OF_LAMP * k, size + OF_LAMP * (k + 1)), of_lamp[k].reshape(-1, OF_LAMP).T
            outer[at, at] = own @ by_lamp[k].reshape(-1, OF_LAMP)
            push[at] = own @ left[k]
            outer[at, -1] = outer[-1, at] = own @ by_depth[k]
        held = np.r_[
            np.tile(prior.gloss[:, 1] ** -2.0, materials), prior.precision(self.of_lamps).ravel(), prior.distance**-2.0
        ]
        away = np.r_[(fit.gloss.rows - prior.gloss[:, 0]).ravel(), self.of_lamps.ravel(), fit.depth]
        return outer + np.diag(held), push - held * away


def _rows(values: Array) -> Array:
    """(K, C, P) → (P, K·C)."""
    return np.ascontiguousarray(values.reshape(-1, values.shape[2]).T)
