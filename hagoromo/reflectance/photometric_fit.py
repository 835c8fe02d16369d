"""Photometric fit: gloss of the materials and unevenness of the lamps, together with normals and body colours.

    value_kc(p) = s_k(p) [ body_c(p) B_k(p) + I_k(p) ],   s_k(p) = e_k (1 + a_k · place(p)),   B, I as in `shading`

Robust Gauss–Newton with the pixels eliminated (a block arrow): the normal and the body colour of a pixel touch nobody
else, gloss and lamps touch all. e and a have priors of lamps that are alike; without them a departure of the body from
Lambert's law would pass for uneven lamps. Errors of the model are alike over large parts of an object, so a photograph
counts as so many independent values as its residuals show (`independent_share`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.reflectance.pixel_fit import CAUCHY, Light, fit_pixels
from hagoromo.reflectance.shading import Gloss, Shading, shading, turned
from hagoromo.reflectance.views import Array, Views

PRIOR_STRENGTH = 0.01  # scale of ln e, Cauchy: lamps are of one kind and set alike, now and then one is not
PRIOR_SLOPE = 0.1  # standard deviation of a, per radius of the object
PRIOR_GLOSS = np.array([[np.log(1.0), 2.0], [np.log(0.3), 1.0], [0.0, 0.2]])  # mean, standard deviation of each column
WIDTHS = (np.log(0.02), np.log(1.2))  # range of ln γ
SUBSET = 2000  # pixels that gloss and lamps are estimated from
STEPS, ROUNDS = 12, 3
FLOOR = 0.003  # least relative error of the model
NORMAL_MEDIAN = 0.4549364  # median of r² for a normal r
LONGEST = 0.5  # of a step in ln β, ln γ, ln ε, ln e and a


@dataclass(frozen=True, eq=False)
class Fit:
    """normals (P, 3), body (C, P), labels (P,) of the materials, gloss, lamps: strength ln e (K,) and slope a (K, 2).

    model_error: relative error of the model beside the noise. variance: (P,) of the normal's direction [rad²], the sum
    over its two turns; inf where not estimated.
    """

    normals: Array
    body: Array
    labels: NDArray[np.intp]
    gloss: Gloss
    strength: Array
    slope: Array
    model_error: float
    variance: Array

    def evenness(self, place: Array) -> Array:
        """s_k (K, P) at `place` (P, 2)."""
        return evenness(self.strength, self.slope, place)

    def pixels(self, chosen: NDArray) -> Fit:
        """The fit of some pixels."""
        parts = {name: getattr(self, name)[chosen] for name in ("normals", "labels", "variance")}
        return replace(self, body=self.body[:, chosen], **parts)


def evenness(strength: Array, slope: Array, place: Array) -> Array:
    """s = e (1 + a·place) of lamps with ln e `strength` (K,) and a `slope` (K, 2), at `place` (P, 2): (K, P)."""
    return np.exp(strength)[:, None] * np.maximum(1.0 + slope @ place.T, 0.1)


def photometric_fit(seen: Views, start: Fit, seed: int = 0) -> Fit:
    """Everything: gloss, lamps and model error from a subset of the pixels, then normals and body of all."""
    fit = fit_together(seen, start, seed)
    light = Light(fit.gloss.rows[fit.labels], fit.evenness(seen.place), precision(seen, fit.model_error))
    normals, body, variance = fit_pixels(seen, light, start.normals, start.body)
    return replace(fit, normals=normals, body=body, variance=variance)


def fit_together(seen: Views, start: Fit, seed: int = 0) -> Fit:
    """Gloss, lamps and model error from SUBSET pixels of `seen`; normals and body of all pixels stay as they are."""
    count = len(seen.rows)
    chosen = np.sort(np.random.default_rng(seed).choice(count, min(SUBSET, count), replace=False))
    some, fit, place = seen.pixels(chosen), start.pixels(chosen), seen.place[chosen]
    share = independent_share(seen, start) * count / len(chosen)
    for _ in range(ROUNDS):
        step, damping = _Step(some, fit, place, share), 1e-2
        first = step.cost
        for _ in range(STEPS):
            trial = _Step(some, step.moved(damping), place, share)
            if trial.cost < step.cost:
                settled = step.cost - trial.cost < 1e-4 * step.cost
                step, damping = trial, max(damping / 5, 1e-5)
                if settled:
                    break
            else:
                damping *= 5
        fit = replace(step.fit, model_error=_model_error(step))
        if first - step.cost < 1e-3 * first:
            break
    return replace(start, gloss=fit.gloss, strength=fit.strength, slope=fit.slope, model_error=fit.model_error)


def independent_share(seen: Views, fit: Fit) -> float:
    """Independent values per pixel of a photograph: Σ r² over Σ (Σ r)² of tiles half the object's radius wide.

    1/C for residuals that are noise, one per tile for those of a model that is wrong all over: its errors are alike in
    all C channels.
    """
    grey = seen.values.mean(axis=1)
    model = predicted(fit, seen.to_lamp, seen.to_eye).mean(axis=1)
    size = np.maximum(_size(seen)[:, 0], 1e-30)  # a pixel that no photograph sees anything of has 0
    relative = np.where(seen.used, (grey - model) / size, 0.0)
    limit = 3.0 * np.sqrt(np.median(relative[seen.used] ** 2) / NORMAL_MEDIAN)
    relative = np.clip(relative, -limit, limit)
    side = max(int(0.5 * np.sqrt(len(seen.rows) / np.pi)), 1)
    tile = (seen.rows // side) * (seen.shape[1] // side + 1) + seen.columns // side
    sums = sum(float(np.sum(np.bincount(tile, row) ** 2)) for row in relative)
    return float(min(np.sum(relative**2) / max(sums, 1e-30), 1.0)) / seen.values.shape[1]


def predicted(fit: Fit, to_lamp: Array, to_eye: Array) -> Array:
    """(K, C, P) values that the fit gives under even lamps of strength 1 in directions `to_lamp` (K, P, 3)."""
    shade = shading(fit.normals, to_lamp, to_eye, fit.gloss.rows[fit.labels])
    return fit.body[None] * shade.body[:, None] + shade.interface[:, None]


def precision(seen: Views, model_error: float) -> Array:
    """(K, C, P) inverse variance of noise and model error, 0 where a value is not used."""
    return seen.used[:, None] / (seen.variance + (model_error * _size(seen)) ** 2)


class _Step:
    """Residuals of some pixels and the Gauss–Newton step from there."""

    def __init__(self, seen: Views, fit: Fit, place: Array, share: float) -> None:
        self.seen, self.fit, self.place, self.share = seen, fit, place, share
        self.shade: Shading = shading(fit.normals, seen.to_lamp, seen.to_eye, fit.gloss.rows[fit.labels])
        self.even = fit.evenness(place)[:, None]  # (K, 1, P)
        self.model = self.even * (fit.body * self.shade.body[:, None] + self.shade.interface[:, None])
        self.deviation = seen.values - self.model
        inverse = precision(seen, fit.model_error)
        squared = self.deviation**2 * inverse / CAUCHY**2
        self.weight = share * inverse / (1.0 + squared)
        self.cost = 0.5 * (share * CAUCHY**2 * float(np.log1p(squared).sum()) + self._prior())

    def _prior(self) -> float:
        fit = self.fit
        gloss = np.sum(((fit.gloss.rows - PRIOR_GLOSS[:, 0]) / PRIOR_GLOSS[:, 1]) ** 2)
        strength = CAUCHY**2 * np.log1p((fit.strength / PRIOR_STRENGTH / CAUCHY) ** 2)
        return float(gloss + np.sum(strength) + np.sum((fit.slope / PRIOR_SLOPE) ** 2))

    def moved(self, damping: float) -> Fit:
        """One damped step of everything."""
        fit, (lamps, channels, _) = self.fit, self.model.shape
        local, gloss, lamp = self._slopes()
        weighed = local * self.weight[..., None]
        inner = np.einsum("kcpi,kcpj->pij", weighed, local)
        inner += damping * inner * np.eye(2 + channels) + 1e-9 * np.eye(2 + channels)
        pull = np.einsum("kcpi,kcp->pi", weighed, self.deviation)
        border = self._border(weighed, gloss, lamp)
        outer, push = self._outer(gloss, lamp)
        solved = np.linalg.solve(inner, np.concatenate([border, pull[..., None]], axis=2))
        flat, size = border.reshape(-1, border.shape[2]), len(push)
        across = flat.T @ solved.reshape(-1, size + 1)
        outer, push = outer - across[:, :-1], push - across[:, -1]
        change = np.linalg.solve(outer + damping * np.diag(np.diag(outer)), push)
        change = np.clip(change, -LONGEST, LONGEST)
        local_change = solved[..., -1] - solved[..., :-1] @ change
        normals = turned(fit.normals, np.clip(local_change[:, :2], -0.3, 0.3), self.seen.to_eye)
        body = np.maximum(fit.body + local_change[:, 2:].T, 0.1 * fit.body)
        rows = fit.gloss.rows + change[: -3 * lamps].reshape(-1, 3)
        rows[:, 1] = np.clip(rows[:, 1], *WIDTHS)
        each = change[-3 * lamps :].reshape(lamps, 3)
        return replace(
            fit,
            normals=normals,
            body=body,
            gloss=Gloss(rows),
            strength=fit.strength + each[:, 0],
            slope=fit.slope + each[:, 1:],
        )

    def _slopes(self) -> tuple[Array, Array, Array]:
        """Slopes of the values (K, C, P, ·) by turns and body colours, by the own material's gloss, by the own lamp."""
        fit, shade, shape = self.fit, self.shade, self.model.shape
        local = np.zeros((*shape, 2 + shape[1]))
        for i, (body, interface) in enumerate(zip(shade.body_turned, shade.interface_turned, strict=True)):
            local[..., i] = self.even * (fit.body * body[:, None] + interface[:, None])
        for c in range(shape[1]):
            local[:, c, :, 2 + c] = self.even[:, 0] * shade.body
        gloss = np.empty((*shape, 3))
        gloss[..., 0], gloss[..., 1] = self.even * shade.interface[:, None], self.even * shade.by_width[:, None]
        gloss[..., 2] = self.even * fit.body * shade.by_exponent[:, None]
        level = 1.0 + fit.slope @ self.place.T
        by_lamp = np.stack([np.ones_like(level), self.place[:, 0] / level, self.place[:, 1] / level], axis=-1)
        return local, gloss, self.model[..., None] * by_lamp[:, None]

    def _border(self, weighed: Array, gloss: Array, lamp: Array) -> Array:
        """(P, 2 + C, 3 M + 3 K) products of the pixels' own slopes with those of gloss and lamps."""
        pixels, materials = len(self.fit.labels), len(self.fit.gloss.rows)
        own = np.einsum("kcpi,kcpj->pij", weighed, gloss)
        member = (self.fit.labels[:, None] == np.arange(materials)).astype(np.float64)
        of_gloss = np.einsum("pij,pm->pimj", own, member).reshape(pixels, weighed.shape[3], -1)
        of_lamps = np.einsum("kcpi,kcpj->pikj", weighed, lamp).reshape(pixels, weighed.shape[3], -1)
        return np.concatenate([of_gloss, of_lamps], axis=2)

    def _outer(self, gloss: Array, lamp: Array) -> tuple[Array, Array]:
        """Normal equations of gloss and lamps, with their priors."""
        fit, lamps, materials = self.fit, len(self.fit.strength), len(self.fit.gloss.rows)
        size = 3 * materials
        outer, push = np.zeros((size + 3 * lamps,) * 2), np.zeros(size + 3 * lamps)
        weighed = gloss * self.weight[..., None]
        for m in range(materials):
            at, own = slice(3 * m, 3 * m + 3), fit.labels == m
            outer[at, at] = np.einsum("kcpi,kcpj->ij", weighed[:, :, own], gloss[:, :, own])
            outer[at, size:] = np.einsum("kcpi,kcpj->ikj", weighed[:, :, own], lamp[:, :, own]).reshape(3, -1)
            outer[size:, at] = outer[at, size:].T
            push[at] = np.einsum("kcpi,kcp->i", weighed[:, :, own], self.deviation[:, :, own])
        pressed = lamp * self.weight[..., None]
        for k, block in enumerate(np.einsum("kcpi,kcpj->kij", pressed, lamp)):
            at = slice(size + 3 * k, size + 3 * k + 3)
            outer[at, at] = block
        push[size:] = np.einsum("kcpi,kcp->ki", pressed, self.deviation).ravel()
        loose = PRIOR_STRENGTH**2 + (fit.strength / CAUCHY) ** 2  # Cauchy's loss as a variance
        of_lamps = np.stack([1.0 / loose, *(2 * [np.full(lamps, PRIOR_SLOPE**-2.0)])], axis=1)
        held = np.r_[np.tile(PRIOR_GLOSS[:, 1] ** -2.0, materials), of_lamps.ravel()]
        away = np.r_[(fit.gloss.rows - PRIOR_GLOSS[:, 0]).ravel(), np.c_[fit.strength, fit.slope].ravel()]
        return outer + np.diag(held), push - held * away


def _model_error(step: _Step) -> float:
    """Relative error of the model that makes the median of the squared residuals that of a normal error."""
    used = np.broadcast_to(step.seen.used[:, None], step.model.shape)
    channels, pixels = step.model.shape[1:]
    freedom = 1.0 - (2.0 + channels) * pixels / max(float(used.sum()), 1.0)
    squared = (step.deviation**2)[used] / max(freedom, 0.1)
    noise, signal = step.seen.variance[used], _size(step.seen)[used] ** 2
    low, high = np.log(FLOOR), 0.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        excess = np.median(squared / (noise + np.exp(2 * middle) * signal)) > NORMAL_MEDIAN
        low, high = (middle, high) if excess else (low, middle)
    return float(np.exp(0.5 * (low + high)))


def _size(seen: Views) -> Array:
    """What errors of the model are relative to: the value, or the pixel's mean where a shadow makes that small."""
    return np.maximum(seen.values, seen.values.mean(axis=0))
