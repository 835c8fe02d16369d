"""Shadow: how much of a lamp's light arrives through all volume boxes, by brute march or by deep shadow maps.

A deep shadow map holds, for every ray of a square grid of rays from the lamp (lines, for a far lamp), knots
(distance, optical depth) that follow the ray's transmittance: a new one wherever it has made one of DROPS equal drops
since the last, and at both ends of every gap in the matter. Between knots optical depth is linear; transmittance is
bilinear across rays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip, opaque_vector
from hagoromo.image.march import THINNEST, optical_depth
from hagoromo.light.lamp import Lamp
from hagoromo.volume.medium import Medium

KNOTS = 64  # a ray, a power of two
DROPS = 52.0  # equal drops of a ray's transmittance with a knot each; the other knots are for gaps and steep steps
GAP_DROP = 1.0 / 512.0  # of transmittance since the last knot, below which a gap gets no knots
DEEPEST = 10.0  # optical depth where a map ends: exp(−10) = 5e-5 of the light
WIDEST = math.tan(math.radians(75))  # a wider view from the lamp is mapped onto an octahedron
NOWHERE = 1e30  # m, distance of the knots that a ray does not use
TEXELS_PER_VOXEL = 2.0  # two boxes that shade each other and a floor: 0.7 % against brute march; with one texel 2 %
MOST_TEXELS = 1024  # a side: 384 MiB a lamp


def brute_attenuation(medium: Medium) -> Any:
    """`Attenuation` by marching from every point to the lamp: slow, exact up to the step; the oracle of the maps."""

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        return dr.exp(-optical_depth(medium, point, to_lamp, arrays().Float(0), arrays().Float(distance)))

    return transmittance


def mapped_attenuation(medium: Medium, lamps: Sequence[Lamp], resolution: int | None = None) -> Any:
    """`Attenuation` by one deep shadow map a lamp; `resolution` texels a side (default: about one a voxel)."""
    maps = [DeepShadowMap(medium, lamp, resolution or fitting_resolution(medium)) for lamp in lamps]

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        return maps[lamp].transmittance(point)

    return transmittance


def fitting_resolution(medium: Medium) -> int:
    """Texels a side: TEXELS_PER_VOXEL of the smallest voxel over the extent of all boxes, from 128 to MOST_TEXELS."""
    corners = np.concatenate([box.corners() for box in medium.boxes])
    voxels = np.linalg.norm(np.ptp(corners, axis=0)) / min(box.voxel_size for box in medium.boxes)
    return int(np.clip(64 * round(TEXELS_PER_VOXEL * voxels / 64), 128, MOST_TEXELS))


class DeepShadowMap:
    """Transmittance from one lamp through all boxes, on a square of `resolution` rays a side."""

    def __init__(self, medium: Medium, lamp: Lamp, resolution: int) -> None:
        kinds, self.resolution = arrays(), resolution
        self.view = view_from(lamp, np.concatenate([box.corners() for box in medium.boxes]))
        self.distances = dr.full(kinds.Float, NOWHERE, resolution**2 * KNOTS)
        self.depths = dr.zeros(kinds.Float16, resolution**2 * KNOTS)
        texel = dr.arange(kinds.UInt, resolution**2)
        size = dr.opaque(kinds.UInt, resolution)
        a, b = ((kinds.Float(place) + 0.5) / kinds.Float(size) for place in (texel % size, texel // size))
        origin, direction = self.view.ray(a, b)
        dr.eval(origin, direction)
        lay_knots(medium, origin, direction, self)
        dr.eval(self.distances, self.depths)

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
                passed = dr.exp(-self._depth((row + y) * size + column + x, distance))
                total += (b if y else 1.0 - b) * (a if x else 1.0 - a) * passed
        return total

    def _depth(self, texel: Any, distance: Any) -> Any:
        """Optical depth of one ray of the map at `distance`: binary search for the knots around it."""
        kinds, knot = arrays(), texel * KNOTS
        stride = KNOTS // 2
        while stride:
            beyond = dr.gather(kinds.Float, self.distances, knot + stride) <= distance
            knot = dr.select(beyond, knot + stride, knot)
            stride //= 2
        following = dr.minimum(knot + 1, texel * KNOTS + (KNOTS - 1))
        begin, end = (dr.gather(kinds.Float, self.distances, k) for k in (knot, following))
        before, after = (kinds.Float(dr.gather(kinds.Float16, self.depths, k)) for k in (knot, following))
        part = clip((distance - begin) / dr.fmax(end - begin, 1e-9), 0.0, 1.0)
        return dr.fma(part, dr.fmax(after - before, 0.0), before)

    def lay(self, knot: Any, distance: Any, depth: Any, here: Any) -> Any:
        """Write a knot of every ray (numbers 0… in `knot`) where `here`; the number of the next one."""
        index = dr.arange(arrays().UInt, self.resolution**2) * KNOTS + dr.minimum(knot, KNOTS - 1)
        dr.scatter(self.distances, distance, index, here)
        dr.scatter(self.depths, arrays().Float16(depth), index, here)
        return dr.select(here, knot + 1, knot)


@dr.syntax
def lay_knots(medium: Medium, origin: Any, direction: Any, target: DeepShadowMap) -> None:
    """March every ray once through the boxes and lay its knots into `target`."""
    kinds = arrays()
    crossing = medium.cross(origin, direction, kinds.Float(0), kinds.Float(dr.inf))
    taken = crossing.start()
    count = dr.width(direction)
    knot, depth = dr.zeros(kinds.UInt, count), dr.zeros(kinds.Float, count)
    drop = (1.0 - dr.exp(-optical_depth(medium, origin, direction, 0.0, dr.inf, DEEPEST))) / DROPS
    noted = dr.ones(kinds.Float, count)  # transmittance at the last knot
    last = dr.full(kinds.Float, -1.0, count)  # and its distance [m]
    reached = dr.full(kinds.Float, -1.0, count)  # end of the matter met so far [m]
    while crossing.unfinished(taken) & (depth < DEEPEST):
        step = medium.next(crossing, taken)
        if step.brick < 0:
            taken = crossing.leave(step, taken)
        else:
            met = step.tau * medium.density(step) * step.length
            if (met > THINNEST) & ~taken.too_coarse(met):
                begin, end = step.distance - 0.5 * step.length, step.distance + 0.5 * step.length
                passed = dr.exp(-depth)
                gap = (begin > reached + 0.5 * step.length) & (noted - passed > GAP_DROP)
                knot = target.lay(knot, reached, depth, gap & (reached > last))
                steep = noted - dr.exp(-depth - met) > drop
                fresh = ((last < 0) | gap | steep) & (begin > last)
                knot = target.lay(knot, begin, depth, fresh)
                noted, last = dr.select(fresh, passed, noted), dr.select(fresh, begin, last)
                depth += met
                fall = noted - dr.exp(-depth) > drop
                knot = target.lay(knot, end, depth, fall)
                noted, last = dr.select(fall, dr.exp(-depth), noted), dr.select(fall, end, last)
                reached = dr.fmax(reached, end)
            taken = crossing.after(step, met, taken)
        taken = crossing.exchange(taken)
    target.lay(knot, reached, depth, reached > last)


class LampView:
    """What a lamp sees, as a square a, b in 0…1: a pyramid, parallel lines or the octahedron of all directions."""

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
