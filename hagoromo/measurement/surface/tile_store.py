"""Tile store: photographs that exceed the memory, read once each and stored on disk as tiles with all lamps.

Enters: photographs, one at a time, and a scratch folder. Leaves: the tiles, and a coarse capture of means over squares
of pixels, which fits into memory. The scratch is removed at the end, also on failure and on Ctrl-C.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.whole import scratch_folder
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.normals.views import CLIPPED, Stack, check_lamps, enough
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.rig import Rig
from hagoromo.progress import Progress, silent

SIDE = 192  # [pixel] side of a tile: all lamps of one need a few hundred megabytes
LARGEST_HALF = 6e4  # below the largest number of 16 bits
COARSE_PIXELS = 30_000  # largest number of pixels of the coarse capture


class Source(Protocol):
    """Photographs that are simulated or read on demand."""

    @property
    def count(self) -> int:
        """How many photographs there are."""
        ...

    def photograph(self, number: int) -> Photograph:
        """The photograph of that number."""
        ...


@dataclass(frozen=True)
class FolderSource:
    """The photographs of a capture folder, its `frames` that have an image, read one at a time, and evened by `rig`.

    name: that the capture states.
    """

    folder: Path
    frames: tuple[int, ...]
    rig: Rig | None = None
    name: str = ""

    @property
    def count(self) -> int:
        """How many photographs there are."""
        return len(self.frames)

    def photograph(self, number: int) -> Photograph:
        """The photograph of that number."""
        frame = self.frames[number]
        photograph = load_capture(self.folder, slice(frame, frame + 1)).photographs[0]
        return photograph if self.rig is None else self.rig.evened(photograph)


@dataclass(frozen=True, eq=False)
class TileStore:
    """The file `path` holds (tiles, K, 2, C, SIDE, SIDE) halves: values and standard deviations over `scale` (K,).

    Deviations are 0 where invalid; of invalid values those that are clipped are kept. coarse: the capture of means over
    `factor` × `factor` pixels.
    """

    path: Path
    channels: int
    scale: NDArray[np.float64]
    camera: Camera
    lamps: tuple[Lamp, ...]
    coarse: Capture
    factor: int

    @property
    def count(self) -> int:
        """Number of tiles."""
        return -(-self.camera.height // SIDE) * -(-self.camera.width // SIDE)

    def place(self, tile: int) -> tuple[slice, slice]:
        """Rows and columns of a tile."""
        across = -(-self.camera.width // SIDE)
        row, column = SIDE * (tile // across), SIDE * (tile % across)
        return (
            slice(row, min(row + SIDE, self.camera.height)),
            slice(column, min(column + SIDE, self.camera.width)),
        )

    def stack(self, tile: int) -> tuple[Stack, NDArray[np.intp], NDArray[np.intp]]:
        """The values of the pixels that are valid in most photographs, with their rows and columns."""
        rows, columns = self.place(tile)
        h, w = rows.stop - rows.start, columns.stop - columns.start
        shape = (len(self.lamps), 2, self.channels, SIDE, SIDE)
        size = int(np.prod(shape))
        # read, not mapped: pages of a mapped file count as used memory
        numbers = np.fromfile(self.path, np.float16, size, offset=2 * size * tile).reshape(shape)[..., :h, :w]
        index = np.nonzero(enough(list(numbers[:, 1, 0] > 0)))
        whole = numbers[..., index[0], index[1]].astype(np.float32)  # (K, 2, C, P)
        whole = np.moveaxis(whole * self.scale[:, None, None, None].astype(np.float32), 3, 2)
        valid = whole[:, 1, :, 0] > 0
        variance = np.where(valid[..., None], np.maximum(whole[:, 1], 1e-18) ** 2, np.inf)
        stack = Stack(whole[:, 0], variance, valid)
        return stack, index[0] + rows.start, index[1] + columns.start


@contextmanager
def tile_store(source: Source, beside: Path, progress: Progress = silent) -> Iterator[TileStore]:
    """The tiles of `source` in a scratch folder within `beside`, which is removed when the block ends.

    `InputError` when the photographs do not belong together (see `views.check_lamps`) or the disk is too small.
    """
    first = source.photograph(0)
    height, width, channels = first.values.shape
    tiles = -(-height // SIDE) * -(-width // SIDE)
    needed = 2.0 * tiles * source.count * 2 * channels * SIDE**2
    free = shutil.disk_usage(beside).free
    if needed > 0.95 * free:
        raise InputError(
            f"{source.count} photographs of {width} × {height} px need {needed / 1e9:.0f} GB of scratch in {beside}, "
            f"which has {free / 1e9:.0f} GB free: write to another disk"
        )
    factor = coarse_factor(first.camera)
    with scratch_folder(beside) as scratch:
        path, scale, coarse, lamps = scratch / "tiles", np.ones(source.count), [], []
        path.touch()
        for k in range(source.count):
            progress(k / source.count, f"photograph {k + 1} of {source.count}")
            photograph = first if k == 0 else source.photograph(k)
            check_lamps([first, photograph], fewest=1)
            scale[k] = _write(path, (k, source.count), photograph)
            coarse.append(binned(photograph, factor))
            lamps.append(photograph.lamps[0])
        small = Capture(tuple(coarse), "coarse")
        yield TileStore(path, channels, scale, first.camera, tuple(lamps), small, factor)


def _write(path: Path, number: tuple[int, int], photograph: Photograph) -> float:
    """Write photograph k of K to the file, where `number` is (k, K); returns the scale of its numbers."""
    height, width, channels = photograph.values.shape
    mask = np.asarray(photograph.mask)
    scale = max(float(np.max(photograph.values, where=mask[..., None], initial=0.0)), 1e-30)
    block, tile = np.zeros((2, channels, SIDE, SIDE), np.float16), 0
    with path.open("r+b") as file:
        for row in range(0, height, SIDE):
            for column in range(0, width, SIDE):
                index = np.s_[row : row + SIDE, column : column + SIDE]
                valid, (h, w) = mask[index][..., None], mask[index].shape
                values = np.nan_to_num(photograph.values[index]) / scale
                values = np.where(valid, values, np.where(values >= CLIPPED, np.minimum(values, LARGEST_HALF), 0.0))
                deviation = np.sqrt(np.where(valid, photograph.variance[index], 0.0)) / scale
                # a deviation that rounds to 0 would count as invalid
                deviation = np.where(valid, np.maximum(deviation, 1e-6), 0.0)
                block[:] = 0.0
                for part, image in enumerate((values, deviation)):
                    block[part, :, :h, :w] = np.moveaxis(image, 2, 0)
                file.seek(block.nbytes * (tile * number[1] + number[0]))
                file.write(block.tobytes())
                tile += 1
    return scale


def coarse_factor(camera: Camera) -> int:
    """Pixels of a side of the squares over which a coarse capture has the means."""
    return max(int(np.ceil(np.sqrt(camera.height * camera.width / COARSE_PIXELS))), 1)


def binned(photograph: Photograph, factor: int, least_valid: float = 1.0) -> Photograph:
    """Means over the valid pixels of squares of `factor`, valid where a share of `least_valid` of them is, by default
    all; incomplete squares at the edges are cut.
    """
    valid = photograph.mask[..., None]
    share = means(photograph.mask, factor)
    mask = share[..., 0] > least_valid - 1e-4
    weight = np.where(share > 1.0 - 1e-4, 1.0, np.maximum(share, 1e-4))

    def over_valid(image: NDArray) -> NDArray[np.float32]:
        return np.asarray(means(np.where(valid, np.nan_to_num(image), 0.0), factor) / weight, np.float32)

    values = np.where(mask[..., None], over_valid(photograph.values), 0.0)
    variance = np.where(mask[..., None], over_valid(photograph.variance) / (weight * factor**2), 1.0)
    camera = coarser(photograph.camera, factor)
    return Photograph(values, variance, mask, camera, photograph.lamps, photograph.name)


def means(image: NDArray, factor: int) -> NDArray[np.float32]:
    """Means (h, w, …) over squares of `factor` pixels; incomplete squares at the edges are cut."""
    import cv2

    height, width = (length // factor for length in image.shape[:2])
    cut = np.ascontiguousarray(image[: height * factor, : width * factor], np.float32)
    small = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32).reshape(height, width, -1)


def coarser(camera: Camera, factor: int) -> Camera:
    """The camera whose pixels are squares of `factor` pixels of `camera`."""
    sensor = None if camera.sensor is None else replace(camera.sensor, mosaic="").binned(factor)
    return replace(camera.resampled(camera.width // factor, camera.height // factor, (factor, factor)), sensor=sensor)
