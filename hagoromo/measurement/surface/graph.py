"""Graph: pixels joined to their neighbours by the differences that they should have, and the values that fit best.

Σ over edges w_e (u_j − u_i − d_e)² of a robust loss + Σ over pixels h_i (u_i − l_i)², solved by sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.views import Array

BEND = 0.2  # of the change of slope between neighbours: standard deviation that the trapezoidal rule is taken to have
CUT = 1e-4  # of an edge's weight that is left where parts are told apart
CLEARLY = 0.5  # of a step: jump of the told depth, smoothed at its edges, that parts neighbours
SOFT = (1e-3, 1e-2, 0.1, 1.0)  # stiffness of the edges where levels are told, round by round
FAR = 10.0  # standard deviations of an edge that it may be stretched by there
PATIENCE = 3.0  # standard deviations of the told depth that smoothing takes for noise
FAR_OFF = 20.0  # the same, beyond which a pixel is clipped
UNSURE = 0.05  # of the median weight, below which what is told is left out
NORMAL_DIFFERENCE = 0.9538726  # median of |a − b| for two normal numbers


@dataclass(frozen=True, eq=False)
class Graph:
    """E edges over P pixels, the true ones of `known` (h, w).

    pair (E, 2); wanted (E,) differences; weight (E,) inverse variance; open (E,): share of the weight that is left
    where neighbours were parted; step: difference that counts as a jump; values (P,): the solution, zeros before one.
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
        at = np.tile(np.arange(edges), 2), self.pair.T.ravel()
        return csr_array((sign, at), (edges, int(self.known.sum())))

    def settled(self, level: Array, held: Array, stiffness: Sequence[float] = (1.0,) * 3, far: float = np.inf) -> Graph:
        """The graph with the values that fit best, edges that would have to jump let go (Cauchy's loss).

        stiffness: share of the edges' weights in each round; from soft to whole, levels first draw parts apart. far:
        jump in standard deviations of an edge, beyond which it counts as one, if that is less than a step.
        """
        part, values = self.open, self.values
        scale = np.minimum(self.step, far / np.sqrt(self.weight))
        for stiff in stiffness:
            values = self._solver(stiff * part, held)(stiff * self._pull(part) + held * level)
            part = self.open / (1.0 + ((self.difference @ values - self.wanted) / scale) ** 2)
        return replace(self, values=values, open=part)

    def variance(self, held: Array, draws: int, seed: int) -> Array:
        """(P,) of the values, from draws of the errors of edges and levels; without levels about their mean."""
        random = np.random.default_rng(seed)
        gauge = held + 1e-9 * self.typical
        solve, root = self._solver(self.open, gauge), np.sqrt(self.weight * self.open)
        found = np.zeros(len(held))
        for _ in range(draws):
            error = self.difference.T @ (root * random.normal(size=len(root)))
            one = solve(error + np.sqrt(held) * random.normal(size=len(held)))
            found += (one if held.any() else one - one.mean()) ** 2
        return found / draws

    def _pull(self, part: Array) -> Array:
        return self.difference.T @ (self.weight * part * self.wanted)

    def _solver(self, part: Array, held: Array) -> Any:
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        weighed = self.difference.multiply((self.weight * part)[:, None]).tocsr()
        matrix = (self.difference.T @ weighed + diags_array(held)).tocsc()
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def graph(known: NDArray[np.bool_], slopes: Array, variance: Array, step: float) -> Graph:
    """Neighbours of `known` (h, w), differing by `slopes` (h, w, 2) per column and row of `variance` (h, w) each."""
    index = np.full(known.shape, -1)
    index[known] = np.arange(known.sum())
    pairs, wanted, weights = [], [], []
    for axis, here, there in (
        (0, np.s_[:, :-1], np.s_[:, 1:]),
        (1, np.s_[:-1, :], np.s_[1:, :]),
    ):
        both = known[here] & known[there]
        pairs.append(np.stack([index[here][both], index[there][both]], axis=1))
        one, other = slopes[here][both][:, axis], slopes[there][both][:, axis]
        wanted.append(0.5 * (one + other))
        weights.append(1.0 / (0.25 * (variance[here][both] + variance[there][both]) + (BEND * (other - one)) ** 2))
    weight = np.concatenate(weights)
    ones, zeros = np.ones(len(weight)), np.zeros(int(known.sum()))
    return Graph(known, np.concatenate(pairs), np.concatenate(wanted), weight, ones, step, zeros)


def parted_by(net: Graph, level: Array, held: Array, rounds: int) -> Graph:
    """The graph, opened where what is told jumps against what it integrates to: steps that no normal shows.

    The difference of the two is smoothed by total variation, which keeps its jumps.
    """
    from skimage.restoration import denoise_tv_chambolle

    for _ in range(rounds):
        left = level - net.settled(level, held, SOFT, FAR).values
        noise = float(np.median(np.abs(net.difference @ left))) / NORMAL_DIFFERENCE
        middle, reach = float(np.median(left)), FAR_OFF * noise + net.step
        trusted = held > UNSURE * np.median(held)
        picture = np.zeros(net.known.shape)
        picture[net.known] = np.where(trusted, np.clip(left - middle, -reach, reach), 0.0)
        smooth = np.asarray(denoise_tv_chambolle(picture, weight=PATIENCE * noise))[net.known]
        jump = np.abs(smooth[net.pair[:, 1]] - smooth[net.pair[:, 0]])
        cut = jump > CLEARLY * net.step
        if not (cut & (net.open > CUT)).any():
            break
        net = replace(net, open=np.where(cut, CUT, net.open))
    return net
