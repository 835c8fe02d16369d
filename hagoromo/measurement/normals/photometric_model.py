"""Photometric model: the values that photographs under many lamps should have, and the error of that model.

    value_kc(p) = s_k(p) [ body_c(p) B_k(p) + I_k(p) ],   s_k(p) = e_k (1 + a_k · place(p)),   B, I as in `shading`

s is the unevenness of the lamps: their strengths e and a linear change a_k over the object, in addition to the
irradiance that follows from their positions. The positions themselves have a small error (`shift`). Lamps and bodies
have a `Prior`, whose scales are learnt from the photographs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.own_gloss import OWN, OwnGloss, OwnGlossTest
from hagoromo.measurement.normals.pixel_errors import PixelErrors
from hagoromo.measurement.normals.shading import TAIL, Gloss, lit_values
from hagoromo.measurement.normals.smooth_share import SmoothShare
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.photometric.reading import reading

STATED_WEIGHT = 6.0  # a stated scale counts as much as this many numbers of the lamps


@dataclass(frozen=True, eq=False)
class GlossChoice:
    """The test of M materials for tails of their facets and for a colour of their interface.

    free: (M, G) which numbers of a row of `Gloss` were estimated. tails, coloured: (M,) rise of χ² without the
    extension, NaN where it was asked for, excluded, or not tested. wide, wide_covariance: rows (M, G) of the fit with
    all that was allowed, and their covariance (M, G, G). failure: why no extension was tried; else "".
    """

    free: NDArray[np.bool_]
    tails: Array
    coloured: Array
    wide: Array
    wide_covariance: Array
    failure: str = ""


@dataclass(frozen=True)
class LobeParameters:
    """Further lobes of the interface of M materials: of each its β and γ [rad], and the share of the squared error of
    photographs left out by which they predict better. covariances: of each, that of ln β and ln γ of its lobes in turn.
    """

    each: tuple[tuple[tuple[float, float], ...], ...]
    gains: tuple[float, ...]
    covariances: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class Fit:
    """normals (P, 3), body (C, P), labels (P,) of the materials, gloss, lamps: strength ln e (K,), slope a (K, 2), and
    shift (K, 3): of a far lamp's direction [rad], of a near one's position over its distance; depth: ln of the ratio
    of the distance of the surface to the stated distance.

    model_error: relative error of the model, in addition to the noise. variance: (P,) of the normal's direction
    [rad²], the sum over its two turns; inf where not estimated. covariance: (M, G, G) of the rows of `gloss`.
    choice: whether the facets of each material have tails, and its interface a colour of its own; None: not examined.
    status: how the fit of gloss and lamps ended; pixel_status: (P,) `Status` of the fit of each normal; shape_status:
    how the rounds of normals and surface under near lamps ended. None: there was no such fit. lobes: further lobes of
    the interface (`lobe_fit`); None: every material has one. own: gloss of each pixel (`solved_gloss`), of which that
    of the material is the mean; None: one gloss for all pixels of a material. own_tests: of each material, why; None
    where it was not tested. lamp_variance: (K, 6) of strength and slope less their means over the lamps, and of
    shift; None where they were not fitted. prior: of lamps and bodies, with the scales that were learnt. share:
    effective number of independent values per value. errors: of each pixel and of all, of which `variance` is the sum;
    None: `variance` is that of noise and model error alone. smooth: how normals were smoothed over neighbours
    (`smooth_normals`); None: they were not.
    """

    normals: Array
    body: Array
    labels: NDArray[np.intp]
    gloss: Gloss
    strength: Array
    slope: Array
    shift: Array
    depth: float
    model_error: float
    variance: Array
    covariance: Array
    choice: GlossChoice | None = None
    status: FitStatus | None = None
    pixel_status: NDArray[np.int8] | None = None
    shape_status: FitStatus | None = None
    lobes: LobeParameters | None = None
    own: OwnGloss | None = None
    own_tests: tuple[OwnGlossTest | None, ...] = ()
    lamp_variance: Array | None = None
    prior: Prior | None = None
    share: float = 1.0
    errors: PixelErrors | None = None
    smooth: SmoothShare | None = None

    @property
    def rows(self) -> Array:
        """(P, G) row of `gloss` of each pixel."""
        rows = self.gloss.rows[self.labels]
        if self.own is not None:
            rows[:, OWN] = self.own.value
        return rows

    def evenness(self, place: Array) -> Array:
        """s_k (K, P) at `place` (P, 2)."""
        return evenness(self.strength, self.slope, place)

    @property
    def interface_colour(self) -> Array:
        """(C, P) colour of the interface of each pixel, of geometric mean 1."""
        return self.gloss.colour[self.labels].T

    def pixels(self, chosen: NDArray) -> Fit:
        """The fit of some pixels."""
        names = ("normals", "labels", "variance", *([] if self.pixel_status is None else ["pixel_status"]))
        parts = {name: getattr(self, name)[chosen] for name in names}
        own = None if self.own is None else self.own.pixels(chosen)
        errors = None if self.errors is None else self.errors.pixels(chosen)
        smooth = None if self.smooth is None else self.smooth.pixels(chosen)
        return replace(self, body=self.body[:, chosen], own=own, errors=errors, smooth=smooth, **parts)


def evenness(strength: Array, slope: Array, place: Array) -> Array:
    """s = e (1 + a·place) of lamps with ln e `strength` (K,) and a `slope` (K, 2), at `place` (P, 2): (K, P)."""
    return np.exp(strength)[:, None] * np.maximum(1.0 + slope @ place.T, 0.1)


def predicted(fit: Fit, to_lamp: Array, to_eye: Array) -> Array:
    """(K, C, P) values of the fit under even lamps of strength 1 in directions `to_lamp` (K, P, 3)."""
    body, interface = lit_values(fit.normals, to_lamp, to_eye, fit.rows, further_rows(fit))
    return reading(fit.body, body[:, None], fit.interface_colour, interface[:, None])


def further_lobes(fit: Fit, to_lamp: Array, to_eye: Array) -> Array | None:
    """(K, P) what the further lobes add to the interface under lamps (K, P, 3); None where there are none."""
    if fit.lobes is None:
        return None
    rows = fit.rows
    rows[:, 0] = -np.inf
    return lit_values(fit.normals, to_lamp, to_eye, rows, further_rows(fit))[1]


def further_rows(fit: Fit) -> tuple[Array, ...]:
    """Of each further lobe (P, 2) ln β and ln γ of each pixel, −∞ and 0 where its material has no such lobe."""
    if fit.lobes is None:
        return ()
    with np.errstate(invalid="ignore"):
        apart = fit.rows[:, :2] - fit.gloss.rows[fit.labels, :2]  # of a pixel's gloss from that of its material
    apart = np.nan_to_num(apart)  # both −∞ where a material has no gloss
    each = []
    for k in range(max(len(one) for one in fit.lobes.each)):
        rows = np.array([np.log(one[k]) if k < len(one) else (-np.inf, 0.0) for one in fit.lobes.each])
        each.append(rows[fit.labels] + apart)
    return tuple(each)


def precision(views: Views, model_error: float) -> Array:
    """(K, C, P) inverse variance of noise, model error and what a value may lack, 0 where it is not used."""
    lacks = 0.0 if views.lacks is None else views.lacks[:, None] ** 2
    return views.used[:, None] / (views.variance + (model_error * size(views)) ** 2 + lacks)


def precision_of_bounds(views: Views, model_error: float) -> Array | None:
    """(K, C, P) inverse variance of clipped values by the error of the model, 0 of others; None where none is."""
    return None if views.lower is None else views.lower / (model_error * size(views)) ** 2


def size(views: Views) -> Array:
    """The value to which errors of the model are relative: at least the pixel's mean, for values in shadow."""
    return np.maximum(views.values, views.values.mean(axis=0))


@dataclass(frozen=True)
class Prior:
    """Prior of lamps and bodies. The default: lamps of one type, set up by hand and calibrated with a ball.

    strength: scale of ln e (Cauchy: an occasional lamp deviates much). slope: standard deviation of a, per radius of
    the object. direction: of each component of a lamp's shift [rad]. roughness, exponent: of σ and ln(1 + ε) of the
    bodies.
    distance: of the ln distance of a surface of unknown depth.
    """

    strength: float = 0.01
    slope: float = 0.03
    direction: float = 0.01
    roughness: float = 0.2
    exponent: float = 0.2
    distance: float = 0.05

    def gloss(self, numbers: int) -> Array:
        """(G, 2) mean and standard deviation of the `numbers` G of a row of `Gloss`: any dielectric, as wide as
        measured ones vary.
        """
        body = [[0.0, self.roughness], [0.0, self.exponent]]
        return np.array([[np.log(1.0), 2.0], [np.log(0.3), 1.0], *body, *[[0.0, 1.0]] * (numbers - TAIL)])

    def loss(self, lamps: Array) -> float:
        """Twice the negative logarithm of the prior of `lamps` (K, 6): ln e, a, shift."""
        strength = CAUCHY_SCALE**2 * np.log1p((lamps[:, 0] / self.strength / CAUCHY_SCALE) ** 2)
        others = np.sum((lamps[:, 1:3] / self.slope) ** 2) + np.sum((lamps[:, 3:] / self.direction) ** 2)
        return float(np.sum(strength) + others)

    def precision(self, lamps: Array) -> Array:
        """(K, 6) curvature of the prior at `lamps`; of Cauchy's loss the weight."""
        curvature = np.empty(lamps.shape)
        curvature[:, 0] = 1.0 / (self.strength**2 + (lamps[:, 0] / CAUCHY_SCALE) ** 2)
        curvature[:, 1:3] = self.slope**-2.0
        curvature[:, 3:] = self.direction**-2.0
        return curvature

    def learnt(self, stated: Prior, lamps: Array, variance: Array) -> Prior:
        """The prior with the scales of `lamps` (K, 6) of this posterior variance (expectation maximisation).

        stated: the prior with the stated scales; it counts as STATED_WEIGHT further numbers.
        """
        weight = np.ones(lamps.shape)
        weight[:, 0] = 1.0 / (1.0 + (lamps[:, 0] / self.strength / CAUCHY_SCALE) ** 2)
        second = weight * (lamps**2 + variance)

        def scale(columns: slice, before: float) -> float:
            numbers = second[:, columns]
            return float(np.sqrt((numbers.sum() + STATED_WEIGHT * before**2) / (numbers.size + STATED_WEIGHT)))

        return replace(
            self,
            strength=scale(np.s_[:1], stated.strength),
            slope=scale(np.s_[1:3], stated.slope),
            direction=scale(np.s_[3:], stated.direction),
        )
