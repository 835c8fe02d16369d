"""Lamp colour from highlights: the dichromatic planes of several materials intersect in the colour of the interface.

The values of one material, α cosθ_i c_b + w_s e, lie in a plane of the channels' space through its body colour and the
lamp's. The planes of two or more materials share the lamp's colour only (Klinker, Shafer & Kanade 1988; Tominaga &
Wandell 1989). Lamps of one capture are taken to have one colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status
from hagoromo.least_squares.loss import HUBER, HUBER_SCALE
from hagoromo.measurement.material.segment import interior
from hagoromo.measurement.observations import Pixels, known_shape, noise_gain, stratified
from hagoromo.measurement.sight import Array, sight_of
from hagoromo.photograph.capture import Capture

MOST_PIXELS = 3000  # of a material
SEED = 0
LARGEST_ERROR = 0.1  # largest standard error of a chromaticity of a usable lamp colour
FEWEST_VALUES = 100  # of a material
SIGNIFICANT = 10.0  # standard deviations of the scatter of noise alone
STEP, WIDE_STEP = 1e-6, 1e-4  # [rad] of numerical first and second derivatives
LAMP_COLOUR_STEPS: int | None = None  # largest number of evaluations of one fit; None is SciPy's 100 per unknown
LAMP_COLOUR_ROUNDS = 3  # of re-weighting by the variance of the fitted value


@dataclass(frozen=True, eq=False)
class LampColour:
    """Colour of the lamps in the channels of the camera.

    value: (3,) mean 1. covariance: (3, 3) of value.
    """

    value: Array
    covariance: Array

    @property
    def standard_error(self) -> Array:
        """(3,) of value."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative_covariance(self) -> Array:
        """(3, 3) covariance of ln value."""
        return self.covariance / np.outer(self.value, self.value)


def lamp_colour(capture: Capture, labels: NDArray[np.integer]) -> LampColour:
    """Colour of the lamps of `capture` from the highlights of the materials `labels` (h, w; −1 unknown).

    All planes are fitted at once: the lamp's direction and one angle per material, by least squares of the distances
    from the planes over their noise, with Huber's loss. `InputError` for other than three channels, and when the
    highlights do not determine the colour: fewer than two materials, of too similar a colour, or too little gloss.
    """
    channels = capture.photographs[0].values.shape[2]
    if channels != 3:
        raise InputError(f"a lamp colour from highlights needs 3 channels: given {channels}; give the lamp's spectrum")
    numbers = range(int(np.max(labels, initial=-1)) + 1)
    clouds = [cloud for n in numbers if _is_plane(cloud := _cloud(capture, interior(labels, n)))]
    if len(clouds) < 2:
        raise InputError(f"only {len(clouds)} material(s) show a highlight, the lamp colour needs 2: give its spectrum")
    colour = _meeting(clouds)
    if not (colour.standard_error.max() < LARGEST_ERROR and colour.value.min() > 0.0):
        raise InputError(
            f"the highlights leave the lamp colour open (standard error {colour.standard_error.max():.2g}): "
            "give its spectrum"
        )
    return colour


class Cloud(NamedTuple):
    """Values (M, 3) of one material, their stated variance (M, 3) and its slope (M, 3) against the value."""

    values: Array
    noise: Array
    gain: Array


def _cloud(capture: Capture, region: NDArray[np.bool_]) -> Cloud:
    """Values of a material in all photographs, at pixels of every φ, so that diffuse and specular light are present."""
    pixels = Pixels.where(capture, region & known_shape(capture))
    pixels = pixels[stratified(capture, pixels, MOST_PIXELS, SEED)]
    parts = []
    for photograph in capture.photographs:
        index = pixels.rows, pixels.columns
        used = sight_of(photograph, pixels.points, pixels.normals).fit_to_use & photograph.mask[index]
        values, noise = (image[index][used].astype(np.float64) for image in (photograph.values, photograph.variance))
        parts.append((values, noise, np.broadcast_to(noise_gain(photograph), values.shape)))
    return Cloud(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _meeting(clouds: list[Cloud]) -> LampColour:
    """The line in which the planes of all clouds intersect, by least squares; its covariance is the sandwich."""
    planes = np.stack([_axes(cloud)[1][:, 0] * np.sqrt(_axes(cloud)[0][1]) for cloud in clouds])
    start = np.linalg.svd(planes)[2][2]
    start = start * np.sign(start.sum())
    aside = np.linalg.svd(start[None])[2][1:]

    def lamp(x: Array) -> Array:
        return start + x[:2] @ aside

    def normals(x: Array) -> list[Array]:
        """Of the planes through the lamp's direction, each turned about it by its own angle."""
        first = np.cross(lamp(x), aside[1])
        first, second = (v / np.linalg.norm(v) for v in (first, np.cross(lamp(x), first)))
        return [np.cos(angle) * first + np.sin(angle) * second for angle in x[2:]]

    def distances(x: Array, variances: list[Array]) -> Array:
        """Distances from the planes over their noise. The noise depends on the plane too; else the fit is biased."""
        triples = zip(clouds, normals(x), variances, strict=True)
        return np.concatenate([cloud.values @ p / np.sqrt(variance @ p**2) for cloud, p, variance in triples])

    first, second = normals(np.array([0.0, 0.0, 0.0, np.pi / 2]))
    x = np.array([0.0, 0.0, *np.arctan2(planes @ second, planes @ first)])
    variances = [cloud.noise for cloud in clouds]
    for _ in range(LAMP_COLOUR_ROUNDS):
        fit = least_squares(
            distances,
            x,
            args=(variances,),
            loss="huber",
            f_scale=HUBER_SCALE,
            x_scale="jac",
            max_nfev=LAMP_COLOUR_STEPS,
        )
        if not scipy_status(fit).converged:
            raise InputError(f"{scipy_status(fit).remark('the lamp colour')}: give the lamp's spectrum")
        x = fit.x
        variances = [_variance_at_foot(cloud, p) for cloud, p in zip(clouds, normals(x), strict=True)]

    def scores(point: Array) -> Array:
        """Contribution of each value to the gradient of Σρ: (M, P)."""
        r = distances(point, variances)
        steps = STEP * np.eye(len(point))
        j = [distances(point + step, variances) - distances(point - step, variances) for step in steps]
        return np.stack(j, axis=1) / (2 * STEP) * (HUBER.weight(r) * r)[:, None]

    # the whole Hessian: JᵀJ alone would count the noise within the planes as information about them
    steps = WIDE_STEP * np.eye(len(x))
    hessian = np.stack([(scores(x + s) - scores(x - s)).sum(axis=0) for s in steps]) / (2 * WIDE_STEP)
    inverse = np.linalg.pinv(0.5 * (hessian + hessian.T), hermitian=True)
    spread = (inverse @ (scores(x).T @ scores(x)) @ inverse)[:2, :2]
    colour = lamp(x)
    value = colour / colour.mean()
    slope = (aside.T - value[:, None] * aside.mean(axis=1)) / colour.mean()
    return LampColour(value, slope @ spread @ slope.T)


def _is_plane(cloud: Cloud) -> bool:
    """Whether the values deviate from the line of their body colour by more than the noise."""
    return len(cloud.values) >= FEWEST_VALUES and bool(
        _axes(cloud)[0][1] > SIGNIFICANT * np.sqrt(2.0 * len(cloud.values))
    )


def _axes(cloud: Cloud) -> tuple[Array, Array]:
    """Scatter of the values over their noise along its principal axes, ascending, less that of the noise; the axes."""
    scale = cloud.noise.mean(axis=1)
    noise = np.diag((cloud.noise / scale[:, None]).sum(axis=0))
    return np.linalg.eigh(cloud.values.T @ (cloud.values / scale[:, None]) - noise)


def _variance_at_foot(cloud: Cloud, normal: Array) -> Array:
    """Variance (M, 3) of the sensor at the foot of each value in the plane."""
    across = cloud.noise @ normal**2
    foot = cloud.values - cloud.noise * normal * (cloud.values @ normal / across)[:, None]
    return np.maximum(cloud.noise + cloud.gain * (foot - np.maximum(cloud.values, 0.0)), 0.2 * cloud.noise)
