"""Exponent: whether the values of photographs are linear in light, by the shading of the object itself.

Enters: values of pixels under several lamps of known direction. Leaves: the exponent p for which vᵖ follows Lambert's
law best, v = (n · L)^(1/p): 1 where values are linear, near 2.2 where display-encoded numbers were taken for light,
near 0.45 where light was decoded once too often.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import log_interval

Array = NDArray[np.float64]

FEWEST_LAMPS = 6  # three fit any values, and errors of the lamps' directions show only where some can be left out
FEWEST_PIXELS = 60
MOST_PIXELS = 500  # a sample of them is as good
EXPONENTS = np.exp(np.linspace(np.log(0.2), np.log(5.0), 21))
FEWEST_AT_A_PIXEL = 5
LIT = 0.2  # cosine of incidence above which a lamp counts at a pixel
DARK = 0.01  # share of a pixel's largest value below which a lamp is taken for shadow
RELATIVE, FLOOR = 0.03, 0.01  # errors of the model: of the value, and of the pixel's largest value
OUTLIER = 2.5  # [such errors] residuals beyond count linearly (Huber), as highlights and cast shadows do
ROUNDS = 3  # reweightings
PIXEL_GROUPS, LAMP_GROUPS = 8, 6  # that are left out, one after the other, for the error of the exponent (jackknife)
LEAST_ERROR = 0.01  # of ln p: matte balls in 8 bits under exact lamps come out 0.98 to 1.02
SIGNIFICANT = 2.0  # standard errors from 1
# Limits of the exponent of linear values. Below: rough and porous matter, which darkens late, has 0.87 to 1. Above:
# half of the way to 2.2. With lamps that are 1° to 8° off, twelve real sets have 0.92 to 1.31.
LOWEST, HIGHEST = 0.8, 2.2**0.5
# [rad] from the normal to the half vector: nearer, a highlight may brighten the pixel. On a flat object it then does so
# in whole photographs, which looks as if values were bent: on rings of lamps 30° and 55° up, linear values of a glossy
# relief have an exponent of 3.3. Lobes of 15° half width have 5 % of their peak there.
GLOSSY = np.radians(30.0)
Finding = Literal["linear", "uncertain", "doubtful", "bent"]


@dataclass(frozen=True)
class Exponent:
    """value: of best fit; standard_error: of its logarithm. glossy: whether highlights may be why it is not 1."""

    value: float
    standard_error: float
    glossy: bool = False

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the exponent."""
        return log_interval(self.value, self.standard_error, SIGNIFICANT)

    @property
    def finding(self) -> Finding:
        """What the shading says about the transfer.

        bent: the values are not linear in light, beyond what noise and the surfaces of matter explain. doubtful: the
        interval leaves 1 out, and a wrong transfer, wrong lamps, gloss or rough matter may be why. uncertain: the
        interval has 1 and values that are not linear in light. linear: the interval has 1 and no such value.
        """
        low, high = self.interval
        outside = not low <= 1.0 <= high
        if outside:
            return "doubtful" if self.glossy or LOWEST <= self.value <= HIGHEST else "bent"
        return "linear" if LOWEST <= low and high <= HIGHEST else "uncertain"

    @property
    def bent(self) -> bool:
        """Whether the values are not linear in light: beyond what noise and the surfaces of matter explain."""
        return self.finding == "bent"

    @property
    def contradicted(self) -> bool:
        """Whether the interval leaves 1 out, so that people must hear of it."""
        return self.finding in ("bent", "doubtful")

    @property
    def uncertain(self) -> bool:
        """Whether values that are not linear in light are within the interval."""
        low, high = self.interval
        return not (LOWEST <= low and high <= HIGHEST)

    @property
    def sentence(self) -> str:
        """What the shading says about the transfer, in words."""
        low, high = self.interval
        figure = f"exponent {self.value:.2f}, {low:.2f} to {high:.2f} by the shading of the object"
        if not self.contradicted:
            uncertain = "too uncertain to tell linear values from others"
            return f"{figure}: {'linear in light' if self.finding == 'linear' else uncertain}"
        curve = "display-encoded (sRGB) and were taken for linear" if self.value > 1.0 else (
            "linear and were decoded as sRGB, or decoded twice"
        )  # fmt: skip
        if self.bent:
            return f"{figure}, 1 expected: the photographs look as if they were {curve}"
        other = ", or the matter is glossy" if self.glossy else (
            "" if self.value > 1.0 else ", or the matter is rough and darkens late"
        )  # fmt: skip
        return f"{figure}, and linear values have 1: perhaps the photographs were {curve}, or the lamps are off{other}"

    @property
    def advice(self) -> str:
        """What to do where the interval leaves 1 out; empty elsewhere."""
        if not self.contradicted:
            return ""
        if self.bent:
            return (
                "normals and materials are wrong until it is right: state it (--transfer of capture), or take RAW files"
            )
        other = "srgb" if self.value > 1.0 else "linear"
        return (
            f"unless the files are RAW, run capture again with the other curve (--transfer {other}) and keep the one "
            "whose exponent is nearer to 1, or measure the curve (--transfer estimate with --bracket); if the curve is "
            "known, check the lamps"
        )

    def record(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "exponent": self.value,
            "standard_error_of_log": self.standard_error,
            "interval_95": list(self.interval),
            "finding": self.finding,
            "advice": self.advice,
            "bent": self.bent,
        }


def exponent_of(values: Array, to_lamp: Array, to_eye: Array) -> Exponent | None:
    """The exponent of values (K, P) over the irradiance that faces their lamp; to_lamp: (K, 3), unit, or (K, P, 3).

    to_eye: (3,) unit, to the camera. Where the exponent is not 1 by all values, those beside highlights (GLOSSY) are
    asked alone: where they are linear theirs is given, and where they do not say, highlights may be why.
    Values that are not finite or not above 0 are not used. None where the photographs do not determine it: fewer than
    six lamps, or 60 pixels that five of them light.
    """
    if len(values) < FEWEST_LAMPS:
        return None
    to_lamp = np.broadcast_to(to_lamp[:, None] if to_lamp.ndim == 2 else to_lamp, (*values.shape, 3))
    chosen = _chosen(values, to_lamp)
    by_all = _of_chosen(*chosen)
    if by_all is None or not by_all.contradicted:
        return by_all
    beside = _of_chosen(*_beside_highlights(*chosen, np.asarray(to_eye, np.float64)))
    if beside is None or beside.finding == "uncertain":
        return replace(by_all, glossy=True)
    return beside if beside.finding == "linear" else by_all


def _of_chosen(scaled: Array, usable: NDArray[np.bool_], to_lamp: Array) -> Exponent | None:
    """The exponent of values (K, P) as `_chosen` gives them."""
    if scaled.shape[1] < FEWEST_PIXELS:
        return None
    misfit = _profile(scaled, usable, to_lamp)
    total = misfit.sum(axis=1)
    group = np.arange(scaled.shape[1]) * PIXEL_GROUPS // scaled.shape[1]
    by_pixels = [_least(total - misfit[:, group == k].sum(axis=1)) for k in range(PIXEL_GROUPS)]
    by_lamps = []
    for k in range(LAMP_GROUPS):
        kept = usable & (np.arange(len(scaled)) % LAMP_GROUPS != k)[:, None]
        still = kept.sum(axis=0) >= FEWEST_AT_A_PIXEL - 1
        by_lamps.append(_least(_profile(scaled[:, still], kept[:, still], to_lamp[:, still]).sum(axis=1)))
    parts = _jackknife(by_pixels), _jackknife(by_lamps), LEAST_ERROR
    return Exponent(float(np.exp(_least(total))), float(np.linalg.norm(parts)))


def lambert_fit(values: Array, usable: NDArray[np.bool_], to_lamp: Array) -> tuple[Array, Array]:
    """Residuals (K, P) of Lambert's law in errors of the model, 0 where not usable, and g (P, 3), normal times albedo.

    values: (K, P) over the largest of their pixel, any number above 0 where not usable. to_lamp: (K, P, 3).
    """
    return _fit(values, usable, to_lamp, 1.0)


def _chosen(values: Array, to_lamp: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Values over the largest of their pixel, whether they count, and the directions (K, P, 3), of up to MOST_PIXELS
    pixels that enough lamps light.
    """
    light = np.where(np.isfinite(values), values, 0.0)
    largest = light.max(axis=0)
    usable = light > DARK * largest
    pixels = np.flatnonzero(usable.sum(axis=0) >= FEWEST_AT_A_PIXEL)
    pixels = pixels[:: max(-(-len(pixels) // MOST_PIXELS), 1)]
    usable, to_lamp = usable[:, pixels], to_lamp[:, pixels]
    scaled = np.where(usable, light[:, pixels], largest[pixels]) / largest[pixels]
    usable &= _lit(scaled, usable, to_lamp)
    still = usable.sum(axis=0) >= FEWEST_AT_A_PIXEL
    return scaled[:, still], usable[:, still], to_lamp[:, still]


def _beside_highlights(
    scaled: Array, usable: NDArray[np.bool_], to_lamp: Array, to_eye: Array
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Those of `_chosen` whose half vector is GLOSSY or more from the pixel's normal, of pixels with enough of them."""
    _, g = _fit(scaled, usable, to_lamp, 1.0)
    half = to_lamp + to_eye
    length = np.linalg.norm(half, axis=2) * np.linalg.norm(g, axis=1)
    usable = usable & (np.einsum("kpi,pi->kp", half, g) < np.cos(GLOSSY) * length)
    still = usable.sum(axis=0) >= FEWEST_AT_A_PIXEL
    return scaled[:, still], usable[:, still], to_lamp[:, still]


def _jackknife(estimates: Sequence[float]) -> float:
    """Standard error of an estimate from those without one group each."""
    return float(np.sqrt((len(estimates) - 1) * np.var(estimates)))


def _profile(values: Array, usable: NDArray[np.bool_], to_lamp: Array) -> Array:
    """(EXPONENTS, P) misfit of each pixel."""
    return np.stack([_misfit(values, usable, to_lamp, p) for p in EXPONENTS])


def _lit(values: Array, usable: NDArray[np.bool_], to_lamp: Array) -> NDArray[np.bool_]:
    """(K, P) lamps that light the pixel well by its own normal: nothing dark is chosen by its value, which p
    changes.
    """
    _, g = _fit(values, usable, to_lamp, 1.0)
    return np.einsum("kpi,pi->kp", to_lamp, g) > LIT * np.linalg.norm(g, axis=1)


def _misfit(values: Array, usable: NDArray[np.bool_], to_lamp: Array, p: float) -> Array:
    """(P,) Huber's misfit of values (K, P) to (g · L)^(1/p), with the best g of each pixel."""
    scaled, _ = _fit(values, usable, to_lamp, p)
    return np.where(scaled < OUTLIER, 0.5 * scaled**2, OUTLIER * (scaled - 0.5 * OUTLIER)).sum(axis=0)


def _fit(values: Array, usable: NDArray[np.bool_], to_lamp: Array, p: float) -> tuple[Array, Array]:
    """Residuals (K, P) in errors of the model, 0 where not usable, and g (P, 3)."""
    power = values**p
    # dv = dy / (p v^(p − 1)): an error of the value, as one of its power
    weight = np.where(usable, 1.0 / (p * values ** (p - 1.0) * np.hypot(RELATIVE * values, FLOOR)), 0.0)
    robust, scaled, g = np.ones_like(values), np.zeros_like(values), np.zeros((values.shape[1], 3))
    for _ in range(ROUNDS):
        w2 = (weight * robust) ** 2
        normal = np.einsum("kp,kpi,kpj->pij", w2, to_lamp, to_lamp, optimize=True)
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-30 * np.eye(3)
        right = np.einsum("kp,kpi->pi", w2 * power, to_lamp)
        g = np.linalg.solve(normal, right[..., None])[..., 0]
        predicted = np.maximum(np.einsum("kpi,pi->kp", to_lamp, g), 0.0) ** (1.0 / p)
        scaled = np.where(usable, np.abs(values - predicted) / np.hypot(RELATIVE * values, FLOOR), 0.0)
        robust = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(scaled, 1e-12)))
    return scaled, g


def _least(curve: Array) -> float:
    """ln p at the least of a curve over EXPONENTS, by a parabola within its ends."""
    place = int(np.clip(np.argmin(curve), 1, len(curve) - 2))
    left, middle, right = curve[place - 1 : place + 2]
    step = np.log(EXPONENTS[1] / EXPONENTS[0])
    bend = left - 2.0 * middle + right
    off = 0.5 * (left - right) / bend if bend > 0.0 else np.sign(left - right)
    return float(np.log(EXPONENTS[place]) + step * np.clip(off, -1.0, 1.0))
