"""Body map: α c_b of every pixel, estimated per pixel where a material varies, and the values predicted with it.

Dichromatic separation: a photograph separated into the diffuse (body) and specular (interface) parts of its light.

A value is v = m_b c + m_s e + noise, with c the body's colour and e the light's in the channels of the camera. m_s is
estimated from the colours by weighted least squares (Klinker, Shafer & Kanade 1988) and from the measured materials;
the two are combined by their variances, so the materials decide for a grey body and the colours for a coloured one.
The rest is the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.least_squares.loss import TUKEY
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.gloss.pixel_gloss import LobeShape, SampleLobes
from hagoromo.measurement.material.material_objective import expected, interface_of, theta_of
from hagoromo.measurement.observations import Pixels, known_shape
from hagoromo.measurement.sight import Array, Sight, sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.torrance_sparrow import normal_fresnel

PASSES = 3  # of re-weighting: shadows and dust lose their weight in two
MODEL_ERROR = 0.01  # relative, of the model, beside the noise
LEAST_VARIATION = 1e-3  # relative, of a body colour that varies
FARTHEST_BODY = 4.0  # standard deviations of the variation between the start of a pixel's body colour and the mean
ANY_BODY = {"variation": 1e3}  # as good as no prior
OTHER_BODY, OTHER_SIGMA = 0.25, 8.0  # relative, and in standard deviations: a pixel farther off has a body of its own
DARKEST = 1e-6  # of the largest irradiance of a photograph: pixels with less carry no information
TRUST = 0.3  # relative error assumed for the materials' interface part
FLOOR = 0.01  # of the value: error of that part where the materials have no highlight
COLOUR_ERROR = 0.02  # relative error assumed for the colours c and e


@dataclass(frozen=True, eq=False)
class SeparatedParts:
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

    error: its standard error (h, w, C), NaN where unknown; None where it was not estimated. materials; labels: (h, w)
    index into them. white: (C,) colour of the lamps where it was measured.
    gloss: of each pixel, where it varies.
    """

    value: Array | NDArray[np.float32]
    error: Array | None
    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.integer]
    white: Array | None = None
    gloss: GlossMap | None = None

    def parts(self, capture: Capture, photograph: Photograph) -> SeparatedParts:
        """The parts that body and interface contribute to `photograph` of `capture`."""
        body, interface, light = (np.full(self.value.shape, np.nan) for _ in range(3))
        for number, material in enumerate(self.materials):
            pixels = Pixels.where(capture, (self.labels == number) & known_shape(capture))
            geometry = sight_of(photograph, pixels.points, pixels.normals, self.white)
            index = pixels.rows, pixels.columns
            body[index] = self.value[index] * geometry.body_of(material.body_law)
            if self.gloss is None:
                interface[index] = interface_of(geometry, material)
            else:
                interface[index] = _own_interface(geometry, material, self.gloss, index)
            light[index] = geometry.irradiance.sum(axis=1)
        return SeparatedParts(body, interface, light)

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
        elif np.all(mean > 0.0):
            own, spread = _own(capture, pixels, replace(material, texture=ANY_BODY), white)
            other = _is_other(own, spread, mean)
            value[index], error[index] = np.where(other, own, mean), np.where(other, spread, error[index])
    return BodyMap(value, error, tuple(materials), labels, white, gloss)


def _own(capture: Capture, pixels: Pixels, material: MaterialEstimate, white: Array | None) -> tuple[Array, Array]:
    """Body (M, C) of each pixel, and its standard error; inf where no photograph shows it.

    The prior is the material: its mean, with the variation that was found. Shadows make values too dark, never too
    bright, and of a few photographs half may be in one: so the start is the higher median of the photographs, values
    far from it do not count, and a pixel whose values are all far keeps the mean.
    """
    assert material.texture is not None
    mean = material.alpha * np.array(material.body_colour)
    theta = theta_of(material, np.zeros_like(mean))
    views = [_view(photograph, pixels, theta, white) for photograph in capture.photographs]
    index = pixels.rows, pixels.columns
    prior = 1.0 / np.maximum(np.array(material.texture["variation"]) * mean, LEAST_VARIATION * np.abs(mean)) ** 2
    body, power = _higher_median(views, mean, prior), np.zeros((len(pixels), len(mean)))
    for _ in range(PASSES):
        rhs, power = np.tile(prior * mean, (len(pixels), 1)), np.tile(prior, (len(pixels), 1))
        for photograph, (lit, used, rest) in zip(capture.photographs, views, strict=True):
            variance = photograph.variance[index] + (MODEL_ERROR * body * lit) ** 2
            weight = np.where(used & (variance > 0.0), 1.0 / np.where(variance > 0.0, variance, 1.0), 0.0)
            weight = weight * TUKEY.weight((rest - body * lit) * np.sqrt(weight))
            rhs += weight * lit * rest
            power += weight * lit**2
        body = rhs / power
    seen = np.any([used for _, used, _ in views], axis=0)
    return body, np.where(seen, 1.0 / np.sqrt(power), np.inf)


def _is_other(own: Array, spread: Array, mean: Array) -> NDArray[np.bool_]:
    """(M, 1) pixels that are not of their material's one body colour `mean` (C,): stray ones at its border, or dirt."""
    off, sigma = (own - mean).sum(axis=1), np.sqrt((spread**2).sum(axis=1))
    other = (np.abs(off) > OTHER_BODY * mean.sum()) & (np.abs(off) > OTHER_SIGMA * sigma)
    return other[:, None]


def _own_interface(sight: Sight, material: MaterialEstimate, gloss: GlossMap, index: tuple[NDArray, NDArray]) -> Array:
    """(N, C) interface of pixels `index` with their own gloss; their further lobes are as much stronger and wider."""
    facing, shape = normal_fresnel(material.n), LobeShape.of(material)
    beta, gamma = gloss.beta[index], gloss.gamma[index]
    if gloss.nu is not None:
        shape = replace(shape, nu=gloss.nu[index])
    value = (beta * facing)[:, None] * SampleLobes(sight, material.n, shape).evaluate(np.log(gamma))[0]
    if material.lobes:
        gaussian = SampleLobes(sight, material.n, replace(shape, nu=np.inf))
        for of_lobe, width in material.lobes:
            strength = beta / material.beta * of_lobe * facing
            value += strength[:, None] * gaussian.evaluate(np.log(gamma / material.gamma * width))[0]
    return value


def _higher_median(views: Sequence[tuple[Array, NDArray[np.bool_], Array]], mean: Array, prior: Array) -> Array:
    """(M, C) of the body colours that each photograph alone gives; within FARTHEST_BODY of `prior` from the mean."""
    each = np.stack([np.where(used, rest / np.where(used, lit, 1.0), -np.inf) for lit, used, rest in views])
    count = np.isfinite(each).sum(axis=0)
    falling = -np.sort(-each, axis=0)  # those that are unknown last
    place = np.maximum(count - 1, 0) // 2
    middle = np.take_along_axis(falling, place[None], axis=0)[0]
    off = FARTHEST_BODY / np.sqrt(prior)
    return np.where(count > 0, np.clip(middle, mean - off, mean + off), mean)


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


@dataclass(frozen=True, eq=False)
class Separation:
    """Parts (h, w, C) of photograph `number` of a capture, NaN where no material is known or the pixel is invalid."""

    number: int
    body: Array
    interface: Array


def separated(photograph: Photograph, parts: SeparatedParts, number: int) -> Separation:
    """The parts of `photograph`, which sum to its values; neither is negative except for noise."""
    values = np.where(photograph.mask[..., None], photograph.values.astype(np.float64), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        c = parts.body / np.linalg.norm(parts.body, axis=2, keepdims=True)
        e = parts.light / np.linalg.norm(parts.light, axis=2, keepdims=True)
        weight = 1.0 / (photograph.variance + (COLOUR_ERROR * values) ** 2)
        cc, ce, ee = ((weight * one * other).sum(axis=2) for one, other in ((c, c), (c, e), (e, e)))
        cv, ev = ((weight * one * values).sum(axis=2) for one in (c, e))
        determinant = np.maximum(cc * ee - ce**2, 1e-9 * cc * ee)
        by_colour, variance = (cc * ev - ce * cv) / determinant, cc / determinant
        by_material = (parts.interface * e).sum(axis=2)
        spread = (TRUST * by_material) ** 2 + FLOOR**2 * (values**2).sum(axis=2)
        strength = (by_colour * spread + by_material * variance) / (variance + spread)  # by the inverse variances
        most = np.min(np.where(e > 0.0, values / np.where(e > 0.0, e, 1.0), np.inf), axis=2)
        interface = np.clip(strength, 0.0, np.maximum(most, 0.0))[..., None] * e
    return Separation(number, values - interface, interface)


def write_separation(of: Separation, names: Sequence[str], home: Path) -> None:
    """separation_NN.exr (channels body.R, …, interface.R, …, linear, 0 where unknown) and a PNG of each part."""
    parts = {"body": np.nan_to_num(of.body), "interface": np.nan_to_num(of.interface)}
    channels = {f"{part}.{name}": one[..., k] for part, one in parts.items() for k, name in enumerate(names)}
    write_exr(home / f"separation_{of.number:02d}.exr", channels)
    known = np.isfinite(of.body).all(axis=2)
    brightest = float(np.percentile((parts["body"] + parts["interface"])[known], 99)) if known.any() else 1.0
    for part, one in parts.items():
        shown = one if one.shape[2] == 3 else np.repeat(one.mean(axis=2, keepdims=True), 3, axis=2)
        write_png(home / f"separation_{of.number:02d}_{part}.png", srgb_encode(shown / max(brightest, 1e-300)))
