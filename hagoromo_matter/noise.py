"""Noise on the device: random numbers by hashing, value, gradient and cellular noise.

Enters: positions (Array3f, in units of the noise's cells) and a seed (int or UInt); the same seed gives the same bits.
Differentiable in the position; the cells themselves are constants.
"""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays

HASH_UNIT = 2.0**-24  # of the upper 24 bits of a hash


class CellularNoise(NamedTuple):
    """Cellular noise: distances to the nearest and second nearest point [cells], and a number of the nearest."""

    nearest: Any
    second: Any
    number: Any  # UInt, uniform over 32 bits


def hashed(cell: tuple[Any, Any, Any], seed: int | Any) -> tuple[Any, Any, Any]:
    """Three uniform 32-bit numbers for every triple of integers and seed.

    PCG3D of Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
    """
    key = seed_of(seed) * 0x9E3779B9
    x, y, z = _mixed([(_word(number) + key) * 1664525 + 1013904223 for number in cell])
    return _mixed([number ^ (number >> 16) for number in (x, y, z)])


def seed_of(seed: int | Any) -> Any:
    """A seed as a UInt that kernels read from memory, so that a new seed compiles no new kernel."""
    UInt = arrays().UInt
    return dr.opaque(UInt, seed) if isinstance(seed, int) else UInt(seed)


def uniform(number: Any) -> Any:
    """A hash as a Float in [0, 1)."""
    return arrays().Float(number >> 8) * HASH_UNIT


def random(cell: tuple[Any, Any, Any], seed: int | Any) -> Any:
    """A Float in [0, 1) for every triple of integers (Int, or Python's) and seed."""
    return uniform(hashed(cell, seed)[0])


def value_noise(point: Any, seed: int | Any) -> Any:
    """Random values at the corners of cells, joined smoothly: 0…1, mean ½."""
    cell, part = _cell(point)
    values = [random(_plus(cell, corner), seed) for corner in product((0, 1), repeat=3)]
    return _joined(values, part)


def gradient_noise(point: Any, seed: int | Any) -> Any:
    """Random slopes at the corners of cells, joined smoothly: −1…1, mean 0 (Perlin, "Improving Noise", 2002)."""
    cell, part = _cell(point)
    values = []
    for corner in product((0, 1), repeat=3):
        slope = [2.0 * uniform(number) - 1.0 for number in hashed(_plus(cell, corner), seed)]
        values.append(sum(slope[k] * (part[k] - corner[k]) for k in range(3)))
    return _joined(values, part)


def cellular_noise(point: Any, seed: int | Any, jitter: float = 1.0) -> CellularNoise:
    """Distances to the nearest random points, one in each cell (Worley, "A Cellular Texture Basis Function", 1996).

    jitter: 0 puts the points on a lattice, 1 anywhere in their cells.
    """
    jit = arrays()
    cell, part = _cell(point)
    nearest, second, number = jit.Float(9.0), jit.Float(9.0), jit.UInt(0)
    for corner in product((-1, 0, 1), repeat=3):
        numbers = hashed(_plus(cell, corner), seed)
        offset = [corner[k] + 0.5 + jitter * (uniform(numbers[k]) - 0.5) - part[k] for k in range(3)]
        squared = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2]
        closer = squared < nearest
        second = dr.select(closer, nearest, dr.fmin(second, squared))
        number = dr.select(closer, numbers[0] ^ numbers[1], number)
        nearest = dr.select(closer, squared, nearest)
    return CellularNoise(dr.sqrt(dr.fmax(nearest, 1e-12)), dr.sqrt(second), number)


def _word(number: Any) -> Any:
    """A signed integer as 32 bits."""
    return arrays().UInt(number & 0xFFFFFFFF if isinstance(number, int) else number)


def _mixed(numbers: list[Any]) -> tuple[Any, Any, Any]:
    x, y, z = numbers
    x = x + y * z
    y = y + z * x
    z = z + x * y
    return x, y, z


def _cell(point: Any) -> tuple[Any, Any]:
    """The integer cell of a point and the position inside it, 0…1."""
    jit = arrays()
    floor = dr.floor(dr.detach(point))
    return jit.Array3i(floor), point - floor


def _plus(cell: Any, corner: tuple[int, ...]) -> tuple[Any, Any, Any]:
    return cell.x + corner[0], cell.y + corner[1], cell.z + corner[2]


def _joined(values: list[Any], part: Any) -> Any:
    """Eight corner values (x slowest) joined by the quintic of Perlin 2002."""
    for k in range(3):
        t = part[k]
        share = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
        half = len(values) // 2
        values = [dr.fma(share, high - low, low) for low, high in zip(values[:half], values[half:], strict=True)]
    return values[0]
