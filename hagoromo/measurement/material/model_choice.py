"""Model choice: whether a material has facets with tails, and an interface with a colour of its own, by evidence.

The widest model that is allowed is fitted. Each extension is then taken away from it under the same weights, and stays
where χ² rises by more than noise would make it rise with probability CHANCE (likelihood ratio). χ² is divided by κ, the
ratio of the variance of the robust estimate to that of the least squares (Satorra & Bentler 1994), so that residuals
that are wider than stated, or correlated over an image tile, give no evidence. κ follows from the residuals, few of
which may depend on the extension: the law of the ratio is F, with that many degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from hagoromo.errors import InputError
from hagoromo.measurement.material.albedo_variation import AlbedoVariation, find_albedo_variation
from hagoromo.measurement.material.interval import degrees_of_freedom
from hagoromo.measurement.material.material_fit import INCOMPLETE_SCALE, fit_material
from hagoromo.measurement.material.quantity import coordinate
from hagoromo.measurement.material.sandwich import MaterialFit, inverse_over
from hagoromo.measurement.observations import Observations
from hagoromo.measurement.parameters import STRENGTH, TAIL, channels_of, colour_slice
from hagoromo.measurement.robust_fit import minimise
from hagoromo.measurement.sight import Array

Facets = Literal["auto", "gaussian", "student-t"]
Interface = Literal["auto", "neutral", "coloured"]
FACETS, INTERFACES = ("auto", "gaussian", "student-t"), ("auto", "neutral", "coloured")
FIRST_TAIL = 0.2  # 1/ν from which tails are added to a fit without them
CHANCE = 0.01  # probability that noise makes one extension appear where there is none
MANY = 1e9  # degrees of freedom: as good as infinitely many


@dataclass(frozen=True)
class Model:
    """Which extensions a fit has: facets with tails, an interface with a colour of its own."""

    tails: bool = False
    coloured: bool = False


class Fitted(NamedTuple):
    """A fit with one body colour or one per pixel, and the test for its variation."""

    fit: MaterialFit
    albedo_variation: AlbedoVariation | None


@dataclass(frozen=True, eq=False)
class ChosenFit:
    """The fit of the model that was chosen, and the evidence for each extension of it.

    wide: the fit of the widest model that was tried, `fitted` itself where that was chosen. tails, coloured: rise of χ²
    over κ without the extension, None where it was not tested. failure: why none was tried; else "".
    """

    fitted: Fitted
    model: Model
    wide: Fitted
    tails: float | None = None
    coloured: float | None = None
    failure: str = ""


def check_model(facets: str, interface: str) -> None:
    """`InputError` for a name of facets or interface that does not exist."""
    for key, given, known in (("facets", facets, FACETS), ("interface", interface, INTERFACES)):
        if given not in known:
            raise InputError(f"{key} is {given!r}: give one of {', '.join(known)}")


def choose_fit(
    observations: Observations, n: float | None = None, facets: Facets = "auto", interface: Interface = "auto"
) -> ChosenFit:
    """The fit of one material, with the extensions that are asked for, or for which there is evidence.

    Raises `InputError` as `fit_material` does; an extension that does not converge, and was not asked for, is left out.
    """
    check_model(facets, interface)
    colours = observations.channels > 1 and interface != "neutral"
    if interface == "coloured" and not colours:
        raise InputError("interface is 'coloured' for photographs of one channel: give photographs with colours")
    asked = Model(facets == "student-t", interface == "coloured")
    wanted = Model(facets != "gaussian", colours)
    if wanted == asked:
        fitted = fit_as(observations, n, asked)
        return ChosenFit(fitted, asked, fitted)
    base = fit_as(observations, n, asked)
    try:
        wide = _widened(observations, n, wanted, base.fit)
    except InputError as error:
        return ChosenFit(base, asked, base, failure=str(error))
    tails = _rise(wide.fit, _places(wide.fit, "tails")) if wanted.tails and not asked.tails else None
    coloured = _rise(wide.fit, _places(wide.fit, "coloured")) if wanted.coloured and not asked.coloured else None
    found = Model(
        asked.tails or (tails is not None and evidence(wide.fit, "tails", tails) < CHANCE),
        asked.coloured or (coloured is not None and evidence(wide.fit, "coloured", coloured) < CHANCE),
    )
    if found in (wanted, asked):
        return ChosenFit(wide if found == wanted else base, found, wide, tails, coloured)
    fitted = fit_as(observations, n, found, _reduced(wide.fit, found))
    return ChosenFit(fitted, found, wide, tails, coloured)


def model_remarks(
    tails: float | None, coloured: float | None, model: Model, least_nu: float, failure: str = ""
) -> list[str]:
    """What was chosen between Gaussian facets and such with tails, a neutral interface and a coloured one, and why.

    tails, coloured: rise of χ² without them, None where that was not tested. least_nu: lower end of the interval of ν.
    """
    remarks = []
    if failure:
        remarks.append(f"facets with tails and a coloured interface were not tried: {failure}")
    if tails is not None:
        found = "have tails" if model.tails else "cannot be distinguished from Gaussian ones"
        least = "" if model.tails else f"; nu is above {least_nu:.2g}"
        remarks.append(f"the facets {found} (χ² rises by {max(tails, 0.0):.3g} without tails{least})")
    if coloured is not None:
        found = "has a colour of its own" if model.coloured else "cannot be distinguished from a neutral one"
        remarks.append(f"the interface {found} (χ² rises by {max(coloured, 0.0):.3g} with the colour of the lamp)")
    return remarks


def _widened(observations: Observations, n: float | None, model: Model, base: MaterialFit) -> Fitted:
    """The fit of the widest `model`: from the narrower fit `base`, and from starts of its own if that explains less.

    With as many freedoms as it has, starts of its own may end in a few stray values; `base` cannot.
    """
    theta = base.theta.copy()
    theta[TAIL] = max(theta[TAIL], FIRST_TAIL if model.tails else 0.0)
    fits, failure = [], ""
    for start in (theta, None):
        try:
            fits.append(fit_as(observations, n, model, start))
        except InputError as error:
            failure = str(error)
        if fits and fits[-1].fit.residuals.scale <= INCOMPLETE_SCALE:
            break
    if not fits:
        raise InputError(failure)
    best = min(fits, key=lambda fitted: fitted.fit.residuals.scale)
    if best.fit.residuals.scale > max(base.residuals.scale, INCOMPLETE_SCALE):
        raise InputError("their fit explains less than that of the smaller model")
    return best


def fit_as(observations: Observations, n: float | None, model: Model, start: Array | None = None) -> Fitted:
    """The fit of one model, with a body colour per pixel where there is evidence for it."""
    fit = fit_material(observations, n, tails=model.tails, coloured=model.coloured, start=start)
    return Fitted(*find_albedo_variation(fit))


def _reduced(wide: MaterialFit, model: Model) -> Array:
    """Where the fit of a smaller `model` starts: at the wide one without the extensions that it lacks."""
    theta = wide.theta.copy()
    if not model.tails:
        theta[TAIL] = 0.0
    if not model.coloured:
        theta[colour_slice(channels_of(theta))] = 0.0
    return theta


def evidence(fit: MaterialFit, extension: Literal["tails", "coloured"], rise: float) -> float:
    """Probability that noise alone makes χ²/κ rise by `rise` without the extension of the widest `fit`.

    A tail is 0 or more, so that half of its noise does not count.
    """
    places = _places(fit, extension)
    freedom = min(degrees_of_freedom(fit, coordinate(int(place))) for place in places)
    p = float(fisher.sf(rise / len(places), len(places), min(freedom, MANY)))
    return 0.5 * p if extension == "tails" else p


def _places(fit: MaterialFit, extension: str) -> NDArray[np.intp]:
    """Places in θ of the parameters of an extension."""
    places = np.arange(fit.theta.size)
    return places[[TAIL]] if extension == "tails" else places[colour_slice(channels_of(fit.theta))]


def _rise(fit: MaterialFit, places: NDArray[np.intp]) -> float:
    """Rise of χ² over κ when the parameters at `places` are 0: Gaussian facets, or a neutral interface."""
    if not np.any(fit.theta[places]) or fit.theta[STRENGTH] <= 0.0:
        return 0.0
    held = np.isin(np.arange(fit.theta.size), places)
    without = minimise(fit.objective, np.where(held, 0.0, fit.theta)[None], fit.free & ~held)
    rise = 2.0 * (without.cost[0] - fit.objective.evaluate(fit.theta[None])[0][0])
    return float(rise) / _inflation(fit, places)


def _inflation(fit: MaterialFit, places: NDArray[np.intp]) -> float:
    """κ of several parameters: the mean over them of the sandwich variance over that of the least squares."""
    known = places[fit.inside[places]]
    if not known.size:
        return max(fit.residuals.scale**2, 1.0)
    naive, robust = (_block(one, known) for one in (inverse_over(fit.curvature, fit.inside), fit.covariance))
    return float(np.trace(np.linalg.pinv(naive, hermitian=True) @ robust)) / len(known)


def _block(matrix: Array, places: NDArray[np.intp]) -> Array:
    return matrix[np.ix_(places, places)]
