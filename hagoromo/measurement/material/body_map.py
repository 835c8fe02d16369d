"""Body map: α c_b of every pixel, estimated per pixel where a material varies, and the values predicted with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares import HUBER
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.gloss.lobes import Lobes, LobeShape
from hagoromo.measurement.material.material_objective import expected, interface_of, theta_of
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import Array, sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

PASSES = 3  # of re-weighting: shadows and dust lose their weight in two
DARKEST = 1e-6  # of the largest irradiance of a photograph: pixels with less carry no information


@dataclass(frozen=True, eq=False)
class Parts:
    """Diffuse and specular parts of a photograph: body and interface (h, w, C), NaN where no material is known.

    light: (h, w, C) irradiance facing the lamps, in the channels of the camera.
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
        """The parts that body and interface contribute to `photograph` of `capture`."""
        body, interface, light = (np.full(self.value.shape, np.nan) for _ in range(3))
        for number, material in enumerate(self.materials):
            pixels = Pixels.where(capture, (self.labels == number) & known_shape(capture))
            geometry = sight_of(photograph, pixels.points, pixels.normals, self.white)
            index = pixels.rows, pixels.columns
            body[index] = self.value[index] * geometry.body_of(material.epsilon, material.sigma)
            if self.gloss is None:
                interface[index] = interface_of(geometry, material)
            else:
                strength = self.gloss.beta[index] * ((material.n - 1.0) / (material.n + 1.0)) ** 2
                lobes = Lobes(geometry, material.n, LobeShape.of(material))
                interface[index] = strength[:, None] * lobes.evaluate(np.log(self.gloss.gamma[index]))[0]
            light[index] = geometry.irradiance.sum(axis=1)
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
    """The body of every pixel of `materials`; white: (C,) colour of the lamps if it was estimated.

    Where a material's gloss varies, the body colours are those that were estimated together with it.
    """
    shape = (*labels.shape, capture.photographs[0].values.shape[2])
    value, error = np.full(shape, np.nan), np.full(shape, np.nan)
    for number, material in enumerate(materials):
        pixels = Pixels.where(capture, (labels == number) & known_shape(capture))
        index = pixels.rows, pixels.columns
        mean = material.alpha * np.array(material.body_colour)
        value[index] = mean
        error[index] = material.alpha * np.array(material.standard_error.get("body_colour") or np.nan)
        if gloss is not None and material.gloss is not None and material.gloss["per_pixel"]:
            known = np.isfinite(gloss.body_error[index])
            value[index] = np.where(known, gloss.body[index], mean)
            error[index] = np.where(known, gloss.body_error[index], error[index])
        elif material.texture is not None and material.texture["per_pixel"]:
            own, spread = _own(capture, pixels, material, white)
            known = np.isfinite(spread)
            value[index], error[index] = np.where(known, own, mean), np.where(known, spread, error[index])
    return BodyMap(value, error, tuple(materials), labels, white, gloss)


def _own(capture: Capture, pixels: Pixels, material: MaterialEstimate, white: Array | None) -> tuple[Array, Array]:
    """Body (M, C) of each pixel by robust least squares, and its standard error, inf where no photograph shows it."""
    mean = material.alpha * np.array(material.body_colour)
    theta = theta_of(material, np.zeros_like(mean))
    body, index = np.tile(mean, (len(pixels), 1)), (pixels.rows, pixels.columns)
    photographs_parts = [_view(photograph, pixels, theta, white) for photograph in capture.photographs]
    power = np.zeros_like(body)
    for turn in range(PASSES):
        rhs, power = np.zeros_like(body), np.zeros_like(body)
        for photograph, (lit, used, rest) in zip(capture.photographs, photographs_parts, strict=True):
            variance = photograph.variance[index].astype(np.float64)
            weight = np.where(used & (variance > 0.0), 1.0 / np.where(variance > 0.0, variance, 1.0), 0.0)
            if turn:
                weight = weight * HUBER.weight((rest - body * lit) * np.sqrt(weight))
            rhs += weight * lit * rest
            power += weight * lit**2
        body = np.where(power > 0.0, rhs / np.where(power > 0.0, power, 1.0), body)
    return body, np.where(power > 0.0, 1.0 / np.sqrt(np.where(power > 0.0, power, 1.0)), np.inf)


def _view(
    photograph: Photograph, pixels: Pixels, theta: Array, white: Array | None
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Light on the body (M, C), mask of usable values (M, C), and the values less the interface (M, C)."""
    geometry, index = sight_of(photograph, pixels.points, pixels.normals, white), (pixels.rows, pixels.columns)
    lit = geometry.body
    used = np.asarray(geometry.fit_to_use & photograph.mask[index])[:, None] & np.asarray(
        lit > DARKEST * lit.max(initial=0.0)
    )
    return lit, used, photograph.values[index] - expected(geometry, theta)
