"""Lobe samples: some pixels of a material under all lamps, from which the lobes of its interface are estimated.

Body colours are eliminated pixel by pixel. Light in excess of the model counts in full, as it is what is sought; light
that is missing counts little, as shadows do. A clipped value is a lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays, column, evaluate
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.shading import N, lit
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.reading import reading
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.torrance_sparrow import cosines, squared_angle_of, weights_at

RELATIVE_ERROR = 0.02  # of the model, in the weights
BODY_PASSES = 2  # of re-weighting
LEAST_BODY = 1e-4  # smallest body colour, of their mean
UNBOUNDED = 1e30  # of a model below all values
TOGETHER = 4  # columns that a kernel makes at once


class _Index(NamedTuple):
    """Of samples of K lamps, C channels and P pixels: the counts K, C P and P, pixel (C, P) of each colour, and of each
    value (K, C, P) its place in (K, P) and its colour in (C, P). A division is dear in a kernel.
    """

    lamps: Any
    values: Any
    pixels: Any
    pixel: Any
    place: Any
    own: Any

    @staticmethod
    def of(lamps: int, channels: int, pixels: int) -> _Index:
        """For samples of this shape."""
        jit = arrays()
        own = np.arange(channels * pixels)
        place = np.repeat(np.arange(lamps) * pixels, channels * pixels) + np.tile(own % pixels, lamps)
        each = (column(jit.UInt, one.astype(np.uint32)) for one in (own % pixels, place, np.tile(own, lamps)))
        return _Index(*(dr.opaque(jit.UInt, one) for one in (lamps, channels * pixels, pixels)), *each)


@dataclass(frozen=True, eq=False)
class Samples:
    """P pixels under K lamps in C channels, as flat arrays of the device, single precision, in the order of `shape`.

    shape: (K, C, P). values, level2: (K, C, P), the latter (RELATIVE_ERROR times the value to which errors are
    relative)²; known, lower: (K, C, P) 1 where a value is valid or clipped, and where it is clipped, and so a lower
    bound. body, first: (K, P) what a body of 1 and the first lobe give; by_law: two of (K, P), slopes of that body by σ
    and ln(1 + ε); flat: (K, P) the interface for D = β = 1; angle2: (K, P) φ² [rad²]. colour: (C, P) of the interface;
    coloured: whether it differs from 1. sensor: (K, C, P) variance of its noise; noise: the same with what errors of
    the normals make.
    """

    shape: tuple[int, int, int]
    index: _Index
    values: Float
    level2: Float
    known: Float
    lower: Float
    body: Float
    first: Float
    by_law: tuple[Float, Float]
    flat: Float
    angle2: Float
    colour: Float
    coloured: bool
    sensor: Float
    noise: Float

    @cached_property
    def stated(self) -> Float:
        """(K, C, P) inverse variance, 0 where a value is unknown."""
        weight = self.known / (self.noise + self.level2)
        evaluate(weight)
        return weight

    def lamps(self, chosen: NDArray) -> Samples:
        """The samples of some lamps, whose weights are those beside all lamps."""
        numbers, (lamps, channels, pixels) = np.arange(self.shape[0])[chosen], self.shape

        def part(values: Float) -> Float:
            each = dr.width(values) // lamps
            index = numbers.repeat(each) * each + np.tile(np.arange(each), len(numbers))
            return dr.gather(arrays().Float, values, column(arrays().UInt, index.astype(np.uint32)))

        names = ("values", "level2", "known", "lower", "body", "first", "flat", "angle2", "sensor", "noise")
        parts = {name: part(getattr(self, name)) for name in names}
        law = part(self.by_law[0]), part(self.by_law[1])
        evaluate(list(parts.values()), law)
        shape = len(numbers), channels, pixels
        return replace(self, shape=shape, index=_Index.of(*shape), by_law=law, **parts)

    def under_law(self, change: Array) -> Samples:
        """The samples with bodies whose (σ, ln(1 + ε)) differ by `change` (2,), to first order."""
        if not np.any(change):
            return self
        by = [dr.opaque(arrays().Float, float(one)) for one in change]
        body = dr.fmax(self.body + by[0] * self.by_law[0] + by[1] * self.by_law[1], 0.0)
        evaluate(body)
        return replace(self, body=body)

    def neutral(self) -> Samples:
        """The samples with an interface of the colour of the lamp."""
        return replace(self, colour=dr.opaque(arrays().Float, 1.0, dr.width(self.colour)), coloured=False)

    def density(self, log_gamma: float) -> Float:
        """(K, P) a Gaussian density of facets of this ln γ [rad]."""
        return dr.exp2(-self.angle2 * dr.opaque(arrays().Float, math.exp(-2.0 * log_gamma)))

    def column(self, width: float) -> Float:
        """(K, P) a Gaussian lobe of β = 1 and this half width [rad]."""
        lobe = self.flat * self.density(math.log(width))
        evaluate(lobe)
        return lobe

    def interface(self, weights: Array, widths: Array) -> Float:
        """(K, P) the first lobe times weights[0], and lobes of `widths` with β weights[1:]."""
        total = dr.opaque(arrays().Float, float(weights[0])) * self.first
        for weight, width in zip(weights[1:], widths, strict=True):
            if weight > 0.0:
                total = total + dr.opaque(arrays().Float, float(weight)) * self.column(float(width))
        evaluate(total)
        return total

    def bodies(self, interface: Float) -> Float:
        """(C, P) body colours by least squares of what the interface (K, P) leaves, less where light is missing."""
        body = dr.opaque(arrays().Float, -UNBOUNDED, dr.width(self.colour))  # a model below all values: no light misses

        def add(at: _Sampled, weight: Any, value: Any) -> tuple[Any, Any]:
            return weight * at.body * at.body, weight * at.body * (value - at.lobes)

        for _ in range(BODY_PASSES):
            power, total = self._sums(interface, body, add)
            body = total / dr.fmax(power, 1e-30)
            evaluate(body)
            body = dr.fmax(body, LEAST_BODY * dr.fmax(dr.mean(body), 1e-30))
            evaluate(body)
        return body

    def weighed(self, interface: Float | None, body: Float | None) -> tuple[Float, Float]:
        """√weight and what the model of bodies (C, P) and the interface (K, P) leaves, (K, C, P); without a model, the
        weight less what missing light takes from it, and the values.
        """
        index = dr.arange(arrays().UInt, dr.width(self.values))
        at = _Sampled.of(self, index, self.index.place, self.index.own, interface, body)
        weight, left = at.weight(), at.value if body is None else at.value - at.model
        root = dr.sqrt(weight)
        evaluate(root, left)
        return root, left

    def beside_bodies(self, pairs: Sequence[tuple[Float, Float]], root: Float) -> list[NDArray[np.float32]]:
        """Of each pair (K, P) and (C, P) the array (K, C, P): root times what bodies do not make of the values
        colour × of, at weights root².
        """
        parts = [pairs[i : i + TOGETHER] for i in range(0, len(pairs), TOGETHER)]
        return [self.numbers(one) for part in parts for one in self._beside_bodies(part, root)]

    def _beside_bodies(self, pairs: Sequence[tuple[Float, Float]], root: Float) -> list[Float]:
        """As `beside_bodies`, of pairs that one kernel reads together."""
        jit, index = arrays(), self.index
        each = self.shape[1] * self.shape[2]
        own, pixel = dr.arange(jit.UInt, each), index.pixel

        def add(lamp: Any, power: Any, *mixed: Any) -> tuple[Any, ...]:
            place = lamp * index.pixels + pixel
            unit = dr.gather(jit.Float, self.body, place)
            weight = unit * dr.square(dr.gather(jit.Float, root, lamp * index.values + own))
            sums = (old + weight * dr.gather(jit.Float, of, place) for old, (of, _) in zip(mixed, pairs, strict=True))
            return lamp + 1, power + weight * unit, *sums

        start = dr.zeros(jit.UInt, each), *(dr.zeros(jit.Float, each) for _ in range(1 + len(pairs)))
        _, power, *mixed = dr.while_loop(start, lambda lamp, *_: lamp < index.lamps, add)
        shares = [colour * sums / dr.fmax(power, 1e-30) for sums, (_, colour) in zip(mixed, pairs, strict=True)]
        evaluate(shares)
        unit, found = dr.gather(jit.Float, self.body, index.place), []
        for share, (of, colour) in zip(shares, pairs, strict=True):
            value = dr.gather(jit.Float, colour, index.own) * dr.gather(jit.Float, of, index.place)
            found.append(root * (value - unit * dr.gather(jit.Float, share, index.own)))
        evaluate(found)
        return found

    def loss(self, interface: Float, body: Float) -> float:
        """That whose weights are `weighed`: squares of light in excess, Cauchy's loss of light that is missing."""

        def add(at: _Sampled, _: Any, value: Any) -> tuple[Any, Any]:
            squared = at.stated * dr.square(value - at.model)
            missing = CAUCHY_SCALE**2 * dr.log(1.0 + squared / CAUCHY_SCALE**2)
            return dr.select(value < at.model, dr.select(at.lower > 0.0, 0.0, missing), squared), 0.0

        return total_of(self._sums(interface, body, add)[0])

    def squared_error(self, interface: Float, body: Float) -> float:
        """Of all pixels, clipped values as they are recorded and the model clipped there."""

        def add(at: _Sampled, _: Any, value: Any) -> tuple[Any, Any]:
            model = dr.select(at.lower > 0.0, dr.fmin(at.model, value), at.model)
            return at.known * dr.square(value - model), 0.0

        return total_of(self._sums(interface, body, add)[0])

    def log_spread(self) -> float:
        """Σ ln of the variance of the values, noise and RELATIVE_ERROR together, that are valid."""

        def add(at: _Sampled, _: Any, __: Any) -> tuple[Any, Any]:
            spread = dr.select(at.stated > 0.0, -dr.log(at.stated), 0.0)
            return dr.select(at.lower > 0.0, 0.0, spread), 0.0

        return total_of(self._sums(None, None, add)[0])

    def flank_noise(self, slope: Float, variance: Array) -> Samples:
        """The samples with the noise that turns of this variance (P,) [rad²] make of lobes of this slope (K, P)."""
        jit, spread = arrays(), column(arrays().Float, variance.astype(np.float32))
        light = dr.square(
            dr.gather(jit.Float, slope, self.index.place) * dr.gather(jit.Float, self.colour, self.index.own)
        )
        pixel = dr.gather(jit.UInt, self.index.pixel, self.index.own)
        noise = self.sensor + light * dr.gather(jit.Float, spread, pixel)
        evaluate(noise)
        return replace(self, noise=noise)

    def numbers(self, values: Float) -> NDArray[np.float32]:
        """The array (K, C, P), (K, P) or (C, P) in memory."""
        lamps, channels, pixels = self.shape
        shapes = {lamps * channels * pixels: self.shape, channels * pixels: (channels, pixels)}
        return values.numpy().reshape(shapes.get(dr.width(values), (lamps, pixels)))

    def _sums(self, interface: Float | None, body: Float | None, add: Any) -> tuple[Float, Float]:
        """(C, P) sums over lamps of the two numbers that `add` makes of a place, its weight and its value."""
        jit, index, each = arrays(), self.index, self.shape[1] * self.shape[2]
        own, _ = dr.arange(jit.UInt, each), self.stated  # computed before the loop

        def more(lamp: Any, first: Any, second: Any) -> tuple[Any, Any, Any]:
            place = lamp * index.pixels + index.pixel
            at = _Sampled.of(self, lamp * index.values + own, place, own, interface, body)
            a, b = add(at, at.weight(), at.value)
            return lamp + 1, first + a, second + b

        start = dr.zeros(jit.UInt, each), dr.zeros(jit.Float, each), dr.zeros(jit.Float, each)
        _, first, second = dr.while_loop(start, lambda lamp, *_: lamp < index.lamps, more)
        evaluate(first, second)
        return first, second


class _Sampled(NamedTuple):
    """Values of `Samples` in a kernel, at one lamp, channel and pixel a lane; stated: their inverse variance; model: of
    them, lobes: their part.
    """

    value: Any
    stated: Any
    known: Any
    lower: Any
    body: Any
    lobes: Any
    model: Any

    @staticmethod
    def of(samples: Samples, index: Any, place: Any, own: Any, interface: Float | None, body: Float | None) -> _Sampled:
        """Those at `index` of (K, C, P), `place` of (K, P), and `own` of (C, P)."""
        jit = arrays()
        value, stated, known, lower = (
            dr.gather(jit.Float, of, index) for of in (samples.values, samples.stated, samples.known, samples.lower)
        )
        lit = dr.gather(jit.Float, samples.body, place)
        if interface is None or body is None:
            return _Sampled(value, stated, known, lower, lit, 0.0, -UNBOUNDED)
        lobes = dr.gather(jit.Float, samples.colour, own) * dr.gather(jit.Float, interface, place)
        return _Sampled(
            value, stated, known, lower, lit, lobes, reading(dr.gather(jit.Float, body, own), lit, None, lobes)
        )

    def weight(self) -> Any:
        """Inverse variance; less where light is missing; 0 where a lower bound holds already."""
        missing, weight = dr.fmax(self.model - self.value, 0.0), self.stated
        weight = weight / (1.0 + dr.square(missing) * weight / CAUCHY_SCALE**2)
        return dr.select((self.lower > 0.0) & (self.model >= self.value), 0.0, weight)


def total_of(each: Float) -> float:
    """The sum over all lanes, in double precision."""
    return float(each.numpy().sum(dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Trust:
    """Which values of P pixels under K lamps are valid: trusted (K, P); and which are clipped: lower (K, C, P)."""

    trusted: NDArray[np.bool_]
    lower: NDArray[np.bool_]

    @staticmethod
    def of(views: Views, trusted: NDArray[np.bool_]) -> Trust:
        """With the lower bounds of `views`."""
        return Trust(trusted, np.zeros(views.values.shape, bool) if views.lower is None else views.lower)

    def pixels(self, chosen: NDArray) -> Trust:
        """That of some pixels."""
        return Trust(self.trusted[:, chosen], self.lower[..., chosen])


def trust_of(capture: Capture, views: Views) -> Trust:
    """That of `views`, by the masks of `capture`."""
    return Trust.of(views, views.valid(capture.photographs))


def samples_of(views: Views, fit: Fit, place: Array, trust: Trust) -> Samples:
    """The samples of `views`, whose pixels `fit`, `place` and `trust` have."""
    trusted, lower = trust.trusted, trust.lower
    shade, (flat, angle2) = lit(fit.normals, views.to_lamp, views.to_eye, fit.rows), _flat(views, fit.normals)
    values = np.where(np.isfinite(views.values), views.values, 0.0)
    noise = np.where(np.isfinite(views.variance) & (views.variance > 0.0), views.variance, np.inf)
    usual = noise[np.isfinite(noise)]
    noise = np.where(lower, np.median(usual) if len(usual) else np.inf, noise)
    level2 = (RELATIVE_ERROR * np.maximum(values, values.mean(axis=0))) ** 2
    colour = fit.interface_colour

    def flat_array(array: NDArray) -> Float:
        return column(arrays().Float, np.asarray(array, np.float32))

    even, spread = flat_array(fit.evenness(place)), flat_array(noise)
    by_light = [even * one for one in (shade.body, shade.interface, *shade.by_body, flat)]
    evaluate(by_light, angle2)
    body, first, by_sigma, by_exponent, flat = by_light
    return Samples(
        values.shape,
        _Index.of(*values.shape),
        flat_array(values),
        flat_array(level2),
        flat_array(trusted[:, None] | lower),
        flat_array(lower),
        body,
        first,
        (by_sigma, by_exponent),
        flat,
        angle2,
        flat_array(colour),
        bool(np.ptp(colour) > 0.0),
        spread,
        spread,
    )


def _flat(views: Views, normals: Array) -> tuple[Float, Float]:
    """F G / cosθ_r (K, P), and φ² [rad²], of all lamps, on the device."""
    jit, (lamps, pixels) = arrays(), views.to_lamp.shape[:2]
    pixel = dr.arange(jit.UInt, lamps * pixels) % dr.opaque(jit.UInt, pixels)

    def wide(vectors: Array) -> Any:
        flat = [column(jit.Float, one.astype(np.float32)) for one in vectors.T]
        return jit.Array3f(*(dr.gather(jit.Float, one, pixel) for one in flat))

    towards = jit.Array3f(*(column(jit.Float, views.to_lamp[..., i].astype(np.float32)) for i in range(3)))
    normal, to_eye = wide(normals), wide(views.to_eye)
    at = cosines(normal, towards, to_eye)
    flat = weights_at(at, 0.0, 1.0, dr.opaque(jit.Float, 1e6), N).interface
    half = towards + to_eye
    return flat, squared_angle_of(dr.squared_norm(dr.cross(normal, half)) / dr.squared_norm(half), at.half)


def inner_products(columns: list[NDArray[np.float32]]) -> Array:
    """(N, N) of N columns (K, …), in double precision: columns of neighbouring widths are nearly the same."""
    total = np.zeros((len(columns), len(columns)))
    for lamp in zip(*columns, strict=True):
        rows = np.stack([one.ravel() for one in lamp]).astype(np.float64)
        total += rows @ rows.T
    return total
