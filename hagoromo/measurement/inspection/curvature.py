"""Curvature: how much a surface bends at each pixel, from the change of its normals, with its standard error.

H = ½ tr(I⁻¹ M), the mean of the two principal curvatures, with I_ij = P_i·P_j and M_ij = n_i·P_j: indices are
derivatives of point P and unit normal n along the columns and rows of the picture (do Carmo 1976, §3.3). It is positive
where the surface bulges towards the camera (1/R on a ball of radius R), negative in a groove.

Normals are differentiated by a Gaussian of `width` pixels: detail narrower than that is averaged. Points enter by
their distance alone, as P lies on the ray of its pixel and in the plane across n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from hagoromo.errors import InputError
from hagoromo.measurement.inspection.seen_surface import SeenSurface

Array = NDArray[np.float64]
WIDTH = 1.0  # px, of the Gaussian
LEAST_WIDTH, MOST_WIDTH = 0.5, 50.0  # px
CUT_OFF = 3.0  # widths, at which the Gaussian ends
GRAZING = 0.05  # cosine between normal and line of sight, below which a pixel shows a silhouette, no surface


@dataclass(frozen=True, eq=False)
class Curvature:
    """value: (h, w) mean curvature [1/unit], NaN where unknown. error: its standard error; None: not known.

    unit: mm, or px where the scale is unknown. width: of the Gaussian [px].
    """

    value: Array
    error: Array | None
    unit: str
    width: float


def curvature(surface: SeenSurface, width: float = WIDTH) -> Curvature:
    """The mean curvature of `surface` by normals under a Gaussian of `width` [px].

    Unknown, NaN, within three widths of what is unknown. The error is an upper bound where normals were smoothed: it is
    the smaller of that of unsmoothed normals and that of neighbours that err alike. `InputError` for a bad width.
    """
    if not LEAST_WIDTH <= width <= MOST_WIDTH:
        raise InputError(f"a width of {width:g} px: give {LEAST_WIDTH:g} to {MOST_WIDTH:g}")
    kernels = _kernels(width)
    inside = surface.known & _all_known(surface.known, len(kernels[0]) // 2)
    mean = _filtered(surface.normals, kernels[1], kernels[1])
    mean = mean / np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1e-12)
    across, facing = _weights(surface, mean)
    inside &= facing > GRAZING
    slopes = [_filtered(surface.normals, *pair) for pair in (kernels, kernels[::-1])]  # along x, along y
    value = 0.5 * sum(np.einsum("hwi,hwi->hw", slope, a) for slope, a in zip(slopes, across, strict=True))
    error = None if surface.own_variance is None else np.sqrt(_variance(surface, across, kernels))
    of_unit = 1.0 / surface.units_per_metre
    return Curvature(
        np.where(inside, value * of_unit, np.nan),
        None if error is None else np.where(inside, error * of_unit, np.nan),
        surface.unit,
        width,
    )


def _kernels(width: float) -> tuple[Array, Array]:
    """Weights of the derivative along one axis and of the mean along the other, for correlation.

    A normal that changes by 1 a pixel has the derivative 1 exactly.
    """
    reach = int(np.ceil(CUT_OFF * width))
    x = np.arange(-reach, reach + 1.0)
    mean = np.exp(-0.5 * (x / width) ** 2)
    slope = x * mean
    return slope / (slope * x).sum(), mean / mean.sum()


def _filtered(maps: Array, along_x: Array, along_y: Array) -> Array:
    return correlate1d(correlate1d(maps, along_x, axis=1, mode="constant"), along_y, axis=0, mode="constant")


def _all_known(known: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    from scipy.ndimage import minimum_filter

    return np.asarray(minimum_filter(known, size=2 * reach + 1, mode="constant", cval=False), bool)


def _weights(surface: SeenSurface, normals: Array) -> tuple[list[Array], Array]:
    """Of x and y: Σ_j I⁻¹_ij P_j (h, w, 3) [1/m], so that H = ½ Σ n_i·these; and the cosine to the line of sight."""
    ray = surface.camera.pixel_directions()
    facing = -np.einsum("hwi,hwi->hw", normals, ray)
    safe = np.where(facing > GRAZING, facing, 1.0)
    steps = []
    for axis in (1, 0):
        turn = np.gradient(ray, axis=axis)
        farther = np.einsum("hwi,hwi->hw", normals, turn) / safe  # of ln distance
        steps.append(surface.away[..., None] * (turn + farther[..., None] * ray))
    (xx, xy), (_, yy) = ([np.einsum("hwi,hwi->hw", a, b) for b in steps] for a in steps)
    area = np.maximum(xx * yy - xy**2, 1e-300)
    along_x = (yy[..., None] * steps[0] - xy[..., None] * steps[1]) / area[..., None]
    along_y = (xx[..., None] * steps[1] - xy[..., None] * steps[0]) / area[..., None]
    return [along_x, along_y], facing


def _variance(surface: SeenSurface, across: list[Array], kernels: tuple[Array, Array]) -> Array:
    """(h, w) of H [1/m²]: of each pixel's own errors, and of those that all share."""
    assert surface.own_variance is not None and surface.summed_variance is not None
    slope, mean = kernels
    squares = [np.einsum("hwi,hwi->hw", a, a) for a in across]
    product = np.einsum("hwi,hwi->hw", *across)
    # a turn about each of two axes has half of the variance of the direction; 0.25 is that of ½ Σ
    half = 0.5 * 0.25 * surface.summed_variance[..., None]
    by_x, by_y, both = (
        _filtered(half, *pair)[..., 0]
        for pair in ((slope**2, mean**2), (mean**2, slope**2), (slope * mean, slope * mean))
    )
    independent = squares[0] * by_x + squares[1] * by_y + 2.0 * product * both
    size = float(np.abs(slope).sum())  # of errors that are alike up to their sign
    alike = 0.5 * 0.25 * size**2 * surface.own_variance * (np.sqrt(squares[0]) + np.sqrt(squares[1])) ** 2
    total = np.minimum(np.maximum(independent, 0.0), alike)
    for mode in () if surface.shared is None else surface.shared.normals:
        parts = (_filtered(mode.astype(np.float64), *pair) for pair in (kernels, kernels[::-1]))
        total = (
            total + (0.5 * sum(np.einsum("hwi,hwi->hw", part, a) for part, a in zip(parts, across, strict=True))) ** 2
        )
    return total
