"""Box plan: a volume box before its voxels are known, to be built in memory or straight to disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader, Extinction
from hagoromo.volume.bricks import Bricks
from hagoromo.volume.store.blocks import Block


class Blocks(Protocol):
    """Where voxels come from: `FieldBlocks` or `ZarrBlocks`."""

    shape: tuple[int, int, int]  # (nz, ny, nx) voxels
    colours: int  # coefficients of the body colour of a voxel
    material: bool  # whether voxels have material numbers

    def bricks(self, materials: int) -> Bricks:
        """All bricks that hold matter, on the device."""
        ...

    def parts(self) -> Sequence[NDArray[np.integer]]:
        """Blocks that may hold matter, (n, 3), in parts that are read together; always the same ones."""
        ...

    def drawn(self, count: int) -> Iterator[tuple[float, Iterator[tuple[Block, dict[str, NDArray]]]]]:
        """Probability of a draw, and what `read` gives of the block or part that was drawn; the same ones each time.

        count: of blocks; there are two draws at least, where there is anything.
        """
        ...

    def read(self, part: NDArray[np.integer]) -> Iterator[tuple[Block, dict[str, NDArray]]]:
        """The blocks of a part that hold anything, with their voxels (≤ 64, ≤ 64, ≤ 64, …)."""
        ...


@dataclass(frozen=True, eq=False)
class BoxPlan:
    """All of a volume box but its voxels, and where these come from."""

    header: BoxHeader
    blocks: Blocks

    def box(self) -> VolumeBox:
        """The box, built in memory."""
        return VolumeBox.of(self.header, self.blocks.bricks(len(self.header.materials)))

    def named(self, name: str, provenance: dict[str, Any]) -> BoxPlan:
        """The same plan under another name (as it is where that is empty) and of another provenance."""
        return BoxPlan(replace(self.header, name=name or self.header.name, provenance=provenance), self.blocks)

    def with_extinction(self, extinction: Extinction) -> BoxPlan:
        """The same plan with another `extinction`, see `VolumeBox`; `InputError` where its texel is matched for one."""
        if extinction == self.header.extinction:
            return self
        if self.header.texel:
            raise InputError(f"extinction is {extinction!r}: this kind of matter knows {self.header.extinction!r} only")
        return BoxPlan(replace(self.header, extinction=extinction), self.blocks)
