"""Volume file: the numbers of a lattice and where its points lie, as a file of another program has them.

The file's first index is x, its second y, its third z, whatever they are called there: arrays are (nz, ny, nx).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.format import Format, file_and_part, formats_of, function_at, suffixes_read
from hagoromo.files.memory import require

MM = 1e-3  # m
MOST_SHEAR = 1e-3  # cosine of the angle between two axes of a lattice
SAME_EDGE = 1e-3  # relative difference of edges of voxels that are called equal
NUMBER_KINDS = "biuf"  # kinds of NumPy types


@dataclass(frozen=True, eq=False)
class Later:
    """Numbers of a file that are not read yet: their shape and type, as its header states them, and what reads them."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    read: Callable[[], NDArray[Any]]

    def transpose(self, order: Sequence[int]) -> Later:
        """The same with its axes in another order."""
        return Later(tuple(self.shape[k] for k in order), self.dtype, lambda: self.read().transpose(order))


@dataclass(frozen=True, eq=False)
class VolumeFile:
    """stored: (nz, ny, nx) or (nz, ny, nx, components), of any type of numbers, also a view of the file, or `Later`.

    matrix: (4, 4), whole at the centres of voxels: index (x, y, z) → place in the file's world [m]; None where the file
    does not state it. where: the file, for messages.
    """

    stored: NDArray[Any] | Later
    matrix: NDArray[np.float64] | None
    where: str

    def __post_init__(self) -> None:
        if self.dtype.kind not in NUMBER_KINDS:
            raise InputError(f"{self.where} holds values of type {self.dtype}: give a volume of numbers")
        if len(self.shape) not in (3, 4) or min(self.shape, default=0) < 1:
            raise InputError(f"{self.where} is an array of {_shape(self.shape)}: a volume has three axes (x, y, z)")
        if self.matrix is not None and not (
            np.isfinite(self.matrix).all() and np.linalg.norm(self.matrix[:3, :3], axis=0).all()
        ):
            raise InputError(f"{self.where} has no right place in the world: {self.matrix[:3].tolist()}")

    @property
    def shape(self) -> tuple[int, ...]:
        """(nz, ny, nx) or (nz, ny, nx, components)."""
        return self.stored.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the numbers."""
        return self.stored.dtype

    @cached_property
    def values(self) -> NDArray[Any]:
        """The numbers, which are read when they are first asked for. `InputError` where they are damaged or missing."""
        if not isinstance(self.stored, Later):
            return self.stored
        values = self.stored.read()
        if values.shape != self.shape or values.dtype != self.dtype:
            raise InputError(
                f"{self.where} holds {_shape(values.shape)} and states {_shape(self.shape)}: it is damaged"
            )
        return values

    @property
    def edges(self) -> NDArray[np.float64] | None:
        """Edges of a voxel along x, y, z [m]; None where the file does not state it."""
        return None if self.matrix is None else np.linalg.norm(self.matrix[:3, :3], axis=0)

    def upright(self) -> tuple[NDArray[Any], NDArray[np.float64] | None]:
        """values and matrix of a right-handed lattice: one that is not is read from its last layer in z to its first.

        `InputError` where its axes are not at right angles.
        """
        if self.matrix is None:
            return self.values, None
        axes = self.matrix[:3, :3] / np.linalg.norm(self.matrix[:3, :3], axis=0)
        if np.abs(axes.T @ axes - np.eye(3)).max() > MOST_SHEAR:
            raise InputError(f"the axes of {self.where} are not at right angles: resample it in the program it is from")
        if np.linalg.det(axes) > 0:
            return self.values, self.matrix
        matrix = self.matrix.copy()
        matrix[:3, 3] += (len(self.values) - 1) * matrix[:3, 2]
        matrix[:3, 2] *= -1.0
        return self.values[::-1], matrix


def read_volume(path: str | Path) -> VolumeFile:
    """The volume in a file of any format that holds one, or in a folder of layers.

    `InputError` for another format, a damaged file, or one that does not fit the memory.
    """
    return _format_of_volume(path).read(path)


def look_at_volume(path: str | Path) -> VolumeFile:
    """As `read_volume`, but that no numbers are read where the file has a header that says what they are."""
    form = _format_of_volume(path)
    return function_at(form.look)(path) if form.look else form.read(path)


def _format_of_volume(path: str | Path) -> Format:
    name = file_and_part(path)[0].lower()
    folder = Path(path).is_dir()
    for form in formats_of("volume"):
        if form.is_sniffed(Path(path)) if folder else name.endswith(form.suffixes):
            return form
    existing_file(path)
    raise InputError(f"{path} is no volume of a known format: Zarr arrays and {suffixes_read('volume')} are read")


def grid_matrix(
    edges: Sequence[float], first: Sequence[float] = (0.0, 0.0, 0.0), axes: Any = None, unit: float = 1.0
) -> NDArray[np.float64]:
    """Matrix of a `VolumeFile`: edges of a voxel and centre of the first one, in a unit [m]; axes: columns, unit."""
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) if axes is None else np.asarray(axes, float)) * np.asarray(edges, float) * unit
    matrix[:3, 3] = np.asarray(first, float) * unit
    return matrix


def resampled(values: NDArray[Any], edges: Sequence[float], edge: float) -> NDArray[np.float32]:
    """(nz, ny, nx), linear between the values: voxels with the `edges` (x, y, z) become cubes with one `edge`.

    The outer faces of the lattice stay where they are to half a voxel at the far side; before the first and behind the
    last centre values are those of the nearest one.
    """
    counts = [max(round(n * e / edge), 2) for n, e in zip(values.shape, reversed(list(edges)), strict=True)]
    require(16.0 * math.prod(map(max, zip(counts, values.shape, strict=True))), "the resampled volume")
    even: NDArray[np.float32] = values.astype(np.float32)
    for axis, (count, old) in enumerate(zip(counts, reversed(list(edges)), strict=True)):
        at = np.clip((np.arange(count) + 0.5) * edge / old - 0.5, 0.0, values.shape[axis] - 1.0)
        low = np.minimum(at.astype(int), max(values.shape[axis] - 2, 0))
        share = (at - low).astype(np.float32).reshape([-1 if k == axis else 1 for k in range(3)])
        high = np.minimum(low + 1, values.shape[axis] - 1)
        even = np.asarray((1.0 - share) * even.take(low, axis) + share * even.take(high, axis), np.float32)
    return even


def check_lattice(shape: Sequence[float], where: str) -> None:
    """Raise `InputError` where a lattice that a header states is none."""
    if not all(isinstance(n, (int, np.integer)) and n > 0 for n in shape):
        raise InputError(f"{where} states a lattice of {_shape(shape)}: give whole numbers above 0")


def check_size(shape: Sequence[float], itemsize: int, where: str, copies: float = 2.0) -> None:
    """Raise `InputError` where a lattice that a header states does not fit the memory, or is none."""
    check_lattice(shape, where)
    require(copies * itemsize * math.prod(map(float, shape)), where)


def _shape(shape: Sequence[float]) -> str:
    return " × ".join(f"{n!s:.20}" for n in list(shape)[:6]) or "no axes"
