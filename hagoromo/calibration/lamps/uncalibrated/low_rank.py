"""Low rank: photographs of a Lambertian object under far lamps are products of three numbers per lamp and per pixel.

    I_kp = s_k · b_p,  s strength times direction, b albedo times normal, up to one 3 × 3 matrix (Shashua 1997;
    Hayakawa 1994, "Photometric stereo under a light source with arbitrary motion")

Shadows are excluded, and highlights and cast shadows have low weight: Cauchy's weights, alternating least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.least_squares.loss import CAUCHY_SCALE, robust_scale

Array = NDArray[np.float64]

FEWEST_LAMPS = 5  # four photographs fit any three factors; five leave a residual that shows other than shading
FEWEST_PIXELS = 1500  # of the object
SHADOW = 0.15  # of a pixel's second largest value: below it the pixel is in shadow or penumbra
FAINT = 0.015  # of the 99th percentile of all values: below it noise and stray light dominate
LOW_RANK_STEPS = 25  # alternations of lamps and pixels
LARGEST_CHANGE = 1e-3  # relative change of the lamps in the last alternation of a fit that has converged
SIGNIFICANT = 2.0  # ratio of the third singular value to the residual, above which photographs have rank three


@dataclass(frozen=True, eq=False)
class Factors:
    """lamps (K, 3) and pixels (P, 3), whose products are the values over `size` (P,), the pixels' mean values.

    mask: (h, w) where the pixels are. residual: standard deviation of a value relative to its pixel's mean. status:
    how the alternation ended.
    """

    lamps: Array
    pixels: Array
    size: Array
    mask: NDArray[np.bool_]
    residual: float
    status: FitStatus

    def image(self) -> Array:
        """(h, w, 3) of `pixels`, NaN elsewhere."""
        whole = np.full((*self.mask.shape, 3), np.nan)
        whole[self.mask] = self.pixels
        return whole


def binned(image: NDArray, k: int) -> Array:
    """Means (h/k, w/k, ...) over k × k pixels of an image (h, w, ...); NaN where one is NaN."""
    height, width = (n // k for n in image.shape[:2])
    parts = image[: height * k, : width * k].reshape(height, k, width, k, *image.shape[2:])
    return np.asarray(parts.mean(axis=(1, 3), dtype=np.float64))


def lit(values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """values (K, P) with 0 where clipped, and which of them are lit and not clipped."""
    shine = np.nan_to_num(values)
    least = np.maximum(SHADOW * np.sort(shine, axis=0)[-2], FAINT * np.quantile(shine, 0.99))
    return shine, np.isfinite(values) & (shine > least)


def factorise(light: Array, mask: NDArray[np.bool_]) -> Factors:
    """The factors of `light` (K, h, w), NaN where clipped, over the object in `mask`.

    `InputError` for too few photographs or pixels, or photographs of lower rank than three.
    """
    if len(light) < FEWEST_LAMPS:
        raise InputError(f"{len(light)} photographs do not calibrate their lamps: give {FEWEST_LAMPS} lamps or more")
    shine, used = lit(light[:, mask])
    usable = used.sum(axis=0) >= max(FEWEST_LAMPS - 1, len(light) // 2)
    if usable.sum() < FEWEST_PIXELS:
        raise InputError(
            f"{int(usable.sum())} pixels of the object are lit by most lamps and not clipped: "
            f"{FEWEST_PIXELS} are needed"
        )
    where = mask.copy()
    where[mask] = usable
    values, used = shine[:, usable], used[:, usable]
    size = np.maximum(values.sum(axis=0) / len(values), 1e-30)
    lamps, pixels, residual, status = _alternate(values / size, used)
    weakest = float(np.linalg.svd(lamps, compute_uv=False)[2] / np.sqrt(len(lamps)))
    if weakest < SIGNIFICANT * residual:
        raise InputError(
            "the photographs differ in fewer than three ways: the lamps lie in one plane with the object, or it is "
            "flat: move a lamp out of the plane, or calibrate with a ball"
        )
    return Factors(lamps, pixels, size, where, residual, status)


def _alternate(values: Array, used: NDArray[np.bool_]) -> tuple[Array, Array, float, FitStatus]:
    """lamps (K, 3), pixels (P, 3) with unit second moments, the scale of the residuals, and the fit's status."""
    start = values[:, used.all(axis=0)]
    start = start if start.shape[1] > FEWEST_PIXELS // 3 else values
    vectors, singular, _ = np.linalg.svd(start @ start.T)
    lamps = vectors[:, :3] * np.sqrt(singular[:3])
    weight, pixels, residual = used.astype(np.float64), np.zeros((values.shape[1], 3)), 0.0
    change = np.inf
    for _ in range(LOW_RANK_STEPS):
        last = lamps
        square = np.einsum("kp,ki,kj->pij", weight, lamps, lamps, optimize=True) + 1e-9 * np.eye(3)
        rhs = np.einsum("kp,ki->pi", weight * values, lamps)
        pixels = np.linalg.solve(square, rhs[..., None])[..., 0]
        off = values - lamps @ pixels.T
        free = np.sqrt(used.sum() / max(used.sum() - 3.0 * len(pixels), 1.0))
        residual = float(robust_scale(off[used]) * free)
        weight = used / (1.0 + (off / (CAUCHY_SCALE * max(residual, 1e-12))) ** 2)
        square = np.einsum("kp,pi,pj->kij", weight, pixels, pixels, optimize=True)
        lamps = np.linalg.solve(square, ((weight * values) @ pixels)[..., None])[..., 0]
        root = np.linalg.cholesky(pixels.T @ pixels / len(pixels))
        pixels, lamps = np.linalg.solve(root, pixels.T).T, lamps @ root
        change = float(np.linalg.norm(lamps - last) / np.linalg.norm(lamps))
    status = Status.CONVERGED if change < LARGEST_CHANGE else Status.OUT_OF_STEPS
    return lamps, pixels, residual, FitStatus(status, LOW_RANK_STEPS, last_step=change)
