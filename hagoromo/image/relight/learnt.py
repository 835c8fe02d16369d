"""Learnt: what the photographs that were measured teach about the light under another lamp.

    value / irradiance = s · fit + (1 − κ s) · a · body + r,   s = s₀ Φ((h − μ) / σ)

h is the lamp's height over the relief's horizon (`height_over_horizon`), which the relief has to σ, off by μ: Φ is the
share of the light that passes; s₀ is that which passes in the volume boxes, 1 for the fit's own forecast. a is light
from all around, as the object sends to itself, per unit of body colour; κ is 1 where the fit has taken that light for
the lamp's wherever it shines, else 0. r is what the rest leaves under the neighbouring lamps, interpolated over the
lamps' directions (simple kriging).

Each photograph is left out in turn and its pixels are fitted to the rest. The numbers are those that predict the
photographs left out best; a part that does not predict them better is not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.relight.forecast import Forecast, Missed, forecast_of, outside_hull
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.pixel_fit import NormalFit, fit_pixels
from hagoromo.measurement.normals.smooth_normals import conditions
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.surface.horizon import height_over_horizon
from hagoromo.photograph.capture import Capture

OFFSETS = np.radians(np.arange(-4.0, 17.0, 2.0))  # candidates of μ
SPREADS = np.radians([0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 11.0, 15.0])  # and of σ
NO_HORIZON = (-np.pi, np.radians(0.5))  # μ and σ at which all light passes
FITTED_SHARES = (0.0, 1.0)  # candidates of κ
REACHES = np.radians([8.0, 13.0, 20.0, 30.0, 45.0])  # standard deviations of the kernel over lamps' directions
NUGGETS = (0.3, 1.0, 3.0, 10.0)  # variance of what no neighbour shares, over that of the rest
LEARNING_PIXELS = 4000  # at most
LEFT_OUT = 12  # photographs at most
FEWEST_LAMPS = 6  # with one left out there are five: two more than a normal needs
MOST_CHANGE = 4.0  # times, of a body colour by one photograph less
LEAST_GAIN = 0.05  # of the squared error of photographs left out: a part that gains less is not used


@dataclass(frozen=True)
class Shadows:
    """Shadows of a relief whose horizon is off by `offset` μ and known to `spread` σ [rad]; ambient a, of which the
    share `fitted` κ is in the fit where the lamp shines.
    """

    offset: float
    spread: float
    ambient: float
    fitted: float = 0.0

    def share(self, height: Array) -> Array:
        """Share of the light that passes, of lamps at `height` [rad] over the horizon."""
        from scipy.special import ndtr

        return np.asarray(ndtr((height - self.offset) / self.spread), np.float64)

    def ambient_share(self, share: Array) -> Array:
        """Ambient light per unit of body colour where the fit has this share of the lamp's."""
        return self.ambient * np.maximum(1.0 - self.fitted * share, 0.0)


@dataclass(frozen=True)
class Neighbours:
    """Kriging over lamps: reach [rad] of the kernel exp(−½ angle² / reach²) over the lamps' directions, and nugget."""

    reach: float
    nugget: float

    def weights(self, lamps: Array, to_lamp: Array) -> Array:
        """(K,) of the residuals under `lamps` (K, 3) for one in direction `to_lamp` (3,)."""
        matrix = self._kernel(lamps @ lamps.T) + self.nugget * np.eye(len(lamps))
        return np.linalg.solve(matrix, self._kernel(lamps @ to_lamp)).astype(np.float64)

    def _kernel(self, cosine: Array) -> Array:
        return np.exp(-0.5 * (np.arccos(np.clip(cosine, -1.0, 1.0)) / self.reach) ** 2)


@dataclass(frozen=True, eq=False)
class Learnt:
    """What was learnt from the photographs of `capture`, whose fit is `solved`.

    shadows and neighbours: None where they do not predict better. gains: share of the squared error of photographs
    left out that each takes off; error: their relative error that is left; forecast: that of photographs under other
    lamps. residuals: (K, C, P) of the views' values, under even lamps.
    """

    solved: NormalMap
    capture: Capture
    shadows: Shadows | None
    neighbours: Neighbours | None
    gains: tuple[float, float]
    error: float
    residuals: NDArray[np.float32] | None
    forecast: Forecast

    def outside(self, to_lamp: Array) -> float:
        """Angle [rad] of a lamp in the direction `to_lamp` (3,) from the hull of those that were measured."""
        return outside_hull(_directions(self.solved.views.to_lamp), to_lamp)

    def added(self, shown: Array, to_lamp: Array, passed: Array | float = 1.0) -> Array:
        """(C, P) values per irradiance under a lamp in directions `to_lamp` (P, 3), `shown` before.

        passed: (P,) share of the light s₀ that passes in what is shown.
        """
        fitted = shown
        if self.shadows is not None:
            share = self.shadows.share(_heights(self.capture, self.solved.views, to_lamp))
            fitted = share * shown + self.shadows.ambient_share(passed * share) * self.solved.fit.body
        if self.neighbours is not None:
            assert self.residuals is not None
            weights = self.neighbours.weights(_directions(self.solved.views.to_lamp), _directions(to_lamp[None])[0])
            fitted = fitted + np.tensordot(weights, self.residuals, axes=1)
        return np.maximum(fitted, 0.0)


def learn(capture: Capture, solved: NormalMap, seed: int = 0, passed: Array | None = None) -> Learnt | None:
    """What the photographs of `capture`, with its points, teach beyond their fit `solved`; None of too few.

    passed: (K, P) share of the light in each photograph that passes in what is to be corrected (None: all of it).
    """
    views, fit = solved.views, solved.fit
    if len(views.values) < FEWEST_LAMPS:
        return None
    count, random = len(views.rows), np.random.default_rng(seed)
    passed = np.ones((len(views.values), count)) if passed is None else passed
    some = np.sort(random.choice(count, min(count, LEARNING_PIXELS), replace=False))
    cases = _cases(capture, views, fit, some, passed[:, some])
    found = [(None, 0.0), *(_shadows(cases, share) for share in FITTED_SHARES)]
    both = [(shadows, first, *_neighbours(cases, shadows)) for shadows, first in dict.fromkeys(found)]
    shadows, first, neighbours, second = min(both, key=lambda one: (1.0 - one[1]) * (1.0 - one[3]))
    residuals = None
    if neighbours is not None:
        whole = HeldOutFit(-1, *_known(capture, views), *_predictions(capture, views, fit, passed), fit.body)
        residuals = whole.residuals(shadows).astype(np.float32)
    before = _error([case.own for case in cases], None)
    error = float(np.sqrt(before * (1.0 - first) * (1.0 - second)))
    forecast = _forecast(cases, shadows, neighbours, views.pixels(some))
    return Learnt(solved, capture, shadows, neighbours, (first, second), error, residuals, forecast)


@dataclass(frozen=True, eq=False)
class HeldOutFit:
    """A fit without photograph `number`, and what it gives of all: values (K, C, P), trusted (K, P), fitted (K, C, P)
    under the shares of light that were given, passed (K, P), height (K, P) of the lamps over the horizon, and even
    (K, P), by which lamps are uneven; body (C, P).
    """

    number: int
    values: Array
    trusted: NDArray[np.bool_]
    directions: Array
    fitted: Array
    passed: Array
    height: Array
    even: Array
    body: Array

    def model(self, shadows: Shadows | None) -> Array:
        """(K, C, P)"""
        if shadows is None:
            return self.fitted
        share = shadows.share(self.height)
        ambient = shadows.ambient_share(self.passed * share) * self.even
        return share[:, None] * self.fitted + ambient[:, None] * self.body

    def residuals(self, shadows: Shadows | None) -> Array:
        """(K, C, P), 0 where a value is not valid, under even lamps."""
        left = (self.values - self.model(shadows)) / self.even[:, None]
        return np.where(self.trusted[:, None], left, 0.0)

    @property
    def own(self) -> HeldOutFit:
        """The photograph that was left out alone."""
        one = np.s_[self.number : self.number + 1]
        names = ("values", "trusted", "directions", "fitted", "passed", "height", "even")
        return replace(self, number=0, **{name: getattr(self, name)[one] for name in names})

    @property
    def power(self) -> float:
        """Sum of the squares of the valid values; above 0, also of a photograph that is black."""
        return max(float(np.sum(np.where(self.trusted[:, None], self.values, 0.0) ** 2)), 1e-30)


def _cases(capture: Capture, views: Views, fit: Fit, some: NDArray[np.intp], passed: Array) -> list[HeldOutFit]:
    """A fit without each of LEFT_OUT photographs, of some of the pixels."""
    few, few_fit, place = views.pixels(some), fit.pixels(some), views.place[some]
    values, trusted, directions = _known(capture, few)
    even, count = fit.evenness(place), len(values)
    height = np.stack([_heights(capture, few, to_lamp) for to_lamp in few.to_lamp])
    whole, cases = fit_pixels(few, conditions(few, few_fit, place), few_fit.normals, few_fit.body), []
    for number in np.unique(np.linspace(0, count - 1, min(count, LEFT_OUT)).round().astype(int)).tolist():
        rest = np.arange(count) != number
        without = replace(few, used=few.used & rest[:, None])
        pixels = fit_pixels(without, conditions(without, few_fit, place), few_fit.normals, few_fit.body)
        one = _changed(few_fit, whole, pixels)
        fitted = (even * passed)[:, None] * predicted(one, few.to_lamp, few.to_eye)
        cases.append(HeldOutFit(number, values, trusted, directions, fitted, passed, height, even, one.body))
    return cases


def _changed(fit: Fit, whole: NormalFit, without: NormalFit) -> Fit:
    """`fit` as without a photograph, of pixels that are `whole` with it.

    Of the change of a normal that is smoothed over neighbours, the share is left that is left of its variance. A body
    that its own photographs do not determine may change by any factor: at most MOST_CHANGE is passed on.
    """
    if fit.smooth is None:
        return replace(fit, normals=without.normals, body=without.body)
    normals = fit.normals + fit.smooth.share[:, None] * (without.normals - whole.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    change = np.clip(without.body / np.maximum(whole.body, 1e-300), 1.0 / MOST_CHANGE, MOST_CHANGE)
    return replace(fit, normals=normals, body=fit.body * change)


def _known(capture: Capture, views: Views) -> tuple[Array, NDArray[np.bool_], Array]:
    """Values, whether they are valid (also in shadow), and directions of the lamps."""
    trusted = views.valid(capture.photographs)
    values = np.where(np.isfinite(views.values), views.values, 0.0)
    return values, trusted, _directions(views.to_lamp)


def _predictions(capture: Capture, views: Views, fit: Fit, passed: Array) -> tuple[Array, Array, Array, Array]:
    """Of the fit to all photographs: fitted, passed, height and even."""
    even = fit.evenness(views.place)
    fitted = (even * passed)[:, None] * predicted(fit, views.to_lamp, views.to_eye)
    height = np.stack([_heights(capture, views, to_lamp) for to_lamp in views.to_lamp])
    return fitted, passed, height, even


def _heights(capture: Capture, views: Views, to_lamp: Array) -> Array:
    assert capture.points is not None
    camera = capture.photographs[0].camera
    return height_over_horizon(capture.points, camera, (views.rows, views.columns), to_lamp)


def _directions(to_lamp: Array) -> Array:
    """(K, 3) mean directions of lamps (K, P, 3)."""
    mean = to_lamp.mean(axis=1)
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def _shadows(cases: Sequence[HeldOutFit], fitted: float) -> tuple[Shadows | None, float]:
    """The horizon's offset and spread and the ambient light that predict best, and their gain."""
    own = [case.own for case in cases]
    before = _error(own, None)
    best, error = None, before
    for offset, spread in [NO_HORIZON, *product(OFFSETS, SPREADS)]:
        dark = Shadows(float(offset), float(spread), 0.0, fitted)
        trial = replace(dark, ambient=_ambient(own, dark))
        found = _error(own, trial)
        if found < error:
            best, error = trial, found
    gain = 1.0 - error / max(before, 1e-300)
    return (best, gain) if gain >= LEAST_GAIN else (None, 0.0)


def _ambient(own: Sequence[HeldOutFit], shadows: Shadows) -> float:
    """The ambient light, 0 or more, that leaves least squares under these shadows."""
    shared = power = 0.0
    for case in own:
        even = replace(shadows, ambient=1.0).ambient_share(case.passed * shadows.share(case.height)) * case.even
        body = np.where(case.trusted[:, None], even[:, None] * case.body, 0.0)
        shared += float(np.sum(body * (case.values - case.model(shadows)))) / case.power
        power += float(np.sum(body**2)) / case.power
    return max(shared / max(power, 1e-300), 0.0)


def _error(own: Sequence[HeldOutFit], shadows: Shadows | None) -> float:
    """Mean over the photographs left out of the squared error relative to the photograph."""
    return float(np.mean([np.sum((case.even[:, None] * case.residuals(shadows)) ** 2) / case.power for case in own]))


def _forecast(
    cases: Sequence[HeldOutFit], shadows: Shadows | None, neighbours: Neighbours | None, views: Views
) -> Forecast:
    """What the photographs left out let expect of others; views: of the same pixels."""
    missed = [_missed(case, shadows, neighbours, views.variance[case.number]) for case in cases]
    known = views.used[:, None] & np.isfinite(views.variance) & np.isfinite(views.values)
    rise, least = np.polyfit(views.values[known], views.variance[known], 1)
    return forecast_of(cases[0].directions, missed, (float(least), float(rise)))


def _missed(case: HeldOutFit, shadows: Shadows | None, neighbours: Neighbours | None, variance: Array) -> Missed:
    """How far off the photograph that was left out is, and by noise of this `variance` (C, P)."""
    others = np.arange(len(case.values)) != case.number
    lamps, left = case.directions, case.residuals(shadows)
    off, trusted = left[case.number], case.trusted[case.number]
    if neighbours is not None:
        off = off - np.tensordot(neighbours.weights(lamps[others], lamps[case.number]), left[others], axes=1)
    if not trusted.any():
        return Missed(case.number, 0.0, 0.0)
    noise = variance[:, trusted] / case.even[case.number, trusted] ** 2
    return Missed(case.number, float(np.mean(off[:, trusted] ** 2)), float(np.mean(noise)))


def _neighbours(cases: Sequence[HeldOutFit], shadows: Shadows | None) -> tuple[Neighbours | None, float]:
    """The kernel whose interpolated residuals predict best, and their gain."""
    left = [case.residuals(shadows) for case in cases]
    scale = [case.even[case.number] / np.sqrt(case.own.power) for case in cases]
    before = sum(float(np.sum((one[case.number] * by) ** 2)) for case, one, by in zip(cases, left, scale, strict=True))
    best, error = None, before
    for reach in REACHES:
        for nugget in NUGGETS:
            trial, found = Neighbours(float(reach), nugget), 0.0
            for case, one, by in zip(cases, left, scale, strict=True):
                others = np.arange(len(one)) != case.number
                weights = trial.weights(case.directions[others], case.directions[case.number])
                off = one[case.number] - np.tensordot(weights, one[others], axes=1)
                found += float(np.sum((np.where(case.trusted[case.number], off, 0.0) * by) ** 2))
            if found < error:
                best, error = trial, found
    gain = 1.0 - error / max(before, 1e-300)
    return (best, gain) if gain >= LEAST_GAIN else (None, 0.0)
