"""Depth: normals → the surface that has them, by weighted least squares over neighbouring pixels (MODEL §7.3).

With v = (x', y', 1) the ray of a pixel in the camera's frame and u = ln depth, a surface of normal n has
∂u/∂x = −n·∂v/∂x / n·v, in perspective as in a view from afar. The scale is a gauge: the mean depth is given.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError

STEEPEST = 0.05  # least |n·v|/|v|: beyond 87° a slope is that of the edge, not of the surface
STEP = 2.0  # pixels of depth by which neighbours may miss their normals before they count as parted
REWEIGHTINGS = 3
PULL = 1e-7  # of the weights: keeps every island of pixels at the mean depth


def points_from_normals(
    normals: NDArray[np.floating],
    camera: Camera,
    distance: float,
    variance: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Points (h, w, 3) [m], world, of the surface with `normals` (h, w, 3), world, 0 where unknown (points then too).

    distance: mean depth along the camera's axis [m], of each connected part. variance: (h, w) of the normals [rad²].
    Where neighbours' depths would have to jump to fit the rest they are parted (Cauchy's loss, STEP).
    `InputError` when the lens is distorted, sizes differ, no normal is known or the distance is none.
    """
    if any(camera.distortion):
        raise InputError("depth needs photographs without lens distortion: undistort them first")
    if normals.shape != (camera.height, camera.width, 3):
        raise InputError(f"normals of shape {normals.shape} for a camera of {camera.width} × {camera.height} pixels")
    if not (np.isfinite(distance) and distance > 0.0):
        raise InputError(f"the distance of the surface is {distance} m: give a length above 0")
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    if not known.any():
        raise InputError("no normal is known: there is no surface to integrate")
    rows, columns = np.nonzero(known)
    x = (columns + 0.5 - camera.principal[0]) / camera.focal[0]
    y = (rows + 0.5 - camera.principal[1]) / camera.focal[1]
    ray = np.stack([x, y, np.ones_like(x)], axis=1)
    n = normals[rows, columns].astype(np.float64) @ camera.world_to_camera[:3, :3].T
    towards = np.minimum(np.einsum("pi,pi->p", n, ray), -STEEPEST)
    slopes = np.zeros((*known.shape, 2))
    slopes[rows, columns] = -n[:, :2] / camera.focal / towards[:, None]
    trust = np.zeros(known.shape)
    # the slope's error is that of the angle over cos²
    error = 1.0 if variance is None else np.maximum(variance[rows, columns], 1e-6)
    trust[rows, columns] = towards**4 / error
    trust /= np.median(trust[rows, columns])
    step = STEP / float(np.mean(camera.focal))
    depth = distance * np.exp(_integrate(slopes, np.minimum(trust, 10.0), known, step))
    points = np.zeros(normals.shape, np.float32)
    local = ray * depth[rows, columns][:, None]
    to_world = camera.camera_to_world
    points[rows, columns] = local @ to_world[:3, :3].T + to_world[:3, 3]
    return points


def _integrate(
    slopes: NDArray[np.float64], trust: NDArray[np.float64], known: NDArray[np.bool_], step: float
) -> NDArray[np.float64]:
    """u (h, w) of mean 0 in each part of `known`, with differences from `slopes` (h, w, 2) per column and per row."""
    from scipy.sparse import csr_array, identity
    from scipy.sparse.linalg import splu

    index = np.full(known.shape, -1)
    index[known] = np.arange(known.sum())
    pairs, wanted, weights = [], [], []
    for axis, here, there in (
        (0, np.s_[:, :-1], np.s_[:, 1:]),
        (1, np.s_[:-1, :], np.s_[1:, :]),
    ):
        both = known[here] & known[there]
        pairs.append(np.stack([index[here][both], index[there][both]], axis=1))
        wanted.append(0.5 * (slopes[here][both] + slopes[there][both])[:, axis])
        weights.append(2.0 / (1.0 / trust[here][both] + 1.0 / trust[there][both]))
    pair, want, weight = np.concatenate(pairs), np.concatenate(wanted), np.concatenate(weights)
    count, edges = int(known.sum()), len(pair)
    ends = np.concatenate([pair[:, 0], pair[:, 1]])
    sign = np.concatenate([-np.ones(edges), np.ones(edges)])
    difference = csr_array((sign, (np.tile(np.arange(edges), 2), ends)), (edges, count))
    u, part = np.zeros(count), np.ones(edges)
    for _ in range(REWEIGHTINGS):
        weighed = difference.multiply((weight * part)[:, None]).tocsr()
        matrix = (difference.T @ weighed + PULL * identity(count)).tocsc()
        u = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(weighed.T @ want)
        part = 1.0 / (1.0 + ((difference @ u - want) / step) ** 2)
    whole = np.zeros(known.shape)
    whole[known] = u
    return whole
