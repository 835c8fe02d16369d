"""Depth: normals → the surface that has them, by weighted least squares over neighbouring pixels (MODEL §7.3).

The differences d of u = ln depth between neighbours follow from both normals (`chords`). Normals leave the scale of
each connected part free: either the mean depth is given, or near lamps give an estimate of the depth (`DepthEstimate`),
and with it the steps between parts.

Graph: pixels connected to their neighbours by expected differences, and the values that fit those best.

Σ over edges w_e (u_j − u_i − d_e)² with a robust loss + Σ over pixels h_i (u_i − l_i)², by sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.shading import tangents
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.chords import Chords, chords, normal_variance, rays

LEAST_STEP = 2.0  # pixels of depth by which neighbours may miss their normals before they count as separate
ROUNDS = 3  # of separating neighbours where the estimated depth has a step
GAUGE = 1e-10  # of the median weight: weak constraint of every connected part to the mean depth
ANCHORED = (0.1, 1.0)  # stiffness, round by round, around a coarser surface
DRAWS = 12  # simulated errors of the surface, from which its variance is estimated
CUT = 1e-4  # share of the weight that an edge across a step retains
CLEARLY = 0.5  # of the step size: jump of the smoothed estimated depth that separates neighbours
SOFT = (1e-3, 1e-2, 0.1, 1.0)  # stiffness of the edges, round by round, where levels are estimated
FAR = 10.0  # standard deviations by which such an edge may be stretched
PATIENCE = 3.0  # standard deviations of the estimated depth that the smoothing removes as noise
FAR_OFF = 20.0  # standard deviations at which a pixel is clipped before the smoothing
UNSURE = 0.05  # of the median weight: less certain levels are ignored
NORMAL_DIFFERENCE = 0.9538726  # median of |a − b| of two independent standard normal numbers


DrawnErrors: TypeAlias = "Callable[[np.random.Generator], NDArray[np.floating]]"  # (h, w, 3) [rad], world axes


@dataclass(frozen=True, eq=False)
class DepthEstimate:
    """Depth from near lamps: ln depth (h, w) and the inverse of its variance (h, w), 0 where unknown."""

    log_depth: Array
    precision: Array


@dataclass(frozen=True, eq=False)
class DepthSurface:
    """points (h, w, 3) [m], world, 0 where unknown; variance (h, w) [m²] of their distance, inf where unknown.

    modes: (m, h, w) changes of the distance [m] by errors that all normals share; their squares are in the variance.
    Without an estimate of the depth, errors are those of the shape at a fixed mean depth.
    """

    points: NDArray[np.float64]
    variance: NDArray[np.float32]
    modes: NDArray[np.float32] | None = None


def surface_of(
    normal_map: NormalMap, camera: Camera, distance: float, estimate: DepthEstimate | None = None
) -> DepthSurface:
    """The surface of solved normals, with all that is known of their errors; see `surface_from_normals`."""
    return surface_from_normals(
        normal_map.normals,
        camera,
        distance,
        normal_map.own_variance,
        estimate,
        modes=normal_map.modes,
        drawn=normal_map.own_errors(),
    )


def points_from_normals(
    normals: NDArray[np.floating],
    camera: Camera,
    distance: float,
    variance: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """The points of `surface_from_normals`."""
    return surface_from_normals(normals, camera, distance, variance, draws=0).points


def surface_from_normals(
    normals: NDArray[np.floating],
    camera: Camera,
    distance: float,
    variance: NDArray[np.floating] | None = None,
    estimate: DepthEstimate | None = None,
    draws: int = DRAWS,
    modes: NDArray[np.floating] | None = None,
    drawn: DrawnErrors | None = None,
) -> DepthSurface:
    """The surface with `normals` (h, w, 3), world, 0 where unknown (points then too).

    distance: mean depth along the camera's axis [m] of each connected part, used without an `estimate`. variance:
    (h, w) of the normals [rad²], independent between pixels. modes: (m, h, w, 3) changes of the normals by errors that
    all share, of variance 1 each. drawn: what draws the errors that are the normals' own; by default they have this
    variance and are independent. Neighbours are separated where their depths would have to jump to fit the rest
    (Cauchy's loss), and where `estimate` has a step. `InputError` when the lens is distorted, sizes differ, no normal
    is known or the distance is not positive.
    """
    check_surface(normals, camera, distance)
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    rows, columns = np.nonzero(known)
    net = graph(normals, camera, known, variance)
    level, weight = np.full(len(rows), np.log(distance)), np.full(len(rows), GAUGE * net.typical)
    if estimate is not None:
        level, weight = _combined(estimate, known, level, weight)
        net = with_steps(net, level, weight, ROUNDS)
    solved = net.settled(level, weight) if estimate is None else net.settled(level, weight, SOFT, FAR)
    depth = np.exp(solved.values)
    spread = (
        solved.variance(weight if estimate is not None else 0.0 * weight, draws, _drawn(normals, camera, net, drawn))
        if draws
        else np.full(len(rows), np.inf)
    )
    points, errors = np.zeros(normals.shape), np.full(known.shape, np.inf, np.float32)
    ray = rays(camera, rows, columns) * depth[:, None]
    points[rows, columns] = ray @ camera.camera_to_world[:3, :3].T + camera.position
    if modes is None or not draws:
        errors[rows, columns] = spread * np.sum(ray**2, axis=1)
        return DepthSurface(points, errors)
    changes = (chords(_turned(normals, mode), camera, known, variance).wanted - net.chords.wanted for mode in modes)
    by = solved.responses(changes, 0.0 * weight if estimate is None else weight)
    errors[rows, columns] = (spread + np.sum(by**2, axis=0)) * np.sum(ray**2, axis=1)
    moved = np.zeros((len(by), *known.shape), np.float32)
    moved[:, rows, columns] = by * np.linalg.norm(ray, axis=1)
    return DepthSurface(points, errors, moved)


def _turned(normals: NDArray[np.floating], by: NDArray[np.floating]) -> Array:
    """Normals (h, w, 3) that are changed `by` as much, unit where they are known."""
    moved = normals.astype(np.float64) + by
    return moved / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), 1e-12)


def anchored_surface(
    normals: NDArray[np.floating], camera: Camera, variance: NDArray[np.floating], log_depth: Array, factor: int
) -> NDArray[np.float64]:
    """Points (h, w, 3) of the surface with `normals` around a coarser one of ln depth `log_depth` (h, w), NaN
    where that is unknown.

    The coarser surface, with pixels `factor` times as wide, determines all that is wider than two of its pixels, and
    its steps separate the finer surface too. Errors as `surface_from_normals`.
    """
    check_surface(normals, camera, 1.0)
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    rows, columns = np.nonzero(known)
    net = graph(normals, camera, known, variance)
    level, sure = log_depth[known], np.isfinite(log_depth[known])
    # a membrane of stiffness w follows its levels over a length √(w/h) pixels
    weight = np.where(sure, net.typical / (2.0 * factor) ** 2, GAUGE * net.typical)
    level = np.where(sure, level, level[sure].mean())
    depth = np.exp(net.settled(level, weight, ANCHORED).values)
    points = np.zeros(normals.shape)
    ray = rays(camera, rows, columns) * depth[:, None]
    points[rows, columns] = ray @ camera.camera_to_world[:3, :3].T + camera.position
    return points


def check_surface(normals: NDArray[np.floating], camera: Camera, distance: float) -> None:
    """`InputError` unless the normals fit the camera, some are known, and the distance is positive."""
    if any(camera.distortion):
        raise InputError("depth needs photographs without lens distortion: undistort them first")
    if normals.shape != (camera.height, camera.width, 3):
        raise InputError(f"normals of shape {normals.shape} for a camera of {camera.width} × {camera.height} pixels")
    if not (np.isfinite(distance) and distance > 0.0):
        raise InputError(f"the distance of the surface is {distance} m: give a length above 0")
    if not (np.linalg.norm(normals, axis=2) > 0.5).any():
        raise InputError("no normal is known: there is no surface to integrate")


def _combined(estimate: DepthEstimate, known: NDArray[np.bool_], level: Array, gauge: Array) -> tuple[Array, Array]:
    """Level and weight of each known pixel from the estimated depth and the mean depth, `level` of weight `gauge`."""
    weight = estimate.precision[known]
    both = weight + gauge
    return (weight * estimate.log_depth[known] + gauge * level) / both, both


def _drawn(
    normals: NDArray[np.floating], camera: Camera, net: Graph, drawn: DrawnErrors | None
) -> Callable[[np.random.Generator], Array]:
    """What draws errors (P, 3) of the normals that are known, camera axes."""
    known, to_camera = net.chords.known, camera.world_to_camera[:3, :3].T
    if drawn is not None:
        return lambda random: drawn(random)[known] @ to_camera
    axes, spread = np.stack(tangents(normals[known].astype(np.float64))) @ to_camera, np.sqrt(0.5 * net.of_normals)
    return lambda random: np.einsum("ip,ipj->pj", spread * random.normal(size=(2, len(spread))), axes)


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

    @cached_property
    def difference(self) -> Any:
        """Sparse (E, P): u_j − u_i."""
        from scipy.sparse import csr_array

        pair = self.chords.pair
        sign = np.concatenate([-np.ones(len(pair)), np.ones(len(pair))])
        index = np.tile(np.arange(len(pair)), 2), pair.T.ravel()
        return csr_array((sign, index), (len(pair), len(self.of_normals)))

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
            values = self.solver(stiff * part, level_weight)(stiff * self._rhs(part) + level_weight * level)
            part = self.open / (1.0 + ((self.difference @ values - self.chords.wanted) / scale) ** 2)
        return replace(self, values=values, open=part)

    def variance(
        self, level_weight: Array, draws: int, of_normals: Callable[[np.random.Generator], Array], seed: int = 0
    ) -> Array:
        """(P,) variance of the values by errors of normals, rule and levels, drawn; without levels, about their mean.

        A normal is part of all chords of its pixel, so that their errors are not independent.
        """
        random = np.random.default_rng(seed)
        gauge = level_weight + GAUGE * self.typical
        solve, weight = self.solver(self.open, gauge), self.weight * self.open
        variance = np.zeros(len(level_weight))
        for _ in range(draws):
            error = self.chords.of_errors(of_normals(random)) + self.chords.rule * random.normal(size=len(weight))
            of_levels = np.sqrt(level_weight) * random.normal(size=len(level_weight))
            values = solve(self.difference.T @ (weight * error) + of_levels)
            variance += (values if level_weight.any() else values - values.mean()) ** 2
        return variance / draws

    def responses(self, changes: Iterable[Array], level_weight: Array) -> Array:
        """(m, P) changes of the values by `changes` (E,) of the chords, each; without levels, about their mean."""
        solve, found = self.solver(self.open, level_weight + GAUGE * self.typical), []
        weight = self.weight * self.open
        for change in changes:
            values = solve(self.difference.T @ (weight * change))
            found.append(values if level_weight.any() else values - values.mean())
        return np.array(found).reshape(len(found), len(level_weight))

    def _rhs(self, part: Array) -> Array:
        return self.difference.T @ (self.weight * part * self.chords.wanted)

    def solver(self, part: Array, level_weight: Array) -> Any:
        """What solves for values (P,), given right-hand sides; part: share of the weight of each edge."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        weighed = self.difference.multiply((self.weight * part)[:, None]).tocsr()
        matrix = (self.difference.T @ weighed + diags_array(level_weight)).tocsc()
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve


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
