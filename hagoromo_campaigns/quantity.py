"""Quantity: one of the things that are compared, as a map with its error and where it is significant.

colour: difference of ln body colours, shown as ΔE00. gloss, width: ln of the strength β F₀ and of the width γ of the
highlight, shown in %. shape: along the normal, outwards positive. normals: turns about two axes, shown as their angle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.shading import tangents
from hagoromo_campaigns.campaign import GLOSS
from hagoromo_campaigns.overlap import Overlap
from hagoromo_campaigns.paint import Paint
from hagoromo_campaigns.significance import Significance, significant
from hagoromo_campaigns.trend import trend

Array = NDArray[np.float64]
DEGREES = {"colour": 1, "gloss": 0, "width": 0, "shape": 2, "normals": 1}  # of the trend that is taken out


@dataclass(frozen=True, eq=False)
class Quantity:
    """difference, variance: (h, w, k) at BEFORE's pixels, less the trend; NaN where not compared.

    value, error: name of a map → (h, w) in `unit`; colour has a map for each lamp, all others one, "".
    trend: coefficients (t, k) of what was taken out, the first of the constant; shared: standard error that both
    campaigns state of the constant, NaN where they state none. least_error: of `difference`, by registration and
    others.
    """

    name: str
    unit: str
    difference: Array
    variance: Array
    trend: Array
    shared: float
    significance: Significance
    value: Mapping[str, Array]
    error: Mapping[str, Array]
    paint: Paint | None = field(default=None, repr=False)

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(h, w)"""
        return np.asarray(np.isfinite(self.difference).all(axis=2))

    @property
    def signed(self) -> bool:
        """Whether the map has a sign; else it is a distance, 0 or more."""
        return self.name not in ("colour", "normals")


@dataclass(frozen=True, eq=False)
class _Raw:
    """A quantity before its test; scale: of its unit. pattern: that its errors follow, see `trend`."""

    name: str
    unit: str
    scale: float
    difference: Array
    variance: Array
    shared: float = float("nan")
    pattern: Array | None = None


def quantities(both: Overlap, painted: Paint, rate: float) -> tuple[Quantity, ...]:
    """All that both campaigns state with errors. rate: of false discoveries, of all quantities together."""
    raw = [_colour(both, painted), *_gloss(both), *_shape(both), *_normals(both)]
    return tuple(_tested(one, rate / len(raw), painted) for one in raw)


def _tested(raw: _Raw, rate: float, painted: Paint) -> Quantity:
    common, coefficients = trend(raw.difference, raw.variance, DEGREES[raw.name], raw.pattern)
    difference = raw.difference - common
    tested = significant(difference, raw.variance, rate)
    wider = tested.widening[0]
    if raw.name == "colour":
        value = {label: painted.delta_e(label, painted.before, difference) for label in painted.displays}
        error = {
            label: wider * painted.delta_e_error(label, painted.before, difference, raw.variance)
            for label in painted.displays
        }
    elif raw.name == "normals":
        size = np.linalg.norm(difference, axis=2)
        value = {"": raw.scale * size}
        error = {"": raw.scale * wider * np.sqrt(raw.variance.mean(axis=2))}
    else:
        value = {"": shown(raw.unit, raw.scale, difference[..., 0])}
        slope = np.exp(difference[..., 0]) if raw.unit == "%" else 1.0
        error = {"": raw.scale * slope * wider * np.sqrt(raw.variance[..., 0])}
    of_colour = painted if raw.name == "colour" else None
    return Quantity(
        raw.name, raw.unit, difference, raw.variance, coefficients, raw.shared, tested, value, error, of_colour
    )


def shown(unit: str, scale: float, difference: Array) -> Array:
    """A difference in its unit; in per cent, of logarithms."""
    return scale * (np.expm1(difference) if unit == "%" else difference)


def scale_of(quantity: Quantity, pitch: float) -> float:
    """From `difference` to the unit."""
    return {"%": 100.0, "µm": 1e6, "px": 1.0 / pitch, "°": float(np.degrees(1.0)), "ΔE00": 1.0}[quantity.unit]


def _colour(both: Overlap, painted: Paint) -> _Raw:
    value, added = both.after_map(np.log(painted.after))
    variance = painted.before_variance + both.after_variance(painted.after_variance) + added
    shared = float(np.hypot(both.before.body_shared, both.after.body_shared))
    difference = value - np.log(painted.before)
    return _Raw("colour", "ΔE00", 1.0, difference, _known(variance, value), shared, _light_of_gloss(both, painted))


def _light_of_gloss(both: Overlap, painted: Paint) -> Array | None:
    """Light of the highlight over that of the body: an error of a material's gloss gives the body this pattern."""
    gloss = both.before.gloss
    if gloss is None or not np.isfinite(gloss[both.shown]).any():
        return None
    strength = np.exp(np.where(np.isfinite(gloss[..., :1]), gloss[..., :1], -np.inf))
    pattern = strength / painted.before
    return pattern / np.median(pattern[both.shown])


def _gloss(both: Overlap) -> list[_Raw]:
    before, after = both.before, both.after
    if before.gloss is None or after.gloss is None or before.gloss_variance is None or after.gloss_variance is None:
        return []
    if not (before.gloss_varies or after.gloss_varies):
        return []  # one value of each material has no map: see `common_changes`
    found = []
    for k, name in enumerate(GLOSS):
        own, other = (one.gloss[..., k : k + 1] for one in (before, after) if one.gloss is not None)
        value, added = both.after_map(other)
        variance = (
            before.gloss_variance[..., k : k + 1] + both.after_variance(after.gloss_variance[..., k : k + 1]) + added
        )
        difference = np.where(both.shown[..., None], value - own, np.nan)
        if not np.isfinite(difference).any():
            continue
        shared = float(np.hypot(before.gloss_shared[k], after.gloss_shared[k]))
        found.append(_Raw(name, "%", 100.0, difference, _known(variance, difference), shared))
    return found


def _shape(both: Overlap) -> list[_Raw]:
    before, after, to_after = both.before, both.after, both.registration.to_after
    if before.point_variance is None or after.point_variance is None:
        return []
    value, added = both.after_map(after.points, to_after.directions(before.normals)[..., None, :])
    away = (to_after.inverse.points(value) - before.points) * before.normals
    other = (both.after_variance(after.point_variance[..., None]) + added) / to_after.scale**2
    variance = before.point_variance[..., None] + other
    metres = before.in_metres and after.in_metres
    unit, scale = ("µm", 1e6) if metres else ("px", 1.0 / before.pitch)
    return [_Raw("shape", unit, scale, away.sum(axis=2, keepdims=True), _known(variance, value))]


def _normals(both: Overlap) -> list[_Raw]:
    before, after, to_after = both.before, both.after, both.registration.to_after
    if before.normal_variance is None or after.normal_variance is None:
        return []
    across = np.stack(tangents(before.normals), axis=-2)
    value, added = both.after_map(after.normals, to_after.directions(across))
    turned = to_after.inverse.directions(value) - before.normals
    difference = np.einsum("hwki,hwi->hwk", across, turned)
    variance = before.normal_variance[..., None] + both.after_variance(after.normal_variance[..., None]) + added
    return [_Raw("normals", "°", float(np.degrees(1.0)), difference, _known(variance, difference))]


def _known(variance: Array, like: Array) -> Array:
    """Variances, NaN where nothing is compared."""
    return np.where(np.isfinite(like).all(axis=2, keepdims=True), variance, np.nan)
