"""Joint surface: lamps, one height field, its albedos and its gloss, fitted together by robust Gauss–Newton.

The model is that of `photometric_model`; albedos are eliminated, the surface is solved sparsely, and lamps and gloss
remain (Schur complement). The bas-relief ambiguity of a matte body (Belhumeur, Kriegman and Yuille 1999) is resolved by
gloss and roughness (Georghiades 2003, "Incorporating the Torrance and Sparrow model of reflectance in uncalibrated
photometric stereo") and by priors: lamps of similar strength, few albedos, a mean slope of 0.

Height field: one surface over the pixels of an object, so that its normals are integrable.

Unknown at the corners of the pixels: u, ln of the distance along the ray; in an orthographic view, the distance in
pixels. With the rays (x', y', −1), x right, y up, the normal is along (u_x, u_y, 1 + x' u_x + y' u_y).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.bas_relief import WIDTH, entropy
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.normals.photometric_step import LOG_EXPONENT_RANGE, LOG_GAMMA_RANGE, ROUGHNESS_RANGE
from hagoromo.measurement.normals.shading import Shading, shading, tangents
from hagoromo.measurement.normals.views import Array

INDEPENDENT_PIXELS = 30.0  # effective number of pixels: model errors and albedos are correlated over an object
ALIKE = 0.1  # prior scale of ln strength between lamps, with the weight of one lamp; the scale is learnt
LEVEL = 0.25  # standard deviation of the mean slope of an object
SADDLE = 0.1  # weight of the chessboard, whose slopes are 0
UNIT_PRECISION = 1e4  # of the constraint that fixes the unit: ln of the mean strength is 0
LONGEST_STEP = (0.3, 0.3, 0.5, 0.1, 0.1)  # in a lamp's two turns [rad], ln strength and slope over the object
OF_LAMP, OF_GLOSS = len(LONGEST_STEP), 4  # parameters of a lamp, and of the gloss
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
STEEPEST = 5.0  # largest slope of a normal at the start of a height field
REWEIGHTINGS = 6  # of the start; it is not tested for convergence, since a fit of the surface follows


@dataclass(frozen=True, eq=False)
class SurfaceData:
    """values and used (K, P) of the pixels of a height field; place (P, 2), x right, y up, radius 1.

    model_error: (K,) relative, of each photograph. few: effective number of pixels in the prior of few albedos.
    """

    values: Array
    used: NDArray[np.bool_]
    place: Array
    field: HeightField
    model_error: Array
    few: float = INDEPENDENT_PIXELS

    @property
    def precision(self) -> Array:
        """(K, P) inverse variance, scaled to the effective number of pixels; 0 where not used."""
        size = np.maximum(self.values, self.values.mean(axis=0))
        return self.used * INDEPENDENT_PIXELS / len(self.place) / (self.model_error[:, None] * size) ** 2


@dataclass(frozen=True, eq=False)
class Guess:
    """depth (V,) of the field, albedo (P,) ln, to_lamp (K, 3) unit, lamps (K, 3): ln e and slope a; gloss (4,) row."""

    depth: Array
    albedo: Array
    to_lamp: Array
    lamps: Array
    gloss: Array


class JointSurface:
    """Residuals and cost at a guess, and the Gauss–Newton step from there."""

    def __init__(self, data: SurfaceData, guess: Guess, prior: Prior) -> None:
        self.data, self.guess, self.prior = data, guess, prior
        count, pixels = data.values.shape
        self.normals, self.tilts = data.field.normals(guess.depth)
        towards = np.repeat(guess.to_lamp[:, None], pixels, axis=1)
        self.shade: Shading = shading(self.normals, towards, data.field.to_eye, np.tile(guess.gloss, (pixels, 1)))
        self.level = np.maximum(1.0 + guess.lamps[:, 1:] @ data.place.T, 0.1)
        self.even = np.exp(guess.lamps[:, :1]) * self.level
        self.body = self.even * np.exp(guess.albedo)
        self.model = self.body * self.shade.body + self.even * self.shade.interface
        self.deviation = data.values - self.model
        inverse = data.precision
        unit = len(data.place) / INDEPENDENT_PIXELS
        squared = unit * self.deviation**2 * inverse / CAUCHY_SCALE**2
        self.weight = inverse / (1.0 + squared)
        self.disorder, self.by_albedo = entropy(guess.albedo)
        around = guess.lamps[:, 0] - guess.lamps[:, 0].mean()
        self.spread = float(np.sum(around**2)) + ALIKE**2
        self.tilt = np.array([float(np.mean(slope @ guess.depth)) for slope in data.field.slopes])
        mean, scale = prior.gloss(OF_GLOSS).T
        losses = (
            CAUCHY_SCALE**2 / unit * float(np.sum(np.log1p(squared[data.used]))),
            2.0 * data.few * self.disorder,
            count * float(np.log(self.spread)) + UNIT_PRECISION * float(guess.lamps[:, 0].mean()) ** 2,
            CAUCHY_SCALE**2 * float(np.sum(np.log1p((guess.lamps[:, 1:] / prior.slope / CAUCHY_SCALE) ** 2))),
            float(np.sum((self.tilt / LEVEL) ** 2)),
            float(np.sum(((guess.gloss - mean) / scale) ** 2)),
            self._saddle_precision * float(np.sum((data.field.saddle @ guess.depth) ** 2)),
        )
        self.cost = 0.5 * sum(losses)

    @property
    def gradient(self) -> float:
        """Norm of the slope of the cost by lamps and gloss, with surface and albedos eliminated."""
        return float(np.linalg.norm(self._undamped[1]))

    def trial(self, damping: float) -> tuple[JointSurface, float]:
        """The point after a damped step, and the size of the step in lamps and gloss."""
        trial, guess = self.moved(damping), self.guess
        pairs = ((trial.to_lamp, guess.to_lamp), (trial.lamps, guess.lamps), (trial.gloss, guess.gloss))
        size = float(np.sqrt(sum(np.sum((after - before) ** 2) for after, before in pairs)))
        return JointSurface(self.data, trial, self.prior), size

    def moved(self, damping: float) -> Guess:
        """One damped step of everything."""
        guess, count = self.guess, len(self.guess.to_lamp)
        schur, rhs, solved, pixels = self._reduced(damping)
        change = np.linalg.solve(schur, rhs)
        depth = solved[:, -1] - solved[:, :-1] @ change
        across = np.stack([slope @ depth for slope in self.data.field.slopes])
        outer = change[:-2]  # the last two are the mean slope
        albedo = (pixels.rhs - np.sum(pixels.tilts * across, axis=0) - pixels.outer @ outer) / pixels.own
        lamps_change, gloss_change = unpack_shared(outer, count)
        limit = np.array(LONGEST_STEP)[:, None]
        turn_1, turn_2, *lamps = np.clip(lamps_change, -limit, limit)
        first, second = tangents(guess.to_lamp)
        to_lamp = guess.to_lamp + turn_1[:, None] * first + turn_2[:, None] * second
        gloss = guess.gloss + np.clip(gloss_change, -0.7, 0.7)
        lowest, highest = np.transpose([LOG_GAMMA_RANGE, ROUGHNESS_RANGE, LOG_EXPONENT_RANGE])
        gloss[1:] = np.clip(gloss[1:], lowest, highest)
        return Guess(
            guess.depth + depth,
            guess.albedo + np.clip(albedo, -1.0, 1.0),
            to_lamp / np.linalg.norm(to_lamp, axis=1, keepdims=True),
            guess.lamps + np.stack(lamps, axis=1),
            gloss,
        )

    def variance(self) -> tuple[Array, Array]:
        """(K,) of a direction [rad²], the sum over its two turns, and of ln strength; the rest is free."""
        schur, _ = self._undamped
        diagonal = np.maximum(np.diag(np.linalg.inv(schur)), 0.0)
        lamps, _ = unpack_shared(diagonal[:-2], len(self.guess.to_lamp))
        return lamps[0] + lamps[1], lamps[2]

    @cached_property
    def _undamped(self) -> tuple[Array, Array]:
        """Normal equations of lamps, gloss and mean slope, damped by 1e-6."""
        schur, rhs, _, _ = self._reduced(1e-6)
        return schur, rhs

    @property
    def _saddle_precision(self) -> float:
        """Precision of the chessboard, relative to that of a value of size 1."""
        return SADDLE * INDEPENDENT_PIXELS / len(self.data.place)

    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """Of the model by u_x, u_y (2, K, P), ln albedo (K, P), its lamp (OF_LAMP, K, P) and gloss (OF_GLOSS, K, P)."""
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
        lamps = np.stack([*led, self.model, *(over * self.data.place[:, i] for i in (0, 1))])
        rough = [self.body * part for part in shade.by_body]
        gloss = np.stack([self.even * shade.interface, self.even * shade.by_width, *rough])
        return tilts, self.body * shade.body, lamps, gloss

    def _reduced(self, damping: float) -> tuple[Array, Array, Array, _AlbedoPixels]:
        """Normal equations of lamps, gloss and mean slope, with the surface (V, · + 1) and the albedos eliminated."""
        from scipy.sparse import diags
        from scipy.sparse.linalg import splu

        weight, field = self.weight, self.data.field
        tilts, albedo, lamps, gloss = self._slopes()
        few = self.data.few / len(self.data.place) / WIDTH**2  # least curvature of the histogram's bell
        weighed = weight * albedo
        own = (np.sum(weighed * albedo, axis=0) + few + 1e-9) * (1.0 + damping)
        pixel_rhs = np.sum(weighed * self.deviation, axis=0) - self.data.few * self.by_albedo
        pixels = _AlbedoPixels(own, pixel_rhs, np.sum(weighed * tilts, axis=1), _each(weighed, lamps, gloss))
        outer, rhs = self._outer(lamps, gloss)
        outer -= pixels.outer.T @ (pixels.outer / own[:, None])
        rhs -= pixels.outer.T @ (pixel_rhs / own)
        border, square, towards = [], self._saddle_precision * field.saddle.T @ field.saddle, 0.0
        for q, slope in enumerate(field.slopes):
            share = pixels.tilts[q] / own
            border.append(slope.T @ (_each(weight * tilts[q], lamps, gloss) - share[:, None] * pixels.outer))
            towards = towards + slope.T @ (np.sum(weight * tilts[q] * self.deviation, axis=0) - share * pixel_rhs)
            for r, other in enumerate(field.slopes):
                both = np.sum(weight * tilts[q] * tilts[r], axis=0) - share * pixels.tilts[r]
                square = square + slope.T @ diags(both) @ other
        towards = towards - self._saddle_precision * (field.saddle.T @ (field.saddle @ self.guess.depth))
        mean = np.column_stack([np.asarray(slope.mean(axis=0)).ravel() for slope in field.slopes])
        towards = towards - mean @ self.tilt / LEVEL**2
        edge = np.column_stack([sum(border), mean])
        level = square.diagonal()
        factor = splu((square + diags(damping * level + 1e-8 * level.mean())).tocsc(), "MMD_AT_PLUS_A", 0.0)
        solved = np.asarray(factor.solve(np.column_stack([edge, towards])))
        whole = np.zeros((len(rhs) + 2,) * 2)
        whole[:-2, :-2] = outer + damping * np.diag(np.diag(outer))
        whole[-2:, -2:] = -(LEVEL**2) * np.eye(2)  # an unknown of its own: eliminated, it would fill the sparse matrix
        return whole - edge.T @ solved[:, :-1], np.r_[rhs, 0.0, 0.0] - edge.T @ solved[:, -1], solved, pixels

    def _outer(self, lamps: Array, gloss: Array) -> tuple[Array, Array]:
        """Normal equations of lamps and gloss with their priors, for known pixels."""
        count = len(self.guess.to_lamp)
        split, weighed = OF_LAMP * count, self.weight * lamps
        outer = np.zeros((split + OF_GLOSS,) * 2)
        of_lamps = outer[:split, :split].reshape(OF_LAMP, count, OF_LAMP, count)
        each = np.arange(count)
        of_lamps[:, each, :, each] = np.einsum("akp,bkp->kab", weighed, lamps, optimize=True)
        outer[:split, split:] = np.einsum("akp,bkp->akb", weighed, gloss, optimize=True).reshape(split, OF_GLOSS)
        outer[split:, :split] = outer[:split, split:].T
        outer[split:, split:] = np.einsum("akp,bkp->ab", self.weight * gloss, gloss, optimize=True)
        rhs = pack_shared(
            np.sum(weighed * self.deviation, axis=2), np.sum(self.weight * gloss * self.deviation, axis=(1, 2))
        )
        strength = self.guess.lamps[:, 0]
        index, alike = 2 * count + each, count / self.spread
        outer[np.ix_(index, index)] += alike * np.eye(count) + (UNIT_PRECISION / count - alike) / count
        rhs[index] -= alike * (strength - strength.mean()) + UNIT_PRECISION / count * strength.mean()
        mean, scale = self.prior.gloss(OF_GLOSS).T
        slope = self.guess.lamps[:, 1:].T.ravel()
        # Cauchy's: an occasional lamp is near, or shaded by its stand
        precision = np.r_[1.0 / (self.prior.slope**2 + (slope / CAUCHY_SCALE) ** 2), scale**-2.0]
        away = np.r_[slope, self.guess.gloss - mean]
        last = np.arange(3 * count, len(rhs))
        outer[last, last] += precision
        rhs[last] -= precision * away
        return outer, rhs


def pack_shared(lamps: Array, gloss: Array) -> Array:
    """The parameters that all pixels share as one vector: lamps (OF_LAMP, K) and gloss (OF_GLOSS,)."""
    return np.r_[lamps.ravel(), gloss]


def unpack_shared(shared: NDArray[np.floating], lamps: int) -> tuple[Array, Array]:
    """Lamps (OF_LAMP, K) and gloss (OF_GLOSS,) of a vector: the inverse of `pack_shared`."""
    shared = np.asarray(shared, np.float64)
    return shared[: OF_LAMP * lamps].reshape(OF_LAMP, lamps), shared[OF_LAMP * lamps :]


@dataclass(frozen=True, eq=False)
class _AlbedoPixels:
    """Of ln albedo: curvature (P,), right-hand side (P,), and products with u_x and u_y (2, P), lamps, gloss (P, ·)."""

    own: Array
    rhs: Array
    tilts: Array
    outer: Array


def _each(weighed: Array, lamps: Array, gloss: Array) -> Array:
    """(P, OF_LAMP K + OF_GLOSS) products of a pixel's `weighed` (K, P) with the slopes by lamps and gloss."""
    by_lamp = (weighed * lamps).reshape(-1, weighed.shape[1])
    return np.concatenate([by_lamp, np.sum(weighed * gloss, axis=1)]).T


@dataclass(frozen=True, eq=False)
class HeightField:
    """slopes: u (V,) → u_x and u_y (P,), sparse. saddle: → the chessboard, of slope 0. tangent: (P, 2) x', y'."""

    slopes: tuple[Any, Any]
    saddle: Any
    tangent: Array

    @property
    def to_eye(self) -> Array:
        """(P, 3) unit."""
        rays = np.column_stack([-self.tangent, np.ones(len(self.tangent))])
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def normals(self, depth: Array) -> tuple[Array, Array]:
        """Unit normals (P, 3) of u (V,), and their derivatives (2, P, 3) by u_x and u_y, up to parts along them."""
        x, y = self.tangent.T
        across, along = (slope @ depth for slope in self.slopes)
        normal = np.column_stack([across, along, 1.0 + x * across + y * along])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        one, zero = np.ones_like(x), np.zeros_like(x)
        by = np.stack([np.column_stack([one, zero, x]), np.column_stack([zero, one, y])])
        return normal / length, by / length

    def through(self, normals: Array) -> Array:
        """u (V,) from `normals` (P, 3) of any length, by robust least squares: a start for a fit of the surface."""
        from scipy.sparse import diags, eye_array
        from scipy.sparse.linalg import splu

        floor = 0.1 * np.linalg.norm(normals, axis=1)
        facing = np.maximum(normals[:, 2] - np.sum(normals[:, :2] * self.tangent, axis=1), floor)
        wanted = np.clip(normals[:, :2] / facing[:, None], -STEEPEST, STEEPEST)
        flat = 1.0 / (1.0 + np.sum(wanted**2, axis=1))
        weight, depth = np.ones(len(wanted)), np.zeros(self.saddle.shape[1])
        regulariser = 1e-2 * self.saddle.T @ self.saddle + 1e-7 * eye_array(len(depth))
        for _ in range(REWEIGHTINGS):
            each = diags(weight * flat**2)
            square, rhs = regulariser, np.zeros(len(depth))
            for i, slope in enumerate(self.slopes):
                square = square + slope.T @ each @ slope
                rhs = rhs + slope.T @ (each @ wanted[:, i])
            depth = splu(square.tocsc()).solve(rhs)
            off = flat * np.hypot(*(slope @ depth - wanted[:, i] for i, slope in enumerate(self.slopes)))
            weight = 1.0 / (1.0 + (off / (3.0 * float(np.median(off)) + 1e-9)) ** 2)
        return np.asarray(depth)


def height_field(mask: NDArray[np.bool_], tangent: Array) -> HeightField:
    """The field over the pixels of `mask` (h, w); tangent: (h, w, 2) x', y' of the rays, 0 from afar."""
    from scipy.sparse import csr_array

    pixels = np.argwhere(mask)
    node = np.full((mask.shape[0] + 1, mask.shape[1] + 1), -1)
    places = [(pixels[:, 0] + down, pixels[:, 1] + right) for down, right in CORNERS]
    for place in places:
        node[place] = 0
    node[node == 0] = np.arange(np.count_nonzero(node == 0))
    columns = np.concatenate([node[place] for place in places])
    rows = np.tile(np.arange(len(pixels)), len(CORNERS))
    afar = not tangent.any()
    wide = 1.0 if afar else abs(tangent[0, 1, 0] - tangent[0, 0, 0])
    high = 1.0 if afar else abs(tangent[0, 0, 1] - tangent[1, 0, 1])

    def differences(signs: tuple[float, ...], pitch: float) -> Any:
        values = np.repeat(0.5 * np.array(signs) / pitch, len(pixels))
        return csr_array((values, (rows, columns)), shape=(len(pixels), int(node.max()) + 1))

    slopes = differences((-1, 1, -1, 1), wide), differences((1, 1, -1, -1), high)
    return HeightField(slopes, differences((1, -1, -1, 1), wide), tangent[mask])
