"""Wing grid: the feathers near a place over the sheet of a wing, and the distance to the next one. Lengths in mm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo_matter.feather.wing_rows import FEATHER_FIELDS, height_of

CELL_SIZE = np.array([2.0, 2.0, 0.6])  # x, z, height
LOW, HIGH = np.array([0.0, 40.0, -10.4]), np.array([145.0, 312.5, 10.4])
EVERY = 1.2  # distance of the sample points on a feather
SAMPLE_REACH = 1.3  # radius of a feather's matter around a sample point: half of EVERY plus frayed edges
VANE_HALF_THICKNESS = 0.7  # half thickness of a vane with its soft edge; shafts are thicker
STRETCH = 1.5  # the way in (x, z, height) is at most √2 of the way in space, a little more over the bent sheet


class FeatherGrid(NamedTuple):
    """starts: (2 · cells + 1,) first of each cell's `members`; members: numbers of feathers, of the left side after
    those of the right; table: their fields; clear: (cells,) a bound of the distance to matter [mm].
    """

    starts: NDArray[np.uint32]
    members: NDArray[np.uint32]
    table: NDArray[np.float32]
    clear: NDArray[np.float32]


SHAPE = np.ceil((HIGH - LOW) / CELL_SIZE).astype(int)


def grid_of(feathers: NDArray[np.float32], body: NDArray[np.float64]) -> FeatherGrid:
    """The grid of the feathers of both wings, see `wing_rows.feathers`; body: places in their arms, (n, 3)."""
    from scipy.ndimage import distance_transform_edt

    cells, count = int(np.prod(SHAPE)), feathers.shape[1]
    pairs = []
    for side, own in enumerate(feathers):
        for number, row in enumerate(own):
            fields: dict[str, float] = dict(zip(FEATHER_FIELDS, row.tolist(), strict=True))
            near = _cells(places_on(fields), max(VANE_HALF_THICKNESS, fields["rachis_mm"]))
            pairs.append(np.stack([near + side * cells, np.full(len(near), number + side * count)], axis=1))
    cell, member = np.concatenate(pairs).T
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(2 * cells + 1))
    empty = np.ones(cells, bool)
    empty[cell % cells] = False
    empty[_cells(body, VANE_HALF_THICKNESS)] = False
    clear = distance_transform_edt(empty.reshape(SHAPE), sampling=CELL_SIZE)
    clear = (np.asarray(clear).ravel() - float(np.linalg.norm(CELL_SIZE))) / STRETCH
    words, reals = np.uint32, np.float32
    return FeatherGrid(starts.astype(words), member[order].astype(words), feathers.reshape(-1), clear.astype(reals))


def places_on(feather: Mapping[str, float]) -> NDArray[np.float64]:
    """Sample points over a whole feather: (n, 3) x, z, height."""
    long, wide = feather["length_mm"], 1.1 * (feather["outer_mm"] + feather["inner_mm"])
    along, across = np.meshgrid(
        np.linspace(0.0, long, max(int(long / EVERY), 2) + 1),
        np.linspace(-1.1 * feather["outer_mm"], 1.1 * feather["inner_mm"], int(wide / EVERY) + 2),
        indexing="ij",
    )
    radius = -1.0 / feather["bow"]
    turn = along / radius
    off, ahead = (radius + across) * np.cos(turn) - radius, (radius + across) * np.sin(turn)
    x = feather["x"] - off * feather["cosine"] + ahead * feather["sine"]
    z = feather["z"] - off * feather["sine"] - ahead * feather["cosine"]
    return np.stack([x, z, height_of(across, along / long, feather)], axis=-1).reshape(-1, 3)


def cell_at(x: Any, z: Any, height: Any) -> Any:
    """Number of the cell of a place; the nearest one for places outside."""
    jit, index = arrays(), arrays().UInt(0)
    for k, at in enumerate((x, z, height)):
        number = clip((at - float(LOW[k])) * float(1.0 / CELL_SIZE[k]), 0.0, float(SHAPE[k] - 1))
        index = index * int(SHAPE[k]) + jit.UInt(number)
    return index


def _cells(places: NDArray[np.float64], thick: float) -> NDArray[np.int64]:
    """Numbers of all cells within SAMPLE_REACH of places, and `thick` in height."""
    on_axes, reach = [], np.array([SAMPLE_REACH, SAMPLE_REACH, thick])
    steps = np.ceil(2.0 * reach / CELL_SIZE).astype(int)  # no step is longer than a cell
    for k, count in enumerate(steps):
        offsets = (2.0 * np.arange(count + 1) / count - 1.0) * reach[k]
        at = ((places[:, k, None] + offsets - LOW[k]) / CELL_SIZE[k]).astype(int)
        on_axes.append(np.clip(at, 0, SHAPE[k] - 1))
    x, z, height = on_axes
    return np.unique((x[:, :, None, None] * SHAPE[1] + z[:, None, :, None]) * SHAPE[2] + height[:, None, None, :])
