"""Stack basis: a weight stack as few pictures times functions of the lamp's direction, in whole numbers.

W_j(pixel, d) = s(pixel) Σ_k c_k(pixel) φ_kj(d): principal components over all lamps and colours together, each pixel
divided by s, the root of its mean brightness, as the eye sees errors in dark parts more. φ between the lamps is the
prediction of ordinary kriging with Matérn's kernel of order 3/2 (Rasmussen and Williams 2006, "Gaussian Processes for
Machine Learning", §4.2), whose length is the one that predicts each lamp best from the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo_page.publication.lit import shown
from hagoromo_page.publication.planes import Plane
from hagoromo_page.publication.weight_stack import WeightStack

LENGTHS = (0.2, 0.3, 0.45, 0.7, 1.0, 1.5)  # of the kernel, chords of the unit sphere
NUGGET = 1e-6  # noise of the kernel, relative
STORED_ERROR = 1.0  # of 255, root mean square, that components and whole numbers may make under the stored lamps
TESTED_PIXELS = 2048
MOST_COMPONENTS = 192  # a shader holds so many colours
MIDDLE, LEVEL_TOP, COVER_TOP = 32768, 4095, 255
DARKEST = 1e-4  # of the mean brightness: darker pixels are stored as if they were so bright
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DirectionFunctions:
    """φ at any direction: (directions, 1) kernel values times `values`.

    directions: (N, 3) unit. length: of the kernel. values: (N + 1, P, K), the last row a constant.
    """

    directions: Array
    length: float
    values: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PackedStack:
    """planes: level (logarithm of s), cover, label (1 where there is matter), c0, c1 …: whole numbers about MIDDLE.

    scales: how the page makes values of them again. stored_error, error_between: root mean square of display values,
    of 255, under the stored lamps, and under each of them predicted from the others. lamp_errors: (N,) the latter of
    each lamp.
    """

    planes: dict[str, Plane]
    scales: dict[str, Any]
    functions: DirectionFunctions
    stored_error: float
    lamp_errors: Array

    @property
    def error_between(self) -> float:
        """Over all lamps."""
        return float(np.sqrt(np.mean(self.lamp_errors**2)))


def packed_stack(stack: WeightStack, to_display: Array, exposure: float) -> PackedStack:
    """The stack in planes; to_display: (3, P) from weights under irradiance 1 to linear display values."""
    known = stack.known
    weights = stack.weights[known]
    scale = np.maximum(np.linalg.norm(to_display, axis=0), 1e-9)
    level, low, high = _levels(weights @ scale.astype(np.float32))
    even = (weights * scale.astype(np.float32) / level[:, None, None]).reshape(len(weights), -1).astype(np.float32)
    vectors = np.linalg.eigh((even.T @ even).astype(np.float64))[1][:, ::-1]
    components = even @ vectors.astype(np.float32)
    chosen = np.random.default_rng(0).permutation(len(weights))[:TESTED_PIXELS]
    tested = _Display(weights[chosen], level[chosen, None, None] / scale, exposure * to_display)
    step = _coarsest_step(components[chosen], vectors, tested)
    whole = np.rint(components / step)
    some = (whole != 0).any(axis=0)
    some[0] = True  # of a picture that is black, too
    used = np.flatnonzero(some)[:MOST_COMPONENTS]
    shape = (*stack.directions.shape[:1], len(scale), len(used))
    functions, held_out = _interpolated(
        stack.directions, (vectors[:, used] * step).reshape(shape), np.sqrt((whole[:, used] ** 2).mean(axis=0))
    )
    parts = whole[chosen][:, used]
    planes = {"label": known.astype(np.uint16)}
    planes["level"] = _spread(known, np.rint(LEVEL_TOP * np.log(level**2 / low) / math.log(high / low)))
    planes["cover"] = np.rint(COVER_TOP * np.clip(stack.alpha, 0.0, 1.0)).astype(np.uint16)
    for k, number in enumerate(used):
        planes[f"c{k}"] = _spread(known, np.clip(whole[:, number] + MIDDLE, 0, 65535), MIDDLE)
    return PackedStack(
        planes,
        {"components": len(used), "level": [low, high], "channels": len(scale)},
        DirectionFunctions(stack.directions, functions[0], _over(functions[1], scale)),
        tested.error(parts @ (vectors[:, used] * step).T),
        tested.errors(parts @ held_out.reshape(-1, len(used)).T),
    )


def matern(distance: Array, length: float) -> Array:
    """Matérn's kernel of order 3/2."""
    x = math.sqrt(3.0) * distance / length
    return (1.0 + x) * np.exp(-x)


class _Display:
    """Display values of the weights of some pixels, and how far others are from them."""

    def __init__(self, weights: NDArray[np.float32], back: Array, to_display: Array) -> None:
        self.back, self.to_display, self.shape = back, to_display, weights.shape
        self.truth = self._shown(weights)

    def error(self, even: Array) -> float:
        """Root mean square [of 255] of weights that are divided by their level and scale."""
        return float(np.sqrt(np.mean(self.errors(even) ** 2)))

    def errors(self, even: Array) -> Array:
        """(N,) that of each lamp."""
        off = self._shown(np.reshape(even, self.shape) * self.back) - self.truth
        return np.sqrt(np.mean(off**2, axis=(0, 2)))

    def _shown(self, weights: NDArray[Any]) -> Array:
        return 255.0 * shown(np.asarray(weights, np.float64) @ self.to_display.T, 1.0)


def _levels(brightness: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, float]:
    """s of each pixel as the page decodes it, and the range of s²."""
    mean = brightness.mean(axis=1, dtype=np.float64)
    mean = np.maximum(mean, DARKEST * max(float(mean.mean()), 1e-30))
    low, high = float(mean.min()), float(max(mean.max(), mean.min() * 1.000001))
    share = np.rint(LEVEL_TOP * np.log(mean / low) / math.log(high / low)) / LEVEL_TOP
    return np.sqrt(low * (high / low) ** share).astype(np.float32), low, high


def _coarsest_step(components: NDArray[np.float32], vectors: Array, tested: _Display) -> float:
    """The coarsest step of components whose error is STORED_ERROR, by bisection of its logarithm."""
    largest = max(float(np.abs(components).max()), 1e-30)
    low, high = math.log(largest / (MIDDLE - 1)), math.log(largest)
    for _ in range(14):
        middle = 0.5 * (low + high)
        step = math.exp(middle)
        if tested.error(np.rint(components / step) * step @ vectors.T) > STORED_ERROR:
            high = middle
        else:
            low = middle
    return math.exp(low)


def _interpolated(directions: Array, values: Array, strength: Array) -> tuple[tuple[float, Array], Array]:
    """Length and kernel coefficients (N + 1, P, K) of functions known at the lamps; their values (N, P, K) there as
    predicted from the other lamps. strength: (K,) root mean square of each component.
    """
    count = len(directions)
    flat = values.reshape(count, -1)
    apart = np.linalg.norm(directions[:, None] - directions[None], axis=2)
    best: tuple[float, float, Array, Array] | None = None
    for length in LENGTHS:
        system = np.ones((count + 1, count + 1))
        system[:count, :count] = matern(apart, length) + NUGGET * np.eye(count)
        system[count, count] = 0.0
        inverse = np.linalg.inv(system)
        coefficients = inverse[:, :count] @ flat
        residual = (coefficients[:count] / np.diag(inverse)[:count, None]).reshape(values.shape)
        off = float(np.sum((residual * strength) ** 2))
        if best is None or off < best[0]:
            best = off, length, coefficients.reshape(count + 1, *values.shape[1:]), values - residual
    assert best is not None
    return (best[1], best[2]), best[3]


def _over(values: Array, scale: Array) -> NDArray[np.float32]:
    return (values / scale[None, :, None]).astype(np.float32)


def _spread(known: NDArray[np.bool_], values: NDArray[Any], outside: int = 0) -> Plane:
    plane = np.full(known.shape, outside, np.uint16)
    plane[known] = values.astype(np.uint16)
    return plane
