"""Any Zarr array of densities, or two (densities and axes), as a volume box: in memory, or streamed to disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.stores import address
from hagoromo.files.volume_file import SAME_EDGE, read_volume, resampled
from hagoromo.files.zarr_arrays import ZarrArray, open_array
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.bricks import Bricks
from hagoromo.volume.store.array_source import ArraySource, Windowed, check_explained
from hagoromo.volume.store.blocks import BLOCK_SIDE, Block
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.read_bricks import occupied_places, read_bricks
from hagoromo.volume.store.zarr_blocks import ZarrBlocks

BLOCKS_OF_DRAW = 8  # that a draw of a tile stands for


def box_from_zarr(
    density: str | Path,
    voxel_size: float,
    tau: float,
    materials: Sequence[Reflectance],
    axis: str | Path | None = None,
    scale: float | None = None,
    **record: Any,
) -> VolumeBox:
    """The box of the Zarr array (v2 or v3) at `density`, (nz, ny, nx) of any type of numbers, whatever its chunks.

    axis: a Zarr array (nz, ny, nx, 3); without it axes point outwards, down the slope of the density. scale: density
    per unit of the array (default: 1 where it holds floats; whole numbers need one stated). record: pose, name,
    provenance. The array is read twice, tile by tile: memory follows the bricks that hold matter. Raises `InputError`
    for what cannot be read, is no density, or does not fit the memory.
    """
    header = BoxHeader(float(voxel_size), float(tau), tuple(materials), **record)
    return BoxPlan(header, ZarrVolume(density, axis, scale)).box()


def open_source(path: str | Path) -> tuple[ZarrArray | ArraySource, np.ndarray | None]:
    """The numbers of a Zarr array or of a volume file of another program, and the matrix of a file that states one.

    matrix: (4, 4), index (x, y, z) of the centre of a voxel → place [m], right-handed; see `VolumeFile.upright`.
    """
    if address(path) or any((Path(path) / name).is_file() for name in ("zarr.json", ".zarray")):
        return open_array(path), None
    if Path(path).suffix == ".zarr":
        return open_array(path), None  # says what is wrong with it
    values, matrix = read_volume(path).upright()
    return ArraySource(values, str(path)), matrix


class ZarrVolume:
    """The blocks of a Zarr array or another file of densities, and of one of axes if there is one; see `box_from_zarr`.

    window: the numbers of density 0 and of density 1, what lies beyond is cut off; scale is then a factor on that.
    voxel: edge of a voxel [m] where the file is to be resampled, or does not state one. voxel_size: the edge that
    resulted; pose: where the box lies; None where neither the file nor `voxel` says.
    """

    def __init__(
        self,
        density: str | Path,
        axis: str | Path | None = None,
        scale: float | None = None,
        window: tuple[float, float] | None = None,
        voxel: float | None = None,
    ) -> None:
        opened, matrix = open_source(density)
        check_explained(opened, scale, window)
        self.voxel_size, self.pose = voxel, None
        if matrix is not None:
            opened, self.voxel_size, self.pose = _in_cubes(opened, matrix, voxel)
        others = {} if axis is None else {"axis": open_source(axis)[0]}
        if axis is not None and opened.shape[:3] != others["axis"].shape[:3]:
            raise InputError(f"{axis} is {others['axis'].shape}: {density} has {opened.shape} voxels (z, y, x)")
        densities = opened if window is None else Windowed(opened, window)
        self.source = ZarrBlocks(densities, others, 1.0 if scale is None else scale)
        self.shape, self.colours, self.material = self.source.shape, 0, False

    def bricks(self, materials: int) -> Bricks:
        """All bricks that hold matter, on the device."""
        return read_bricks(self.source, occupied_places(self.source), materials)

    def parts(self) -> list[NDArray[np.integer]]:
        """The blocks (n, 3) of every tile."""
        inner = np.argwhere(np.ones([side // BLOCK_SIDE for side in self.source.tile], bool))
        ends = -(-np.array(self.shape) // BLOCK_SIDE)
        blocks = (inner + tile * self.source.tile // BLOCK_SIDE for tile in self.source.tiles())
        return [part[(part < ends).all(axis=1)] for part in blocks]

    def drawn(self, count: int) -> Iterator[tuple[float, Iterator[tuple[Block, dict[str, NDArray]]]]]:
        """Probability of a draw, and what `read` gives of the part: a tile, so that there are fewer draws."""
        parts = self.parts()
        share = np.array([len(part) for part in parts]) / max(sum(map(len, parts)), 1)
        draws = -(-count // BLOCKS_OF_DRAW) if parts else 0
        for number in np.random.default_rng(0).choice(len(parts), draws, p=share):
            yield float(share[number]), self.read(parts[number])

    def read(self, part: NDArray[np.integer]) -> Iterator[tuple[Block, dict[str, NDArray]]]:
        """The blocks of a tile that hold matter, with their voxels."""
        corner = part[0] * BLOCK_SIDE
        tile = tuple((corner // self.source.tile).tolist())
        values = self.source.voxels(tile)
        values["axis"] = np.where(values["density"][..., None] > 0, values["axis"], np.float16(0))
        for z, y, x in part.tolist():
            inner = tuple(
                slice(k - c, k - c + BLOCK_SIDE)
                for k, c in zip((z * BLOCK_SIDE, y * BLOCK_SIDE, x * BLOCK_SIDE), corner, strict=True)
            )
            block = {name: array[inner] for name, array in values.items()}
            if block["density"].any():
                yield (z, y, x), block


def _in_cubes(source: Any, matrix: np.ndarray, voxel: float | None) -> tuple[Any, float, np.ndarray]:
    """The numbers in voxels of one edge, that edge [m], and the pose of the box.

    Voxels of unequal edges become cubes of the shortest of them, or of `voxel`, by linear interpolation.
    """
    edges = np.linalg.norm(matrix[:3, :3], axis=0)
    edge, pose = float(edges.min() if voxel is None else voxel), np.eye(4)
    pose[:3, :3] = matrix[:3, :3] / edges
    pose[:3, 3] = matrix[:3, 3] - 0.5 * matrix[:3, :3].sum(axis=1)
    if np.abs(edges / edge - 1.0).max() <= SAME_EDGE:
        return source, edge, pose
    if len(source.shape) != 3:
        raise InputError(f"{source.where} is {source.shape}: a density is three axes of numbers")
    return ArraySource(resampled(source.array, edges.tolist(), edge), source.where), edge, pose
