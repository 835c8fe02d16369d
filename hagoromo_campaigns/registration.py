"""Registration: how AFTER's world lies on BEFORE's, by surface and body colour, with its error.

Minimised over turn, shift, scale and one factor of brightness, at pixels of BEFORE that AFTER shows: differences of ln
of the mean body colour, of the normals across BEFORE's, and of the distance along them, each over its own robust
spread. Neighbouring pixels err alike: the covariance is that of the sums over squares of BLOCK pixels (a "sandwich").
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.levenberg_marquardt import Damping, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import ROBUST_SCALE, TUKEY
from hagoromo.least_squares.rows import RowsProblem
from hagoromo.measurement.normals.shading import tangents
from hagoromo_campaigns.campaign import Campaign
from hagoromo_campaigns.features import starts
from hagoromo_campaigns.sampled import sampled, smoothed
from hagoromo_campaigns.similarity import Similarity

Array = NDArray[np.float64]
PARAMETERS = 8  # turn (3) [rad], shift (3) [pitch], ln scale, ln brightness
MOST_PIXELS = 4000  # of BEFORE, drawn by chance, that the registration looks at
WIDTHS = (2.5, 1.0, 0.0, 0.0)  # px, by which the maps are smoothed, round by round; spreads are those at its start
STEPS = 40
TOLERANCE = Tolerance(gain=1e-5)  # of the mean loss: a tenth of what one pixel in a standard error changes
UNBOUNDED = np.full(PARAMETERS, np.inf)
BLOCK = 8  # px
LEAST_DEPTH_SPREAD = 0.3  # pitch: distances bend over an object, and must not outweigh its detail
FEWEST_PIXELS = 60  # of the pixels that are looked at, which AFTER must show
LEAST_AGREEMENT = 0.3  # correlation of the detail of both, below which they show different things
AWAY = 0.15  # least cosine between a normal and the way to AFTER's camera
STEP = 1e-4  # of differences by which slopes are taken [rad, pitch …]


@dataclass(frozen=True, eq=False)
class Registration:
    """to_after: from BEFORE's world to AFTER's. covariance: (7, 7) of turn [rad], shift [pitch] and ln scale.

    centre: (3,) BEFORE's point about which it turns. agreement: correlation of the detail of paint and of relief that
    both show. error_px: root mean square error of places, in pixels of AFTER. status: how the fit ended.
    """

    to_after: Similarity
    covariance: Array
    centre: Array
    pitch: float
    agreement: tuple[float, float]
    error_px: float
    status: FitStatus = field(repr=False)

    def image_errors(self, before: Campaign, after: Campaign) -> Array:
        """(h, w, 2, 2) covariance of where pixels of BEFORE are in AFTER's image [px²]."""
        slopes = [
            (self._image(before, after, k, STEP) - self._image(before, after, k, -STEP)) / (2 * STEP) for k in range(7)
        ]
        by = np.stack(slopes, axis=-1)
        return np.asarray(by @ self.covariance @ np.swapaxes(by, -1, -2))

    def moved(self, theta: Array) -> Similarity:
        """`to_after`, changed by turn [rad], shift [pitch] and ln scale (7 numbers or more)."""
        return _moved(self.to_after, theta, self.centre, self.pitch)

    def _image(self, before: Campaign, after: Campaign, which: int, step: float) -> Array:
        theta = np.zeros(PARAMETERS)
        theta[which] = step
        return after.camera.project(self.moved(theta).points(before.points))

    def record(self) -> dict[str, Any]:
        """As JSON files have it."""
        return {
            "to_after": self.to_after.record(),
            "error_px": self.error_px,
            "agreement": {"paint": self.agreement[0], "relief": self.agreement[1]},
            "fit": self.status.record(),
        }


def register(before: Campaign, after: Campaign, seed: int = 0) -> Registration:
    """The registration of two campaigns of one object.

    `InputError` where AFTER shows nothing of BEFORE, or what it shows there is something else.
    """
    found: list[tuple[float, Registration]] = []
    for start in starts(before, after, seed):
        fitted = _fitted(before, after, start, seed)
        if fitted is not None:
            found.append((sum(max(one, 0.0) for one in fitted.agreement), fitted))
            if max(fitted.agreement) > 0.8:
                break
    best = max(found, key=lambda pair: pair[0])[1] if found else None
    if best is None or max(best.agreement) < LEAST_AGREEMENT:
        said = (
            ""
            if best is None
            else f" (paint agrees by {best.agreement[0]:.2f}, relief by {best.agreement[1]:.2f} of 1)"
        )
        raise InputError(
            f"nothing of {before.name} is found again in {after.name}{said}: they show two different objects, or parts "
            "of one that do not overlap; give two measurements of the same side"
        )
    return best


class _Detail:
    """Residuals of a registration at drawn pixels of BEFORE."""

    def __init__(self, before: Campaign, after: Campaign, width: float, seed: int) -> None:
        rows, columns = np.nonzero(before.known)
        if len(rows) > MOST_PIXELS:
            drawn = np.sort(np.random.default_rng(seed).choice(len(rows), MOST_PIXELS, replace=False))
            rows, columns = rows[drawn], columns[drawn]
        self.rows, self.columns, self.after, self.pitch = rows, columns, after, before.pitch
        own, self.other = (smoothed(_layers(one), width) for one in (before, after))
        own = own[rows, columns]
        self.paint, self.normals, self.points = own[:, 0], before.normals[rows, columns], before.points[rows, columns]
        self.smooth_normals = own[:, 1:4]
        self.across = np.stack(tangents(self.normals), axis=-2)
        self.centre, self.axes = self.points.mean(axis=0), before.camera.world_to_camera[:2, :3]

    def residuals(self, at: Similarity, brightness: float) -> Array:
        """(P, 4): ln body, two turns of the normal [rad], distance along the normal [pitch]; NaN where not shown."""
        there = at.points(self.points)
        image = self.after.camera.project(there)
        found = sampled(self.other, image)
        facing = np.einsum("pi,pi->p", at.directions(self.normals), self.after.camera.position - there)
        facing /= np.linalg.norm(self.after.camera.position - there, axis=1)
        back = at.inverse
        turned = back.directions(found[:, 1:4]) - self.smooth_normals
        away = np.einsum("pi,pi->p", back.points(found[:, 4:7]) - self.points, self.normals) / self.pitch
        turns = np.einsum("pki,pi->pk", self.across, turned)
        result = np.column_stack([found[:, 0] - self.paint - brightness, turns, away])
        result[facing < AWAY] = np.nan
        return result


def _layers(one: Campaign) -> Array:
    """(h, w, 7): ln of the mean body colour, normal, place."""
    with np.errstate(invalid="ignore"):
        return np.concatenate([np.log(one.body.mean(axis=2))[..., None], one.normals, one.points], axis=2)


def _moved(start: Similarity, theta: Array, centre: Array, pitch: float) -> Similarity:
    return start.moved(theta[:3], theta[3:6] * pitch * start.scale, theta[6], start.points(centre))


def _fitted(before: Campaign, after: Campaign, start: Similarity, seed: int) -> Registration | None:
    """The registration from `start`; None where too few pixels are shown."""
    brightness, status, fit = 0.0, None, None
    for width in WIDTHS:
        detail = _Detail(before, after, width, seed)
        residuals = detail.residuals(start, brightness)
        shown = np.isfinite(residuals).all(axis=1)
        if shown.sum() < FEWEST_PIXELS:
            return None
        middle = np.median(residuals[shown], axis=0) * (1.0, 0.0, 0.0, 0.0)
        spread = ROBUST_SCALE * np.median(np.abs(residuals[shown] - middle), axis=0) + 1e-9
        spread[3] = max(spread[3], LEAST_DEPTH_SPREAD)
        fit = _Fit(detail, start, spread)
        problem = RowsProblem(fit.rows, -UNBOUNDED, UNBOUNDED, np.ones(PARAMETERS, bool))
        theta = np.zeros((1, PARAMETERS))
        theta[0, 7] = brightness + middle[0]
        ended = levenberg_marquardt(problem, problem.start(theta), Damping(), TOLERANCE, STEPS)
        solved = ended.state.theta[0]
        start, brightness, status = _moved(start, solved, detail.centre, detail.pitch), float(solved[7]), ended.status
    assert fit is not None and status is not None
    detail, covariance = fit.detail, _Fit(fit.detail, start, fit.spread).covariance(brightness)
    made = Registration(start, covariance, detail.centre, detail.pitch, _agreement(detail, start), 0.0, status)
    errors = made.image_errors(before, after)
    return replace(made, error_px=float(np.sqrt(np.nanmean(np.trace(errors, axis1=2, axis2=3)))))


class _Fit:
    """The robust sum of squares about a similarity, residuals over their `spread`."""

    def __init__(self, detail: _Detail, start: Similarity, spread: Array) -> None:
        self.detail, self.start, self.spread = detail, start, spread

    def scaled(self, theta: Array) -> Array:
        """(P, 4), 0 where nothing is shown."""
        at = _moved(self.start, theta, self.detail.centre, self.detail.pitch)
        return self.detail.residuals(at, theta[7]) / self.spread

    def rows(self, rows: Array) -> tuple[Array, Array, Array]:
        """Cost (1,), gradient (1, 8) and curvature (1, 8, 8)."""
        cost, slopes, weighted, weight = self._sums(rows[0])
        gradient = np.einsum("prk,pr->k", slopes, weighted)
        curvature = np.einsum("prk,pr,prl->kl", slopes, weight, slopes)
        return np.array([cost]), gradient[None], curvature[None]

    def _sums(self, theta: Array) -> tuple[float, Array, Array, Array]:
        """Mean loss of what is shown, slopes (P, 4, 8), and ρ′ and its weight (P, 4), over the number shown."""
        value = self.scaled(theta)
        slopes = np.stack([(self.scaled(theta + step) - value) / STEP for step in STEP * np.eye(PARAMETERS)], axis=2)
        shown = np.isfinite(value) & np.isfinite(slopes).all(axis=2)
        value, slopes = np.where(shown, value, 0.0), np.where(shown[..., None], slopes, 0.0)
        count = max(int(shown[:, 0].sum()), 1)
        weight = np.where(shown, TUKEY.weight(value), 0.0) / count
        lost = 1.0 - count / len(value)  # what is not shown counts as one that disagrees: no step flees the overlap
        cost = float(np.where(shown, TUKEY.value(value), 0.0).sum()) / count + lost * float(TUKEY.value(np.array(1e9)))
        return cost, slopes, weight * value, weight

    def covariance(self, brightness: float) -> Array:
        """(7, 7), of sums over blocks of pixels."""
        theta = np.append(np.zeros(7), brightness)
        _, slopes, weighted, weight = self._sums(theta)
        bread = np.linalg.pinv(np.einsum("prk,pr,prl->kl", slopes, weight, slopes))
        each = np.einsum("prk,pr->pk", slopes, weighted)
        columns = self.detail.columns // BLOCK
        _, block = np.unique(self.detail.rows // BLOCK * (columns.max() + 1) + columns, return_inverse=True)
        sums = np.zeros((block.max() + 1, PARAMETERS))
        np.add.at(sums, block, each)
        return (bread @ (sums.T @ sums) @ bread)[:7, :7]


def _agreement(detail: _Detail, at: Similarity) -> tuple[float, float]:
    """Correlations of paint, and of normals in BEFORE's image, less their means over squares of 2 BLOCK."""
    found = sampled(detail.other, detail.after.camera.project(at.points(detail.points)))
    shown = np.isfinite(found).all(axis=1)
    _, block = np.unique(
        detail.rows[shown] // (2 * BLOCK) * len(detail.other) + detail.columns[shown] // (2 * BLOCK),
        return_inverse=True,
    )
    turned = at.inverse.directions(found[shown][:, 1:4]) @ detail.axes.T
    paint = _correlation(found[shown][:, :1], detail.paint[shown][:, None], block)
    return paint, _correlation(turned, detail.smooth_normals[shown] @ detail.axes.T, block)


def _correlation(a: Array, b: Array, block: NDArray[np.integer]) -> float:
    """Of columns (P, k), less their means over each block."""
    count = np.maximum(np.bincount(block), 1.0)[:, None]
    rest = []
    for one in (a, b):
        sums = np.stack([np.bincount(block, column) for column in one.T], axis=1)
        rest.append(one - (sums / count)[block])
    size = float(np.sqrt((rest[0] ** 2).sum() * (rest[1] ** 2).sum()))
    return float((rest[0] * rest[1]).sum()) / size if size > 0.0 else 0.0
