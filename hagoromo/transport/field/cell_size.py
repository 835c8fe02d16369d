"""Cell size: how coarse the grid of light is, from the extinction, the size of the matter and its memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hagoromo.transport.field.cells import Bounds, bounds_of, grid_over, voxels_in_reach, with_neighbours
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.path.majorants import texel_density
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import BRICK, unpacked_density

DEEPEST_CELL = 1.0  # mean free paths of typical matter a cell, where memory allows it
BRICKS_LOOKED_AT = 512  # of a box, for its typical density
FEWEST_ACROSS = 24  # cells across the shortest side of all matter
MEMORY_SHARE = 0.25  # of that of the bricks
LITTLE = float(1 << 20)  # memory that is not worth saving [byte]
PARTS = 8  # of a voxel, whose multiples cells are
DEEP_CELL = 4.0  # mean free paths a cell, from which bright matter of hard faces is off by 5 % of its light
PACKET = 4  # halves of a cell that are read at once


def cell_size(boxes: Sequence[VolumeBox], channels: int) -> float:
    """Edge of a cell [m]: DEEPEST_CELL mean free paths of typical matter, or as much as keeps the light of `channels`
    within MEMORY_SHARE of the memory of the bricks. The light is solved in cells of half the edge.
    """
    part = min(box.voxel_size for box in boxes) / PARTS
    corners = np.concatenate([box.matter_corners() for box in boxes])
    most = float(np.ptp(corners, axis=0).min()) / FEWEST_ACROSS
    sigma = max((0.5 if box.extinction == "projected" else 1.0) * box.tau * typical(box) for box in boxes)
    bricks = {id(box.bricks): box.bricks.bytes for box in boxes}
    texels = {id(box.texel): box.texel.bytes for box in boxes if box.texel}
    allowed = max(MEMORY_SHARE * (sum(bricks.values()) + sum(texels.values())), LITTLE)
    volume = sum(
        len(voxels_in_reach(box)) * box.voxel_size**3 if box.texel else box.bricks.kept * (BRICK * box.voxel_size) ** 3
        for box in boxes
    )
    least = 0.8 * (cell_bytes(channels) * volume / allowed) ** (1.0 / 3.0)  # near where the search begins
    count = max(round(max(min(DEEPEST_CELL / max(sigma, 1e-30), most), least) / part), 1)
    bounds = bounds_of(boxes)
    while _light_bytes(bounds, part * count, channels) > allowed:
        count += max(count // 32, 1)
    return part * count


def densest_extinction(boxes: Sequence[VolumeBox]) -> float:
    """The largest σ of the matter, mean over directions [1/m]."""
    return max((0.5 if box.extinction == "projected" else 1.0) * box.tau * densest(box) for box in boxes)


def densest(box: VolumeBox) -> float:
    """The largest density of the matter in a box, 0…1."""
    return float(texel_density(box.texel)) if box.texel else box.bricks.densest


def typical(box: VolumeBox) -> float:
    """The density where the matter of a box is, 0…1: its mean, weighed with itself; of texels the largest."""
    if box.texel:
        return densest(box)
    if not box.bricks.kept:
        return 0.0
    bricks = np.unique(np.linspace(0, box.bricks.kept - 1, BRICKS_LOOKED_AT).astype(np.uint32))
    density = unpacked_density(np.array(box.bricks.density.of(bricks))).astype(np.float64)
    total = float(density.sum())
    return float(np.square(density).sum()) / total if total > 0.0 else 0.0


def light_bytes(boxes: Sequence[VolumeBox], size: float, channels: int) -> float:
    """Memory of the light in cells of edge `size` [m], if bricks were full, and in those around; and of the table of
    cells [byte].
    """
    return _light_bytes(bounds_of(boxes), size, channels)


def _light_bytes(bounds: Sequence[Bounds], size: float, channels: int) -> float:
    _, touched = grid_over(bounds, size)
    return cell_bytes(channels) * float(np.count_nonzero(with_neighbours(touched))) + 4.0 * touched.size


def cell_bytes(channels: int) -> float:
    """Memory of the light of one cell [byte], at most: whole packets of halves."""
    return 2.0 * PACKET * -(-NUMBERS * channels // PACKET)
