"""Body maps: α c_b of every pixel, each its own where its material varies, and what the materials predict with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import HUBER
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.gloss.lobes import Lobes
from hagoromo.measurement.material.quantity import theta_of
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import Array, sight
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

PASSES = 3  # of re-weighting: shadows and dust lose their weight in two
DARKEST = 1e-6  # of the most light that a pixel gets in a photograph: less than this tells nothing


@dataclass(frozen=True, eq=False)
class Parts:
    """What a photograph shows of each pixel: body and interface (h, w, C), NaN where no material is known.

    light: (h, w, C) that falls on it, facing the lamps, as the camera sees it.
    """

    body: Array
    interface: Array
    light: Array

    @property
    def sum(self) -> Array:
        """(h, w, C) values."""
        return self.body + self.interface


@dataclass(frozen=True, eq=False)
class BodyMap:
    """Body colour of each pixel: value, α c_b (h, w, C) [1/sr], NaN or 0 where unknown.

    error: its standard error (h, w, C), NaN where unknown; None where the colours were solved together with the shape,
    which gives none. materials; labels: (h, w) index into them. white: (C,) colour of the lamps where it was measured.
    gloss: of each pixel, where it varies.
    """

    value: Array | NDArray[np.float32]
    error: Array | None
    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.integer]
    white: Array | None = None
    gloss: GlossMap | None = None

    def parts(self, capture: Capture, photograph: Photograph) -> Parts:
        """What body and interface give in `photograph` of `capture`."""
        body, interface, light = (np.full(self.value.shape, np.nan) for _ in range(3))
        for number, material in enumerate(self.materials):
            pixels = Pixels.where(capture, (self.labels == number) & known_shape(capture))
            seen = sight(photograph, pixels.points, pixels.normals, self.white)
            at = pixels.rows, pixels.columns
            body[at] = self.value[at] * seen.body
            if self.gloss is None:
                theta = theta_of(np.zeros(self.value.shape[2]), material.beta, material.gamma, material.n)
                interface[at] = theta[-3] * seen.interface(theta[-2:-1], theta[-1:])[0][0]
            else:
                strength = self.gloss.beta[at] * ((material.n - 1.0) / (material.n + 1.0)) ** 2
                interface[at] = strength[:, None] * Lobes(seen, material.n).at(np.log(self.gloss.gamma[at]))[0]
            light[at] = seen.irradiance.sum(axis=1)
        return Parts(body, interface, light)

    def channels(self, names: Sequence[str]) -> dict[str, NDArray[np.float32]]:
        """Channels of an EXR: each colour channel and, where known, its standard error; 0 where unknown."""
        both = (("", self.value), ("error.", self.error))
        parts = {f"{of}{name}": one[..., k] for of, one in both if one is not None for k, name in enumerate(names)}
        return {name: np.where(np.isfinite(one), one, 0.0).astype(np.float32) for name, one in parts.items()}


def body_map(
    capture: Capture,
    labels: NDArray[np.integer],
    materials: Sequence[MaterialEstimate],
    white: Array | None = None,
    gloss: GlossMap | None = None,
) -> BodyMap:
    """The body of every pixel of `materials`; white: (C,) colour of the lamps where it was measured.

    Where a material's gloss varies, its bodies are those that were solved with it.
    """
    shape = (*labels.shape, capture.photographs[0].values.shape[2])
    value, error = np.full(shape, np.nan), np.full(shape, np.nan)
    for number, material in enumerate(materials):
        pixels = Pixels.where(capture, (labels == number) & known_shape(capture))
        at = pixels.rows, pixels.columns
        mean = material.alpha * np.array(material.body_colour)
        value[at] = mean
        error[at] = material.alpha * np.array(material.standard_error.get("body_colour") or np.nan)
        if gloss is not None and material.gloss is not None and material.gloss["per_pixel"]:
            known = np.isfinite(gloss.body_error[at])
            value[at] = np.where(known, gloss.body[at], mean)
            error[at] = np.where(known, gloss.body_error[at], error[at])
        elif material.texture is not None and material.texture["per_pixel"]:
            own, spread = _own(capture, pixels, material, white)
            known = np.isfinite(spread)
            value[at], error[at] = np.where(known, own, mean), np.where(known, spread, error[at])
    return BodyMap(value, error, tuple(materials), labels, white, gloss)


def _own(capture: Capture, pixels: Pixels, material: MaterialEstimate, white: Array | None) -> tuple[Array, Array]:
    """Robust least squares of the body (M, C) in each pixel, and its standard error, inf where nothing shows it."""
    mean = material.alpha * np.array(material.body_colour)
    theta = theta_of(mean, material.beta, material.gamma, material.n)
    body, at = np.tile(mean, (len(pixels), 1)), (pixels.rows, pixels.columns)
    views = [_view(photograph, pixels, theta, white) for photograph in capture.photographs]
    power = np.zeros_like(body)
    for turn in range(PASSES):
        pull, power = np.zeros_like(body), np.zeros_like(body)
        for photograph, (lit, used, rest) in zip(capture.photographs, views, strict=True):
            variance = photograph.variance[at].astype(np.float64)
            weight = np.where(used & (variance > 0.0), 1.0 / np.where(variance > 0.0, variance, 1.0), 0.0)
            if turn:
                weight = weight * HUBER.weight((rest - body * lit) * np.sqrt(weight))
            pull += weight * lit * rest
            power += weight * lit**2
        body = np.where(power > 0.0, pull / np.where(power > 0.0, power, 1.0), body)
    return body, np.where(power > 0.0, 1.0 / np.sqrt(np.where(power > 0.0, power, 1.0)), np.inf)


def _view(
    photograph: Photograph, pixels: Pixels, theta: Array, white: Array | None
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Light on the body (M, C), which values may be used (M, C), and the values less the interface (M, C)."""
    seen, at = sight(photograph, pixels.points, pixels.normals, white), (pixels.rows, pixels.columns)
    lit = seen.body
    used = np.asarray(seen.fit_to_use & photograph.mask[at])[:, None] & np.asarray(lit > DARKEST * lit.max(initial=0.0))
    return lit, used, photograph.values[at] - theta[-3] * seen.interface(theta[-2:-1], theta[-1:])[0][0]
