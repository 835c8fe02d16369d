"""Tiled images: the images of a surface by UDIM, laid side by side as one, and its UVs on that.

All images of a surface have one grid of tiles, so that it keeps one set of UVs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.memory import require
from hagoromo.files.udim import MARK, Tile, udim_files, udim_number
from hagoromo.image.scene.surface import Surface

INWARDS = 1e-4  # of a triangle, by which its corners are moved to its middle before it is asked in which tile they are
BYTES_PER_NUMBER = 12.0
Pixels = tuple[NDArray[Any], Any]  # (height, width, channels), and how they are meant: whether encoded for displays


class TiledImage(NamedTuple):
    """name: with the mark. files: by tile, of which there may be fewer than the grid (wide, tall) has."""

    name: str
    files: Mapping[Tile, Path]
    grid: tuple[int, int]

    def __str__(self) -> str:
        return self.name

    def read(self, read: Callable[[Path], Pixels]) -> Pixels:
        """One image of all tiles, the largest of which says their size; where there is none it has another's pixel."""
        parts = {tile: read(path) for tile, path in self.files.items()}
        tall, wide = np.max([part.shape[:2] for part, _ in parts.values()], axis=0)
        counts = {part.shape[2] for part, _ in parts.values()}
        encoded = {encoded for _, encoded in parts.values()}
        if len(encoded) > 1:
            raise InputError(f"{self.name}: some tiles have 8 or 16 bits, others floats: give tiles of one kind")
        (across, up), count = self.grid, max(counts)
        require(BYTES_PER_NUMBER * tall * wide * across * up * count, self.name)
        first = next(iter(parts.values()))[0]
        whole = np.empty((int(tall) * up, int(wide) * across, count), first.dtype)
        whole[:] = first[0, 0]
        for (u, v), (part, _) in parts.items():
            times = tall // part.shape[0], wide // part.shape[1]
            if (part.shape[0] * times[0], part.shape[1] * times[1]) != (tall, wide):
                size = f"{part.shape[1]} × {part.shape[0]}"
                raise InputError(
                    f"{self.name}: tile {udim_number((u, v))} is {size} px, the largest {wide} × {tall}, which is no "
                    f"multiple of it: resize it"
                )
            large = part.repeat(times[0], axis=0).repeat(times[1], axis=1)
            whole[(up - 1 - v) * tall : (up - v) * tall, u * wide : (u + 1) * wide] = large
        return whole, encoded.pop()


@dataclass(frozen=True)
class TextureFiles:
    """The images that a surface of a scene file in `folder` names. tiled: those by UDIM, by their names."""

    folder: Path
    tiled: Mapping[str, TiledImage]

    def place(self, name: str) -> Path | TiledImage:
        """Where an image is; `InputError` outside the folder."""
        return self.tiled[name] if name in self.tiled else inside(self.folder, name)

    def placed(self, surface: Surface) -> Surface:
        """The surface with its UVs on the grid of its tiles; `InputError` where it is on none of an image."""
        if not self.tiled:
            return surface
        if surface.uv is None or surface.faces is None:
            raise InputError(f"surface {surface.name!r} has an image by {MARK}, and no UVs: give a mesh that has them")
        used = tiles_of(surface.uv, surface.faces)
        for name, image in self.tiled.items():
            if missing := sorted(used - set(image.files)):
                u, v = missing[0]
                which = f"tile {udim_number((u, v))}" if 0 <= u < 10 and v >= 0 else f"what is at u = {u}, v = {v}"
                raise InputError(f"surface {surface.name!r} has UVs on {which}, of which {name} has no file: add it")
        (grid,) = {image.grid for image in self.tiled.values()}
        return replace(surface, uv=np.asarray(surface.uv, float) / grid)


def tiles_of(uv: NDArray[Any], faces: NDArray[Any]) -> set[Tile]:
    """The tiles on which triangles (m, 3) of UVs (n, 2) lie.

    >>> sorted(tiles_of(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]]), np.array([[0, 1, 2], [2, 1, 3]])))
    [(0, 0), (1, 0)]
    """
    corners = np.asarray(uv, float)[faces]
    corners = corners + INWARDS * (corners.mean(axis=1, keepdims=True) - corners)
    return {(int(u), int(v)) for u, v in np.unique(np.floor(corners.reshape(-1, 2)), axis=0)}


class Tiles(NamedTuple):
    """Some tiles of a grid (wide, tall) that images have in common."""

    grid: tuple[int, int]
    numbers: tuple[Tile, ...]

    def cuts(self, values: NDArray[Any], name: str) -> dict[str, NDArray[Any]]:
        """The parts of an image of the whole grid, as `TiledImage.read` lays it together, by their names.

        >>> Tiles((2, 1), ((1, 0),)).cuts(np.arange(8).reshape(2, 4), "a.<UDIM>.png")
        {'a.1002.png': array([[2, 3],
               [6, 7]])}
        """
        across, up = self.grid
        tall, wide = values.shape[0] // up, values.shape[1] // across
        return {
            name.replace(MARK, str(udim_number((u, v)))): np.ascontiguousarray(
                values[(up - 1 - v) * tall : (up - v) * tall, u * wide : (u + 1) * wide]
            )
            for u, v in self.numbers
        }


def texture_files(folder: Path, names: Sequence[str]) -> TextureFiles:
    """The images `names` of a surface; `InputError` where some are by UDIM and others not, and for tiles without a
    file.
    """
    marked = [name for name in names if MARK in name]
    if not marked:
        return TextureFiles(folder, {})
    if plain := [name for name in names if name not in marked]:
        raise InputError(f"{marked[0]} has tiles by {MARK} and {plain[0]} has none: give all images of a surface alike")
    files = {name: udim_files(folder, name) for name in marked}
    for name, tiles in files.items():
        if not tiles:
            raise InputError(f"{name}: there is no tile such as {name.replace(MARK, '1001')}: give the files")
    every = np.array([tile for tiles in files.values() for tile in tiles])
    grid = int(every[:, 0].max()) + 1, int(every[:, 1].max()) + 1
    return TextureFiles(
        folder,
        {
            name: TiledImage(name, {tile: inside(folder, file) for tile, file in tiles.items()}, grid)
            for name, tiles in files.items()
        },
    )
