"""Exponent: whether the values of photographs are linear in light, by the shading of the object itself.

Enters: values of pixels under several lamps of known direction. Leaves: the exponent p for which vᵖ follows Lambert's
law best, v = (n · L)^(1/p): 1 where values are linear, near 2.2 where display-encoded numbers were taken for light,
near 0.45 where light was decoded once too often.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import Loss, log_interval

Array = NDArray[np.float64]

FEWEST_LAMPS = 6  # three fit any values, and errors of the lamps' directions show only where some can be left out
FEWEST_PIXELS = 60
MOST_PIXELS = 500  # a sample of them is as good
EXPONENTS = np.exp(np.linspace(np.log(0.2), np.log(5.0), 21))
LINEAR = len(EXPONENTS) // 2  # place of 1 among them
FEWEST_AT_A_PIXEL = 5
LIT = 0.2  # cosine of incidence above which a lamp counts at a pixel
DARK = 0.01  # share of a pixel's largest value below which a lamp is taken for shadow
RELATIVE, FLOOR = 0.03, 0.01  # errors of the model: of the value, and of the pixel's largest value
ROBUST = Loss("huber", 2.5)  # [such errors] residuals beyond count linearly, as highlights and cast shadows do
ROUNDS = 3  # reweightings
GLOSS_WIDTHS = (0.05, 0.1, 0.2, 0.3, 0.4)  # [rad] of the half vector, of a gloss that is tried
GLOSS_TURNS = 6  # of the gloss and the normals in turn
EVIDENT = 0.8  # misfit with gloss over that without, from which it is taken out
PIXEL_GROUPS, LAMP_GROUPS = 8, 6  # that are left out, one after the other, for the error of the exponent (jackknife)
LEAST_ERROR = 0.01  # of ln p: matte balls in 8 bits under exact lamps come out 0.98 to 1.02
# Of ln p, by gloss, shadows and light between parts that Lambert's law does not explain: of MISFIT or more (mean of
# Huber's loss, in errors of the model), in proportion to its root below.
UNEXPLAINED, MISFIT = 0.12, 0.1
SIGNIFICANT = 2.0  # standard errors from 1
# The same of an exponent that could be one of linear values: captures with nothing wrong are many, and one in a hundred
# is doubted, not one in twenty.
MILD = 2.576
ROUGH = 0.87  # least exponent of linear values of rough and porous matter, which darkens late
# Limits of the exponent of linear values: half of the way to those of values that are coded, or decoded once too often.
# With lamps that are 1° to 8° off, twelve real sets have 0.92 to 1.31.
LOWEST, HIGHEST = 2.2**-0.5, 2.2**0.5
Finding = Literal["linear", "uncertain", "doubtful", "bent"]


@dataclass(frozen=True)
class Exponent:
    """value: of best fit; standard_error: of its logarithm; misfit, linear_misfit: with it, and of linear values,
    mean of Huber's loss of the readings in errors of the model.
    """

    value: float
    standard_error: float
    misfit: float = 0.0
    linear_misfit: float = 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the exponent."""
        return log_interval(self.value, self.standard_error, SIGNIFICANT)

    @property
    def finding(self) -> Finding:
        """What the shading says about the transfer.

        bent: the values are not linear in light, beyond what noise and the surfaces of matter explain. doubtful: the
        interval of 99 % leaves 1 out, and a wrong transfer, wrong lamps or rough matter may be why. uncertain: the
        interval of 95 % has values that are not linear in light. linear: it has no such value.
        """
        low, high = self.interval
        if not LOWEST <= self.value <= HIGHEST:
            return "uncertain" if low <= 1.0 <= high else "bent"
        if abs(math.log(self.value)) > MILD * self.standard_error:
            return "doubtful"
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
            uncertain = "too uncertain to part linear values from others"
            return f"{figure}: {'linear in light' if self.finding == 'linear' else uncertain}"
        curve = "display-encoded (sRGB) and were taken for linear" if self.value > 1.0 else (
            "linear and were decoded as sRGB, or decoded twice"
        )  # fmt: skip
        if self.bent:
            return f"{figure}, 1 expected: the photographs look as if they were {curve}"
        causes = [f"the photographs were {curve}", "the lamps are off"]
        if self.value < 1.0:
            causes.insert(0 if self.value >= ROUGH else 2, "the matter is rough and darkens late")
        return f"{figure}, and linear values have 1: perhaps {', or '.join(causes)}"

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
    """The exponent of values (K, P) over the irradiance that faces their lamp; to_lamp: (K, 3), unit, or (K, P, 3);
    to_eye: (3,) unit, or (P, 3).

    Where it is not 1, it is asked again of values less the light of a gloss that explains them as linear: on a flat
    object a gloss brightens whole photographs, which looks as if values were bent. Values that are not finite or not
    above 0 are not used. None where the photographs do not determine it: fewer than six lamps, or 60 pixels that five
    of them light.
    """
    if len(values) < FEWEST_LAMPS:
        return None
    to_lamp = np.broadcast_to(to_lamp[:, None] if to_lamp.ndim == 2 else to_lamp, (*values.shape, 3))
    to_eye = np.broadcast_to(np.asarray(to_eye, np.float64), (values.shape[1], 3))
    scaled, usable, to_lamp, to_eye = _chosen(values, to_lamp, to_eye)
    by_all = _by_profile(scaled, usable, to_lamp)
    if by_all is None or not by_all.contradicted:
        return by_all
    matte = without_gloss(scaled, usable, to_lamp, to_eye)
    if matte is None:
        return by_all
    by_rest = _by_profile(*_chosen(np.where(matte[1], matte[0], np.nan), to_lamp, to_eye)[:3])
    return by_rest if by_rest is not None and by_rest.finding == "linear" else by_all


def _by_profile(scaled: Array, usable: NDArray[np.bool_], to_lamp: Array) -> Exponent | None:
    """The exponent of values as `_chosen` gives them."""
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
    left, linear = (float(one) / max(int(usable.sum()), 1) for one in (total.min(), total[LINEAR]))
    unexplained = UNEXPLAINED * min(math.sqrt(left / MISFIT), 1.0)
    parts = _jackknife(by_pixels), _jackknife(by_lamps), unexplained, LEAST_ERROR
    return Exponent(float(np.exp(_least(total))), float(np.linalg.norm(parts)), left, linear)


def lambert_fit(values: Array, usable: NDArray[np.bool_], to_lamp: Array) -> tuple[Array, Array]:
    """Residuals (K, P) of Lambert's law in errors of the model, 0 where not usable, and g (P, 3), normal times albedo.

    values: (K, P) over the largest of their pixel, any number above 0 where not usable. to_lamp: (K, P, 3).
    """
    return _fit(values, usable, to_lamp, 1.0)


def without_gloss(
    values: Array, usable: NDArray[np.bool_], to_lamp: Array, to_eye: Array
) -> tuple[Array, NDArray[np.bool_]] | None:
    """Values (K, P), and which are usable, less the light of a gloss that is the same at all pixels: a Gaussian of the
    angle of the half vector. None where no such gloss makes Lambert's law fit better by a fifth.

    to_lamp: (K, P, 3); to_eye: (P, 3); unit.
    """
    largest = np.maximum(np.where(usable, values, 0.0).max(axis=0), 1e-300)
    scaled = np.where(usable, values, 0.0) / largest
    half = to_lamp + to_eye
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-300)

    def fitted(rest: Array, there: NDArray[np.bool_]) -> tuple[float, Array, Array]:
        """Misfit, residuals and unit normals of what is left, over its own largest values."""
        top = np.maximum(np.where(there, rest, 0.0).max(axis=0), 1e-300)
        residual, g = lambert_fit(np.where(there, rest / top, 1.0), there, to_lamp)
        return loss(residual, there), residual, g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-300)

    plain = fitted(scaled, usable)
    least, best = EVIDENT * plain[0], None
    for width in GLOSS_WIDTHS:
        (_, residual, normals), rest, there = plain, scaled, usable
        misfit = np.inf
        for _ in range(GLOSS_TURNS):
            angle = np.arccos(np.clip(np.sum(half * normals, axis=-1), -1.0, 1.0))
            lobe = np.where(np.sum(to_lamp * normals, axis=-1) > 0.0, np.exp(-((angle / width) ** 2)), 0.0) / largest
            weight = np.where(usable, np.sqrt(ROBUST.weight(residual)) / np.hypot(RELATIVE * scaled, FLOOR), 0.0)
            # the parts of both that no normal and albedo of each pixel explain
            own, other = (weight * (one - _lambert(weight**2, one, to_lamp)[1]) for one in (lobe, scaled))
            strength = max(float(np.sum(own * other)) / max(float(np.sum(own * own)), 1e-300), 0.0)
            rest = scaled - strength * lobe
            there = usable & (rest > 0.0)
            misfit, residual, normals = fitted(rest, there)
        if misfit < least:
            least, best = misfit, (np.maximum(rest, 0.0) * largest, there)
    return best


def loss(residual: Array, usable: NDArray[np.bool_]) -> float:
    """Mean of Huber's loss of residuals in errors of the model."""
    return float(ROBUST.value(residual)[usable].mean()) if usable.any() else 0.0


def _chosen(values: Array, to_lamp: Array, to_eye: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
    """Values over the largest of their pixel, whether they count, and the directions (K, P, 3) and (P, 3), of up to
    MOST_PIXELS pixels that enough lamps light.
    """
    light = np.where(np.isfinite(values), values, 0.0)
    largest = light.max(axis=0)
    usable = light > DARK * largest
    pixels = np.flatnonzero(usable.sum(axis=0) >= FEWEST_AT_A_PIXEL)
    pixels = pixels[:: max(-(-len(pixels) // MOST_PIXELS), 1)]
    usable, to_lamp, to_eye = usable[:, pixels], to_lamp[:, pixels], to_eye[pixels]
    scaled = np.where(usable, light[:, pixels], largest[pixels]) / largest[pixels]
    usable &= _lit(scaled, usable, to_lamp)
    still = usable.sum(axis=0) >= FEWEST_AT_A_PIXEL
    return scaled[:, still], usable[:, still], to_lamp[:, still], to_eye[still]


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
    return ROBUST.value(scaled).sum(axis=0)


def _fit(values: Array, usable: NDArray[np.bool_], to_lamp: Array, p: float) -> tuple[Array, Array]:
    """Residuals (K, P) in errors of the model, 0 where not usable, and g (P, 3)."""
    power = values**p
    # dv = dy / (p v^(p − 1)): an error of the value, as one of its power
    weight = np.where(usable, 1.0 / (p * values ** (p - 1.0) * np.hypot(RELATIVE * values, FLOOR)), 0.0)
    robust, scaled, g = np.ones_like(values), np.zeros_like(values), np.zeros((values.shape[1], 3))
    for _ in range(ROUNDS):
        g, light = _lambert((weight * robust) ** 2, power, to_lamp)
        predicted = np.maximum(light, 0.0) ** (1.0 / p)
        scaled = np.where(usable, np.abs(values - predicted) / np.hypot(RELATIVE * values, FLOOR), 0.0)
        robust = np.sqrt(ROBUST.weight(scaled))
    return scaled, g


def _lambert(squares: Array, light: Array, to_lamp: Array) -> tuple[Array, Array]:
    """g (P, 3) with which Lambert's law explains `light` (K, P) best, weighted by `squares`, and its light (K, P)."""
    normal = np.einsum("kp,kpi,kpj->pij", squares, to_lamp, to_lamp, optimize=True)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-30 * np.eye(3)
    right = np.einsum("kp,kpi->pi", squares * light, to_lamp)
    g = np.linalg.solve(normal, right[..., None])[..., 0]
    return g, np.einsum("kpi,pi->kp", to_lamp, g)


def _least(curve: Array) -> float:
    """ln p at the least of a curve over EXPONENTS, by a parabola within its ends."""
    place = int(np.clip(np.argmin(curve), 1, len(curve) - 2))
    left, middle, right = curve[place - 1 : place + 2]
    step = np.log(EXPONENTS[1] / EXPONENTS[0])
    bend = left - 2.0 * middle + right
    off = 0.5 * (left - right) / bend if bend > 0.0 else np.sign(left - right)
    return float(np.log(EXPONENTS[place]) + step * np.clip(off, -1.0, 1.0))
