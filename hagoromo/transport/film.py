"""Film: the pixels of an image, the order of their rays, and the sums over samples.

Rays are numbered tile by tile, so that neighbours share vector lanes. Sizes are read from memory: an image of another
size compiles no new kernel.
"""

from __future__ import annotations

import operator
from typing import Protocol

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, recorded_once
from hagoromo.camera.camera import Camera
from hagoromo.files.memory import require
from hagoromo.progress import Progress, silent

RAYS_AT_ONCE = 1 << 21  # rays of one launch; progress is reported, and an interrupt taken, between launches
R3 = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703)  # Roberts 2018: three dimensions, evenly filled
R2 = (0.7548776662466927, 0.5698402909980532)  # the same in two
TILE = (4, 4)  # columns, rows of pixels whose rays are numbered side by side, to share vector lanes


class RayRadiance(Protocol):
    """Radiance along rays: its weights, one Float per channel, and alpha 0…1 (opacity)."""

    def __call__(self, origin: Array3f, direction: Array3f, phase: Float) -> tuple[list[Float], Float]:
        """Along rays from `origin` [m] in unit `direction` (Array3f, world); phase of the march, 0…1."""
        ...


class Film:
    """Sums over samples of `channels` weights and alpha, for every pixel that `camera` sees.

    stride: a pixel of the film stands for stride × stride of the camera's (at the edges, for what is there of them).
    ahead: depth at which rays begin [m], see `Camera.rays`.
    rays: numbers of the rays that are traced, by default all; of some of them the film holds one value a ray, in their
    order, with the bits that the whole film has there.
    """

    def __init__(
        self, camera: Camera, channels: int, stride: int = 1, ahead: float = 0.0, rays: range | None = None
    ) -> None:
        self.camera, self.stride, self.values, self.ahead = camera, stride, channels + 1, ahead
        self.width, self.height = (-(-size // stride) for size in (camera.width, camera.height))
        self.rays, self.whole = rays or range(tiled(self.width, self.height)), rays is None
        entries = self.pixels if self.whole else len(self.rays)
        require(8 * entries * self.values, f"an image of {self.width} × {self.height} pixels")
        self.samples, self.sums = 0, np.zeros(0, np.float32)

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.width * self.height

    def add(self, radiance: RayRadiance, point: NDArray, progress: Progress = silent) -> None:
        """One ray through every pixel, at `point` (across, down, phase of the march; 0…1) of each."""
        jit = arrays()
        sample_values = dr.zeros(jit.Float, (self.pixels if self.whole else len(self.rays)) * self.values)
        dr.make_opaque(sample_values)
        dx, dy, phase, stride = (dr.opaque(jit.Float, float(number)) for number in (*point, self.stride))
        width, height = (dr.opaque(jit.UInt, size) for size in (self.width, self.height))
        first, end, whole = self.rays.start, self.rays.stop, dr.opaque(jit.Bool, self.whole)
        for start in range(first, end, RAYS_AT_ONCE):
            number = dr.arange(jit.UInt, min(RAYS_AT_ONCE, end - start)) + dr.opaque(jit.UInt, start)
            column, row = tile_place(number, width)
            x, y = (jit.Float(column) + dx) * stride, (jit.Float(row) + dy) * stride
            lens = self._lens(row * width + column) if self.camera.aperture > 0.0 else None
            with recorded_once():
                channels, alpha = radiance(*self.camera.rays(x, y, self.ahead, lens), phase)
            inside = (column < width) & (row < height)
            # one packet: scatters of one value each would march once a value
            # chosen in the kernel, so that a part needs no other kernel than the whole
            place = dr.select(whole, row * width + column, number - dr.opaque(jit.UInt, first))
            dr.scatter(sample_values, jit.ArrayXf([*channels, alpha]), place, inside)
            dr.eval(sample_values)
            dr.sync_thread()
            progress((min(start + RAYS_AT_ONCE, end) - first) / len(self.rays))
        self.sums = (
            np.add(self.sums, sample_values.numpy(), dtype=np.float64) if self.samples else sample_values.numpy()
        )
        self.samples += 1

    def _lens(self, pixel: UInt) -> tuple[Float, Float]:
        """Where the rays of the present sample pass the lens, two numbers in [0, 1): the R2 sequence over the samples
        (Roberts 2018), begun elsewhere for each pixel.
        """
        jit = arrays()
        starts = (jit.Float(scrambled(pixel * 2 + k) >> 8) * 2.0**-24 for k in (0, 1))
        steps = (dr.opaque(jit.Float, (self.samples * step) % 1.0) for step in R2)
        return tuple(one - dr.floor(one) for one in map(operator.add, starts, steps))  # type: ignore[return-value]

    def mean(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean over the samples: weights (height, width, channels) and alpha (height, width), or (rays, …) of some."""
        mean = (self.sums / self.samples).astype(np.float32).reshape(-1, self.values)
        mean = mean.reshape(self.height, self.width, self.values) if self.whole else mean
        return mean[..., :-1], mean[..., -1]


def scrambled(number: UInt) -> UInt:
    """The bits of a 32-bit number mixed (the finaliser of MurmurHash3)."""
    number = (number ^ (number >> 16)) * 0x85EBCA6B
    number = (number ^ (number >> 13)) * 0xC2B2AE35
    return number ^ (number >> 16)


def tiled(width: int, height: int) -> int:
    """Number of rays that fill all tiles of a picture, those beyond its edges included."""
    return -(-width // TILE[0]) * -(-height // TILE[1]) * TILE[0] * TILE[1]


def tile_place(number: UInt, width: UInt) -> tuple[UInt, UInt]:
    """Column and row of ray `number`, in a picture of `width` pixels (UInt)."""
    tile, inside = number // (TILE[0] * TILE[1]), number % (TILE[0] * TILE[1])
    across = (width + (TILE[0] - 1)) // TILE[0]
    return (tile % across) * TILE[0] + inside % TILE[0], (tile // across) * TILE[1] + inside // TILE[0]


def pixels_of(rays: range, width: int, height: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Columns and rows (rays,) of the pixels of some rays, and whether they lie in the picture."""
    column, row = tile_place(np.arange(rays.start, rays.stop), width)
    return column, row, (column < width) & (row < height)


def tile_order(width: int, height: int) -> NDArray[np.uint32]:
    """Pixel numbers (row · width + column) in the order of their rays."""
    column, row = tile_place(np.arange(tiled(width, height)), width)
    return (row * width + column)[(column < width) & (row < height)].astype(np.uint32)


def pixel_points(samples: int, seed: int) -> np.ndarray:
    """Points of a pixel and phases of the march, (samples, 3) in 0…1: the middle, or one in each of `samples` equal
    strips along each axis, in the order of the R3 sequence (Roberts 2018).

    Their mean is the middle of the pixel exactly: another one would shift the picture.
    """
    if samples == 1:
        return np.array([[0.5, 0.5, 0.0]])
    steps = np.outer(np.arange(samples), R3)
    order = np.argsort((np.random.default_rng(seed).random(3) + steps) % 1.0, axis=0)
    return (np.argsort(order, axis=0) + 0.5) / samples
