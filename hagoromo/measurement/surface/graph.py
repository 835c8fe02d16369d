"""Graph: pixels connected to their neighbours by expected differences, and the values that fit those best.

Σ over edges w_e (u_j − u_i − d_e)² with a robust loss + Σ over pixels h_i (u_i − l_i)², by sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.views import Array

BEND = 0.2  # standard deviation of the trapezoidal rule, relative to the change of slope between neighbours
CUT = 1e-4  # share of the weight that an edge across a step retains
CLEARLY = 0.5  # of the step size: jump of the smoothed estimated depth that separates neighbours
SOFT = (1e-3, 1e-2, 0.1, 1.0)  # stiffness of the edges, round by round, where levels are estimated
FAR = 10.0  # standard deviations by which such an edge may be stretched
PATIENCE = 3.0  # standard deviations of the estimated depth that the smoothing removes as noise
FAR_OFF = 20.0  # standard deviations at which a pixel is clipped before the smoothing
UNSURE = 0.05  # of the median weight: less certain levels are ignored
NORMAL_DIFFERENCE = 0.9538726  # median of |a − b| of two independent standard normal numbers


@dataclass(frozen=True, eq=False)
class Graph:
    """E edges over P pixels, the true ones of `known` (h, w).

    pair (E, 2); wanted (E,) expected differences; weight (E,) inverse variance; open (E,): share of the weight left
    across steps; step: smallest difference that counts as a step; values (P,): the solution, zeros before one.
    """

    known: NDArray[np.bool_]
    pair: NDArray[np.intp]
    wanted: Array
    weight: Array
    open: Array
    step: float
    values: Array

    @property
    def typical(self) -> float:
        """Median weight of an edge."""
        return float(np.median(self.weight)) if len(self.weight) else 1.0

    @cached_property
    def difference(self) -> Any:
        """Sparse (E, P): u_j − u_i."""
        from scipy.sparse import csr_array

        edges = len(self.pair)
        sign = np.concatenate([-np.ones(edges), np.ones(edges)])
        index = np.tile(np.arange(edges), 2), self.pair.T.ravel()
        return csr_array((sign, index), (edges, int(self.known.sum())))

    def settled(
        self, level: Array, level_weight: Array, stiffness: Sequence[float] = (1.0,) * 3, far: float = np.inf
    ) -> Graph:
        """The graph with the values that fit best; edges across steps lose their weight (Cauchy's loss).

        stiffness: share of the edges' weights in each round; from soft to stiff, so that levels first separate parts.
        far: stretch of an edge in standard deviations that counts as a step, if that is less than `step`.
        """
        part, values = self.open, self.values
        scale = np.minimum(self.step, far / np.sqrt(self.weight))
        for stiff in stiffness:
            values = self._solver(stiff * part, level_weight)(stiff * self._rhs(part) + level_weight * level)
            part = self.open / (1.0 + ((self.difference @ values - self.wanted) / scale) ** 2)
        return replace(self, values=values, open=part)

    def variance(self, level_weight: Array, draws: int, seed: int) -> Array:
        """(P,) variance of the values from simulated errors of edges and levels; without levels, about their mean."""
        random = np.random.default_rng(seed)
        gauge = level_weight + 1e-9 * self.typical
        solve, root = self._solver(self.open, gauge), np.sqrt(self.weight * self.open)
        variance = np.zeros(len(level_weight))
        for _ in range(draws):
            error = self.difference.T @ (root * random.normal(size=len(root)))
            values = solve(error + np.sqrt(level_weight) * random.normal(size=len(level_weight)))
            variance += (values if level_weight.any() else values - values.mean()) ** 2
        return variance / draws

    def _rhs(self, part: Array) -> Array:
        return self.difference.T @ (self.weight * part * self.wanted)

    def _solver(self, part: Array, level_weight: Array) -> Any:
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        weighed = self.difference.multiply((self.weight * part)[:, None]).tocsr()
        matrix = (self.difference.T @ weighed + diags_array(level_weight)).tocsc()
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def graph(known: NDArray[np.bool_], slopes: Array, variance: Array, step: float) -> Graph:
    """Neighbours of `known` (h, w) with `slopes` (h, w, 2) per column and row, each of `variance` (h, w)."""
    index = np.full(known.shape, -1)
    index[known] = np.arange(known.sum())
    pairs, wanted, weights = [], [], []
    for axis, first, second in (
        (0, np.s_[:, :-1], np.s_[:, 1:]),
        (1, np.s_[:-1, :], np.s_[1:, :]),
    ):
        both = known[first] & known[second]
        pairs.append(np.stack([index[first][both], index[second][both]], axis=1))
        one, other = slopes[first][both][:, axis], slopes[second][both][:, axis]
        wanted.append(0.5 * (one + other))
        weights.append(1.0 / (0.25 * (variance[first][both] + variance[second][both]) + (BEND * (other - one)) ** 2))
    weight = np.concatenate(weights)
    ones, zeros = np.ones(len(weight)), np.zeros(int(known.sum()))
    return Graph(known, np.concatenate(pairs), np.concatenate(wanted), weight, ones, step, zeros)


def with_steps(net: Graph, level: Array, level_weight: Array, rounds: int) -> Graph:
    """The graph with weakened edges where `level` has steps against the integrated normals, which do not show them.

    The difference of the two is smoothed by total variation, which preserves its steps.
    """
    from skimage.restoration import denoise_tv_chambolle

    for _ in range(rounds):
        left = level - net.settled(level, level_weight, SOFT, FAR).values
        noise = float(np.median(np.abs(net.difference @ left))) / NORMAL_DIFFERENCE
        middle, reach = float(np.median(left)), FAR_OFF * noise + net.step
        trusted = level_weight > UNSURE * np.median(level_weight)
        picture = np.zeros(net.known.shape)
        picture[net.known] = np.where(trusted, np.clip(left - middle, -reach, reach), 0.0)
        smooth = np.asarray(denoise_tv_chambolle(picture, weight=PATIENCE * noise))[net.known]
        jump = np.abs(smooth[net.pair[:, 1]] - smooth[net.pair[:, 0]])
        cut = jump > CLEARLY * net.step
        if not (cut & (net.open > CUT)).any():
            break
        net = replace(net, open=np.where(cut, CUT, net.open))
    return net
