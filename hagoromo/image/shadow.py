"""Shadow: how much of a lamp's light arrives through all volume boxes, by brute march or by deep shadow maps.

A deep shadow map holds, for every direction from the lamp (or line, for a far lamp), the optical depth on SLICES equal
slices between where that ray first meets matter and where it leaves it (or is DEEPEST in it). In between, optical depth is
linear along the ray and transmittance is bilinear across rays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip, opaque_vector
from hagoromo.image.march import matter_range, optical_depth
from hagoromo.light.lamp import Lamp
from hagoromo.volume.medium import Medium

SLICES = 32
DEEPEST = 10.0  # optical depth where a map ends: exp(−10) = 5e-5 of the light
WIDEST = math.tan(math.radians(75))  # a wider view from the lamp is mapped onto an octahedron
NOWHERE = 1e30  # m, where a ray that meets no matter meets it
TEXELS_PER_VOXEL = 2.0  # two boxes that shade each other and a floor: 0.7 % against brute march; with one texel 2 %
MOST_TEXELS = 1024  # a side: 128 MiB a lamp
RAYS = 1 << 22  # slices integrated at once


def brute_attenuation(medium: Medium) -> Any:
    """`Attenuation` by marching from every point to the lamp: slow, exact up to the step; the oracle of the maps."""

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        return dr.exp(-optical_depth(medium, point, to_lamp, arrays().Float(0), arrays().Float(distance)))

    return transmittance


def mapped_attenuation(medium: Medium, lamps: Sequence[Lamp], resolution: int | None = None, slices: int = SLICES) -> Any:
    """`Attenuation` by one deep shadow map a lamp; `resolution` texels a side (default: about one a voxel)."""
    maps = [DeepShadowMap(medium, lamp, resolution or fitting_resolution(medium), slices) for lamp in lamps]

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        return maps[lamp].transmittance(point)

    return transmittance


def fitting_resolution(medium: Medium) -> int:
    """Texels a side: TEXELS_PER_VOXEL of the smallest voxel over the extent of all boxes, from 128 to MOST_TEXELS."""
    corners = np.concatenate([box.corners() for box in medium.boxes])
    voxels = np.linalg.norm(np.ptp(corners, axis=0)) / min(box.voxel_size for box in medium.boxes)
    return int(np.clip(64 * round(TEXELS_PER_VOXEL * voxels / 64), 128, MOST_TEXELS))


class DeepShadowMap:
    """Optical depth from one lamp through all boxes."""

    def __init__(self, medium: Medium, lamp: Lamp, resolution: int, slices: int = SLICES) -> None:
        kinds, self.resolution, self.slices = arrays(), resolution, slices
        self.view = view_from(lamp, np.concatenate([box.corners() for box in medium.boxes]))
        ranges, pairs = [], []
        for first_texel in range(0, resolution**2, RAYS // slices):
            count = min(RAYS // slices, resolution**2 - first_texel)
            texel = dr.arange(kinds.UInt, count) + dr.opaque(kinds.UInt, first_texel)
            near, thickness = self._ranges(medium, texel)
            ranges.append((near, thickness))
            pairs.append(self._slices(medium, texel, near, thickness))
        self.ranges = dr.concat([dr.ravel(kinds.Array2f(near, 1.0 / thickness)) for near, thickness in ranges])
        self.depths = dr.concat(pairs)
        dr.eval(self.ranges, self.depths)

    def transmittance(self, point: Any) -> Any:
        """Share of the lamp's light that arrives at `point` (Array3f, world), 0…1."""
        kinds, size = arrays(), self.resolution
        a, b, distance = self.view.place(point)
        a, b = (clip(x * size - 0.5, 0.0, size - 1.001) for x in (a, b))
        column, row = kinds.UInt(a), kinds.UInt(b)
        a, b = a - kinds.Float(column), b - kinds.Float(row)
        total = kinds.Float(0)
        for y in (0, 1):
            for x in (0, 1):
                texel = (row + y) * size + column + x
                near, per_slice = dr.gather(kinds.Array2f, self.ranges, texel)
                at = clip((distance - near) * per_slice, 0.0, self.slices - 1e-3)
                first = kinds.UInt(at)
                before, after = kinds.Array2f(dr.gather(kinds.Array2f16, self.depths, texel * self.slices + first))
                depth = dr.fma(at - kinds.Float(first), after - before, before)
                total += (b if y else 1.0 - b) * (a if x else 1.0 - a) * dr.exp(-depth)
        return total

    def _ranges(self, medium: Medium, texel: Any) -> tuple[Any, Any]:
        """Where the texels' rays first meet matter, and the thickness of their slices [m]."""
        origin, direction = self._rays(texel)
        first, last = matter_range(medium, origin, direction, DEEPEST)
        empty = dr.isinf(first)
        near, thickness = dr.select(empty, NOWHERE, first), dr.select(empty, 1.0, (last - first) / self.slices)
        dr.eval(near, thickness)
        return near, thickness

    def _slices(self, medium: Medium, texel: Any, near: Any, thickness: Any) -> Any:
        """Optical depths before and after every slice of the texels: Float16, (texels · slices · 2)."""
        kinds = arrays()
        index = dr.arange(kinds.UInt, dr.width(texel) * self.slices)
        ray, number = index // self.slices, kinds.Float(index % self.slices)
        start, thick = dr.gather(kinds.Float, near, ray), dr.gather(kinds.Float, thickness, ray)
        origin, direction = self._rays(dr.gather(kinds.UInt, texel, ray))
        begin = dr.fma(number, thick, start)
        end = dr.select(start < NOWHERE, begin + thick, begin)
        within = optical_depth(medium, origin, direction, begin, end, math.inf)
        before = dr.block_prefix_sum(within, self.slices, exclusive=True)
        pair = kinds.Array2f16(kinds.Float16(dr.fmin(before, 6e4)), kinds.Float16(dr.fmin(before + within, 6e4)))
        flat = dr.ravel(pair)
        dr.eval(flat)
        return flat

    def _rays(self, texel: Any) -> tuple[Any, Any]:
        kinds, size = arrays(), self.resolution
        return self.view.ray((kinds.Float(texel % size) + 0.5) / size, (kinds.Float(texel // size) + 0.5) / size)


class LampView:
    """What a lamp sees, as a square a, b in 0…1: a pyramid, a bundle of parallel lines or the octahedron of all directions."""

    def __init__(self, kind: str, origin: np.ndarray, axes: np.ndarray, extent: float) -> None:
        self.kind, self.extent = kind, dr.opaque(arrays().Float, extent)
        self.origin, (self.right, self.up, self.ahead) = opaque_vector(origin), map(opaque_vector, axes)

    def place(self, point: Any) -> tuple[Any, Any, Any]:
        """Square coordinates a, b of a point and its distance along the ray [m]."""
        offset = point - self.origin
        x, y, z = (dr.dot(offset, axis) for axis in (self.right, self.up, self.ahead))
        if self.kind == "octahedron":
            folded = dr.rcp(dr.abs(x) + dr.abs(y) + dr.abs(z))
            u, v = x * folded, y * folded
            behind = z < 0
            outer = _turned(1.0 - dr.abs(v), u), _turned(1.0 - dr.abs(u), v)
            u, v = dr.select(behind, outer[0], u), dr.select(behind, outer[1], v)
            return 0.5 * u + 0.5, 0.5 * v + 0.5, dr.norm(offset)
        scale = 0.5 / (self.extent * z) if self.kind == "pyramid" else 0.5 / self.extent
        return x * scale + 0.5, y * scale + 0.5, dr.norm(offset) if self.kind == "pyramid" else z

    def ray(self, a: Any, b: Any) -> tuple[Any, Any]:
        """Origin and unit direction of the ray at square coordinates a, b."""
        u, v = 2.0 * a - 1.0, 2.0 * b - 1.0
        if self.kind == "lines":
            return self.origin + (u * self.right + v * self.up) * self.extent, self.ahead
        if self.kind == "octahedron":
            z = 1.0 - dr.abs(u) - dr.abs(v)
            u, v = (
                dr.select(z < 0, _turned(1.0 - dr.abs(v), u), u),
                dr.select(z < 0, _turned(1.0 - dr.abs(u), v), v),
            )
            return self.origin, dr.normalize(u * self.right + v * self.up + z * self.ahead)
        return self.origin, dr.normalize((u * self.right + v * self.up) * self.extent + self.ahead)


def view_from(lamp: Lamp, corners: np.ndarray) -> LampView:
    """The view of a lamp that covers the world points `corners` (n, 3)."""
    middle = corners.mean(axis=0)
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    if lamp.position is None:
        assert lamp.to_lamp is not None
        axes = _axes(-lamp.to_lamp)
        extent = 1.01 * np.abs((corners - middle) @ axes[:2].T).max()
        return LampView("lines", middle + 2.0 * radius * lamp.to_lamp, axes, float(extent))
    axes = _axes(middle - lamp.position)
    across, along = (corners - lamp.position) @ axes[:2].T, (corners - lamp.position) @ axes[2]
    extent = float(np.max(np.abs(across) / along[:, None])) if (along > 0).all() else math.inf
    if extent > WIDEST:
        return LampView("octahedron", lamp.position, axes, 1.0)
    return LampView("pyramid", lamp.position, axes, 1.01 * extent)


def _axes(ahead: np.ndarray) -> np.ndarray:
    """Right, up and ahead, unit and at right angles: (3, 3)."""
    length = float(np.linalg.norm(ahead))
    ahead = np.array([0.0, 0.0, 1.0]) if length == 0 else ahead / length
    aside = np.eye(3)[int(np.argmin(np.abs(ahead)))]
    right = np.cross(aside, ahead) / np.linalg.norm(np.cross(aside, ahead))
    return np.stack([right, np.cross(ahead, right), ahead])


def _turned(value: Any, like: Any) -> Any:
    return dr.select(like < 0, -value, value)
