"""Volume boxes on disk: a Zarr v3 group that any Zarr reader opens; `box_group` and `shell_store` say what is in it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.stores import is_file
from hagoromo.files.whole import whole_folder
from hagoromo.files.zarr_arrays import open_arrays
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import Bricks, brick_bytes
from hagoromo.volume.store.blocks import BLOCK_SIDE, OFFSETS, Block, block_of, low_part, runs
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.open_box import OpenBox, open_box
from hagoromo.volume.store.packed_bricks import read_packed, write_packed
from hagoromo.volume.store.read_bricks import read_bricks
from hagoromo.volume.store.shell_store import is_shell, look_at_shell, read_shell, write_shell
from hagoromo.volume.table import BLOCK


def save_box(box: VolumeBox, path: str | Path, force: bool = False) -> None:
    """Write `box` as a Zarr v3 group at `path`, whole or not at all; loaded again it has the same bits.

    force: replace what is there; without it an existing `path` is an `InputError`.
    """
    colours = max(len(box.basis), 1) if box.bricks.colour is not None else 0
    with whole_folder(path, force) as folder:
        if box.texel:
            write_shell(box, folder)
            return
        group = BoxGroup(folder, box.bricks.shape, box.header, colours, box.bricks.material is not None)
        for block, values in _blocks(box, colours):
            group.write(block, values)
        group.finish(box.bricks.places)
        write_packed(folder)


def load_box(path: str | Path) -> VolumeBox:
    """The volume box in the Zarr group at `path`; `InputError` when it is missing, damaged, foreign or too large."""
    if holds_shell(path):
        return read_shell(Path(path))
    box = open_box(path)
    return VolumeBox.of(box.header, stored_bricks(box))


def stored_bricks(box: OpenBox, needed: NDArray[np.bool_] | None = None) -> Bricks:
    """The bricks of a box on disk; of packed ones, those `needed` (n,) at least. `InputError` as from `load_box`."""
    return read_packed(box, needed) or read_bricks(box.source, box.places, len(box.header.materials))


class StoredBox(NamedTuple):
    """A summary of a box on disk, without reading its voxels: shape (nz, ny, nx), bricks that hold matter, memory."""

    header: BoxHeader
    shape: tuple[int, int, int]
    kept: int
    bytes: int

    def __str__(self) -> str:
        voxels = " × ".join(map(str, self.shape[::-1]))
        memory = f"{self.kept} bricks, {self.bytes / 2**20:.1f} MiB, of them hold matter"
        return f"{voxels} voxels of {1000 * self.header.voxel_size:.3g} mm, {memory}"


def look_at_box(path: str | Path) -> StoredBox:
    """The box in the Zarr group at `path`, its voxels unread; `InputError` as from `load_box`."""
    if holds_shell(path):
        return StoredBox(*look_at_shell(Path(path)))
    box = open_box(path)
    size = brick_bytes(box.source.colours > 0, box.source.material)
    return StoredBox(box.header, box.source.shape, len(box.places), len(box.places) * size)


def holds_shell(path: str | Path) -> bool:
    """Whether a box is a shell around a texel."""
    return is_file(Path(path) / "zarr.json") and is_shell(open_arrays(path)[0].get("hagoromo"))


def _blocks(box: VolumeBox, colours: int) -> Iterator[tuple[Block, dict[str, NDArray]]]:
    """Every block (64, 64, 64, …) of `box` in which a stored brick has voxels.

    The last layer of a stored brick may be the first of a brick, or of a block, that is not stored.
    """
    blocks, starts = runs(box.bricks.places // BLOCK)
    shared: dict[Block, list[tuple[Block, dict[str, NDArray]]]] = {}
    for block, begin, end in zip(blocks.tolist(), starts[:-1], starts[1:], strict=True):
        z, y, x = block
        held = box.bricks.read(begin, end)
        if "colour" in held:
            held["body_colour"] = held.pop("colour")[..., :colours]
        inner = box.bricks.places[begin:end] % BLOCK
        wide = {name: block_of(values, inner) for name, values in held.items()}
        for a, b, c in OFFSETS[1:]:
            beyond = tuple(slice(BLOCK_SIDE, None) if step else slice(BLOCK_SIDE) for step in (a, b, c))
            part = {name: values[beyond].copy() for name, values in wide.items()}
            if any(values.any() for values in part.values()):
                shared.setdefault((z + a, y + b, x + c), []).append(((a, b, c), part))
        own = {name: values[:BLOCK_SIDE, :BLOCK_SIDE, :BLOCK_SIDE] for name, values in wide.items()}
        yield (z, y, x), _with_shared(own, shared.pop((z, y, x), []))
    for block, parts in shared.items():
        if all(BLOCK_SIDE * k < n for k, n in zip(block, box.bricks.shape, strict=True)):
            own = {
                name: np.zeros((BLOCK_SIDE,) * 3 + values.shape[3:], values.dtype)
                for name, values in parts[0][1].items()
            }
            yield block, _with_shared(own, parts)


def _with_shared(own: dict[str, NDArray], parts: list[tuple[Block, dict[str, NDArray]]]) -> dict[str, NDArray]:
    for offset, part in parts:
        for name, values in part.items():
            first = own[name][low_part(offset)]
            first[...] = np.where(first == 0, values, first)
    return own
