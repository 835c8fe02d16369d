"""Lack of fit: whether the residuals of a material's fit still depend on the angles, as they must not.

The model is opened where it is a choice: the facet density of eq. (4) may have another peak, other flanks or heavier
tails than a Gaussian, and the body may follow squares of cosθ_i and cosθ_r instead of Lambert's law. If the model is
right, the gradient of the fit by those freedoms is noise. Its variance is taken from the residuals themselves, summed
over each pixel, so neither a misjudged noise level nor a pixel's own texture sounds the alarm (score test, Rao 1948,
with the variance of White 1982).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import f as f_distribution

from hagoromo.reflectance.material.material_fit import MaterialFit, expected, jacobian
from hagoromo.reflectance.sight import Array, Sight
from hagoromo.reflectance.torrance_sparrow import LN2

LEVEL = 1e-4  # rate of false alarms that is stated: a capture has several materials
FLAT = np.log(1e3)  # ln γ at which every facet density is 1
FEWEST = 10.0  # pixels, effective number, that a freedom must rest on
BODY = tuple(f"the body is not Lambert's: it varies with {of} beside the model" for of in ("θ_i", "θ_i", "θ_r", "θ_r"))
FACETS = tuple(f"the facets are not Gaussian: their density has {what}" for what in ("another peak", "other flanks",
               "other tails", "other far tails"))  # fmt: skip


@dataclass(frozen=True)
class LackOfFit:
    """Test of the model's shape over the angles.

    statistic: F with `degrees` (freedoms, pixels − freedoms) of freedom. p_value: chance of as much where the model is
    right. rms: relative size of what the model misses, root mean square over the values. rejected: p_value below LEVEL.
    where: the freedom that misses most, in words.
    """

    statistic: float
    degrees: tuple[int, int]
    p_value: float
    rms: float
    rejected: bool
    where: str

    def record(self) -> dict[str, Any]:
        """As materials.json has it."""
        return asdict(self) | {"degrees": list(self.degrees), "level": LEVEL}

    def remark(self) -> str:
        """One line for people."""
        f = f"F({self.degrees[0]}, {self.degrees[1]}) = {self.statistic:.3g}"
        return (
            f"lack of fit: {self.where}; this is no dichromatic Torrance–Sparrow reflectance, the model misses "
            f"{100 * self.rms:.2g} % of the values rms ({f}, p {_p_text(self.p_value)}, level {LEVEL:g})"
        )


def lack_of_fit(fit: MaterialFit) -> LackOfFit | None:
    """The test for `fit`; None where too few pixels could carry it."""
    seen, objective = fit.objective.seen, fit.objective
    freedoms, names = _freedoms(fit)
    model = expected(seen.sight, fit.theta)
    deviation = np.where(seen.used, seen.values - model, 0.0)
    slope = np.where(seen.used, objective.loss.curvature(deviation / np.sqrt(objective.variance)), 0.0)
    slope = slope / objective.variance
    j = jacobian(seen.sight, fit.theta)[..., fit.free]  # one held at its bound is no news of the model's shape
    # what the fit takes up of a freedom has no gradient: it is taken off
    inner = np.einsum("nc,ncp,ncq->pq", slope, j, j)
    beside = np.linalg.pinv(inner, hermitian=True) @ np.einsum("nc,ncp,ncq->pq", slope, j, freedoms)
    freedoms = freedoms - j @ beside
    scores = np.einsum("nc,nc,ncq->nq", fit.weight, deviation, freedoms)
    pixel = np.unique(seen.pixel, return_inverse=True)[1]
    scores = np.stack([np.bincount(pixel, column) for column in scores.T], axis=1)
    power = scores**2
    rests = power.sum(axis=0) ** 2 / np.maximum((power**2).sum(axis=0), 1e-300)
    kept = rests >= FEWEST
    pixels = int(np.sum(power.any(axis=1)))
    if not kept.any() or pixels <= 3 * kept.sum():
        return None
    scores, freedoms, names = scores[:, kept], freedoms[..., kept], [n for n, k in zip(names, kept, strict=True) if k]
    total = scores.sum(axis=0)
    spread = scores.T @ scores
    scale = 1.0 / np.sqrt(np.diag(spread))
    quadratic = float(total * scale @ np.linalg.pinv(spread * np.outer(scale, scale), hermitian=True) @ (total * scale))
    # Hotelling's T² of scores whose mean is 0 under the model
    q, m = len(total), pixels - len(total)
    statistic = quadratic / q * m / max(pixels - quadratic, 1e-9 * pixels)
    p_value = float(f_distribution.sf(statistic, q, m))
    curvature = np.einsum("nc,ncp,ncq->pq", fit.weight, freedoms, freedoms)
    step = np.linalg.pinv(curvature, rcond=1e-9, hermitian=True) @ total
    missed = freedoms @ step
    rms = float(np.sqrt(np.sum(np.where(seen.used, missed, 0.0) ** 2) / np.sum(np.where(seen.used, model, 0.0) ** 2)))
    worst = int(np.argmax(np.abs(total * scale)))
    return LackOfFit(statistic, (q, m), p_value, rms, p_value < LEVEL, names[worst])


def _freedoms(fit: MaterialFit) -> tuple[Array, list[str]]:
    """Derivatives (N, C, Q) of the values by each freedom, and what is missed where the fit pulls at it."""
    seen, theta = fit.objective.seen.sight, fit.theta
    incidence, view = seen.cosines.incidence, seen.cosines.view
    tilts = np.stack([cosine**power for cosine in (incidence, view) for power in (1, 2)], axis=-1)
    shape = (*seen.body.shape, -1)
    columns, names = theta[:-3, None] * _spread(seen, tilts).body.reshape(shape), [*BODY]
    if theta[-3] > 0.0 and fit.free[-2]:
        u = (np.arccos(np.clip(seen.cosines.half, -1.0, 1.0)) / np.exp(theta[-2])) ** 2  # (φ/γ)²
        shapes = np.stack([u**2 * np.exp(-2 * LN2 * u), u**2 * np.exp(-LN2 * u), (1 + u) ** -2, (1 + u) ** -1], axis=-1)
        facets = _spread(seen, shapes).interface(np.array([FLAT]), theta[-1:])[0][0]
        columns, names = np.concatenate([columns, theta[-3] * facets.reshape(shape)], axis=2), [*names, *FACETS]
    return columns, names


def _spread(seen: Sight, factors: Array) -> Sight:
    """`seen` with C·Q channels: the irradiance (N, L, C) times each of `factors` (N, L, Q)."""
    many = seen.irradiance[..., None] * factors[:, :, None, :]
    return replace(seen, irradiance=many.reshape(*many.shape[:2], -1))


def _p_text(p_value: float) -> str:
    return "< 1e-15" if p_value < 1e-15 else f"= {p_value:.2g}"
