"""Array source: numbers in memory, or in a file that is mapped there, read as a `ZarrArray` is; windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.zarr_arrays import Index, ZarrArray
from hagoromo.volume.store.blocks import BLOCK_SIDE

WHOLE_NUMBERS = "iu"  # kinds of NumPy types


@dataclass(frozen=True, eq=False)
class ArraySource:
    """array: (nz, ny, nx[, components]); where: what messages call it."""

    array: NDArray[Any]
    where: str

    @property
    def shape(self) -> Index:
        """Length of each axis."""
        return self.array.shape

    @property
    def grid(self) -> Index:
        """Length of each axis of what is best read at once."""
        return (*(min(BLOCK_SIDE, n) for n in self.shape[:3]), *self.shape[3:])

    @property
    def files(self) -> Mapping[Index, str]:
        """Files of chunks: none."""
        return {}

    @property
    def absent_is_zero(self) -> bool:
        """Whether what has no file is zero: nothing is absent here."""
        return False

    def read(self, low: Index, high: Index) -> NDArray[Any]:
        """The numbers from index `low` to `high` (excluded)."""
        return np.ascontiguousarray(self.array[tuple(map(slice, low, high))])


@dataclass(frozen=True, eq=False)
class Windowed:
    """Densities 0 … 1 of a source whose numbers are `window[0]` where nothing is, `window[1]` where all is matter."""

    source: ZarrArray | ArraySource
    window: tuple[float, float]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    @property
    def absent_is_zero(self) -> bool:
        """Whether what has no file has no density."""
        return self.source.absent_is_zero and 0.0 <= self.window[0] < self.window[1]

    def read(self, low: Index, high: Index) -> NDArray[np.float32]:
        """Densities from index `low` to `high` (excluded); NaN where the numbers are."""
        empty, full = self.window
        return np.clip((self.source.read(low, high).astype(np.float32) - empty) / (full - empty), 0.0, 1.0)


def check_explained(source: ZarrArray | ArraySource, scale: float | None, window: tuple[float, float] | None) -> None:
    """Raise `InputError` for whole numbers of which nothing says what density they are, and for a bad scale or window.

    source: as it is stored, before anything is interpolated.
    """
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise InputError(f"scale is {scale}: give a finite number above 0")
    if window is not None:
        if not (np.isfinite(window).all() and window[0] != window[1]):
            raise InputError(f"window is {list(window)}: give two different numbers, of density 0 and of density 1")
    kind = source.array.dtype
    if scale is None and window is None and kind.kind in WHOLE_NUMBERS:
        raise InputError(
            f"{source.where} holds whole numbers ({kind}), which are no densities by themselves: state scale, the "
            f"density that 1 stands for, or window, the numbers of density 0 and of density 1"
        )
