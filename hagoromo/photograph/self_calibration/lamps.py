"""Far lamps from photographs of an object of unknown shape: low rank, integrability, then the bas-relief ambiguity.

The scale at which integrability is judged is the one at which it holds best. What is stated as error is how far the
lamps move when tiles of the object are drawn anew, when it is judged at other scales, and, of lamps that seem alike,
when albedo is left out of account, beside a third of the bound on how far integrability's own residual tilts them
(Wedin 1972): the model is wrong for every real object, by more than its noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.photograph.lamps import check_spread
from hagoromo.photograph.self_calibration.bas_relief import Belief, Family, resolve
from hagoromo.photograph.self_calibration.integrability import Rows, first_rows, rows
from hagoromo.photograph.self_calibration.low_rank import Array, Factors, binned, factorise
from hagoromo.photograph.self_calibration.perspective import resolve_in_perspective

MOST_PIXELS = 40_000  # of the object at the finest scale
SCALES, STEPS = (1, 2, 3), (1, 2)  # binning, and pixels to the neighbours that are compared
UNTOLD = 0.8  # `first_rows` from which integrability tells nothing
USABLE = 1.7  # times the best scale's figure up to which another scale is an independent opinion
DRAWS, TILES = 8, 12  # of the bootstrap; tiles across the object
ALIKE = 0.1  # standard deviation of ln strength up to which lamps may be taken for alike, whatever the albedo
BOUND_SHARE = 1.0 / 3.0  # a bound is taken for three standard errors
SWEEPS = 15  # of Powell's method, in perspective
USUAL, NO_ALBEDO = Belief(), Belief(alike=0.05, entropy=False)
FLIP = np.array([-1.0, -1.0, 1.0])  # convex to concave


@dataclass(frozen=True, eq=False)
class SelfCalibration:
    """to_lamp (K, 3) unit; strength (K,) or (K, C), median 1 in each channel; standard errors [°] and of ln strength.

    convex: share of the outline that the surface turns away at, as closed objects do; 0.5 tells nothing, and the
    hollow surface under lamps mirrored about the line of sight is as good. integrability: 0, well told, to 1.
    condition: of the directions. Axes: x right, y up, z to the camera; with a camera, world.
    """

    names: tuple[str, ...]
    to_lamp: Array
    strength: Array
    standard_error_deg: Array
    strength_error: Array
    convex: float
    integrability: float
    condition: float

    def records(self) -> list[dict[str, Any]]:
        """Entries of lamps.json."""
        return [
            {
                "name": name,
                "to_lamp": self.to_lamp[k].tolist(),
                "intensity": self.strength[k].tolist(),
                "standard_error_deg": float(self.standard_error_deg[k]),
                "intensity_relative_error": float(self.strength_error[k]),
                "intensity_from": "the object, relative",
            }
            for k, name in enumerate(self.names)
        ]


def self_calibrate(
    photographs: Mapping[str, NDArray],
    mask: NDArray[np.bool_],
    camera: Camera | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
) -> SelfCalibration:
    """One far lamp per photograph of an object.

    photographs: name → (height, width, channels), linear, NaN where clipped. mask: (height, width), the object, best
    within its outline against the background. camera: None for a view from afar. `InputError` where too little is seen
    of the object, lamps lie in one plane with it, or its surface tells nothing (flat, or too rough).
    """
    tell = progress or (lambda share, step: None)
    for name, photograph in photographs.items():
        if photograph.shape[:2] != mask.shape:
            raise InputError(f"{name} is {photograph.shape[:2]} pixels and the mask {mask.shape}: make them fit")
    light = np.stack([np.asarray(p, np.float64).reshape(*mask.shape, -1) for p in photographs.values()])
    tangent = _tangent(mask.shape, camera)
    scales = _scales(light.mean(axis=3), mask, tangent, tell)
    best = scales[0]
    found = best.solved(USUAL)
    lamps, convex = found.lamps, best.turned_away(found.pixels)
    flip = FLIP if convex < 0.5 else np.ones(3)
    opinions = [scale.solved(USUAL).lamps for scale in scales[1:] if scale.ratio < USABLE * best.ratio]
    own = np.log(np.linalg.norm(lamps, axis=1))
    if np.std(own) < ALIKE:
        opinions.append(best.solved(NO_ALBEDO).lamps)
    random = np.random.default_rng(seed)
    draws = []
    for i in range(DRAWS):
        tell(0.6 + 0.4 * i / DRAWS, "errors")
        draws.append(best.drawn(random).solved(USUAL, found).lamps)
    angle, ratio = (np.hypot(a, b) for a, b in zip(_apart(lamps, opinions), _apart(lamps, draws), strict=True))
    to_lamp = lamps * flip / np.linalg.norm(lamps, axis=1, keepdims=True)
    strength = np.linalg.norm(lamps, axis=1, keepdims=True) * _colours(light[:, mask])
    if camera is not None:
        to_lamp = to_lamp * [1.0, -1.0, -1.0] @ camera.camera_to_world[:3, :3].T
    tell(1.0, "")
    return SelfCalibration(
        tuple(photographs),
        to_lamp,
        strength / np.median(strength, axis=0),
        np.degrees(np.hypot(angle, BOUND_SHARE * best.ratio)),
        np.hypot(ratio, BOUND_SHARE * best.ratio),
        max(convex, 1.0 - convex),
        best.ratio,
        check_spread(to_lamp).condition,
    )


class _Solved(NamedTuple):
    """lamps (K, 3), pixels (P, 3), c₁ and c₂ (2, 3), and the figures of the bas-relief."""

    lamps: Array
    pixels: Array
    first: Array
    figures: Array


@dataclass(frozen=True, eq=False)
class _Scale:
    """Factors at one binning, the rows of integrability at one step, c₁ and c₂, and how well those are told."""

    factors: Factors
    rows: Rows
    first: Array
    ratio: float
    afar: bool

    def solved(self, belief: Belief, start: _Solved | None = None) -> _Solved:
        """The lamps, from `start`, of nearly the same data, where given."""
        first, figures = self.first, None if start is None else start.figures
        if start is not None and not self.afar:
            first = start.first
        family = Family(self.factors, first)
        figures = resolve(family, belief, figures)
        if not self.afar:
            if self.turned_away(family.true(family.third(figures))[1]) < 0.5:
                first, figures = -first, figures * FLIP
            sweeps = SWEEPS if start is None else 2
            first, figures = resolve_in_perspective(self.factors, self.rows, first, figures, belief, sweeps)
            family = Family(self.factors, first)
        return _Solved(*family.true(family.third(figures)), first, figures)

    def drawn(self, random: np.random.Generator) -> _Scale:
        """The same with tiles of the object drawn anew."""
        place = self.rows.place - self.rows.place.min(axis=0)
        side = max(int(place.max()) // TILES, 1)
        tile = place[:, 0] // side * (TILES + 2) + place[:, 1] // side
        order = np.argsort(tile, kind="stable")
        parts = np.split(order, np.flatnonzero(np.diff(tile[order])) + 1)
        again = np.concatenate([parts[i] for i in random.integers(0, len(parts), len(parts))])
        some = self.rows.chosen(again)
        return _Scale(self.factors, some, _same_sign(first_rows(some)[0], self.first), self.ratio, self.afar)

    def turned_away(self, pixels: Array) -> float:
        """Share of the outline's pixels whose normal points out of it."""
        from scipy.ndimage import binary_erosion, gaussian_filter

        mask = self.factors.mask
        soft = gaussian_filter(mask.astype(np.float64), 3.0)
        outward = -np.stack([np.gradient(soft, axis=1), -np.gradient(soft, axis=0)], axis=2)[mask]
        edge = np.logical_not(binary_erosion(mask, iterations=2, border_value=1))[mask]
        return float(np.mean(np.sum(outward * pixels[:, :2], axis=1)[edge] > 0.0)) if edge.any() else 0.5


def _scales(light: Array, mask: NDArray[np.bool_], tangent: Array, tell: Callable[[float, str], None]) -> list[_Scale]:
    """All scales at which the object is large enough, the best told first."""
    finest = int(np.ceil(np.sqrt(max(mask.sum() / MOST_PIXELS, 1.0))))
    found: list[_Scale] = []
    for i, k in enumerate(SCALES):
        tell(0.2 * i, f"shading, {finest * k} × {finest * k} pixels")
        shine, where = binned(light, mask, finest * k)
        try:
            factors = factorise(shine, where)
        except InputError:
            if found:
                break
            raise
        height, width = where.shape
        at = tangent[finest * k // 2 :: finest * k, finest * k // 2 :: finest * k][:height, :width]
        for step in STEPS:
            lines = rows(factors.image(), step, at)
            if len(lines.along) > 100:
                first, ratio = first_rows(lines)
                found.append(_Scale(factors, lines, first, ratio, not tangent.any()))
    found.sort(key=lambda scale: scale.ratio)
    if not found or found[0].ratio > UNTOLD:
        raise InputError(
            "the object's shading does not tell the lamps: it is flat, too rough, or not matte: use a chrome ball"
        )
    return found


def _tangent(shape: tuple[int, int], camera: Camera | None) -> Array:
    """(h, w, 2) x right, y up of the rays (x, y, −1); 0 from afar."""
    if camera is None:
        return np.zeros((*shape, 2))
    if (camera.height, camera.width) != shape:
        raise InputError(f"the camera is {camera.height} × {camera.width} pixels and the mask {shape}: make them fit")
    local = camera.pixel_directions() @ camera.world_to_camera[:3, :3].T
    return local[..., :2] / local[..., 2:] * [1.0, -1.0]


def _same_sign(first: Array, like: Array) -> Array:
    return first if np.sum(first * like) > 0.0 else -first


def _apart(lamps: Array, others: list[Array]) -> tuple[Array, Array]:
    """Root mean squares (K,) of the angles [rad] to the lamps of `others`, convex or hollow, and of ln strength."""
    angles, ratios = [np.zeros(len(lamps))], [np.zeros(len(lamps))]
    length = np.linalg.norm(lamps, axis=1)
    for other in others:
        own = np.linalg.norm(other, axis=1)
        cosines = [np.sum(lamps * other * way, axis=1) / length / own for way in (np.ones(3), FLIP)]
        angles.append(np.arccos(np.clip(max(cosines, key=np.sum), -1.0, 1.0)))
        ratio = np.log(own / length)
        ratios.append(ratio - np.median(ratio))
    count = max(len(others), 1)
    return np.sqrt(np.sum(np.square(angles), axis=0) / count), np.sqrt(np.sum(np.square(ratios), axis=0) / count)


def _colours(values: Array) -> Array:
    """(K, C) strength of each channel over the lamp's mean, up to a colour that all lamps share."""
    grey = values.mean(axis=2)
    bright = np.isfinite(grey) & (grey > 0.2 * np.nanmax(grey, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(bright[..., None], np.log(values / grey[..., None]), np.nan)
    share = np.where(np.isfinite(share), share, np.nan)
    own = share[:, np.isfinite(share).all(axis=(0, 2))]
    if own.shape[1] < 100:
        return np.ones((len(values), 1))
    return np.exp(np.median(own - own.mean(axis=0), axis=1))
