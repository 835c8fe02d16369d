"""Section: where the fibres of a ply lie in its cross-section, as a table that kernels look up.

Lengths are in units of the ply's radius. Where voxels are too coarse for single fibres, bundles of fibres replace them.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hagoromo.errors import InputError
from hagoromo_matter.cloth.yarn import Yarn

TABLE_SIDE = 256  # entries along an edge of the table, which spans −1…1
SEEN = 1.5, 4.0  # fibre diameters [voxels] between which single fibres fade in
BUNDLE, BUNDLE_SHARE, BUNDLE_CONTRAST = 4.0, 0.62, 0.55  # diameter [voxels], share of the section, contrast
RELAXATION_STEPS = 400  # steps of the relaxation that separates fibres
FIBRE_OVERLAP = 0.12  # tolerated overlap of fibres [diameters], which is not visible


class Section(NamedTuple):
    """Fibres or bundles of a ply, as voxels resolve them.

    nearest: (SIDE², 2) centre of the nearest one; radius, softness: of its edge; contrast: 0 (not visible) to 1;
    mean: of their profile over the ply; filling: share of the section that is fibre.
    """

    nearest: NDArray[np.float32]
    radius: float
    softness: float
    contrast: float
    mean: float
    filling: float


def section(yarn: Yarn, voxel_mm: float, seed: int) -> Section:
    """The section of a ply of `yarn` as voxels of `voxel_mm` resolve it."""
    ply = 0.5 * yarn.diameter_mm * yarn.ply[0] * shown_plies(yarn, voxel_mm)[1]
    fibre, voxel, filling = 0.5e-3 * yarn.fibre_um / ply, voxel_mm / ply, _filling(yarn, voxel_mm)
    contrast = min(max((2.0 * fibre / voxel - SEEN[0]) / (SEEN[1] - SEEN[0]), 0.0), 1.0)
    count, radius = round(yarn.fibres / yarn.kept), fibre
    if contrast < 0.3 * BUNDLE_CONTRAST:
        radius, contrast = 0.5 * BUNDLE * voxel, BUNDLE_CONTRAST
        count = int(BUNDLE_SHARE / radius**2)
        if count < 5:
            return Section(np.zeros((TABLE_SIDE * TABLE_SIDE, 2), np.float32), 1.0, 1.0, 0.0, 1.0, filling)
        radius = (BUNDLE_SHARE / count) ** 0.5
    centres = scattered(count, radius, seed)
    tree, softness, outline = KDTree(centres), min(2.0 * voxel, 1.6 * radius), 2.0 * voxel
    index = tree.query(_square(1.0))[1]
    points = _square(1.0 + outline)
    profile = _disc(tree.query(points)[0], sharp_radius(radius, softness), softness)
    ply = _disc(np.linalg.norm(points, axis=1), sharp_radius(1.0, outline), outline)
    mean = float((profile * ply).sum() / ply.sum())
    nearest = np.ascontiguousarray(centres[index], np.float32)
    return Section(nearest, sharp_radius(radius, softness), softness, contrast, mean, filling)


def sharp_radius(radius: float, softness: float) -> float:
    """Radius at which an edge of width `softness` stands, so that the disc keeps its area: ∫ = π (r² + s²/12)."""
    return float(np.sqrt(max(radius**2 - softness**2 / 12.0, 0.25 * softness**2)))


def shown_plies(yarn: Yarn, voxel_mm: float) -> tuple[int, float]:
    """Number of plies that voxels resolve, and the factor on their width: all of them, or one as wide as the yarn."""
    if 0.5 * yarn.diameter_mm * yarn.ply[0] >= 1.2 * voxel_mm:
        return yarn.plies, 1.0
    return 1, 1.0 / yarn.ply[0]


def _square(half: float) -> NDArray[np.floating]:
    """Middles of the entries of a table that spans ± `half`: (SIDE², 2)."""
    at = ((np.arange(TABLE_SIDE) + 0.5) * (2.0 / TABLE_SIDE) - 1.0) * half
    return np.stack(np.meshgrid(at, at, indexing="xy"), axis=-1).reshape(-1, 2)


def _disc(distance: NDArray, radius: float, softness: float) -> NDArray[np.float64]:
    return np.clip(0.5 - (distance - radius) / softness, 0.0, 1.0)


def _filling(yarn: Yarn, voxel_mm: float) -> float:
    plies, wider = shown_plies(yarn, voxel_mm)
    return yarn.packing * (yarn.plies * yarn.kept if plies < yarn.plies else 1.0) / wider**2


@cache
def scattered(count: int, radius: float, seed: int) -> NDArray[np.float64]:
    """Centres of `count` discs in the unit disc, unordered but not overlapping: (count, 2).

    Raises `InputError` where they do not fit: discs pack less densely in a small circle than in the plane.
    """
    draw = np.random.default_rng(seed)
    reach = 1.0 - radius
    spacing = np.sqrt(2.0 / np.sqrt(3.0) * np.pi * reach**2 / max(count, 1))
    rows = np.arange(-1, 2 + int(4.0 / spacing)) - int(2.0 / spacing)
    lattice = np.stack(np.meshgrid(rows, rows), axis=-1).reshape(-1, 2) @ [[1.0, 0.0], [0.5, 0.75**0.5]] * spacing
    lattice = lattice[np.argsort(np.hypot(*lattice.T), kind="stable")[:count]]
    slack = max(spacing - 2.0 * radius, 0.0)
    centres = lattice + draw.normal(0.0, 1.0, lattice.shape) * slack
    deepest = 0.0
    for _ in range(RELAXATION_STEPS):
        away = np.maximum(np.hypot(*centres.T), 1e-9)
        centres *= np.minimum(1.0, reach / away)[:, None]
        pairs = KDTree(centres).query_pairs(2.0 * radius, output_type="ndarray")
        if not len(pairs):
            return centres
        apart = centres[pairs[:, 0]] - centres[pairs[:, 1]]
        far = np.maximum(np.hypot(*apart.T), 1e-9)
        push = (0.5 * (2.0 * radius - far) / far)[:, None] * apart
        deepest = float((2.0 * radius - far).max())
        np.add.at(centres, pairs[:, 0], push)
        np.add.at(centres, pairs[:, 1], -push)
    if deepest > FIBRE_OVERLAP * 2.0 * radius:
        raise InputError(
            f"{count} fibres of {radius:.3g} of their ply's radius do not fit in it: give fewer or finer ones"
        )
    return centres
