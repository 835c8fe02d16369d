"""Joint surface: lamps, one height field, its albedos and its gloss, moved together by robust Gauss–Newton.

The model is that of `model.py`; albedos are eliminated, the surface is solved sparsely, and lamps and gloss are what is
left (Schur). What the bas-relief ambiguity leaves open of a matte body (Belhumeur, Kriegman and Yuille 1999), gloss and
roughness tell (Georghiades 2003, "Incorporating the Torrance and Sparrow model of reflectance in uncalibrated
photometric stereo"), and each by its evidence: lamps alike, albedos few, a surface that is level in the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.entropy import WIDTH, entropy
from hagoromo.least_squares import CAUCHY_SCALE
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.normals.photometric_step import EXPONENTS, ROUGHNESSES, WIDTHS
from hagoromo.measurement.normals.shading import Shading, shading, tangents
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.height_field import HeightField

ALONE = 30.0  # pixels' worth of independent values: errors of the model, and albedos, are alike over parts of an object
ALIKE = 0.1  # scale of ln strength between lamps, worth one lamp: theirs is learnt
LEVEL = 0.25  # standard deviation of the mean slope of an object
SADDLE = 0.1  # weight of the chessboard that no slope sees
UNIT = 1e4  # precision of what is a choice of unit: ln of the mean strength is 0
LONGEST = (0.3, 0.3, 0.5, 0.1, 0.1)  # of a step in a lamp's two turns, ln strength and slope over the object
OF_LAMP, OF_GLOSS = len(LONGEST), 4


@dataclass(frozen=True, eq=False)
class Seen:
    """values and used (K, P) of the pixels of a height field; place (P, 2), x right, y up, radius 1.

    model_error: (K,) relative, of each photograph. few: pixels' worth of albedos that are taken to be few.
    """

    values: Array
    used: NDArray[np.bool_]
    place: Array
    field: HeightField
    model_error: Array
    few: float = ALONE

    @property
    def precision(self) -> Array:
        """(K, P) inverse variance, as far as pixels are independent; 0 where not used."""
        size = np.maximum(self.values, self.values.mean(axis=0))
        return self.used * ALONE / len(self.place) / (self.model_error[:, None] * size) ** 2


@dataclass(frozen=True, eq=False)
class Guess:
    """depth (V,) of the field, albedo (P,) ln, to_lamp (K, 3) unit, lamps (K, 3): ln e and slope a; gloss (4,) row."""

    depth: Array
    albedo: Array
    to_lamp: Array
    lamps: Array
    gloss: Array


class JointSurface:
    """Residuals at a guess, how unlikely it is, and the Gauss–Newton step from there."""

    def __init__(self, seen: Seen, guess: Guess, prior: Prior) -> None:
        self.seen, self.guess, self.prior = seen, guess, prior
        count, pixels = seen.values.shape
        self.normals, self.tilts = seen.field.normals(guess.depth)
        towards = np.repeat(guess.to_lamp[:, None], pixels, axis=1)
        self.shade: Shading = shading(self.normals, towards, seen.field.to_eye, np.tile(guess.gloss, (pixels, 1)))
        self.level = np.maximum(1.0 + guess.lamps[:, 1:] @ seen.place.T, 0.1)
        self.even = np.exp(guess.lamps[:, :1]) * self.level
        self.body = self.even * np.exp(guess.albedo)
        self.model = self.body * self.shade.body + self.even * self.shade.interface
        self.deviation = seen.values - self.model
        inverse = seen.precision
        unit = len(seen.place) / ALONE
        squared = unit * self.deviation**2 * inverse / CAUCHY_SCALE**2
        self.weight = inverse / (1.0 + squared)
        self.disorder, self.by_albedo = entropy(guess.albedo)
        around = guess.lamps[:, 0] - guess.lamps[:, 0].mean()
        self.spread = float(np.sum(around**2)) + ALIKE**2
        self.tilt = np.array([float(np.mean(slope @ guess.depth)) for slope in seen.field.slopes])
        mean, scale = prior.gloss.T
        losses = (
            CAUCHY_SCALE**2 / unit * float(np.sum(np.log1p(squared[seen.used]))),
            2.0 * seen.few * self.disorder,
            count * float(np.log(self.spread)) + UNIT * float(guess.lamps[:, 0].mean()) ** 2,
            CAUCHY_SCALE**2 * float(np.sum(np.log1p((guess.lamps[:, 1:] / prior.slope / CAUCHY_SCALE) ** 2))),
            float(np.sum((self.tilt / LEVEL) ** 2)),
            float(np.sum(((guess.gloss - mean) / scale) ** 2)),
            self._held * float(np.sum((seen.field.saddle @ guess.depth) ** 2)),
        )
        self.cost = 0.5 * sum(losses)

    @property
    def gradient(self) -> float:
        """Norm of the slope of the cost by lamps and gloss, surface and albedos following."""
        return float(np.linalg.norm(self._undamped[1]))

    def trial(self, damping: float) -> tuple[JointSurface, float]:
        """The point after a damped step, and the size of the step in lamps and gloss."""
        there, here = self.moved(damping), self.guess
        pairs = ((there.to_lamp, here.to_lamp), (there.lamps, here.lamps), (there.gloss, here.gloss))
        size = float(np.sqrt(sum(np.sum((after - before) ** 2) for after, before in pairs)))
        return JointSurface(self.seen, there, self.prior), size

    def moved(self, damping: float) -> Guess:
        """One damped step of everything."""
        guess, count = self.guess, len(self.guess.to_lamp)
        schur, push, solved, pixels = self._reduced(damping)
        change = np.linalg.solve(schur, push)
        depth = solved[:, -1] - solved[:, :-1] @ change
        across = np.stack([slope @ depth for slope in self.seen.field.slopes])
        outer = change[:-2]  # the last two hold the mean slope
        albedo = (pixels.pull - np.sum(pixels.tilts * across, axis=0) - pixels.outer @ outer) / pixels.own
        limit = np.array(LONGEST)[:, None]
        turn_1, turn_2, *lamps = np.clip(outer[: OF_LAMP * count].reshape(OF_LAMP, count), -limit, limit)
        first, second = tangents(guess.to_lamp)
        to_lamp = guess.to_lamp + turn_1[:, None] * first + turn_2[:, None] * second
        gloss = guess.gloss + np.clip(outer[OF_LAMP * count :], -0.7, 0.7)
        lowest, highest = np.transpose([WIDTHS, ROUGHNESSES, EXPONENTS])
        gloss[1:] = np.clip(gloss[1:], lowest, highest)
        return Guess(
            guess.depth + depth,
            guess.albedo + np.clip(albedo, -1.0, 1.0),
            to_lamp / np.linalg.norm(to_lamp, axis=1, keepdims=True),
            guess.lamps + np.stack(lamps, axis=1),
            gloss,
        )

    def variance(self) -> tuple[Array, Array]:
        """(K,) of a direction [rad²], the sum over its two turns, and of ln strength; all else free."""
        schur, _ = self._undamped
        diagonal = np.maximum(np.diag(np.linalg.inv(schur)), 0.0)
        lamps = diagonal[: OF_LAMP * len(self.guess.to_lamp)].reshape(OF_LAMP, -1)
        return lamps[0] + lamps[1], lamps[2]

    @cached_property
    def _undamped(self) -> tuple[Array, Array]:
        """Normal equations of lamps, gloss and mean slope, damped by 1e-6."""
        schur, push, _, _ = self._reduced(1e-6)
        return schur, push

    @property
    def _held(self) -> float:
        """Precision of the chessboard, beside that of a value of size 1."""
        return SADDLE * ALONE / len(self.seen.place)

    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """Of the model by u_x and u_y (2, K, P), ln albedo (K, P), its lamp (OF_LAMP, K, P), gloss (OF_GLOSS, K, P)."""
        shade = self.shade
        turned, led = (
            self.body * np.stack(body) + self.even * np.stack(interface)
            for body, interface in (
                (shade.body_turned, shade.interface_turned),
                (shade.body_led, shade.interface_led),
            )
        )
        frame = np.stack(tangents(self.normals))
        tilts = np.einsum("tkp,qtp->qkp", turned, np.einsum("tpi,qpi->qtp", frame, self.tilts))
        over = self.model / self.level
        lamps = np.stack([*led, self.model, *(over * self.seen.place[:, i] for i in (0, 1))])
        rough = [self.body * part for part in shade.by_body]
        gloss = np.stack([self.even * shade.interface, self.even * shade.by_width, *rough])
        return tilts, self.body * shade.body, lamps, gloss

    def _reduced(self, damping: float) -> tuple[Array, Array, Array, _Pixels]:
        """Normal equations of lamps, gloss and mean slope without the surface (V, · + 1) and the albedos."""
        from scipy.sparse import diags
        from scipy.sparse.linalg import splu

        weight, field = self.weight, self.seen.field
        tilts, albedo, lamps, gloss = self._slopes()
        few = self.seen.few / len(self.seen.place) / WIDTH**2  # least curvature of the histogram's bell
        weighed = weight * albedo
        own = (np.sum(weighed * albedo, axis=0) + few + 1e-9) * (1.0 + damping)
        pull = np.sum(weighed * self.deviation, axis=0) - self.seen.few * self.by_albedo
        pixels = _Pixels(own, pull, np.sum(weighed * tilts, axis=1), _each(weighed, lamps, gloss))
        outer, push = self._outer(lamps, gloss)
        outer -= pixels.outer.T @ (pixels.outer / own[:, None])
        push -= pixels.outer.T @ (pull / own)
        border, square, towards = [], self._held * field.saddle.T @ field.saddle, 0.0
        for q, slope in enumerate(field.slopes):
            share = pixels.tilts[q] / own
            border.append(slope.T @ (_each(weight * tilts[q], lamps, gloss) - share[:, None] * pixels.outer))
            towards = towards + slope.T @ (np.sum(weight * tilts[q] * self.deviation, axis=0) - share * pull)
            for r, other in enumerate(field.slopes):
                both = np.sum(weight * tilts[q] * tilts[r], axis=0) - share * pixels.tilts[r]
                square = square + slope.T @ diags(both) @ other
        towards = towards - self._held * (field.saddle.T @ (field.saddle @ self.guess.depth))
        mean = np.column_stack([np.asarray(slope.mean(axis=0)).ravel() for slope in field.slopes])
        towards = towards - mean @ self.tilt / LEVEL**2
        edge = np.column_stack([sum(border), mean])
        level = square.diagonal()
        factor = splu((square + diags(damping * level + 1e-8 * level.mean())).tocsc(), "MMD_AT_PLUS_A", 0.0)
        solved = np.asarray(factor.solve(np.column_stack([edge, towards])))
        whole = np.zeros((len(push) + 2,) * 2)
        whole[:-2, :-2] = outer + damping * np.diag(np.diag(outer))
        whole[-2:, -2:] = -(LEVEL**2) * np.eye(2)  # its own unknown: as a product it would fill the sparse square
        return whole - edge.T @ solved[:, :-1], np.r_[push, 0.0, 0.0] - edge.T @ solved[:, -1], solved, pixels

    def _outer(self, lamps: Array, gloss: Array) -> tuple[Array, Array]:
        """Normal equations of lamps and gloss with their priors, the pixels known."""
        count = len(self.guess.to_lamp)
        split, weighed = OF_LAMP * count, self.weight * lamps
        outer = np.zeros((split + OF_GLOSS,) * 2)
        of_lamps = outer[:split, :split].reshape(OF_LAMP, count, OF_LAMP, count)
        each = np.arange(count)
        of_lamps[:, each, :, each] = np.einsum("akp,bkp->kab", weighed, lamps, optimize=True)
        outer[:split, split:] = np.einsum("akp,bkp->akb", weighed, gloss, optimize=True).reshape(split, OF_GLOSS)
        outer[split:, :split] = outer[:split, split:].T
        outer[split:, split:] = np.einsum("akp,bkp->ab", self.weight * gloss, gloss, optimize=True)
        push = np.r_[
            np.sum(weighed * self.deviation, axis=2).ravel(), np.sum(self.weight * gloss * self.deviation, axis=(1, 2))
        ]
        strength = self.guess.lamps[:, 0]
        at, alike = 2 * count + each, count / self.spread
        outer[np.ix_(at, at)] += alike * np.eye(count) + (UNIT / count - alike) / count
        push[at] -= alike * (strength - strength.mean()) + UNIT / count * strength.mean()
        mean, scale = self.prior.gloss.T
        slope = self.guess.lamps[:, 1:].T.ravel()
        # Cauchy's: now and then a lamp is near, or shaded by its stand
        held = np.r_[1.0 / (self.prior.slope**2 + (slope / CAUCHY_SCALE) ** 2), scale**-2.0]
        away = np.r_[slope, self.guess.gloss - mean]
        last = np.arange(3 * count, len(push))
        outer[last, last] += held
        push[last] -= held * away
        return outer, push


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Of ln albedo: own curvature (P,), pull (P,), and products with u_x and u_y (2, P), lamps and gloss (P, ·)."""

    own: Array
    pull: Array
    tilts: Array
    outer: Array


def _each(weighed: Array, lamps: Array, gloss: Array) -> Array:
    """(P, OF_LAMP K + OF_GLOSS) products of a pixel's `weighed` (K, P) with the slopes by lamps and gloss."""
    by_lamp = (weighed * lamps).reshape(-1, weighed.shape[1])
    return np.concatenate([by_lamp, np.sum(weighed * gloss, axis=1)]).T
