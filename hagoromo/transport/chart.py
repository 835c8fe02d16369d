"""Chart: coordinates on a surface for the voxels of a box, so that its matter is looked up in a texel.

A box with a chart keeps heights over the surface where others keep densities (as shares of the band that it covers),
normals where others keep axes, and four words a voxel: u and v in periods of the texel (16 bits before and 16 after the
point), the tangent along u, and the presence: above ½ within hems, falling evenly over a few voxels across them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Array4u, Float, Int, UInt, arrays, clip
from hagoromo.volume.voxels import (
    CORNERS,
    STORED,
    PackedVoxels,
    axis_between,
    corner,
    packed_axis,
    trilinear,
    unpacked,
)

PERIOD = 65536.0  # fixed-point units of a period of the texel
SHEET_GAP = 4.5  # [voxel] neighbours whose u or v differ by more lie on two sheets (a diagonal is 1.7, gathers more)
HEM_STEEPNESS = 8.0  # presence falls from 1 to 0 within 1 / HEM_STEEPNESS of the charted ramp across a hem


@dataclass
class SurfacePoint:
    """Points relative to the surface that the chart of a box describes."""

    tile_u: Int  # whole periods of the texel along u
    tile_v: Int  # and along v
    u: Float  # rest of the period along u, 0…1
    v: Float  # and along v
    height: Float  # over the surface [m]
    presence: Float  # 1 on the cloth, 0 beyond its hem

    def moved(self, on: Float, way: Array3f, per_metre: Sequence[Float]) -> SurfacePoint:
        """`on` [m] along a straight `way` (along u, v, normal) over a flat surface; periods per metre along u and v."""
        Int = arrays().Int
        u, v = dr.fma(on * way.x, per_metre[0], self.u), dr.fma(on * way.y, per_metre[1], self.v)
        over_u, over_v = dr.floor(u), dr.floor(v)
        tiles = self.tile_u + Int(over_u), self.tile_v + Int(over_v)
        return SurfacePoint(*tiles, u - over_u, v - over_v, dr.fma(on, way.z, self.height), self.presence)


@dataclass
class SurfaceFrame:
    """Unit directions, at right angles: along u, along v and the normal."""

    along_u: Array3f
    along_v: Array3f
    normal: Array3f

    def outwards(self, vector: Array3f) -> Array3f:
        """A vector (u, v, normal) in the axes that the frame is given in."""
        return vector.x * self.along_u + vector.y * self.along_v + vector.z * self.normal

    def inwards(self, vector: Array3f) -> Array3f:
        """The inverse of `outwards`."""
        return type(vector)(*(dr.dot(vector, axis) for axis in (self.along_u, self.along_v, self.normal)))


def chart_words(u: Float, v: Float, along_u: Array3f, presence: Float) -> Array4u:
    """The four words of voxels, Array4u; u, v: Float, in periods."""
    jit = arrays()
    bits = jit.UInt(jit.Float(presence) * PERIOD)
    return jit.Array4u(_fixed(u), _fixed(v), dr.reinterpret_array(jit.UInt, packed_axis(along_u)), bits)


@dataclass
class ChartScale:
    """Scales of the chart of a box."""

    per_u: Float  # fixed-point units of u per metre [1/m]
    per_v: Float  # and of v
    voxel: Float  # size [m]
    low: Float  # lowest height of the band [m]
    span: Float  # of the band [m]


def surface_point_at(
    charts: UInt, voxels: PackedVoxels, bricks: tuple[UInt, UInt], place: Array3f, scale: ChartScale
) -> tuple[SurfacePoint, Array3f, Array3f]:
    """Where samples at `place` [lattice] are, tangent along u and normal in box axes: SurfacePoint, Array3f, Array3f.

    bricks: their numbers in `charts` (words, UInt) and in `voxels`. Where the voxels around a place are on different
    sheets, or on both sides of a fold, those of the nearest voxel's sheet are followed to the place.
    """
    jit = arrays()
    start, part = corner(bricks[0], place)
    packets = [dr.gather(jit.Array4u, charts, start + offset) for offset in CORNERS]
    steps = dr.select(part > 0.5, jit.Array3u(1), jit.Array3u(0))
    reference = dr.gather(jit.Array4u, charts, start + (steps.z * STORED + steps.y) * STORED + steps.x)
    along = [[jit.Float(jit.Int(packet[k] - reference[k])) for packet in packets] for k in range(2)]
    near = [
        (dr.abs(u) < SHEET_GAP * scale.voxel * scale.per_u) & (dr.abs(v) < SHEET_GAP * scale.voxel * scale.per_v)
        for u, v in zip(*along, strict=True)
    ]
    one_sheet = near[0]
    for also in near[1:]:
        one_sheet &= also
    presence = [jit.Float(packet[3]) for packet in packets]
    tangents = [dr.reinterpret_array(jit.Int, packet[2]) for packet in packets]

    def smooth(place: Array3f, part: Array3f, brick: UInt) -> tuple[Any, ...]:
        return (
            trilinear(along[0], part), trilinear(along[1], part), voxels.density(brick, place),
            trilinear(presence, part), axis_between(tangents, part), voxels.axis(brick, place),
        )  # fmt: skip

    def apart(place: Array3f, part: Array3f, brick: UInt) -> tuple[Any, ...]:
        return _on_one_sheet(voxels, brick, place, scale, (along, presence, tangents, near))

    u, v, share, there, along_u, normal = dr.if_stmt((place, part, bricks[1]), one_sheet, smooth, apart)
    tile_u, u = _whole_and_rest(reference[0], u)
    tile_v, v = _whole_and_rest(reference[1], v)
    return SurfacePoint(tile_u, tile_v, u, v, dr.fma(share, scale.span, scale.low), _steep(there)), along_u, normal


def presence_at(charts: UInt, brick: UInt, place: Array3f) -> Float:
    """Presence at samples alone, see `SurfacePoint`; brick: number in `charts`."""
    start, part = corner(brick, place)
    return _steep(
        trilinear([arrays().Float(dr.gather(arrays().UInt, charts, (start + k) * 4 + 3)) for k in CORNERS], part)
    )


def _steep(charted: Float) -> Float:
    """Presence from the charted ramp across a hem [1 / PERIOD]."""
    return clip(dr.fma(charted * (1.0 / PERIOD) - 0.5, HEM_STEEPNESS, 0.5), 0.0, 1.0)


def _on_one_sheet(
    voxels: PackedVoxels, brick: UInt, place: Array3f, scale: ChartScale, corners: tuple[Any, ...]
) -> tuple[Any, ...]:
    """As trilinear values, of the `near` ones of eight voxels only, each followed along its plane to the place."""
    jit, (along, presence, tangents, near) = arrays(), corners
    start, part = corner(brick, place)
    nothing = jit.Float(0)
    total, u, v, share, there = [nothing] * 5
    along_u, normal = jit.Array3f(0), jit.Array3f(0)
    heights = voxels.densities_around(brick, place)
    for k, offset in enumerate(CORNERS):
        side = [k & 1, (k >> 1) & 1, k >> 2]
        weights = [part[j] if side[j] else 1.0 - part[j] for j in range(3)]
        weight = dr.select(near[k], weights[0] * weights[1] * weights[2] + 1e-6, 0.0)
        n = dr.normalize(unpacked(dr.gather(jit.Int, voxels.axes, start + offset)) + 1e-9)
        t = dr.normalize(unpacked(tangents[k]) + 1e-9)
        away = jit.Array3f(*(part[j] - side[j] for j in range(3))) * scale.voxel
        total += weight
        u = dr.fma(weight, dr.fma(dr.dot(t, away), scale.per_u, along[0][k]), u)
        v = dr.fma(weight, dr.fma(dr.dot(dr.cross(n, t), away), scale.per_v, along[1][k]), v)
        share = dr.fma(weight, heights[k] + dr.dot(n, away) / scale.span, share)
        there = dr.fma(weight, presence[k], there)
        along_u, normal = along_u + t * weight, normal + n * weight
    scale = dr.rcp(total)
    return u * scale, v * scale, share * scale, there * scale, along_u, normal


def surface_frame(along_u: Array3f, normal: Array3f) -> SurfaceFrame:
    """The frame of a normal and of a tangent, which is brought to right angles with it; made unit."""
    normal = dr.normalize(normal + 1e-9)
    along_u = dr.normalize(along_u - normal * dr.dot(along_u, normal) + 1e-9)
    return SurfaceFrame(along_u, dr.cross(normal, along_u), normal)


def _whole_and_rest(word: UInt, moved: Float) -> tuple[Int, Float]:
    """Whole periods (Int), and the rest of them, of a word and a Float of words beside it."""
    jit = arrays()
    moved = moved + jit.Float(word & 0xFFFF)
    whole = dr.floor(moved * (1.0 / PERIOD))
    return (jit.Int(word) >> 16) + jit.Int(whole), dr.fma(moved, 1.0 / PERIOD, -whole)


def _fixed(periods: Float) -> UInt:
    """Periods as 16.16 bits, which wrap beyond ±32768."""
    jit = arrays()
    whole = dr.floor(periods)
    return jit.UInt((jit.Int(whole) << 16) + jit.Int((periods - whole) * PERIOD))
