"""Graph: pixels connected to their neighbours by expected differences of ln depth, and the values that fit those best.

Σ over edges w_e (u_j − u_i − d_e)² with a robust loss + Σ over pixels h_i (u_i − l_i)², by sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.chords import Chords, chords, normal_variance, rays

LEAST_STEP = 2.0  # pixels of depth by which neighbours may miss their normals before they count as separate
GAUGE = 1e-10  # of the median weight: weak constraint of every connected part to the mean depth
CUT = 1e-4  # share of the weight that an edge across a step retains
CLEARLY = 0.5  # of the step size: jump of the smoothed estimated depth that separates neighbours
ANCHORED = (0.1, 1.0)  # stiffness, round by round, around a coarser surface
SOFT = (1e-3, 1e-2, 0.1, 1.0)  # stiffness of the edges, round by round, where levels are estimated
FAR = 10.0  # standard deviations by which such an edge may be stretched
PATIENCE = 3.0  # standard deviations of the estimated depth that the smoothing removes as noise
FAR_OFF = 20.0  # standard deviations at which a pixel is clipped before the smoothing
UNSURE = 0.05  # of the median weight: less certain levels are ignored
NORMAL_DIFFERENCE = 0.9538726  # median of |a − b| of two independent standard normal numbers


@dataclass(frozen=True, eq=False)
class Graph:
    """P pixels and the E chords between them, whose `weight` (E,) is an inverse variance.

    of_normals: (P,) variance of the normals [rad²]. open: (E,) share of the weight left across steps. step: smallest
    difference that counts as a step. values: (P,) the solution, zeros before one.
    """

    chords: Chords
    of_normals: Array
    weight: Array
    open: Array
    step: float
    values: Array

    @property
    def typical(self) -> float:
        """Median weight of an edge."""
        return float(np.median(self.weight)) if len(self.weight) else 1.0

    @property
    def gauge(self) -> Array:
        """(P,) weak weights of levels, by which every connected part has a mean."""
        return np.full(len(self.values), GAUGE * self.typical)

    def membrane(self, factor: float) -> float:
        """Weight of levels on pixels `factor` times as wide.

        A membrane of stiffness w follows levels of weight h over a length √(w/h) pixels: here two wide ones.
        """
        return self.typical / (2.0 * factor) ** 2

    @cached_property
    def difference(self) -> Any:
        """Sparse (E, P): u_j − u_i."""
        return differences(self.chords.pair, len(self.values))

    @property
    def parts(self) -> NDArray[np.intp]:
        """(P,) number of the part of each pixel that edges join which are open to no step."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        pair, size = self.chords.pair[self.open > 0.0], len(self.values)
        return connected_components(coo_array((np.ones(len(pair)), pair.T), shape=(size, size)), directed=False)[1]

    def stepped(self, values: Array) -> Graph:
        """The graph with these values (P,), whose edges across their steps have no weight."""
        return replace(self, values=values, open=np.where(np.abs(self.stretch(values)) > 1.0, 0.0, 1.0))

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
            values = self.solver(stiff * part, level_weight)(stiff * self.rhs(part) + level_weight * level)
            part = self.open / (1.0 + ((self.difference @ values - self.chords.wanted) / scale) ** 2)
        return replace(self, values=values, open=part)

    def variance(
        self, level_weight: Array, draws: int, of_normals: Callable[[np.random.Generator], Array], seed: int = 0
    ) -> Array:
        """(P,) variance of the values by errors of normals, rule and levels, drawn; without levels, about their mean.

        A normal is part of all chords of its pixel, so that their errors are not independent.
        """
        random = np.random.default_rng(seed)
        solve, weight = self.solver(self.open, level_weight + self.gauge), self.weight * self.open
        variance = np.zeros(len(level_weight))
        for _ in range(draws):
            error = self.chords.of_errors(of_normals(random)) + self.chords.rule * random.normal(size=len(weight))
            of_levels = np.sqrt(level_weight) * random.normal(size=len(level_weight))
            values = solve(self.difference.T @ (weight * error) + of_levels)
            variance += (values if level_weight.any() else values - values.mean()) ** 2
        return variance / draws

    def responses(self, changes: Iterable[Array], level_weight: Array) -> Array:
        """(m, P) changes of the values by `changes` (E,) of the chords, each; without levels, about their mean."""
        solve, found = self.solver(self.open, level_weight + self.gauge), []
        weight = self.weight * self.open
        for change in changes:
            values = solve(self.difference.T @ (weight * change))
            found.append(values if level_weight.any() else values - values.mean())
        return np.array(found).reshape(len(found), len(level_weight))

    def points(self, camera: Camera) -> Array:
        """(h, w, 3) [m] points of the values as `camera` sees them, world axes; 0 where unknown."""
        rows, columns = np.nonzero(self.chords.known)
        ray = rays(camera, rows, columns) * np.exp(self.values)[:, None]
        points = np.zeros((*self.chords.known.shape, 3))
        points[rows, columns] = ray @ camera.camera_to_world[:3, :3].T + camera.position
        return points

    def stretch(self, values: Array) -> Array:
        """(E,) by how much `values` (P,) differ from the expected differences, in steps."""
        return (self.difference @ values - self.chords.wanted) / self.step

    def rhs(self, part: Array) -> Array:
        """(P,) right-hand side of the edges; part: share of the weight of each."""
        return self.difference.T @ (self.weight * part * self.chords.wanted)

    def solver(self, part: Array, level_weight: Array, more: Any = None) -> Any:
        """What solves for values (P,), given right-hand sides; part: share of the weight of each edge.

        more: sparse (P, P) of the normal equations of what is known beside edges and levels.
        """
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        weighed = self.difference.multiply((self.weight * part)[:, None]).tocsr()
        matrix = self.difference.T @ weighed + diags_array(level_weight)
        matrix = (matrix if more is None else matrix + more).tocsc()
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


def differences(pair: NDArray[np.intp], count: int) -> Any:
    """Sparse (N, count): u_j − u_i of each pair (N, 2) of numbers i, j of `count` values."""
    from scipy.sparse import csr_array

    sign = np.concatenate([-np.ones(len(pair)), np.ones(len(pair))])
    index = np.tile(np.arange(len(pair)), 2), pair.T.ravel()
    return csr_array((sign, index), (len(pair), count))


def graph(
    normals: NDArray[np.floating], camera: Camera, known: NDArray[np.bool_], variance: NDArray[np.floating] | None
) -> Graph:
    """Neighbours of `known` (h, w) with `normals` (h, w, 3), world axes, of this `variance` (h, w) [rad²]."""
    found, of_normals = chords(normals, camera, known, variance), normal_variance(known, variance)[known]
    weight, step = 1.0 / found.variance(of_normals), LEAST_STEP / float(np.mean(camera.focal))
    return Graph(found, of_normals, weight, np.ones(len(weight)), step, np.zeros(len(of_normals)))


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
        picture = np.zeros(net.chords.known.shape)
        picture[net.chords.known] = np.where(trusted, np.clip(left - middle, -reach, reach), 0.0)
        smooth = np.asarray(denoise_tv_chambolle(picture, weight=PATIENCE * noise))[net.chords.known]
        jump = np.abs(smooth[net.chords.pair[:, 1]] - smooth[net.chords.pair[:, 0]])
        cut = jump > CLEARLY * net.step
        if not (cut & (net.open > CUT)).any():
            break
        net = replace(net, open=np.where(cut, CUT, net.open))
    return net
