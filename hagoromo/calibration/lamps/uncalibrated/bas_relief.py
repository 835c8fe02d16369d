"""Bas-relief ambiguity: the three parameters that integrability leaves free, by priors on objects and lamps.

With c₃ = m c₁ + n c₂ + l c₁ × c₂ the surface is sheared by m and n and stretched by l (Belhumeur, Kriegman and Yuille
1999). Objects have few albedos: the entropy of ln albedo is minimal (Alldrin, Mallick and Kriegman 2007, "Resolving the
generalized bas-relief ambiguity by entropy minimization"). Weaker priors: lamps have similar strengths, and the mean
slope of a closed object is 0.

Integrability: the 3 × 3 matrices for which the normals are those of a surface.

With true lamps s = C ŝ and true pixels b = C⁻ᵀ b̂, v the ray of a pixel, (x', y', −1), x right, y up, the surface's
depth has one curl-free gradient where (b_y × b)·(v_x × v) = (b_x × b)·(v_y × v). As C⁻ᵀ is the matrix of cofactors, up
to scale, C acts on the products of b̂ themselves, and the condition is linear in the rows of C:

    c₁·K_x + c₂·K_y + c₃·(x' K_x + y' K_y) = 0,     K_x = b̂_x × b̂,  K_y = b̂_y × b̂

(Yuille and Snow 1997; Belhumeur, Kriegman and Yuille 1999; in perspective Papadhimitri and Favaro 2013, "A new
perspective on uncalibrated photometric stereo"). In an orthographic view the last term vanishes and c₃ stays free: the
generalised bas-relief ambiguity. Products of opposite neighbours serve as derivatives, and albedo cancels in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.low_rank import Array, Factors
from hagoromo.least_squares.fit_status import FitStatus, Status, scipy_status
from hagoromo.least_squares.loss import ROBUST_SCALE, robust_scale

SAMPLES = 5000  # pixels
INDEPENDENT_ALBEDOS = 30.0  # effective number of pixels: albedos of neighbours are correlated
GRID = (np.linspace(-1.0, 1.0, 9), np.linspace(-1.0, 1.0, 9), np.linspace(-1.2, 1.5, 10))  # starts of the parameters
BAS_RELIEF_STEPS = 400  # of the simplex
EDGE_ON = 0.02  # of the median: pixels whose normal has a smaller component to the camera are excluded
BINS, REACH, SMOOTH = 200, 2.5, 1.5  # of the histogram of ln albedo: bins, half width, smoothing in bins
WIDTH = 2.0 * REACH / BINS * SMOOTH  # of the smoothing, in ln albedo
KERNEL = np.exp(-0.5 * (np.arange(-6, 7) / SMOOTH) ** 2)
INTEGRABILITY_REWEIGHTINGS = 15
LARGEST_CHANGE = 1e-3  # of c₁ and c₂ in the last reweighting of a fit that has converged
CLIP = 2.0  # scales of the residual above which a pixel (an edge, a shadow) has less weight


@dataclass(frozen=True)
class ObjectPrior:
    """Prior. alike: scale of ln strength between lamps (Cauchy). level: standard deviation of the mean slope. entropy:
    whether albedos are taken to be few.
    """

    alike: float = 0.5
    level: float = 0.25
    entropy: bool = True


class Family:
    """The surfaces and lamps that c₁ and c₂ leave possible, with the sign for which pixels face the camera.

    sample: indices of the pixels whose albedos are used, any number of times; None for all.
    """

    def __init__(self, factors: Factors, first: Array, sample: NDArray[np.intp] | None = None) -> None:
        across = np.cross(first[0], first[1])
        sign = 1.0 if np.median(factors.pixels @ across) > 0.0 else -1.0
        self.matrix = np.stack([*first, across])
        lamps, pixels = sign * factors.lamps @ self.matrix.T, sign * factors.pixels
        self.lamps = lamps
        # b = C⁻ᵀ b̂ for c₃ = c₁ × c₂
        self.pixels = np.stack(
            [pixels @ np.cross(first[1], across), pixels @ np.cross(across, first[0]), pixels @ across], axis=1
        )
        w = self.pixels[:, 2]
        chosen = np.arange(len(w)) if sample is None else sample
        chosen = chosen[w[chosen] > EDGE_ON * np.median(w)]
        chosen = np.random.default_rng(0).choice(chosen, min(SAMPLES, len(chosen)), replace=False)
        self.some, self.size = self.pixels[chosen], np.log(factors.size[chosen])
        slope = self.some[:, :2] / self.some[:, 2:]
        self.slope = np.median(slope, axis=0)
        self.steepness = float(np.hypot(*(ROBUST_SCALE * np.median(np.abs(slope - self.slope), axis=0))))

    def third(self, figures: Array) -> Array:
        """(m, n, l) of `figures`: mean slope in x and in y, and ln of the relief relative to that of half a ball."""
        ell = np.exp(figures[2]) / self.steepness
        return np.array([*(ell * self.slope + figures[:2]), ell])

    def true(self, third: Array) -> tuple[Array, Array]:
        """Lamps (K, 3) and pixels (P, 3), whose lengths are strength and albedo, for c₃'s `third` (m, n, l)."""
        m, n, ell = third
        lamps = np.c_[self.lamps[:, :2], self.lamps @ [m, n, ell]]
        return lamps, self.pixels * [ell, ell, 1.0] - self.pixels[:, 2:] * [m, n, 0.0]

    def cost(self, figures: Array, prior: ObjectPrior) -> float:
        """Negative logarithm of the prior of lamps and albedos, up to a constant."""
        m, n, ell = self.third(figures)
        body = self.some * [ell, ell, 1.0] - self.some[:, 2:] * [m, n, 0.0]
        height = self.lamps @ [m, n, ell]
        strength = 0.5 * np.log(self.lamps[:, 0] ** 2 + self.lamps[:, 1] ** 2 + height**2)
        loss = float(np.log1p(((strength - np.median(strength)) / prior.alike) ** 2).sum())
        loss += 0.5 * float(np.sum((figures[:2] / prior.level) ** 2)) + 0.05 * float(figures[2]) ** 2
        loss += 1e3 * float(np.sum(np.minimum(height, 0.0) ** 2) / np.mean(height**2))  # lamps are in front
        if prior.entropy:
            loss += INDEPENDENT_ALBEDOS * entropy(self.size + 0.5 * np.log(np.sum(body**2, axis=1)))[0]
        return loss


def resolve(family: Family, prior: ObjectPrior, start: NDArray | None = None) -> tuple[Array, FitStatus]:
    """The parameters of least cost, by Nelder and Mead's simplex from `start` or a grid's best, and how it ended."""
    from scipy.optimize import minimize

    if start is None:
        grid = np.stack(np.meshgrid(*GRID, indexing="ij"), axis=-1).reshape(-1, 3)
        start = grid[int(np.argmin([family.cost(figures, prior) for figures in grid]))]
    simplex = np.asarray(start) + np.vstack([np.zeros((1, 3)), 0.15 * np.eye(3)])
    options = {"initial_simplex": simplex, "maxiter": BAS_RELIEF_STEPS, "xatol": 1e-3, "fatol": 1e-3}
    solution = minimize(family.cost, start, args=(prior,), method="Nelder-Mead", options=options)
    return np.asarray(solution.x), scipy_status(solution)


def entropy(values: Array) -> tuple[float, Array]:
    """−∫ p ln p [nat] of the smoothed histogram p of values (P,) about their median, and its derivative by each."""
    bin_width, bell = 2.0 * REACH / BINS, KERNEL / KERNEL.sum()
    position = np.clip((values - np.median(values) + REACH) / bin_width - 0.5, 0.0, BINS - 1.001)
    low = position.astype(np.intp)
    part = position - low
    counts = np.bincount(low, 1.0 - part, BINS) + np.bincount(low + 1, part, BINS)
    share = np.convolve(counts / len(values), bell, "same")
    logarithm = np.log(share + 1e-9)  # finite for an empty bin, since a value may move there
    # δ ∫ p ln p = ∫ (ln p + 1) δp, and a value that moves carries its share from one bin to the next
    slope = np.diff(np.convolve(logarithm, bell, "same")) / bin_width
    return float(-np.sum(share * logarithm)), -slope[low] / len(values)


@dataclass(frozen=True, eq=False)
class IntegrabilityRows:
    """along (n, 6): K_x and K_y side by side; beyond (n, 3): x' K_x + y' K_y; place (n, 2): row and column."""

    along: Array
    beyond: Array
    place: NDArray[np.intp]

    def chosen(self, index: NDArray) -> IntegrabilityRows:
        """Some of the rows."""
        return IntegrabilityRows(self.along[index], self.beyond[index], self.place[index])


def rows(pixels: Array, step: int, tangent: Array) -> IntegrabilityRows:
    """One row per pixel of `pixels` (h, w, 3), NaN off the object, that has its neighbours at `step` on the object.

    tangent: (h, w, 2) x', y' of the rays; zeros for an orthographic view.
    """
    pitch = tangent[0, 1, 0] - tangent[0, 0, 0], tangent[0, 0, 1] - tangent[1, 0, 1]  # of pixels, right and up
    aspect = np.sqrt(pitch[0] / pitch[1]) if min(pitch) > 0.0 else 1.0
    right, left = np.roll(pixels, -step, axis=1), np.roll(pixels, step, axis=1)
    up, down = np.roll(pixels, step, axis=0), np.roll(pixels, -step, axis=0)
    across, along = _product(right, left), _product(up, down)
    usable = np.asarray(np.isfinite(across + along).all(axis=2))
    usable[:step] = usable[-step:] = usable[:, :step] = usable[:, -step:] = False
    place = np.argwhere(usable)
    k_x, k_y, rays = across[usable] / aspect, along[usable] * aspect, tangent[usable]
    return IntegrabilityRows(np.c_[k_x, k_y], rays[:, :1] * k_x + rays[:, 1:] * k_y, place)


def first_rows(lines: IntegrabilityRows) -> tuple[Array, float, FitStatus]:
    """c₁ and c₂ (2, 3) of unit length together, their uncertainty from 0 (none) to 1, and how the fit ended."""
    weight, ratio = np.ones(len(lines.along)), 1.0
    best, change = np.zeros(6), np.inf
    for _ in range(INTEGRABILITY_REWEIGHTINGS):
        last = best
        values, vectors = np.linalg.eigh(lines.along.T @ (lines.along * weight[:, None]))
        best, ratio = vectors[:, 0], float(np.sqrt(max(values[0], 0.0) / values[1]))
        change = float(min(np.linalg.norm(best - last), np.linalg.norm(best + last)))  # its sign is free
        weight = _weight(lines.along @ best)
    status = Status.CONVERGED if change < LARGEST_CHANGE else Status.OUT_OF_STEPS
    return best.reshape(2, 3), ratio, FitStatus(status, INTEGRABILITY_REWEIGHTINGS, last_step=change)


def _weight(off: Array) -> Array:
    return 1.0 / (1.0 + (off / max(CLIP * robust_scale(off), 1e-30)) ** 2)


def _product(one: Array, other: Array) -> Array:
    lengths = np.linalg.norm(one, axis=2) * np.linalg.norm(other, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.cross(one, other) / lengths[..., None]
