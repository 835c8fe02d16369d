"""Bricks: the sparse lattice of a volume box. Only bricks of 8³ voxels that hold matter are kept.

`table` (one entry a brick, C order of [z, y, x]): ≥ 0 the index of a kept brick, < 0 minus the Chebyshev distance
[bricks] to the nearest kept one. A kept brick stores 9³ voxels (its own and the next layer of its neighbours), so
that trilinear interpolation stays inside it. A voxel is a packet of four halves: density, axis x, y, z.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.door import check_memory

BRICK = 8  # voxels a side
STORED = BRICK + 1  # voxels a side as kept
VOXELS = STORED**3
CHUNK = 1 << 12  # bricks evaluated at once
Shape = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Bricks:
    """The sparse lattice: shape (nz, ny, nx) [voxels], table, and per kept brick its voxels.

    voxels: Float16, (bricks · 729 · 4), density and axis; colour: Float16, (bricks · 729 · 4), coefficients of the body
    colour on the box's basis, or None; material: UInt8-valued UInt, (bricks · 729), or None.
    """

    shape: Shape
    table: np.ndarray
    voxels: Any
    colour: Any = None
    material: Any = None

    @property
    def kept(self) -> int:
        """Number of bricks that hold matter."""
        return int((self.table >= 0).sum())

    @property
    def bytes(self) -> int:
        """Memory of table and bricks [byte]."""
        per_voxel = 8 + (8 if self.colour is not None else 0) + (4 if self.material is not None else 0)
        return self.table.nbytes + self.kept * VOXELS * per_voxel

    def corners(self) -> np.ndarray:
        """First voxel (z, y, x) of every kept brick, in order of index: (bricks, 3)."""
        places = np.argwhere(self.table >= 0)
        return places[np.argsort(self.table[tuple(places.T)])] * BRICK

    def dense(self) -> tuple[np.ndarray, np.ndarray]:
        """Density (nz, ny, nx) and axis (nz, ny, nx, 3) as float16 arrays; for tests and small boxes."""
        full = np.zeros((*(BRICK * m + 1 for m in self.table.shape), 4), np.float16)
        values = np.array(self.voxels).reshape(-1, STORED, STORED, STORED, 4)
        for (z, y, x), brick in zip(self.corners(), values, strict=True):
            full[z : z + STORED, y : y + STORED, x : x + STORED] = brick
        full = full[tuple(slice(n) for n in self.shape)]
        return full[..., 0], full[..., 1:]


def table_shape(shape: Shape) -> Shape:
    """Bricks along (z, y, x): interpolation meets voxel pairs 0…n−2, so n−1 of them are covered."""
    z, y, x = (-(-(n - 1) // BRICK) for n in shape)
    return z, y, x


def bricks_from_field(field: Callable[[Any, Any, Any], dict[str, Any]], shape: Shape, occupied: Any = None) -> Bricks:
    """Bricks of `field`, evaluated chunk by chunk; memory follows the bricks that hold matter.

    field(x, y, z): voxel indices (UInt) → {"density", "axis" (Array3f), optional "colour" (list of ≤ 4), "material"}.
    occupied: optional bool array (table shape); False promises that a brick is empty and it is not looked at.
    """
    check_shape(shape)
    check_memory(
        int(np.prod(table_shape(shape), dtype=np.int64)) * 8, f"the brick table of a lattice of {shape[::-1]} voxels"
    )
    candidates = np.ones(table_shape(shape), bool) if occupied is None else occupied
    keep = np.zeros(table_shape(shape), bool)
    for places in _chunks(candidates):
        density = np.array(field(*_indices(places, shape)[:3])["density"])
        _check_density(density)
        keep[tuple(places.T)] = (density.reshape(-1, VOXELS) > 0).any(axis=1)
    places = np.argwhere(keep)
    check_memory(len(places) * VOXELS * 8, f"{len(places)} bricks of 9³ voxels")
    return Bricks(shape, table_of(keep), *_fill(field, places, shape))


def bricks_from_arrays(
    density: np.ndarray, axis: np.ndarray, colour: np.ndarray | None, material: np.ndarray | None
) -> Bricks:
    """Bricks of dense arrays (nz, ny, nx): density, axis (…, 3), colour (…, ≤ 4), material."""
    check_shape(density.shape)
    _check_density(density)
    nz, ny, nx = density.shape
    check_memory(24 * density.size, f"a dense lattice of {density.shape[::-1]} voxels with its bricks")
    kinds = arrays()
    held = {"density": kinds.Float(np.ascontiguousarray(density, np.float32).ravel())}
    for k in range(3):
        held[f"axis{k}"] = kinds.Float(np.ascontiguousarray(axis[..., k], np.float32).ravel())
    if colour is not None:
        held |= {
            f"colour{k}": kinds.Float(np.ascontiguousarray(colour[..., k], np.float32).ravel())
            for k in range(colour.shape[-1])
        }
    if material is not None:
        held["material"] = kinds.UInt(np.ascontiguousarray(material, np.uint32).ravel())

    def field(x: Any, y: Any, z: Any) -> dict[str, Any]:
        import drjit as dr

        index = (z * ny + y) * nx + x
        read = {key: dr.gather(type(array), array, index) for key, array in held.items()}
        voxel: dict[str, Any] = {
            "density": read["density"],
            "axis": kinds.Array3f(*(read[f"axis{k}"] for k in range(3))),
        }
        if colour is not None:
            voxel["colour"] = [read[f"colour{k}"] for k in range(colour.shape[-1])]
        if material is not None:
            voxel["material"] = read["material"]
        return voxel

    return bricks_from_field(field, (nz, ny, nx), occupied_bricks(density > 0))


def occupied_bricks(matter: np.ndarray) -> np.ndarray:
    """Which bricks hold matter, their shared layer of neighbours included: bool (nz, ny, nx) → bool table."""
    for axis, count in enumerate(table_shape(matter.shape)):
        layers = np.moveaxis(matter, axis, 0)
        layers = np.stack([layers[i * BRICK : i * BRICK + STORED].any(axis=0) for i in range(count)])
        matter = np.moveaxis(layers, 0, axis)
    return matter


def table_of(keep: np.ndarray) -> np.ndarray:
    """The table of the bricks to keep (bool): indices in C order, minus the Chebyshev distance elsewhere, int32."""
    from scipy.ndimage import distance_transform_cdt

    if not keep.any():
        return np.full(keep.shape, -max(keep.shape), np.int32)
    table = -np.asarray(distance_transform_cdt(~keep, metric="chessboard"), np.int32)
    table[keep] = np.arange(keep.sum(), dtype=np.int32)
    return table


def check_shape(shape: tuple[int, ...]) -> None:
    """Raises `InputError` unless `shape` is three numbers of at least 2 voxels."""
    if len(shape) != 3 or min(shape) < 2:
        raise InputError(f"lattice is {tuple(shape)[::-1]} voxels: give three numbers of at least 2 (x, y, z)")


def _fill(field: Callable[..., dict[str, Any]], places: np.ndarray, shape: Shape) -> tuple[Any, Any, Any]:
    """Voxels, colours and materials of the bricks at `places`."""
    import drjit as dr

    kinds = arrays()
    stored: dict[str, Any] = {"voxels": dr.zeros(kinds.Float16, max(len(places), 1) * VOXELS * 4)}
    for start in range(0, len(places), CHUNK):
        x, y, z, local = _indices(places[start : start + CHUNK], shape)
        voxel = field(x, y, z)
        target = local + start * VOXELS
        matter = voxel["density"] > 0
        packet = [dr.select(matter, value, 0) for value in (voxel["density"], *voxel["axis"])]
        if not np.array(dr.all(sum(dr.isfinite(value) for value in packet) == 4)).all():
            raise InputError("the axis of a voxel with matter is not finite: give unit vectors or zeros")
        dr.scatter(stored["voxels"], kinds.Array4f16(*map(kinds.Float16, packet)), target)
        if "colour" in voxel:
            stored.setdefault("colour", dr.zeros(kinds.Float16, len(places) * VOXELS * 4))
            colour = [*voxel["colour"], *[kinds.Float(0)] * (4 - len(voxel["colour"]))]
            dr.scatter(stored["colour"], kinds.Array4f16(*map(kinds.Float16, colour)), target)
        if "material" in voxel:
            stored.setdefault("material", dr.zeros(kinds.UInt, len(places) * VOXELS))
            dr.scatter(stored["material"], voxel["material"], target)
        dr.eval(stored)
    return stored["voxels"], stored.get("colour"), stored.get("material")


def _chunks(candidates: np.ndarray) -> Iterator[np.ndarray]:
    places = np.argwhere(candidates)
    for start in range(0, len(places), CHUNK):
        yield places[start : start + CHUNK]


def _indices(places: np.ndarray, shape: Shape) -> tuple[Any, Any, Any, Any]:
    """Voxel indices x, y, z of the 9³ voxels of each brick (beyond the lattice: its last layer), and 0, 1, 2, …"""
    import drjit as dr

    UInt = arrays().UInt
    local = dr.arange(UInt, len(places) * VOXELS)
    brick, inner = local // VOXELS, local % VOXELS
    offsets = (inner // STORED**2, (inner // STORED) % STORED, inner % STORED)
    z, y, x = (
        dr.minimum(
            dr.gather(UInt, UInt(np.ascontiguousarray(places[:, k], np.uint32)), brick) * BRICK + offsets[k],
            shape[k] - 1,
        )
        for k in range(3)
    )
    return x, y, z, local


def _check_density(density: np.ndarray) -> None:
    low, high = (float(density.min()), float(density.max())) if density.size else (0.0, 0.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError("density has NaN or infinite values: give finite numbers of 0 or more")
    if low < 0:
        raise InputError(f"density goes down to {low:.3g}: give numbers of 0 or more")
    if high > 6e4:
        raise InputError(f"density goes up to {high:.3g}: keep it below 6e4 (it is stored in halves) and raise tau")
