"""Tresses: the hair of a figure: long waving locks, brows and lashes, as thin cylinders. All in mm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.figure.face import CANTHI
from hagoromo_matter.figure.head import head
from hagoromo_matter.figure.locks import LOCK_STEP, Locks, fallen, head_axes
from hagoromo_matter.figure.pose import PRAYER, WELCOME, Pose
from hagoromo_matter.figure.splat import StrandPoints, along, joined, splat

POSES = {"angel": WELCOME, "nun": PRAYER}
HAIR_FINENESS = Fineness(0.2, 0.16)
LOCKS, STRANDS = 600, 17  # of a head, and of a lock
LOCK_HALF_WIDTH = 1.1  # half width of a lock
STRAND_WIDTH = 0.16  # of a strand: a wisp of hairs
LOOSE = 110  # hairs that leave their lock
BROWS = 0.2  # of the colour of the hair, that of brows and lashes
CLOTHES = 1.2  # thickness of the gown on the shoulders
# auburn: absorption of pheomelanin falls more slowly than that of eumelanin (Donner & Jensen 2006): a reddish brown
HAIR_COLOUR = Spectrum((380, 450, 500, 550, 600, 650, 700, 730), (0.035, 0.05, 0.08, 0.14, 0.24, 0.33, 0.40, 0.43))


def hair_of(figure: str, material: Reflectance, resolution: float = 1.0, seed: int = 1) -> BoxPlan:
    """Hair of the "angel": long locks, brows, lashes; of the "nun": brows and lashes. resolution: voxels in 0.2 mm."""
    if figure not in POSES:
        raise InputError(f"there is no figure {figure!r}: give one of {', '.join(POSES)}")
    pose, fine, draw = POSES[figure], HAIR_FINENESS.finer(resolution), np.random.default_rng(seed)
    strands = [face_hair(pose, fine.voxel_mm, draw)]
    if figure == "angel":
        strands.append(long_hair(fallen(pose, LOCKS, CLOTHES, draw), fine.voxel_mm, draw))
    record: dict[str, Any] = {
        "kind": "figure",
        "figure": figure,
        "part": "hair",
        "resolution": resolution,
        "seed": seed,
    }
    dark = replace(material, body_colour=material.body_colour.scaled(BROWS), name=f"{material.name} brows".strip())
    return splat(joined(*strands), (material, dark), fine, name=f"{figure}, hair", provenance=record)


def long_hair(locks: Locks, step: float, draw: np.random.Generator) -> StrandPoints:
    """The strands of locks: wound about their guide, close at the tips; and some loose hairs."""
    paths, last = locks.paths, locks.paths.shape[1] - 1
    way = np.gradient(paths, axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-9)
    one = np.cross(way, (0.3, 0.9, 0.2))
    one /= np.maximum(np.linalg.norm(one, axis=2, keepdims=True), 1e-6)
    two = np.cross(way, one)
    strands, steps = [], np.arange(last + 1)
    for _ in range(STRANDS):
        end = np.minimum(locks.ends - draw.integers(0, 14, len(paths)), last)[:, None]
        share = np.clip(steps / end, 0.0, 1.0)
        spread = LOCK_HALF_WIDTH * np.sqrt(draw.uniform(0.02, 1.0, (len(paths), 1))) * (1.0 - 0.75 * share**2)
        turn = draw.uniform(0, 2 * np.pi, (len(paths), 1)) + LOCK_STEP * steps * draw.uniform(
            0.05, 0.13, (len(paths), 1)
        )
        path = paths + spread[..., None] * (np.cos(turn)[..., None] * one + np.sin(turn)[..., None] * two)
        area = 0.25 * np.pi * STRAND_WIDTH**2 * np.clip((end - steps) / 12.0, 0.0, 1.0)
        strands.append(along(path, area, step))
    some = draw.integers(0, len(paths), LOOSE)
    stray = np.cumsum(np.cumsum(draw.normal(0.0, 0.006, (LOOSE, last + 1, 3)), axis=1), axis=1)
    area = 0.25 * np.pi * (0.5 * STRAND_WIDTH) ** 2 * np.clip((locks.ends[some, None] - steps) / 12.0, 0.0, 1.0)
    return joined(*strands, along(paths[some] + stray, area, step))


def face_hair(pose: Pose, step: float, draw: np.random.Generator) -> StrandPoints:
    """Brows and lashes of both eyes."""
    share = np.linspace(0.0, 1.0, 7)
    brows, lashes = [], []
    for side in (-1.0, 1.0):
        for t in np.sort(draw.uniform(0.0, 1.0, 190)):
            thick = 0.75 * (1.0 - 0.75 * t**1.5)
            x = 2.3 + 6.0 * t + 1.3 * (0.45 + 0.55 * t) * share + draw.normal(0, 0.08)
            z = 2.65 + 1.25 * np.sin(2.3 * t) + thick * (draw.uniform(-0.5, 0.5) + (0.45 - 0.55 * t) * share) - 0.35 * t
            brows.append((side * x, 0.08 + 0.05 * share, z))
        for t in np.linspace(0.04, 0.98, 64) + draw.normal(0, 0.008, 64):
            x0 = CANTHI[0][0] + (CANTHI[1][0] - CANTHI[0][0]) * t
            z0 = CANTHI[0][1] + (CANTHI[1][1] - CANTHI[0][1]) * t - 1.2 * 4.0 * t * (1.0 - t) + 0.1
            reach = 0.75 + 0.45 * t + draw.normal(0, 0.08)
            x = x0 + reach * share * (0.75 * (t - 0.42))
            z = z0 - reach * (0.75 * share - 0.35 * share**2)
            lashes.append((side * x, reach * 0.8 * share, z))
    x, out, z = (np.array(part) for part in zip(*(np.broadcast_arrays(*row) for row in brows + lashes), strict=True))
    on = np.concatenate([np.ones(len(brows)), np.zeros(len(lashes))])[:, None]  # brows lie on the skin all the way
    front = _front(np.where(on > 0, x, x[:, :1]), np.where(on > 0, z, z[:, :1]))
    paths = np.stack([x, front - out, z], axis=2)
    world = paths @ head_axes(pose) + np.array(pose.head)
    area = 0.25 * np.pi * np.where(on > 0, 0.09, 0.075) ** 2 * (1.0 - 0.6 * share)
    return along(world, area, 0.5 * step, 1)


def _front(x: NDArray, z: NDArray) -> NDArray:
    """y of the face at x, z, in the axes of the head: of the foremost skin."""
    jit = arrays()
    y = np.full(x.shape, -22.0)
    for _ in range(60):
        flat = (column(jit.Float, np.asarray(part, np.float32)) for part in (x, y, z))
        y += 0.7 * np.array(head(jit.Array3f(*flat)), np.float64).reshape(x.shape)
    return y
