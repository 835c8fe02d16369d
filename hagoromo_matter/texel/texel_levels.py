"""Levels of a texel: from its finest lattice to ever coarser ones, each with means over cells twice as wide.

Along u and v down to one cell per period; along the height down to FEWEST_ALONG_HEIGHT cells, which keeps the depth.
Means are taken population by population, and some heights of a variant at a time: memory beside the nodes and the
levels is that of an eighth of the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.volume.texel import Level, unscaled

FEWEST_ALONG_HEIGHT = 4  # cells
NODES_AT_ONCE = 1 << 17  # of which moments are held
SLABS = 8  # that are averaged along the height one after the other
MOMENTS = 10  # numbers of a node: ρ, ρ a (3), and the upper triangle of ρ a aᵀ (6)
Values = NDArray[np.float32]
Part = Callable[[int, slice], Values]  # variant, heights → moments (v, u, h, MOMENTS)
Cells = tuple[int, int, int]  # along u and v of a period, and along the height


@dataclass(frozen=True, eq=False)
class Nodes:
    """The finest lattice, each node of a period once; all variants are side by side along u.

    density: (v, u, h). axis: (v, u, h, 3), of either sign. population: (v, u, h) the number of the one that is there.
    """

    density: Values
    axis: Values
    population: NDArray[np.uint8]
    populations: int
    variants: int

    @property
    def cells(self) -> Cells:
        """Of a period, and of the height."""
        v, u, h = self.density.shape
        return u // self.variants, v, h - 1

    def of(self, population: int, where: tuple[slice, ...]) -> tuple[Values, Values]:
        """Density and axis of one population in a part of the lattice; 0 where it is not."""
        density = np.where(self.population[where] == population, self.density[where], np.float32(0.0))
        return density, np.where((density > 0)[..., None], self.axis[where], np.float32(0.0))

    def moments(self, population: int) -> Part:
        """Moments of one population."""
        across = self.cells[0]

        def part(variant: int, heights: slice) -> Values:
            where = slice(None), slice(variant * across, (variant + 1) * across), heights
            density, axis = self.of(population, where)
            moments = np.empty((*density.shape, MOMENTS), np.float32)
            moments[..., 0], moments[..., 1:4] = density, axis * density[..., None]
            for number, (row, column) in enumerate(zip(*np.triu_indices(3), strict=True), 4):
                moments[..., number] = axis[..., row] * axis[..., column] * density
            return moments

        return part


def levels_of(nodes: Nodes) -> tuple[Level, ...]:
    """All levels of the finest lattice.

    The mean axis of a coarse cell is the principal direction of Σ ρ a aᵀ over its matter, for the sign of a tangent has
    no meaning; its length is the share of that direction in the trace. It points to the side of Σ ρ a.
    """
    finest = _finest(nodes)
    populations = [_coarse(nodes.moments(k), nodes.cells, nodes.variants) for k in range(nodes.populations)]
    coarse = [
        Level(np.stack([density for density, _ in level]), np.stack([axis for _, axis in level]), finest.scale.copy())
        for level in zip(*populations, strict=True)
    ]
    return finest, *coarse


def _finest(nodes: Nodes) -> Level:
    """The lattice itself, with the first row and column again as the last."""
    v, u, h = nodes.density.shape
    density = np.empty((nodes.populations, v + 1, u + 1, h), np.float16)
    axis = np.empty((*density.shape, 3), np.float16)
    rows = max(NODES_AT_ONCE // (u * h), 1)
    for k in range(nodes.populations):
        for begin in range(0, v, rows):
            some = slice(begin, min(begin + rows, v))
            density[k, some, :u], axis[k, some, :u] = nodes.of(k, (some,))
        for values in (density[k], axis[k]):
            values[:v, u] = values[:v, 0]
            values[v] = values[0]
    return Level(density, axis, unscaled(nodes.populations))


def _coarse(part: Part, cells: Cells, variants: int) -> list[tuple[NDArray[np.float16], NDArray[np.float16]]]:
    """Density and axis of a population on all levels but the finest."""
    levels = []
    while max(cells[:2]) > 1:
        fewer = max(cells[0] // 2, 1), max(cells[1] // 2, 1), max(cells[2] // 2, min(cells[2], FEWEST_ALONG_HEIGHT))
        blocks = _coarser(part, cells, fewer, variants)
        levels.append((_joined(blocks[..., 0].astype(np.float16)), _joined(_principal(blocks))))
        part, cells = (lambda k, heights, blocks=blocks: blocks[k, :, :, heights]), fewer
    return levels


def _principal(blocks: Values) -> NDArray[np.float16]:
    """Mean axes (…, 3) of moments (…, MOMENTS)."""
    moments, axis = blocks.reshape(-1, MOMENTS), np.zeros((*blocks.shape[:-1], 3), np.float16)
    rows, columns = np.triu_indices(3)
    for begin in range(0, len(moments), NODES_AT_ONCE):
        some = moments[begin : begin + NODES_AT_ONCE]
        matrix = np.zeros((len(some), 3, 3), np.float32)
        matrix[..., rows, columns] = matrix[..., columns, rows] = some[:, 4:]
        values, vectors = np.linalg.eigh(matrix)
        principal = vectors[..., -1]
        share = values[..., -1] / np.maximum(values.sum(axis=-1), 1e-20)
        side = np.where(np.einsum("...k,...k->...", principal, some[:, 1:4]) < 0.0, -1.0, 1.0)
        mean = principal * (np.where(values[..., -1] > 0.0, share, 0.0) * side)[..., None]
        axis.reshape(-1, 3)[begin : begin + NODES_AT_ONCE] = mean
    return axis


def _coarser(part: Part, cells: Cells, fewer: Cells, variants: int) -> Values:
    """Moments of fewer cells: (variants, v, u, h, MOMENTS), each node of a period once."""
    blocks = np.empty((variants, fewer[1], fewer[0], fewer[2] + 1, MOMENTS), np.float32)
    around_u, around_v = _around(cells[0], fewer[0]), _around(cells[1], fewer[1])
    upwards, heights = _upwards(cells[2], fewer[2]), max(NODES_AT_ONCE // (cells[0] * cells[1]), 1)
    for variant in range(variants):
        flat = np.empty((fewer[1], fewer[0], cells[2] + 1, MOMENTS), np.float32)
        for begin in range(0, cells[2] + 1, heights):
            some = slice(begin, min(begin + heights, cells[2] + 1))
            narrow = np.tensordot(around_u, part(variant, some), (1, 1))  # u, v, h, MOMENTS
            flat[:, :, some] = np.tensordot(around_v, narrow, (1, 1))
        for rows in np.array_split(np.arange(fewer[1]), min(SLABS, fewer[1])):
            blocks[variant, rows] = np.moveaxis(np.tensordot(upwards, flat[rows], (1, 2)), 0, 2)
    blocks[:, 0] = blocks[:, 0].mean(axis=0, keepdims=True)  # any variant may be the neighbour
    blocks[:, :, 0] = blocks[:, :, 0].mean(axis=0, keepdims=True)
    return blocks


def _joined(blocks: NDArray[np.float16]) -> NDArray[np.float16]:
    """(variants, v, u, h, …) as a lattice (v, u, h, …) of all variants, its first row and column again as the last."""
    rows = np.moveaxis(blocks, 0, 1)
    v, variants, u = rows.shape[:3]
    rows = rows.reshape(v, variants * u, *rows.shape[3:])
    rows = np.concatenate([rows, rows[:, :1]], axis=1)
    return np.concatenate([rows, rows[:1]], axis=0)


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
