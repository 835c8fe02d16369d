"""Scale: photographs of an object at one binning and one distance of compared pixels, and the lamps from them.

Perspective: diverging rays determine tilt and relief as well, so all of C is estimated together.

The cost is that of the bas-relief parameters plus the robust residual of integrability, with its effective number of
independent rows. A hollow surface has another cost in perspective, so the start must have the right sign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.bas_relief import (
    CLIP,
    Family,
    IntegrabilityRows,
    ObjectPrior,
    first_rows,
    resolve,
    rows,
)
from hagoromo.calibration.lamps.uncalibrated.low_rank import Array, Factors, binned, factorise
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, scipy_status
from hagoromo.least_squares.loss import robust_scale
from hagoromo.progress import Progress

SCALES, NEIGHBOUR_STEPS = (1, 2, 3), (1, 2)  # binning, and distance [pixel] of compared neighbours
FEWEST_ROWS = 100  # of integrability
UNIDENTIFIABLE = 0.8  # ratio of `first_rows` above which integrability does not determine the lamps
TILES = 12  # across the object, resampled for errors
SWEEPS, FEWER = 10, 2  # of Powell's method in perspective: from an orthographic view, and from a resampled one
FLIP = np.array([-1.0, -1.0, 1.0])  # convex to hollow
INDEPENDENT_ROWS = 200.0  # effective number of rows with independent residuals
SAMPLES = 2000  # rows that are evaluated


class ScaledLamps(NamedTuple):
    """lamps (K, 3), pixels (P, 3), c₁ and c₂ (2, 3), the bas-relief parameters, and how their fit ended."""

    lamps: Array
    pixels: Array
    first: Array
    figures: Array
    status: FitStatus


@dataclass(frozen=True, eq=False)
class Scale:
    """Factors at one binning, the rows of integrability at one step, c₁ and c₂, and their uncertainty `ratio`.

    status: how the fit of c₁ and c₂ ended. sample: pixels whose albedos are used; None for all.
    """

    factors: Factors
    rows: IntegrabilityRows
    first: Array
    ratio: float
    afar: bool
    status: FitStatus
    sample: NDArray[np.intp] | None = None

    def family(self, first: Array) -> Family:
        """The surfaces and lamps that c₁ and c₂ leave possible."""
        return Family(self.factors, first, self.sample)

    def solved(self, prior: ObjectPrior, start: ScaledLamps | None = None) -> ScaledLamps:
        """The lamps, from `start`, of nearly the same data, where given."""
        first, figures = self.first, None if start is None else start.figures
        if start is not None and not self.afar:
            first = start.first
        family = self.family(first)
        figures, status = resolve(family, prior, figures)
        if not self.afar:
            if self.turned_away(family.true(family.third(figures))[1]) < 0.5:
                first, figures = -first, figures * FLIP
            sweeps = SWEEPS if start is None else FEWER
            first, figures, status = resolve_in_perspective(self.family, self.rows, first, figures, prior, sweeps)
            family = self.family(first)
        return ScaledLamps(*family.true(family.third(figures)), first, figures, status)

    def drawn(self, random: np.random.Generator) -> Scale:
        """The same with tiles of the object resampled."""
        pixels = np.argwhere(self.factors.mask)
        corner, side = pixels.min(axis=0), max(int(np.ptp(pixels, axis=0).max()) // TILES, 1)
        drawn = random.poisson(1.0, (2 * TILES + 2, 2 * TILES + 2))  # times that each tile counts

        def again(place: NDArray[np.intp]) -> NDArray[np.intp]:
            row, column = ((place - corner) // side).T
            return np.repeat(np.arange(len(place)), drawn[row, column])

        some = self.rows.chosen(again(self.rows.place))
        first, _, status = first_rows(some)
        first = _same_sign(first, self.first)
        return Scale(self.factors, some, first, self.ratio, self.afar, status, again(pixels))

    def turned_away(self, pixels: Array) -> float:
        """Share of the outline's pixels whose normal points out of it."""
        from scipy.ndimage import binary_erosion, gaussian_filter

        mask = self.factors.mask
        soft = gaussian_filter(mask.astype(np.float64), 3.0)
        outward = -np.stack([np.gradient(soft, axis=1), -np.gradient(soft, axis=0)], axis=2)[mask]
        edge = np.logical_not(binary_erosion(mask, iterations=2, border_value=1))[mask]
        return float(np.mean(np.sum(outward * pixels[:, :2], axis=1)[edge] > 0.0)) if edge.any() else 0.5


def scales_of(light: Array, mask: NDArray[np.bool_], tangent: Array, progress: Progress) -> list[Scale]:
    """All scales of light (K, h, w) at which the object is large enough, the most certain first."""
    scales: list[Scale] = []
    for i, k in enumerate(SCALES):
        progress(0.2 * i, "shading")
        shine, where = np.stack([binned(picture, k) for picture in light]), binned(mask, k) == 1.0
        try:
            factors = factorise(shine, where)
        except InputError:
            if scales:
                break
            raise
        rays = binned(tangent, k)
        for step in NEIGHBOUR_STEPS:
            lines = rows(factors.image(), step, rays)
            if len(lines.along) > FEWEST_ROWS:
                first, ratio, status = first_rows(lines)
                scales.append(Scale(factors, lines, first, ratio, not tangent.any(), status))
    scales.sort(key=lambda scale: scale.ratio)
    if not scales or scales[0].ratio > UNIDENTIFIABLE:
        raise InputError(
            "the object's shading does not determine the lamps: it is flat, too rough, or not matte: use a chrome ball"
        )
    return scales


def _same_sign(first: Array, like: Array) -> Array:
    return first if np.sum(first * like) > 0.0 else -first


def resolve_in_perspective(
    family_of: Callable[[Array], Family],
    lines: IntegrabilityRows,
    first: Array,
    figures: Array,
    prior: ObjectPrior,
    sweeps: int,
) -> tuple[Array, Array, FitStatus]:
    """c₁ and c₂ (2, 3) and the bas-relief parameters, starting from those of an orthographic view, by Powell's method,
    and how that ended.

    family_of: c₁ and c₂ → the surfaces and lamps that they leave possible.
    """
    from scipy.optimize import minimize

    count = len(lines.along)
    some = np.random.default_rng(0).choice(count, min(SAMPLES, count), replace=False)
    along, beyond, start = lines.along[some], lines.beyond[some], first.ravel()
    scale = CLIP * robust_scale(along @ start)
    free = np.linalg.svd(start[None])[2][1:]  # of unit length: five degrees of freedom

    def rows_at(moved: Array) -> Array:
        unit = start + moved[:5] @ free
        return (unit / np.linalg.norm(unit)).reshape(2, 3)

    def cost(moved: Array) -> float:
        pair = rows_at(moved)
        family = family_of(pair)
        third = family.third(moved[5:]) @ np.stack([*pair, np.cross(pair[0], pair[1])])
        off = along @ pair.ravel() + beyond @ third
        return INDEPENDENT_ROWS * float(np.log(np.mean(np.log1p((off / scale) ** 2)))) + family.cost(moved[5:], prior)

    options = {"maxiter": sweeps, "xtol": 1e-3, "ftol": 1e-5}
    best = minimize(cost, np.r_[np.zeros(5), figures], method="Powell", options=options)
    return rows_at(best.x), best.x[5:], scipy_status(best)


def reduced(
    photographs: Mapping[str, NDArray], mask: NDArray[np.bool_], camera: Camera | None, most: int
) -> tuple[Array, NDArray[np.bool_], Array]:
    """light (K, h, w, C), mask (h, w), tangent (h, w, 2) of the region of the object, binned to at most `most` pixels.

    tangent: x right, y up of the rays (x, y, −1); 0 in an orthographic view. One photograph is in memory at a time.
    """
    if not mask.any():
        raise InputError("the mask of the object is black: paint the object white")
    if camera is not None and (camera.height, camera.width) != mask.shape:
        size = f"{camera.height} × {camera.width}"
        raise InputError(f"the camera is {size} pixels and the mask {mask.shape}: resize the mask to {size}")
    k = int(np.ceil(np.sqrt(max(mask.sum() / most, 1.0))))
    about = tuple(
        slice(max(int(filled.min()) - 4 * k, 0), int(filled.max()) + 4 * k + 1)
        for filled in (np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0)))
    )
    light = []
    for name, photograph in photographs.items():
        if photograph.shape[:2] != mask.shape:
            raise InputError(f"{name} is {photograph.shape[:2]} pixels and the mask {mask.shape}: give them one size")
        light.append(binned(photograph.reshape(*mask.shape, -1)[about], k))
    on_object = binned(mask[about], k) == 1.0
    if camera is None:
        return np.stack(light), on_object, np.zeros((*on_object.shape, 2))
    row, column = (np.arange(n) * k + 0.5 * k + part.start for n, part in zip(on_object.shape, about, strict=True))
    rays = camera.unproject(np.stack(np.meshgrid(column, row), axis=-1)) @ camera.world_to_camera[:3, :3].T
    return np.stack(light), on_object, rays[..., :2] / rays[..., 2:] * [1.0, -1.0]


def colours(values: Array) -> Array:
    """(K, C) strength of each channel over the lamp's mean, up to a colour that all lamps share."""
    grey = values.mean(axis=2)
    bright = np.isfinite(grey) & (grey > 0.2 * np.nan_to_num(grey).max(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(bright[..., None], np.log(values / grey[..., None]), np.nan)
    share = np.where(np.isfinite(share), share, np.nan)
    own = share[:, np.isfinite(share).all(axis=(0, 2))]
    if own.shape[1] < 100:
        return np.ones((len(values), 1))
    return np.exp(np.median(own - own.mean(axis=0), axis=1))
