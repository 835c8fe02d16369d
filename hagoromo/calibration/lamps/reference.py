"""Reference: a matte ball or card of known reflectance next to the chrome ball, and the strength of lamps from it.

A Lambertian surface of albedo ρ has the value v = (ρ/π) E max(N·L, 0) + a, with E the irradiance that faces the lamp
and `a` the ambient light. E, per channel, is in π times the unit of the photographs' values, so that a lamp of
intensity E explains photographs that are developed in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, find_ball, grey
from hagoromo.calibration.lamps.reading import Strength
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.loss import CAUCHY_SCALE, robust_scale
from hagoromo.least_squares.rows import reweighted

INNER = 0.96  # of the radius: pixels outside are steep and half background
LIT, DARK = 0.15, -0.15  # N·L above which the ball is fully lit, and below which it is dark, also under a broad lamp
SHADED = 0.3  # smallest N·L of pixels whose shading gives a direction: near the shadow no surface is Lambertian
FEWEST = 60  # pixels
CLIPPED = 0.3  # largest share of the lit pixels that may be clipped
TILES = 8  # across the reference: residuals (stains, grain) are correlated within one
REGRESSION_REWEIGHTINGS = 15
LARGEST_CHANGE = 1e-3  # relative change of the coefficients in the last reweighting of a fit that has converged


@dataclass(frozen=True, eq=False)
class Reference:
    """points (n, 2) [px] and pixels (rows, columns) of a matte surface, normal (n, 3), place (n, 3) [m] or None.

    place: world; None unless of a ball of known radius and a camera. tiles: (n,). reflectance: one number, or one per
    channel. is_ball: the normals of a card are all equal.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    normal: Array
    place: Array | None
    tiles: NDArray[np.intp]
    reflectance: tuple[float, ...]
    is_ball: bool


def matte_ball(ball: Ball, shape: tuple[int, ...], reflectance: ArrayLike, radius: float | None = None) -> Reference:
    """A matte ball in pictures of `shape`; radius [m]: needed where a lamp is near."""
    from skimage.draw import polygon2mask

    inner = np.asarray(polygon2mask(shape[:2], ball.outline(360, INNER)[:, ::-1] - 0.5))
    rows, columns = np.nonzero(inner)
    shown = ball.mirrored(np.stack([columns, rows], axis=1) + np.float64(0.5))
    place = None
    if radius is not None and ball.camera is not None:
        place = ball.camera.position + radius * (shown.centre + shown.normal)
    return Reference(rows, columns, shown.normal, place, _tiles(rows, columns), _reflectance(reflectance), True)


def matte_card(mask: NDArray, normal: ArrayLike, reflectance: ArrayLike) -> Reference:
    """A flat matte card, white in `mask` (height, width[, channels]), with its normal (3,) in the axes of the lamps."""
    level = grey(mask)
    rows, columns = np.nonzero(level > 0.99 * level.max() if level.max() > 0.0 else np.zeros(level.shape, np.bool_))
    if len(rows) < FEWEST:
        raise InputError(f"the mask of the reference has {len(rows)} white pixels: {FEWEST} are needed")
    unit = np.asarray(normal, np.float64).reshape(3)
    if not (np.isfinite(unit).all() and np.linalg.norm(unit) > 0.0):
        raise InputError(f"the normal of the reference is {unit.tolist()}: give the direction that the card faces")
    normals = np.broadcast_to(unit / np.linalg.norm(unit), (len(rows), 3))
    return Reference(rows, columns, normals, None, _tiles(rows, columns), _reflectance(reflectance), False)


def find_matte_ball(
    mask: NDArray, camera: Camera | None, reflectance: ArrayLike, radius: float | None = None
) -> Reference:
    """The matte ball that is white in `mask`."""
    try:
        return matte_ball(find_ball(mask, camera), mask.shape, reflectance, radius)
    except InputError as error:
        raise InputError(f"the reference: {error}") from error


def reference_strength(
    light: NDArray, reference: Reference, to_lamp: ArrayLike | None, position: ArrayLike | None = None
) -> Strength:
    """Strength of the lamp at `position` [m], or in the direction `to_lamp`, by its light on the reference.

    light: (height, width, channels) linear, NaN where clipped or unknown. For a far lamp a matte ball also gives the
    direction, by its shading. `InputError` where the reference is clipped, dark, or its position unknown. Whether the
    regressions converged is stated in `Strength.statuses`; a shading fit that did not converge is left out.
    """
    towards, falloff = _incident(reference, to_lamp, position)
    cosine = np.sum(reference.normal * towards, axis=1)
    values = light[reference.rows, reference.columns].astype(np.float64)
    known = np.asarray(np.isfinite(values).all(axis=1))
    lit = cosine > LIT
    if lit.sum() < FEWEST:
        raise InputError("no visible pixel of the reference is lit by this lamp: turn the reference or move it")
    if np.mean(~known[lit]) > CLIPPED:
        raise InputError(
            f"the reference is clipped in {100 * np.mean(~known[lit]):.0f} % of its lit pixels: expose shorter"
        )
    used = known & (lit | ((cosine < DARK) & reference.is_ball))
    bright = np.maximum(cosine * falloff, 0.0)[used, None]
    design = np.c_[bright, np.ones(len(bright))] if reference.is_ball else bright
    fits = [robust_regression(design, values[used, c], reference.tiles[used]) for c in range(values.shape[1])]
    scale = np.pi / np.broadcast_to(reference.reflectance, len(fits))
    intensity = scale * np.array([fit.coefficients[0] for fit in fits])
    if not (intensity > 0.0).all():
        raise InputError("the reference does not brighten towards the lamp: is it the mask of the matte reference?")
    shading = _shading(reference, values.mean(axis=1), known & (cosine > SHADED)) if position is None else None
    return Strength(
        intensity,
        scale * np.sqrt([fit.covariance[0, 0] for fit in fits]),
        "reference",
        float(np.mean([fit.scatter / (fit.coefficients[0] * bright.max()) for fit in fits])),
        shading if reference.is_ball else None,
        tuple(fit.status for fit in fits),
    )


def _shading(reference: Reference, values: Array, used: NDArray[np.bool_]) -> tuple[Array, float] | None:
    """Direction (3,) to a far lamp and its standard error [°] by the shading of a matte ball: v = N·g + a."""
    if used.sum() < FEWEST:
        return None
    design = np.c_[reference.normal[used], np.ones(int(used.sum()))]
    fit: Regression = robust_regression(design, values[used], reference.tiles[used])
    if not fit.status.converged:
        return None
    length = float(np.linalg.norm(fit.coefficients[:3]))
    unit = fit.coefficients[:3] / length
    across = np.eye(3) - np.outer(unit, unit)
    return unit, float(np.degrees(np.sqrt(np.trace(across @ fit.covariance[:3, :3] @ across)) / length))


def _incident(
    reference: Reference, to_lamp: ArrayLike | None, position: ArrayLike | None
) -> tuple[Array, Array | float]:
    """Unit directions (n, 3) to the lamp, and irradiance facing it over its intensity (n,)."""
    if position is None:
        return np.broadcast_to(np.asarray(to_lamp, np.float64), reference.normal.shape), 1.0
    if reference.place is None:
        raise InputError(
            "the strength of a near lamp needs the place of the reference: give a matte ball, its radius "
            "(--reference-radius), and a camera (--camera)"
        )
    offset = np.asarray(position, np.float64) - reference.place
    distance = np.linalg.norm(offset, axis=1)
    return offset / distance[:, None], 1.0 / distance**2


def _tiles(rows: NDArray, columns: NDArray) -> NDArray[np.intp]:
    side = max((int(np.ptp(rows)) + 1) / TILES, 1.0)
    return ((rows - rows.min()) // side * (TILES + 64) + (columns - columns.min()) // side).astype(np.intp)


def _reflectance(reflectance: ArrayLike) -> tuple[float, ...]:
    values = np.atleast_1d(np.asarray(reflectance, np.float64))
    if values.ndim != 1 or len(values) not in (1, 3) or not ((values > 0.0) & (values <= 1.0)).all():
        raise InputError(f"the reflectance is {values.tolist()}: give one number above 0, up to 1, or one per channel")
    return tuple(values.tolist())


class Regression(NamedTuple):
    """coefficients (p,), their covariance (p, p), and scatter: standard deviation of the residuals, by their median.

    status: how the reweighting ended.
    """

    coefficients: Array
    covariance: Array
    scatter: float
    status: FitStatus


def robust_regression(design: Array, values: Array, tiles: NDArray[np.integer]) -> Regression:
    """values (n,) = design (n, p) · coefficients, with Cauchy's weights.

    tiles: (n,) number of the tile of each value; the covariance is clustered by them (Liang and Zeger 1986).
    """
    smallest = 1e-12 * np.abs(values).max() + 1e-30

    def solve(weight: Array) -> tuple[Array, Array]:
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        return np.asarray(coefficients, np.float64), values - design @ coefficients

    def reweigh(residuals: Array) -> Array:
        return 1.0 / (1.0 + (residuals / max(CAUCHY_SCALE * robust_scale(residuals), smallest)) ** 2)

    start = np.ones(len(values))
    coefficients, weight, status = reweighted(solve, reweigh, start, REGRESSION_REWEIGHTINGS, LARGEST_CHANGE)
    residuals = values - design @ coefficients
    scatter = robust_scale(residuals)
    inverse = np.linalg.pinv(design.T @ (design * weight[:, None]))
    score = np.zeros((int(tiles.max()) + 1, design.shape[1]))
    np.add.at(score, tiles, design * (weight * residuals)[:, None])
    score = score[np.bincount(tiles, minlength=len(score)) > 0]
    few = len(score) / max(len(score) - design.shape[1], 1)
    return Regression(
        np.asarray(coefficients, np.float64), few * inverse @ (score.T @ score) @ inverse, scatter, status
    )
