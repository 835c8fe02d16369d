"""Levels of a texel: from its finest lattice to ever coarser ones, each with means over cells twice as wide.

Along u and v down to one cell per period; along the height down to FEWEST_ALONG_HEIGHT cells, which keeps the depth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.volume.texel import Level, unscaled

FEWEST_ALONG_HEIGHT = 4  # cells
Values = NDArray[np.float32]


def levels_of(density: NDArray, axis: NDArray, variants: int) -> tuple[Level, ...]:
    """All levels of the finest lattice; density and axis as in `Level`, axes of either sign.

    The mean axis of a coarse cell is the principal direction of Σ ρ a aᵀ over its matter, for the sign of a tangent has
    no meaning; its length is the share of that direction in the trace. It points to the side of Σ ρ a.
    """
    populations, v, u, h = density.shape
    finest = Level(density.astype(np.float16), axis.astype(np.float16), unscaled(populations))
    levels, axis = [finest], axis.astype(np.float32)
    held = density.astype(np.float32)
    rows, columns = np.triu_indices(3)
    moments = np.concatenate([axis, axis[..., rows] * axis[..., columns]], axis=-1) * held[..., None]
    cells = (u - 1) // variants, v - 1, h - 1
    while max(cells[:2]) > 1:
        cells = max(cells[0] // 2, 1), max(cells[1] // 2, 1), max(cells[2] // 2, min(cells[2], FEWEST_ALONG_HEIGHT))
        held, moments = (_coarser(values, cells, variants) for values in (held, moments))
        mean = _principal(moments[..., 3:], moments[..., :3])
        levels.append(Level(held.astype(np.float16), mean.astype(np.float16), finest.scale.copy()))
    return tuple(levels)


def _principal(squares: Values, sums: Values) -> Values:
    """Principal directions of symmetric matrices, (…, 6) by their upper triangles, on the side of `sums` (…, 3)."""
    rows, columns = np.triu_indices(3)
    matrix = np.zeros((*squares.shape[:-1], 3, 3), np.float32)
    matrix[..., rows, columns] = matrix[..., columns, rows] = squares
    values, vectors = np.linalg.eigh(matrix)
    principal = vectors[..., -1]
    share = values[..., -1] / np.maximum(values.sum(axis=-1), 1e-20)
    side = np.where(np.einsum("...k,...k->...", principal, sums) < 0.0, -1.0, 1.0)
    return principal * (np.where(values[..., -1] > 0.0, share, 0.0) * side)[..., None]


def _coarser(values: Values, cells: tuple[int, ...], variants: int) -> Values:
    """Values at the nodes of fewer cells: (populations, v, u, h, …)."""
    blocks = _split(values, variants)  # populations, variants, v, u, h, without the last, repeated nodes of v and u
    for axis, count in ((3, cells[0]), (2, cells[1])):
        blocks = np.moveaxis(np.tensordot(_around(blocks.shape[axis], count), blocks, (1, axis)), 0, axis)
    blocks = np.moveaxis(np.tensordot(_upwards(blocks.shape[4] - 1, cells[2]), blocks, (1, 4)), 0, 4)
    blocks[:, :, 0] = blocks[:, :, 0].mean(axis=1, keepdims=True)  # any variant may be the neighbour
    blocks[:, :, :, 0] = blocks[:, :, :, 0].mean(axis=1, keepdims=True)
    return _joined(blocks)


def _split(values: Values, variants: int) -> Values:
    """(populations, v, u, h, …) as (populations, variants, v, u, h, …), each node of a period once."""
    inner = values[:, :-1, :-1]
    populations, v, u = inner.shape[:3]
    parts = inner.reshape(populations, v, variants, u // variants, *inner.shape[3:])
    return np.moveaxis(parts, 2, 1)


def _joined(blocks: Values) -> Values:
    """The inverse of `_split`."""
    parts = np.moveaxis(blocks, 1, 2)
    populations, v, variants, u = parts.shape[:4]
    inner = parts.reshape(populations, v, variants * u, *parts.shape[4:])
    inner = np.concatenate([inner, inner[:, :, :1]], axis=2)
    return np.concatenate([inner, inner[:, :1]], axis=1)


def _around(many: int, few: int) -> Values:
    """Weights (few, many) from the nodes of a period to those of a coarser one: tents two coarse cells wide."""
    ratio = many / few
    apart = np.abs(np.arange(few)[:, None] * ratio - np.arange(many))
    weights = np.maximum(1.0 - apart / ratio, 0.0) + np.maximum(1.0 - (many - apart) / ratio, 0.0)
    return (weights / ratio).astype(np.float32)  # each column sums to few / many, so the mean is kept


def _upwards(many: int, few: int) -> Values:
    """The same along the height, (few + 1, many + 1): matter ends at the lowest and the highest node."""
    ratio = many / few
    apart = np.abs(np.arange(few + 1)[:, None] * ratio - np.arange(many + 1))
    weights = np.maximum(1.0 - apart / ratio, 0.0) / ratio
    weights[:, [0, -1]] *= 0.5  # half of the cells around these nodes is beyond the ends,
    weights[[0, -1]] *= 2.0  # and half of the tents around these
    return weights.astype(np.float32)
