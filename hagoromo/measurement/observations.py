"""Observations: the values of some pixels of a known shape in all photographs, from which reflectance is estimated.

Enters: a Capture with points [m] and normals (unit, world). Leaves: values with their variance and the geometry of
each sample, and a mask of those that may be fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.measurement.sight import NO_LAMP, Array, Sight, sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.reflectance.torrance_sparrow import Cosines

MOST_VALUES = 120_000  # values of one material that are fitted; more would add less than any error of the shape
STRATA = np.array([0.0, 0.05, 0.1, 0.2, 0.4, 0.8, np.pi])  # [rad] of the smallest φ of a pixel, equally represented
TILE = 16  # pixels, side of the image tiles within which residuals of an incomplete model are correlated
UNIT_LENGTH_TOLERANCE = 1e-3  # largest difference from 1 of the length of a unit normal


@dataclass(frozen=True, eq=False)
class Observations:
    """Values of N samples in C channels; a sample is one pixel in one photograph, lit by up to L lamps.

    values: (N, C) linear, in units of ρ of eq. (10). noise: (N, C) variance that the sensor states for the noisy value.
    gain: (N, C) slope of that variance against the value. used: (N, C) true where a value may be fitted.
    sight: geometry and irradiance of the samples. ceiling: (N, C) where the sensor saturates, inf where unknown.
    tile: (N,) number of the image tile of the sample; pixel: (N,) number of its pixel, the same in all photographs.
    shared: (N, C, Q) errors that the values have in common, of one standard deviation each, independent of one another;
    None: there are none.
    """

    values: Array
    noise: Array
    gain: Array
    used: NDArray[np.bool_]
    sight: Sight
    ceiling: Array
    tile: NDArray[np.int64]
    pixel: NDArray[np.int64]
    shared: Array | None = None

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.values.shape[1]

    def of(self, rows: NDArray) -> Observations:
        """The samples `rows`: indices, or a mask (N,)."""
        sight = Sight(Cosines(*(cosine[rows] for cosine in self.sight.cosines)), self.sight.irradiance[rows])
        keys = ("values", "noise", "gain", "used", "ceiling", "tile", "pixel")
        shared = None if self.shared is None else self.shared[rows]
        return replace(self, sight=sight, shared=shared, **{key: getattr(self, key)[rows] for key in keys})

    def variance_at(self, model: Array, model_error: float = 0.0) -> Array:
        """Variance of a value of expectation `model` (…, N, C), and of a relative error `model_error` of the model.

        The variance is stated for the noisy value. Used as it is, it would give low values too large a weight.
        """
        shot = self.noise + self.gain * (model - np.maximum(self.values, 0.0))
        return np.maximum(shot, 0.2 * self.noise) + (model_error * model) ** 2


@dataclass(frozen=True, eq=False)
class Pixels:
    """M pixels of the known shape: rows, columns (M,), points (M, 3) [m], normals (M, 3)."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    points: Array
    normals: Array

    @staticmethod
    def where(capture: Capture, region: NDArray[np.bool_]) -> Pixels:
        """The pixels of `region` (h, w)."""
        rows, columns = np.nonzero(region)
        points, normals = (vectors[rows, columns].astype(np.float64) for vectors in shape(capture))
        return Pixels(rows, columns, points, normals)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, chosen: NDArray) -> Pixels:
        return Pixels(self.rows[chosen], self.columns[chosen], self.points[chosen], self.normals[chosen])


def shape(capture: Capture) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points (h, w, 3) and normals (h, w, 3) of `capture`; `InputError` when it has none."""
    if capture.points is None or capture.normals is None:
        raise InputError(f"capture {capture.name!r} has no shape: give points_path and normals_path in its record")
    return capture.points, capture.normals


def known_shape(capture: Capture) -> NDArray[np.bool_]:
    """(h, w) where point and normal are known."""
    points, normals = shape(capture)
    finite = np.asarray(np.isfinite(points).all(axis=2) & np.isfinite(normals).all(axis=2))
    return finite & (
        np.abs(np.linalg.norm(np.where(finite[..., None], normals, 0.0), axis=2) - 1.0) < UNIT_LENGTH_TOLERANCE
    )


def observe(capture: Capture, region: NDArray[np.bool_], lamp_colour: Array | None, seed: int) -> Observations:
    """The samples of the pixels `region` (h, w) in all photographs: valid, lit and viewed above the grazing limit.

    Where there are more than MOST_VALUES, pixels are drawn so that each range of φ (STRATA) is equally represented,
    which retains the highlights. The draw depends on the geometry and `seed` alone, never on the values.
    """
    pixels = Pixels.where(capture, region)
    per_pixel = len(capture.photographs) * capture.photographs[0].values.shape[2]
    if len(pixels) * per_pixel > MOST_VALUES:
        pixels = pixels[stratified(capture, pixels, MOST_VALUES // per_pixel, seed)]
    return observe_pixels(capture, pixels, lamp_colour)


def observe_pixels(capture: Capture, pixels: Pixels, lamp_colour: Array | None) -> Observations:
    """The samples of `pixels` in all photographs: valid, lit and viewed above the grazing limit."""
    most_lamps = max(len(photograph.lamps) for photograph in capture.photographs)
    parts = [_observe(photograph, pixels, most_lamps, lamp_colour) for photograph in capture.photographs]
    values, noise, gain, used, ceiling, tile, pixel, irradiance, *cosines = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    return Observations(values, noise, gain, used, Sight(Cosines(*cosines), irradiance), ceiling, tile, pixel)


def _observe(photograph: Photograph, pixels: Pixels, lamps: int, lamp_colour: Array | None) -> tuple[NDArray, ...]:
    """Fields of `Observations` for one photograph, `lamps` wide."""
    index = pixels.rows, pixels.columns
    geometry = sight_of(photograph, pixels.points, pixels.normals, lamp_colour)
    measured = native(photograph)
    used = geometry.fit_to_use & photograph.mask[index]
    pixels, index = pixels[used], (pixels.rows[used], pixels.columns[used])
    missing = ((0, 0), (0, lamps - len(photograph.lamps)))
    cosines = [
        np.pad(cosine[used], missing, constant_values=empty)
        for cosine, empty in zip(geometry.cosines, NO_LAMP, strict=True)
    ]
    values = photograph.values[index].astype(np.float64)
    gain, ceiling = (
        np.broadcast_to(per_channel, values.shape) for per_channel in (noise_gain(photograph), _ceiling(photograph))
    )
    tile = (pixels.rows // TILE) * (photograph.values.shape[1] // TILE + 1) + pixels.columns // TILE
    pixel = pixels.rows * photograph.values.shape[1] + pixels.columns
    irradiance = np.pad(geometry.irradiance[used], (*missing, (0, 0)))
    noise = photograph.variance[index].astype(np.float64)
    return values, noise, gain, measured[index], ceiling, tile, pixel, irradiance, *cosines


def native(photograph: Photograph) -> NDArray[np.bool_]:
    """(h, w, C) samples that the sensor itself measured: their noise is independent."""
    if photograph.native is None:
        return np.ones(photograph.values.shape, bool)
    return photograph.native


def noise_gain(photograph: Photograph) -> Array:
    """(C,) slope of the stated variance against the value: shot noise."""
    slopes = []
    for channel in range(photograph.values.shape[2]):
        known = photograph.mask & native(photograph)[..., channel]
        value = np.maximum(photograph.values[..., channel][known].astype(np.float64), 0.0)
        variance = photograph.variance[..., channel][known].astype(np.float64)
        spread = float(np.var(value)) if value.size else 0.0
        slope = float(np.mean((value - value.mean()) * (variance - variance.mean()))) / spread if spread else 0.0
        slopes.append(max(slope, 0.0))
    return np.array(slopes)


def _ceiling(photograph: Photograph) -> Array:
    """(C,) largest valid value where masked pixels are as bright or brighter (saturated); else inf."""
    ceilings = np.full(photograph.values.shape[2], np.inf)
    for channel, values in enumerate(np.moveaxis(photograph.values, 2, 0)):
        largest = np.max(values, where=photograph.mask, initial=-np.inf)
        if np.max(values, where=~photograph.mask & np.isfinite(values), initial=-np.inf) >= largest:
            ceilings[channel] = largest
    return ceilings


def stratified(capture: Capture, pixels: Pixels, limit: int, seed: int) -> NDArray[np.intp]:
    """`limit` of the pixels, so that the strata of their smallest φ have sizes as equal as possible."""
    angle = np.full(len(pixels), np.pi)
    for photograph in capture.photographs:
        angle = np.minimum(angle, sight_of(photograph, pixels.points, pixels.normals).least_half_angle)
    return evenly_drawn(angle, limit, seed)


def evenly_drawn(half_angle: Array, limit: int, seed: int) -> NDArray[np.intp]:
    """Indices of `limit` samples of half angles φ (N,) [rad], so that strata of φ have sizes as equal as possible."""
    stratum = np.digitize(half_angle, STRATA[1:-1])
    random = np.random.default_rng(seed)
    members = sorted((random.permutation(np.flatnonzero(stratum == s)) for s in range(len(STRATA) - 1)), key=len)
    chosen: list[NDArray[np.intp]] = []
    for left, member in zip(range(len(members), 0, -1), members, strict=True):
        chosen.append(member[: (limit - sum(map(len, chosen))) // left])
    return np.sort(np.concatenate(chosen))
