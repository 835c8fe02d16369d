"""Bas-relief: the three numbers that integrability leaves open, from what objects and lamps mostly are.

With c₃ = m c₁ + n c₂ + l c₁ × c₂ the surface is sheared by m and n and stretched by l (Belhumeur, Kriegman and Yuille
1999). Objects have few albedos: the entropy of ln albedo is least (Alldrin, Mallick and Kriegman 2007, "Resolving the
generalized bas-relief ambiguity by entropy minimization"). Weak beside it: lamps are of about one strength, and a
closed object's slopes are 0 in the mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.uncalibrated.entropy import entropy
from hagoromo.calibration.lamps.uncalibrated.low_rank import Array, Factors
from hagoromo.least_squares import ROBUST_SCALE, FitStatus, scipy_status

SAMPLES = 5000  # pixels
ALONE = 30.0  # pixels' worth of independent albedos: those of neighbours are alike
GRID = (np.linspace(-1.0, 1.0, 9), np.linspace(-1.0, 1.0, 9), np.linspace(-1.2, 1.5, 10))
BAS_RELIEF_STEPS = 400  # of the simplex
EDGE_ON = 0.02  # of the median: pixels with less of a normal towards the camera are left out


@dataclass(frozen=True)
class Belief:
    """alike: scale of ln strength between lamps (Cauchy). level: standard deviation of the mean slope. entropy: whether
    albedo counts.
    """

    alike: float = 0.5
    level: float = 0.25
    entropy: bool = True


class Family:
    """The surfaces and lamps that c₁ and c₂ leave possible; pixels and lamps signed so that the camera sees them.

    sample: indices of the pixels whose albedos count, any number of times; None for all.
    """

    def __init__(self, found: Factors, first: Array, sample: NDArray[np.intp] | None = None) -> None:
        across = np.cross(first[0], first[1])
        sign = 1.0 if np.median(found.pixels @ across) > 0.0 else -1.0
        self.matrix = np.stack([*first, across])
        lamps, pixels = sign * found.lamps @ self.matrix.T, sign * found.pixels
        self.lamps = lamps
        # b = C⁻ᵀ b̂ for c₃ = c₁ × c₂
        self.pixels = np.stack(
            [pixels @ np.cross(first[1], across), pixels @ np.cross(across, first[0]), pixels @ across], axis=1
        )
        w = self.pixels[:, 2]
        seen = np.arange(len(w)) if sample is None else sample
        seen = seen[w[seen] > EDGE_ON * np.median(w)]
        seen = np.random.default_rng(0).choice(seen, min(SAMPLES, len(seen)), replace=False)
        self.some, self.size = self.pixels[seen], np.log(found.size[seen])
        slope = self.some[:, :2] / self.some[:, 2:]
        self.slope = np.median(slope, axis=0)
        self.steepness = float(np.hypot(*(ROBUST_SCALE * np.median(np.abs(slope - self.slope), axis=0))))

    def third(self, figures: Array) -> Array:
        """(m, n, l) of `figures`: the median slope in x and in y, and ln of the relief over that of half a ball."""
        ell = np.exp(figures[2]) / self.steepness
        return np.array([*(ell * self.slope + figures[:2]), ell])

    def true(self, third: Array) -> tuple[Array, Array]:
        """Lamps (K, 3) and pixels (P, 3), strength and albedo their lengths, of c₃'s `third` (m, n, l)."""
        m, n, ell = third
        lamps = np.c_[self.lamps[:, :2], self.lamps @ [m, n, ell]]
        return lamps, self.pixels * [ell, ell, 1.0] - self.pixels[:, 2:] * [m, n, 0.0]

    def cost(self, figures: Array, belief: Belief) -> float:
        """How unlikely lamps and albedos are."""
        m, n, ell = self.third(figures)
        body = self.some * [ell, ell, 1.0] - self.some[:, 2:] * [m, n, 0.0]
        height = self.lamps @ [m, n, ell]
        strength = 0.5 * np.log(self.lamps[:, 0] ** 2 + self.lamps[:, 1] ** 2 + height**2)
        loss = float(np.log1p(((strength - np.median(strength)) / belief.alike) ** 2).sum())
        loss += 0.5 * float(np.sum((figures[:2] / belief.level) ** 2)) + 0.05 * float(figures[2]) ** 2
        loss += 1e3 * float(np.sum(np.minimum(height, 0.0) ** 2) / np.mean(height**2))  # lamps stand before the object
        if belief.entropy:
            loss += ALONE * entropy(self.size + 0.5 * np.log(np.sum(body**2, axis=1)))[0]
        return loss


def resolve(family: Family, belief: Belief, start: NDArray | None = None) -> tuple[Array, FitStatus]:
    """The figures of least cost, by a grid, or from `start`, then Nelder and Mead's simplex, and how that ended."""
    from scipy.optimize import minimize

    if start is None:
        grid = np.stack(np.meshgrid(*GRID, indexing="ij"), axis=-1).reshape(-1, 3)
        start = grid[int(np.argmin([family.cost(figures, belief) for figures in grid]))]
    simplex = np.asarray(start) + np.vstack([np.zeros((1, 3)), 0.15 * np.eye(3)])
    options = {"initial_simplex": simplex, "maxiter": BAS_RELIEF_STEPS, "xatol": 1e-3, "fatol": 1e-3}
    found = minimize(family.cost, start, args=(belief,), method="Nelder-Mead", options=options)
    return np.asarray(found.x), scipy_status(found)
