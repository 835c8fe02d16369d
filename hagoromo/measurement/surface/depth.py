"""Depth: normals → the surface that has them, by weighted least squares over neighbouring pixels (MODEL §7.3).

The differences d of u = ln depth between neighbours follow from both normals (`chords`). Normals leave the scale of
each connected part free: either the mean depth is given, or near lamps give an estimate of the depth (`DepthEstimate`),
and with it the steps between parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.shading import tangents
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.cast_shadows import CastShadows, apart_variance, separated
from hagoromo.measurement.surface.chords import chords
from hagoromo.measurement.surface.graph import ANCHORED, FAR, SOFT, Graph, graph, with_steps

ROUNDS = 3  # of separating neighbours where the estimated depth has a step
DRAWS = 12  # simulated errors of the surface, from which its variance is estimated


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
    normal_map: NormalMap,
    camera: Camera,
    distance: float,
    estimate: DepthEstimate | None = None,
    shadows: CastShadows | None = None,
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
        shadows=shadows,
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
    shadows: CastShadows | None = None,
) -> DepthSurface:
    """The surface with `normals` (h, w, 3), world, 0 where unknown (points then too).

    distance: mean depth along the camera's axis [m] of each connected part, used without an `estimate`. variance:
    (h, w) of the normals [rad²], independent between pixels. modes: (m, h, w, 3) changes of the normals by errors that
    all share, of variance 1 each. drawn: what draws the errors that are the normals' own; by default they have this
    variance and are independent. Neighbours are separated where their depths would have to jump to fit the rest
    (Cauchy's loss), where `estimate` has a step, and without one where `shadows` that are cast ask for it.
    `InputError` when the lens is distorted, sizes differ, no normal is known or the distance is not positive.
    """
    check_surface(normals, camera, distance)
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    net, weight = _solved(graph(normals, camera, known, variance), normals, camera, distance, estimate, shadows)
    spread = (
        net.variance(weight if estimate is not None else 0.0 * weight, draws, _drawn(normals, camera, net, drawn))
        + apart_variance(net)
        if draws
        else np.full(len(weight), np.inf)
    )
    points, errors = net.points(camera), np.full(known.shape, np.inf, np.float32)
    away = np.linalg.norm(points[known] - camera.position, axis=1)
    if modes is None or not draws:
        errors[known] = spread * away**2
        return DepthSurface(points, errors)
    changes = (chords(_turned(normals, mode), camera, known, variance).wanted - net.chords.wanted for mode in modes)
    by = net.responses(changes, 0.0 * weight if estimate is None else weight)
    errors[known] = (spread + np.sum(by**2, axis=0)) * away**2
    moved = np.zeros((len(by), *known.shape), np.float32)
    moved[:, known] = by * away
    return DepthSurface(points, errors, moved)


def _solved(
    net: Graph,
    normals: NDArray[np.floating],
    camera: Camera,
    distance: float,
    estimate: DepthEstimate | None,
    shadows: CastShadows | None,
) -> tuple[Graph, Array]:
    """The graph with its values, and the weight (P,) of their levels."""
    level, weight = np.full(len(net.values), np.log(distance)), net.gauge
    if estimate is not None:
        level, weight = _combined(estimate, net.chords.known, level, weight)
        return with_steps(net, level, weight, ROUNDS).settled(level, weight, SOFT, FAR), weight
    joined = net.settled(level, weight)
    parted = None if shadows is None else separated(joined, normals, camera, shadows)
    if parted is None:
        return joined, weight
    return parted.settled(parted.values - parted.values.mean() + np.log(distance), weight), weight


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
    net = graph(normals, camera, known, variance)
    level, sure = log_depth[known], np.isfinite(log_depth[known])
    weight = np.where(sure, net.membrane(factor), net.gauge)
    level = np.where(sure, level, level[sure].mean())
    return net.settled(level, weight, ANCHORED).points(camera)


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
