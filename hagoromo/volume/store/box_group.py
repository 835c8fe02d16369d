"""Box group: the Zarr v3 group of a volume box in the making, written block by block.

Arrays `density` (nz, ny, nx), `axis` (nz, ny, nx, 3), where the box has them `material` (nz, ny, nx) and `body_colour`
(nz, ny, nx, j), and `bricks`, a bool per brick of 8³ voxels: which ones hold matter in their 9³. Chunks are blocks of
8³ bricks; every block with a True in `bricks` has its chunk of each array, blocks without one are absent. The
attribute `hagoromo` holds the header. Beside the arrays the group `packed` keeps their bricks, see `packed_bricks`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from hagoromo.files.finite import check_finite, finite_json
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import table_shape
from hagoromo.volume.store.blocks import BLOCK_SIDE
from hagoromo.volume.store.header import header_record
from hagoromo.volume.store.seal import SEALED
from hagoromo.volume.table import BLOCK

AXES = ("z", "y", "x")
KEEP_EMPTY = {"array.write_empty_chunks": True}  # a setting of arrays as they are opened, not as they are stored
Shape = tuple[int, int, int]


class BoxGroup:
    """The group in an empty folder, or in one where a box of the same kind was begun.

    shape: (nz, ny, nx) voxels. colours: coefficients of the body colour, 0 for none. material: whether there are any.
    begun: another process has made the group and its arrays; here only blocks are written.
    """

    def __init__(
        self, folder: Path, shape: Shape, header: BoxHeader, colours: int, material: bool, begun: bool = False
    ) -> None:
        self.folder, self.shape = folder, shape
        self.group = zarr.open_group(folder, mode="r+" if begun else "a", zarr_format=3)
        if not begun:
            self.group.attrs["hagoromo"] = json.loads(finite_json(header_record(header), str(folder)))
        self._arrays: dict[str, Any] = {"density": self._array("density", "float16")}
        self._arrays["axis"] = self._array("axis", "float16", 3)
        if colours:
            self._arrays["body_colour"] = self._array("body_colour", "float16", colours)
        if material:
            self._arrays["material"] = self._array("material", "uint8")

    def write(self, block: tuple[int, int, int], values: Mapping[str, NDArray]) -> None:
        """Write the voxels (≤ 64, ≤ 64, ≤ 64, …) of a block [z, y, x in blocks], each array whole."""
        region = tuple(
            slice(BLOCK_SIDE * k, min(BLOCK_SIDE * (k + 1), n)) for k, n in zip(block, self.shape, strict=True)
        )
        check_finite(values, f"the block {block} of {self.folder}", "numbers")
        for name, array in self._arrays.items():
            array[region] = values[name][tuple(slice(0, r.stop - r.start) for r in region)]

    def holds(self, block: tuple[int, int, int]) -> bool:
        """Whether a block has been written."""
        return all(chunk.is_file() and chunk.stat().st_size for chunk in self._chunks(block))

    def size(self, block: tuple[int, int, int]) -> int:
        """Bytes on disk of a block that has been written."""
        return sum(chunk.stat().st_size for chunk in self._chunks(block))

    def _chunks(self, block: tuple[int, int, int]) -> list[Path]:
        """The file of a block in each array."""
        key = "/".join(map(str, ("c", *block)))
        suffix = {"axis": "/0", "body_colour": "/0"}
        return [self.folder / name / (key + suffix.get(name, "")) for name in self._arrays]

    def finish(self, places: NDArray[np.integer]) -> None:
        """Write which bricks are stored, (n, 3), and zeros where one of them lies in a block that was not written.

        Such a brick holds matter only in the layer that it shares with the next block.
        """
        empty = {
            name: np.zeros((BLOCK_SIDE,) * 3 + array.shape[3:], array.dtype) for name, array in self._arrays.items()
        }
        for block in np.unique(places // BLOCK, axis=0).tolist():
            if not self.holds(tuple(block)):
                self.write(tuple(block), empty)
        lattice = table_shape(self.shape)
        bricks: Any = self._create("bricks", lattice, tuple(min(BLOCK_SIDE, n) for n in lattice), "bool", AXES)
        chunk, inverse = np.unique(places // BLOCK_SIDE, axis=0, return_inverse=True)
        for number, corner in enumerate(chunk * BLOCK_SIDE):
            kept = np.zeros([min(BLOCK_SIDE, n - c) for n, c in zip(lattice, corner, strict=True)], bool)
            kept[tuple((places[inverse == number] - corner).T)] = True
            bricks[tuple(slice(c, c + n) for c, n in zip(corner, kept.shape, strict=True))] = kept

    def _array(self, name: str, kind: str, components: int = 0) -> Any:
        if name in self.group:
            with zarr.config.set(KEEP_EMPTY):
                return self.group[name]
        more = (components,) if components else ()
        chunks = tuple(min(BLOCK_SIDE, n) for n in self.shape)
        return self._create(name, self.shape + more, chunks + more, kind, AXES + (("component",) if more else ()))

    def _create(self, name: str, shape: tuple[int, ...], chunks: tuple[int, ...], kind: str, axes: Any) -> Any:
        with zarr.config.set(KEEP_EMPTY):
            return self.group.create_array(
                name, shape=shape, chunks=chunks, dtype=kind, fill_value=0, dimension_names=axes, overwrite=True,
                compressors=SEALED,
            )  # fmt: skip
