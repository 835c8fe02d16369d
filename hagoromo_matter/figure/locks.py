"""Locks: how long hair falls from a parted head over neck and shoulders, as guide curves. All in mm.

Every lock leaves the scalp, is combed away from the parting, bends down under its weight, slides along surfaces, and
its waves grow with the distance from the scalp.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.matter.shape import Shape, capsule, distance_and_normal, ellipsoid, mirrored, placed, smooth_union
from hagoromo_matter.figure.pose import Pose

SCALP = (0.0, 2.0, 4.6), (12.0, 15.4, 13.9)  # middle and radii of the cranium, in the axes of the head
HAIRLINE = 9.0  # height over the middle of the head, at the forehead
PARTING, BESIDE = -0.6, 0.26  # x of the parting, and the share of the locks that leave it
CROWN, COMBED_BACK = 1.0, 7.0  # y where the parting ends, and from which hair is combed to the back
AT_CROWN, CROWN_RADIUS = 0.14, 5.0  # share of the locks that leave the crown, and how far around it
SPREAD_BEHIND = 16.0  # x from which hair behind the crown is combed as far to the side as at the parting
RISE, CLOSE = 14.0, 0.25  # way from the scalp where a lock lies as high as it will, and the share of that at its root
FRONT, BEHIND = (9.0, 17.0), (0.5, 16.0)  # x where hair falls over the shoulders, from and to; and down the back
DECIDED = 0.8  # a lock falls to the front or to the back at least so much: others coil on the shoulder
HAIR_BACK_Y = 13.0  # y where hair stays before the roots of wings
LOCK_STEP = 0.8  # between the points of a lock
STIFF = 0.8  # how much of its direction a lock keeps from step to step
WAVE, GROWN = 17.0, 45.0  # length of a wave, and way from the scalp where it is whole


class Locks(NamedTuple):
    """Guide curves (locks, points, 3); how far each is followed, (locks,), in points."""

    paths: NDArray[np.float64]
    ends: NDArray[np.int64]


def fallen(pose: Pose, count: int, clothes_mm: float, draw: np.random.Generator) -> Locks:
    """`count` locks of a standing figure; clothes_mm: thickness of what lies on its shoulders."""
    roots, outward = _roots(count, pose, draw)
    solid = _solid(pose, clothes_mm)
    lift = draw.uniform(0.3, 1.9, count)  # over head and shoulders
    side = _side(_local(roots, pose))
    front = np.clip((_local(roots, pose)[:, 1] + 3.0) / -7.0, -1.0, 1.0) + draw.normal(0.0, 0.25, count)
    front = np.where(front > 0.0, np.maximum(front, DECIDED), np.minimum(front, -DECIDED))
    length = draw.normal(np.where(front > 0, 92.0, 72.0), 6.0)
    aim = np.where(front > 0, draw.uniform(*FRONT, count), draw.uniform(*BEHIND, count))
    points = np.zeros((count, int(120.0 / LOCK_STEP), 3))
    points[:, 0] = roots
    way = 0.25 * outward + 0.75 * _wanted(roots, outward, side, aim, 0.0 * side, pose)
    for k in range(1, points.shape[1]):
        point = points[:, k - 1]
        distance, normal = _asked(solid, point)
        height = lift * min(CLOSE + (1.0 - CLOSE) * k * LOCK_STEP / RISE, 1.0)
        near = np.clip(1.5 - (distance - height) / 2.0, 0.0, 1.0)[:, None]
        wanted = _wanted(point, normal, side, aim, front * np.fmax(near[:, 0], _drawn(point, front)), pose)
        wanted -= near * normal * np.minimum((wanted * normal).sum(axis=1, keepdims=True), 0.0)
        way = STIFF * way + (1.0 - STIFF) * wanted
        held = np.clip((point[:, 2] - pose.head[2] + 2.0) / 6.0, 0.0, 1.0)  # to the skull, not to the neck
        way += np.clip((height - distance) * 0.35, -0.12 * held, 0.5)[:, None] * normal * near
        way[:, 2] = np.where(point[:, 2] < pose.neck[2] + 6.0, np.minimum(way[:, 2], -0.2), way[:, 2])  # it never rises
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        points[:, k] = point + LOCK_STEP * way
    waved = _waved(points, roots, draw)
    return Locks(waved, np.clip(length / LOCK_STEP, 8, points.shape[1] - 1).astype(int))


def _side(root: NDArray) -> NDArray:
    """To which side, −1…1, locks are combed: apart at the parting, to the back behind it. root: in the head's axes."""
    across, behind = root[:, 0] - PARTING, np.clip((root[:, 1] - CROWN) / (COMBED_BACK - CROWN), 0.0, 1.0)
    return (1.0 - behind) * np.where(across > 0.0, 1.0, -1.0) + behind * np.clip(across / SPREAD_BEHIND, -1.0, 1.0)


def _wanted(point: NDArray, normal: NDArray, side: NDArray, aim: NDArray, front: NDArray, pose: Pose) -> NDArray:
    """Preferred direction of a lock: from the parting to the side, and down; along the surface on the shoulders."""
    z = point[:, 2] - pose.head[2]
    top = np.clip(z / 9.0, 0.0, 1.0)
    low = np.clip(-(z + 12.0) / 12.0, 0.0, 1.0)  # under the jaw
    wanted, left_or_right = np.zeros_like(point), np.sign(side)
    beside = np.clip((aim - left_or_right * point[:, 0]) / 6.0, -1.6, 1.0)
    wanted[:, 0] = side * (1.3 * top + 0.12 * (1.0 - top)) + left_or_right * low * (0.6 * beside - 0.12)
    wanted[:, 1] = 0.38 * (1.0 - low) * np.where(front > 0, 1.0 - 0.45 * front, 1.0) - 2.2 * low * front
    wanted[:, 1] -= 0.4 * np.clip((point[:, 1] - HAIR_BACK_Y) / 4.0, 0.0, 1.0)  # wings are behind
    wanted[:, 2] = -1.0 + 0.6 * top
    tangent = (
        wanted - normal * (wanted * normal).sum(axis=1, keepdims=True) * np.clip(1.0 + z / 16.0, 0.0, 1.0)[:, None]
    )
    return tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-6)


def _drawn(point: NDArray, front: NDArray) -> NDArray:
    """How much a lock is drawn to the front before it meets the shoulder: not any more once it is there."""
    return np.where(front > 0, 0.6 * np.clip((point[:, 1] + 3.0) / 6.0, 0.0, 1.0), 0.0)


def _waved(points: NDArray, roots: NDArray, draw: np.random.Generator) -> NDArray:
    """Locks with waves to both sides of their path; neighbours have nearly the same phase."""
    way = np.gradient(points, axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-9)
    across = np.cross(way, (0.0, 1.0, 0.0))
    across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-3)
    other = np.cross(way, across)
    count = len(points)
    s = LOCK_STEP * np.arange(points.shape[1])
    size = np.clip(s / GROWN, 0.0, 1.0) ** 1.2
    phase = 0.22 * roots[:, 0] + 0.35 * roots[:, 1] + draw.normal(0.0, 0.7, count)
    turn = 2.0 * np.pi * s / (WAVE * draw.uniform(0.85, 1.2, (count, 1))) + phase[:, None]
    swing = draw.uniform(0.8, 1.9, (count, 1)) * size
    return points + (swing * np.sin(turn))[..., None] * across + (0.6 * swing * np.cos(turn))[..., None] * other


def _roots(count: int, pose: Pose, draw: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Evenly distributed points on the scalp, and the normals there, in world axes."""
    middle, radii = np.array(SCALP)
    index = np.arange(4 * count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * index / (4 * count)), np.pi * (1.0 + 5.0**0.5) * index  # Fibonacci's sphere
    unit = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)
    unit += draw.normal(0.0, 0.02, unit.shape)
    local = middle + radii * unit / np.linalg.norm(unit, axis=1, keepdims=True)
    x, y, z = local.T
    line = np.interp(-y, (-6.0, 2.0, 6.0, 9.5, 13.0), (-7.0, 1.5, 3.5, 6.5, HAIRLINE)) - 0.12 * np.abs(x)
    grown = (z > line) & ((y < -1.0) | (z > -6.0))
    # more of them beside the parting and at the crown, from where hair goes apart and the scalp would show
    edge, crown = round(BESIDE * count), round(AT_CROWN * count)
    there = np.flatnonzero(grown)
    even = unit[there[np.linspace(0, len(there) - 1, count - edge - crown).astype(int)]]
    x, y = PARTING + np.resize([-0.2, 0.2], edge), np.linspace(middle[1] - 0.97 * radii[1], CROWN, edge)
    away, turn = CROWN_RADIUS * np.sqrt(draw.uniform(0.0, 1.0, crown)), draw.uniform(0.0, 2.0 * np.pi, crown)
    x = np.append(x, PARTING + away * np.cos(turn)) / radii[0]
    y = (np.append(y, CROWN + CROWN_RADIUS + away * np.sin(turn)) - middle[1]) / radii[1]
    top = np.stack([x, y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.05))], axis=1)
    unit = draw.permutation(np.concatenate([even, top]))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    normal = unit / radii
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return _world(middle + radii * unit, pose, True), _world(normal, pose, False)


def _solid(pose: Pose, clothes: float) -> Shape:
    """Head, neck, and shoulders with the clothes on them."""

    def solid(point: Any) -> Any:
        p, q = mirrored(point, 1.0), placed(point, pose.head, pose.nod)
        face = ellipsoid(mirrored(q, 0.5), (0.0, -4.0, -5.0), (9.3, 10.3, 12.2))
        skull = smooth_union(ellipsoid(q, *SCALP), face, 4.0)
        x, y, z = pose.neck
        neck = capsule(point, (x, y + 1.0, z - 10.0), (x, y, z + 14.0), 6.9, 6.3)
        shoulders = capsule(p, (0.0, y + 1.0, z - 7.0), pose.shoulder, 6.5, 7.2)
        trunk = smooth_union(ellipsoid(point, (0.0, y - 0.5, z - 29.0), (19.5, 14.5, 23.0)), shoulders, 9.0)
        trunk = smooth_union(trunk, ellipsoid(p, (8.2, y - 11.0, z - 27.0), (6.6, 6.6, 6.6)), 6.0)
        arm = capsule(p, pose.shoulder, pose.elbow, 6.8, 5.2)
        return dr.fmin(smooth_union(skull, neck, 4.0), dr.fmin(trunk, arm) - clothes)

    return solid


def _asked(solid: Shape, points: NDArray) -> tuple[NDArray, NDArray]:
    """Distances (n,) and normals (n, 3) of a solid."""
    distance, normal = distance_and_normal(solid, arrays().Array3f(np.ascontiguousarray(points.T, np.float32)))
    return np.array(distance, np.float64), np.array(normal, np.float64).T


def _world(vectors: NDArray, pose: Pose, places: bool) -> NDArray:
    """Places, or directions, in the axes of the head → the world."""
    axes = head_axes(pose)
    return vectors @ axes + (np.array(pose.head) if places else 0.0)


def _local(points: NDArray, pose: Pose) -> NDArray:
    return (points - pose.head) @ head_axes(pose).T


def head_axes(pose: Pose) -> NDArray:
    """The head's axes in the world, as rows."""
    jit = arrays()
    rows = [np.array(placed(jit.Array3f(*row), (0, 0, 0), pose.nod)).ravel() for row in np.eye(3).tolist()]
    return np.array(rows).T
