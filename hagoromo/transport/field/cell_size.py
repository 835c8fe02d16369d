"""Cell size: how coarse the grid of light is, from the extinction, the size of the matter and its memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import BRICK

DEEPEST_CELL = 0.5  # mean free paths a cell, where memory allows it
FEWEST_ACROSS = 24  # cells across the shortest side of all matter
AROUND = 1.5  # stored cells over those that hold matter, about
MEMORY_SHARE = 0.25  # of that of the bricks


def cell_size(boxes: Sequence[VolumeBox], channels: int) -> float:
    """Edge of a cell [m]: DEEPEST_CELL mean free paths of the densest matter, or as much as keeps the light of
    `channels` within about MEMORY_SHARE of the memory of the bricks, in whole voxels.
    """
    voxel = min(box.voxel_size for box in boxes)
    corners = np.concatenate([box.matter_corners() for box in boxes])
    most = float(np.ptp(corners, axis=0).min()) / FEWEST_ACROSS
    area = [0.5 if box.extinction == "projected" else 1.0 for box in boxes]
    densest = max(a * box.tau * box.bricks.densest for a, box in zip(area, boxes, strict=True))
    bricks = {id(box.bricks): box.bricks.bytes for box in boxes}
    volume = sum(box.bricks.kept * (BRICK * box.voxel_size) ** 3 for box in boxes)
    cell = 2.0 * NUMBERS * channels + 4.0  # bytes
    least = (AROUND * cell * volume / (MEMORY_SHARE * sum(bricks.values()))) ** (1.0 / 3.0)
    return voxel * max(round(max(min(DEEPEST_CELL / max(densest, 1e-30), most), least) / voxel), 1)
