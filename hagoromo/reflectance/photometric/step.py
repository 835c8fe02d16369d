"""Photometric step: gloss and lamps moved together with all normals and body colours, by robust Gauss–Newton.

The normal and the body colour of a pixel touch nobody else, so they are eliminated (a block arrow); gloss and lamps
touch all. The lamps have the prior of lamps that are alike: without it a departure of the body from Lambert's law
would pass for uneven lamps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hagoromo.reflectance.photometric.model import Fit, precision
from hagoromo.reflectance.photometric.pixel_fit import CAUCHY
from hagoromo.reflectance.photometric.shading import Gloss, Shading, shading, turned
from hagoromo.reflectance.photometric.views import Array, Views

WIDTHS = (np.log(0.02), np.log(1.2))  # range of ln γ
LONGEST = 0.5  # of a step in ln β, ln γ, ln ε, ln e and a


@dataclass(frozen=True)
class Prior:
    """What lamps and bodies are taken for before the photographs speak. The default: lamps of one kind, set up by hand.

    strength: scale of ln e (Cauchy: now and then one lamp is off). slope: standard deviation of a, per radius of the
    object. exponent: standard deviation of ln ε of the bodies.
    """

    strength: float = 0.01
    slope: float = 0.1
    exponent: float = 0.2

    @property
    def gloss(self) -> Array:
        """(3, 2) mean and standard deviation of ln β, ln γ, ln ε: any dielectric, as broad as measured ones are."""
        return np.array([[np.log(1.0), 2.0], [np.log(0.3), 1.0], [0.0, self.exponent]])


class Step:
    """Residuals of some pixels and the Gauss–Newton step from there.

    place: (P, 2) of the pixels on the object. share: independent values that one value stands for.
    """

    def __init__(self, seen: Views, fit: Fit, place: Array, share: float, prior: Prior) -> None:
        self.seen, self.fit, self.place, self.prior = seen, fit, place, prior
        self.shade: Shading = shading(fit.normals, seen.to_lamp, seen.to_eye, fit.gloss.rows[fit.labels])
        self.even = fit.evenness(place)[:, None]  # (K, 1, P)
        self.model = self.even * (fit.body * self.shade.body[:, None] + self.shade.interface[:, None])
        self.deviation = seen.values - self.model
        inverse = precision(seen, fit.model_error)
        squared = self.deviation**2 * inverse / CAUCHY**2
        self.weight_of_rows = _rows(share * inverse / (1.0 + squared))  # (P, K·C)
        self.cost = 0.5 * (share * CAUCHY**2 * float(np.log1p(squared).sum()) + self._prior_loss())

    def _prior_loss(self) -> float:
        fit = self.fit
        gloss = np.sum(((fit.gloss.rows - self.prior.gloss[:, 0]) / self.prior.gloss[:, 1]) ** 2)
        strength = CAUCHY**2 * np.log1p((fit.strength / self.prior.strength / CAUCHY) ** 2)
        return float(gloss + np.sum(strength) + np.sum((fit.slope / self.prior.slope) ** 2))

    def moved(self, damping: float) -> Fit:
        """One damped step of everything."""
        fit, lamps = self.fit, len(self.fit.strength)
        outer, push, solved = self._reduced(damping)
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

    def gloss_covariance(self) -> Array:
        """(M, 3, 3) covariance of each material's row of gloss, everything else free."""
        outer, _, _ = self._reduced(1e-6)  # not 0: some pixels are lit by too few lamps to be eliminated
        count = len(self.fit.gloss.rows)
        inverse = np.linalg.inv(outer)[: 3 * count, : 3 * count].reshape(count, 3, count, 3)
        return np.stack([inverse[m, :, m] for m in range(count)]).astype(np.float64)

    def _reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Normal equations of gloss and lamps with the pixels eliminated, and the pixels' part (P, 2 + C, · + 1)."""
        channels = self.model.shape[1]
        local, gloss = self._slopes()
        weighed = np.ascontiguousarray(np.swapaxes(local * self.weight_of_rows[..., None], 1, 2))  # (P, 2 + C, K·C)
        inner = weighed @ local
        inner += damping * inner * np.eye(2 + channels) + 1e-9 * np.eye(2 + channels)
        pull = weighed @ _rows(self.deviation)[..., None]
        border = self._border(weighed, gloss)
        outer, push = self._outer(gloss)
        solved = np.linalg.solve(inner, np.concatenate([border, pull], axis=2))
        across = border.reshape(-1, len(push)).T @ solved.reshape(-1, len(push) + 1)
        return outer - across[:, :-1], push - across[:, -1], solved.astype(np.float64)

    def _slopes(self) -> tuple[Array, Array]:
        """Slopes of the values (P, K·C, ·) by the own turns and body colours, and by the own material's gloss."""
        fit, shade, (lamps, channels, pixels) = self.fit, self.shade, self.model.shape
        local = np.zeros((pixels, lamps, channels, 2 + channels))
        for i, (body, interface) in enumerate(zip(shade.body_turned, shade.interface_turned, strict=True)):
            turned = self.even * (fit.body * body[:, None] + interface[:, None])
            local[..., i] = np.moveaxis(turned, 2, 0)
        for c in range(channels):
            local[:, :, c, 2 + c] = (self.even[:, 0] * shade.body).T
        by_width = np.broadcast_to(self.even * shade.by_width[:, None], self.model.shape)
        interface = np.broadcast_to(self.even * shade.interface[:, None], self.model.shape)
        by_exponent = self.even * fit.body * shade.by_exponent[:, None]
        gloss = np.stack([_rows(part) for part in (interface, by_width, by_exponent)], axis=-1)
        return local.reshape(pixels, lamps * channels, 2 + channels), gloss

    def _by_lamp(self) -> Array:
        """(P, K, 3) slopes of ln s by the own lamp's ln e and a."""
        level = (1.0 + self.fit.slope @ self.place.T).T
        x, y = self.place[:, :1], self.place[:, 1:]
        return np.stack([np.ones_like(level), x / level, y / level], axis=-1)

    def _border(self, weighed: Array, gloss: Array) -> Array:
        """(P, 2 + C, 3 M + 3 K) products of the pixels' own slopes with those of gloss and lamps."""
        lamps, channels, pixels = self.model.shape
        own = weighed @ gloss
        member = (self.fit.labels[:, None] == np.arange(len(self.fit.gloss.rows))).astype(np.float64)
        of_gloss = (own[:, :, None, :] * member[:, None, :, None]).reshape(pixels, 2 + channels, -1)
        of_lamp = (weighed * _rows(self.model)[:, None]).reshape(pixels, 2 + channels, lamps, channels).sum(axis=3)
        of_lamps = (of_lamp[..., None] * self._by_lamp()[:, None]).reshape(pixels, 2 + channels, -1)
        return np.concatenate([of_gloss, of_lamps], axis=2)

    def _outer(self, gloss: Array) -> tuple[Array, Array]:
        """Normal equations of gloss and lamps, with their priors."""
        fit, (lamps, channels, pixels) = self.fit, self.model.shape
        materials, by_lamp = len(fit.gloss.rows), self._by_lamp()
        size = 3 * materials
        outer, push = np.zeros((size + 3 * lamps,) * 2), np.zeros(size + 3 * lamps)
        weighed, deviation, model = gloss * self.weight_of_rows[..., None], _rows(self.deviation), _rows(self.model)
        per_lamp = (weighed * model[..., None]).reshape(pixels, lamps, channels, 3).sum(axis=2)
        for m in range(materials):
            at, own = slice(3 * m, 3 * m + 3), fit.labels == m
            outer[at, at] = weighed[own].reshape(-1, 3).T @ gloss[own].reshape(-1, 3)
            outer[at, size:] = np.einsum("pki,pkj->ikj", per_lamp[own], by_lamp[own]).reshape(3, -1)
            outer[size:, at] = outer[at, size:].T
            push[at] = weighed[own].reshape(-1, 3).T @ deviation[own].ravel()
        light, pull = (
            (self.weight_of_rows * model * part).reshape(pixels, lamps, channels).sum(axis=2)
            for part in (model, deviation)
        )
        for k in range(lamps):
            at = slice(size + 3 * k, size + 3 * k + 3)
            outer[at, at] = (by_lamp[:, k] * light[:, k, None]).T @ by_lamp[:, k]
        push[size:] = np.einsum("pk,pki->ki", pull, by_lamp).ravel()
        loose = self.prior.strength**2 + (fit.strength / CAUCHY) ** 2  # Cauchy's loss as a variance
        of_lamps = np.stack([1.0 / loose, *(2 * [np.full(lamps, self.prior.slope**-2.0)])], axis=1)
        held = np.r_[np.tile(self.prior.gloss[:, 1] ** -2.0, materials), of_lamps.ravel()]
        away = np.r_[(fit.gloss.rows - self.prior.gloss[:, 0]).ravel(), np.c_[fit.strength, fit.slope].ravel()]
        return outer + np.diag(held), push - held * away


def _rows(values: Array) -> Array:
    """(K, C, P) → (P, K·C)."""
    return np.ascontiguousarray(values.reshape(-1, values.shape[2]).T)
