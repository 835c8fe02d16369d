"""Chart: where the voxels of a box are on a surface, so that matter can be looked up in a texel instead.

A box with a chart keeps heights over the surface where others keep densities (as shares of the band that it covers),
normals where others keep axes, and four words a voxel: u and v in periods of the texel (16 bits before and 16 after the
point, so that neighbours may differ by whole periods), the tangent along u, and how much of the matter is there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.volume.voxels import CORNERS, axis_between, corner, packed_axis, trilinear

ONE = 65536.0  # a period
WORDS = 4  # of a voxel


@dataclass
class OnSurface:
    """Where points are on the surface of a box with a chart.

    tile_u, tile_v: Int, whole periods; u, v: 0…1, the rest. height [m]. presence: 0…1.
    """

    tile_u: Any
    tile_v: Any
    u: Any
    v: Any
    height: Any
    presence: Any


@dataclass
class SurfaceFrame:
    """Unit directions, at right angles: along u, along v and the normal."""

    along_u: Any
    along_v: Any
    normal: Any

    def outwards(self, vector: Any) -> Any:
        """A vector (u, v, normal) in the axes that the frame is told in."""
        return vector.x * self.along_u + vector.y * self.along_v + vector.z * self.normal

    def inwards(self, vector: Any) -> Any:
        """The inverse of `outwards`."""
        return type(vector)(*(dr.dot(vector, axis) for axis in (self.along_u, self.along_v, self.normal)))


def chart_words(u: Any, v: Any, along_u: Any, presence: Any) -> Any:
    """The four words of voxels, Array4u; u, v: Float, in periods."""
    kinds = arrays()
    bits = kinds.UInt(kinds.Float(presence) * ONE)
    return kinds.Array4u(_fixed(u), _fixed(v), dr.reinterpret_array(kinds.UInt, packed_axis(along_u)), bits)


def place_on_surface(words: Any, brick: Any, place: Any, height: Any) -> tuple[OnSurface, Any]:
    """Where samples at `place` [lattice] in `brick` are, and the tangent along u in box axes; words: UInt."""
    kinds = arrays()
    start, part = corner(brick, place)
    packets = [dr.gather(kinds.Array4u, words, start + offset) for offset in CORNERS]
    tile_u, u = _between([packet[0] for packet in packets], part)
    tile_v, v = _between([packet[1] for packet in packets], part)
    presence = trilinear([kinds.Float(packet[3]) for packet in packets], part) * (1.0 / ONE)
    along_u = axis_between([dr.reinterpret_array(kinds.Int, packet[2]) for packet in packets], part)
    return OnSurface(tile_u, tile_v, u, v, height, presence), along_u


def surface_frame(along_u: Any, normal: Any) -> SurfaceFrame:
    """The frame of a unit normal and of a tangent, which is brought to right angles with it."""
    along_u = dr.normalize(along_u - normal * dr.dot(along_u, normal) + 1e-9)
    return SurfaceFrame(along_u, dr.cross(normal, along_u), normal)


def _between(words: list[Any], part: Any) -> tuple[Any, Any]:
    """Whole periods (Int), and the rest of them, between eight words."""
    kinds, first = arrays(), words[0]
    steps = [kinds.Float(kinds.Int(word - first)) for word in words]  # neighbours may differ by whole turns of 32 bits
    moved = kinds.Float(first & 0xFFFF) + trilinear(steps, part)
    whole = dr.floor(moved * (1.0 / ONE))
    return (kinds.Int(first) >> 16) + kinds.Int(whole), dr.fma(moved, 1.0 / ONE, -whole)


def _fixed(periods: Any) -> Any:
    """Periods as 16.16 bits, which wrap beyond ±32768."""
    kinds = arrays()
    whole = dr.floor(periods)
    return kinds.UInt((kinds.Int(whole) << 16) + kinds.Int((periods - whole) * ONE))
