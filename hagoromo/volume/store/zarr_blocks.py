"""Zarr blocks: the voxels of a lattice that lie in Zarr arrays, read a tile (whole blocks) at a time, out of core.

Chunks may have any shape: a tile is the smallest whole number of blocks that is no smaller than a chunk of the density.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from os import cpu_count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError, described
from hagoromo.files.memory import require
from hagoromo.files.zarr_arrays import Index, ZarrArray
from hagoromo.volume.bricks import check_shape, table_shape
from hagoromo.volume.store.blocks import BLOCK_SIDE
from hagoromo.volume.store.brick_writer import DENSEST, check_thin
from hagoromo.volume.voxels import SMALLEST_DENSITY

SMALLEST_HALF = 0x0400  # bits of SMALLEST_DENSITY
LARGEST_HALF = 0x7BFF  # bits of the largest finite half: halves from 0 on have no greater ones
GRADIENT_CHUNKS = 3  # chunks along an edge of a tile of densities without axes, whose rim is read more than once
THREADS = min(cpu_count() or 1, 8)  # that decode
WANTED = {"axis": ("f", (3,)), "body_colour": ("f", (1, 2, 3, 4)), "material": ("ui", ())}  # types, components
Tile = tuple[int, ...]  # [z, y, x in tiles]


class ZarrBlocks:
    """Density (nz, ny, nx), axis (…, 3), body colour (…, ≤ 4) and material in Zarr arrays; all but density may lack.

    Without axes they are −∇density, unit: outwards. scale: density per unit of the array. seen: of each part that was
    read the largest density, and whether some is above 0 and below SMALLEST_DENSITY.
    `InputError` where shapes or types do not fit each other, or a tile does not fit the memory.
    """

    def __init__(self, density: ZarrArray | Any, others: Mapping[str, ZarrArray | Any], scale: float = 1.0) -> None:
        with described(density.where):
            check_shape(density.shape)
        z, y, x = density.shape
        self.shape, self.density, self.others, self.scale = (z, y, x), density, others, scale
        self.seen: list[tuple[float, bool]] = []
        for name, array in others.items():
            _check_like(name, array, self.shape)
        self.colours = others["body_colour"].shape[-1] if "body_colour" in others else 0
        self.material = "material" in others
        chunks = 1 if "axis" in others else GRADIENT_CHUNKS
        self.tile = tuple(
            BLOCK_SIDE * -(-min(chunks * c, n) // BLOCK_SIDE) for c, n in zip(density.grid, self.shape, strict=True)
        )
        self.across = tuple(-(-n // side) for n, side in zip(self.shape, self.tile, strict=True))
        voxel = 40 + 8 * self.colours  # as read and as kept, two tiles a thread
        require(2 * THREADS * voxel * math.prod(self.tile), f"reading tiles of {density.where}")
        require(60 * math.prod(self.across), f"a list of the tiles of {density.where}")
        require(8 * math.prod(table_shape(self.shape)), f"a table of the bricks of {density.where}")

    def tiles(self) -> NDArray[np.int64]:
        """Tiles that may hold matter, in C order: (n, 3) [z, y, x in tiles]."""
        if not self.density.absent_is_zero:
            return np.argwhere(np.ones(self.across, bool))
        low = np.array(list(self.density.files), np.int64).reshape(-1, 3) * self.density.grid
        high = np.minimum(low + self.density.grid, self.shape) - 1
        corners = [np.where(pick, high, low) for pick in np.ndindex(2, 2, 2)]  # a chunk lies in two tiles at most
        return np.unique(np.concatenate(corners) // np.array(self.tile), axis=0)

    def voxels(self, tile: Tile, only_density: bool = False) -> dict[str, NDArray]:
        """The voxels (≤ tile, …) of a tile: density and others as float16, material as uint8."""
        low = tuple(k * side for k, side in zip(tile, self.tile, strict=True))
        high = tuple(min(a + side, n) for a, side, n in zip(low, self.tile, self.shape, strict=True))
        if only_density:
            return {"density": self._density(low, high)}
        values: dict[str, NDArray] = (
            {"density": self._density(low, high)} if "axis" in self.others else self._density_and_axis(low, high)
        )
        for name, array in self.others.items():
            more = array.shape[3:]
            stored = array.read((*low, *(0 for _ in more)), (*high, *more))
            values[name] = _materials(stored, array.where) if name == "material" else _halves(stored)
        return values

    def _density(self, low: Index, high: Index) -> NDArray[np.float16]:
        stored = self.density.read(low, high)
        if stored.dtype == np.float16 and self.scale == 1.0 and stored.view(np.uint16).max() <= LARGEST_HALF:
            self.seen.append(
                (float(stored.max()), bool((stored.view(np.uint16) - np.uint16(1) < SMALLEST_HALF - 1).any()))
            )
            return stored
        density = stored.astype(np.float32) * np.float32(self.scale)
        least, most = float(density.min()), float(density.max())
        if not (least >= 0 and most <= DENSEST):
            raise InputError(
                f"{self.density.where}: density is {least:g} to {most:g} near voxel {low[::-1]}: "
                f"give finite numbers from 0 to {DENSEST:g}"
            )
        self.seen.append((most, bool(((density > 0.0) & (density < SMALLEST_DENSITY)).any())))
        return np.abs(density).astype(np.float16)  # no −0

    def check_thin(self) -> None:
        """`check_thin` of the densities that were read so far."""
        densest, lost = max((most for most, _ in self.seen), default=0.0), any(thin for _, thin in self.seen)
        check_thin(densest, lost, f"{self.density.where}: ")

    def _density_and_axis(self, low: Index, high: Index) -> dict[str, NDArray]:
        """Density, and −∇density / |∇density| from central differences, 0 where it is even."""
        wider = tuple(max(a - 1, 0) for a in low), tuple(min(b + 1, n) for b, n in zip(high, self.shape, strict=True))
        around = self._density(*wider)
        own = tuple(slice(a - w, b - w) for a, b, w in zip(low, high, wider[0], strict=True))
        slopes = np.gradient(around.astype(np.float32))
        downhill = np.stack([-slope[own] for slope in reversed(slopes)], axis=-1)
        length = np.sqrt(np.einsum("...k,...k->...", downhill, downhill))
        axis = downhill / np.maximum(length, np.finfo(np.float32).tiny)[..., None]
        return {"density": np.ascontiguousarray(around[own]), "axis": axis.astype(np.float16)}


def in_order(work: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
    """What `work` makes of each item, in their order; threads are a few items ahead."""
    with ThreadPoolExecutor(THREADS) as threads:
        waiting: deque[Future] = deque()
        try:
            for item in items:
                waiting.append(threads.submit(work, item))
                if len(waiting) > 2 * THREADS:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _check_like(name: str, array: Any, shape: tuple[int, int, int]) -> None:
    dtype_kinds, components = WANTED[name]
    if array.shape[:3] != shape or array.shape[3:] not in ([(n,) for n in components] or [()]):
        wanted = f"{(*shape, *components[-1:])}"
        raise InputError(f"{array.where} is {array.shape}: density {shape} needs {wanted}")
    if array.array.dtype.kind not in dtype_kinds:
        wanted = "whole numbers" if name == "material" else "floating-point numbers"
        raise InputError(f"{array.where} holds {array.array.dtype}: give {wanted}")


def _materials(stored: NDArray, where: str) -> NDArray[np.uint8]:
    if stored.size and (stored.min() < 0 or stored.max() > 255):
        raise InputError(f"{where} has material numbers from {stored.min()} to {stored.max()}: give 0 to 255")
    return stored.astype(np.uint8)


def _halves(stored: NDArray) -> NDArray[np.float16]:
    with np.errstate(over="ignore"):  # refused where there is matter, when bricks are written
        return stored.astype(np.float16, copy=False)
