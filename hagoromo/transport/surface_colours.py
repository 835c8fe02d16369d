"""Surface colours: textures of surfaces on the device, and the colours, and γ, of the places that rays hit.

A texture is an image over the UVs of a mesh or a shape, or values of the vertices of a mesh. Everything is read from
tables, so that another texture needs no new kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, check_entries, lookup
from hagoromo.transport.materials import FAR_BODY, Materials
from hagoromo.transport.sample import Element

NONE, OWN_UV, MESH_UV, VERTICES = 0, 1, 2, 3  # where the values of a surface come from
ROW = 8  # numbers of a row


class SurfaceHit(NamedTuple):
    """First hits of rays: distance [m] (infinity: none), offset point, unit normals to the eye (shaded, and of the
    face), number of the surface, whether its front was hit, the triangle, and UV (of a mesh: shares of the second and
    third corner). ground: the shaded normal before images of normals and heights turned it; None where none does.
    """

    distance: Float
    point: Array3f
    normal: Array3f
    flat: Array3f
    surface: UInt
    front: Bool
    triangle: UInt
    uv: Any
    ground: Array3f | None = None


@dataclass(frozen=True)
class TextureOfSurface:
    """values: (height, width, k) or (vertices, k). corners: (faces, 3) numbers of UVs or vertices; None: the shape's
    own UVs. uv: (n, 2). smooth: whether pixels are interpolated. on_palette: (k, colours), what each value adds to the
    coefficients of the colours.
    """

    values: NDArray[np.float32]
    smooth: bool
    on_palette: NDArray[np.float32]
    corners: NDArray[np.uint32] | None = None
    uv: NDArray[np.float32] | None = None


class TextureTable:
    """One texture, or none, of every surface."""

    def __init__(self, textures: Sequence[TextureOfSurface | None]) -> None:
        jit, rows = arrays(), np.zeros((len(textures), ROW), np.uint32)
        there = [texture for texture in textures if texture is not None]
        self.channels = max(texture.values.shape[-1] for texture in there)
        self.kinds: set[int] = set()
        self.colours = there[0].on_palette.shape[1]
        corners, uvs, values, ends = [], [], [], [0, 0, 0]
        matrix = np.zeros((len(textures), self.channels, self.colours), np.float32)
        for row, own, texture in zip(rows, matrix, textures, strict=True):
            if texture is None:
                continue
            count = texture.values.shape[-1]
            kind = VERTICES if texture.values.ndim == 2 else OWN_UV if texture.corners is None else MESH_UV
            self.kinds.add(kind)
            height, width = texture.values.shape[:2] if kind != VERTICES else (1, 1)
            row[:] = kind, ends[0], ends[2], width, height, count, texture.smooth, 0
            own[:count] = texture.on_palette
            if texture.corners is not None:
                shift = ends[1] if kind == MESH_UV else 0
                corners.append(texture.corners.astype(np.uint32).ravel() + np.uint32(shift))
                ends[0] += corners[-1].size
            if texture.uv is not None:
                uvs.append(texture.uv.astype(np.float32))
                ends[1] += len(texture.uv)
            values.append(texture.values.ravel())
            ends[2] += values[-1].size
        check_entries(max(3 * ends[0], 2 * ends[1], ends[2]), "the textures of all surfaces together")
        self.rows, self.matrix = lookup(jit.UInt, rows), lookup(jit.Float, matrix)
        self.corners = lookup(jit.UInt, np.concatenate(corners)) if corners else None
        self.uv = lookup(jit.Float, np.concatenate(uvs)) if uvs else None
        self.values = lookup(jit.Float, np.concatenate(values))
        dr.eval(self.rows, self.matrix, self.corners, self.uv, self.values)

    def there(self, surface: UInt) -> Bool:
        """Whether surfaces have a texture."""
        return dr.gather(arrays().UInt, self.rows, surface * ROW) != NONE

    def at(self, hit: SurfaceHit) -> list[Float]:
        """Values at hits: as many as the texture with most has, 0 of those that a texture lacks."""
        jit = arrays()
        kind, first_corner, first, width, height, count, smooth, _ = (
            dr.gather(jit.UInt, self.rows, hit.surface * ROW + k) for k in range(ROW)
        )
        u, v = jit.Float(hit.uv.x), jit.Float(hit.uv.y)
        shares, corners = [1.0 - u - v, u, v], []
        if self.corners is not None:
            start = first_corner + hit.triangle * 3
            corners = [dr.gather(jit.UInt, self.corners, start + k, kind >= MESH_UV) for k in range(3)]
        if self.uv is not None:
            mapped = [dr.gather(jit.Array2f, self.uv, corner, kind == MESH_UV) for corner in corners]
            place = mapped[0] * shares[0] + mapped[1] * shares[1] + mapped[2] * shares[2]
            u, v = dr.select(kind == MESH_UV, place.x, u), dr.select(kind == MESH_UV, place.y, v)
        taps = _pixels(u, v, width, height, smooth > 0)
        if VERTICES in self.kinds:
            own = [*zip(corners, shares, strict=True), (jit.UInt(0), jit.Float(0))]
            at_vertices = kind == VERTICES
            taps = [
                (dr.select(at_vertices, p, q), dr.select(at_vertices, s, t))
                for (p, s), (q, t) in zip(own, taps, strict=True)
            ]
        values = []
        for k in range(self.channels):
            there = (kind != NONE) & (k < count)
            total = jit.Float(0)
            for place, share in taps:
                total = dr.fma(dr.gather(jit.Float, self.values, first + place * count + k, there), share, total)
            values.append(dr.select(there, total, 0.0))
        return values

    def on_palette(self, hit: SurfaceHit) -> list[Float]:
        """What the values at hits add to the coefficients of each colour."""
        jit, values = arrays(), self.at(hit)
        start = hit.surface * (self.channels * self.colours)
        return [
            sum(
                (
                    value * dr.gather(jit.Float, self.matrix, start + (k * self.colours + j))
                    for k, value in enumerate(values)
                ),
                jit.Float(0),
            )
            for j in range(self.colours)
        ]


class SurfaceColours:
    """Coefficients on a palette where rays hit surfaces: `bodies` in place of a body colour, `interfaces` a factor on
    that of the interface; and `widths` in place of γ. A plain object: loops do not take its tables into their state.
    """

    def __init__(
        self,
        bodies: Sequence[TextureOfSurface | None],
        interfaces: Sequence[TextureOfSurface | None],
        widths: Sequence[TextureOfSurface | None],
        places: range,
    ) -> None:
        """widths: of the facets, γ [rad]. places: numbers of the interface colours on the palette, after those of
        bodies.
        """
        self.places = places
        self.bodies, self.interfaces, self.widths = (
            TextureTable(each) if any(texture is not None for texture in each) else None
            for each in (bodies, interfaces, widths)
        )

    def with_textures(self, coefficients: list[Float], hit: SurfaceHit) -> list[Float]:
        """`coefficients` of the materials that were hit, with the textures of their surfaces."""
        mixed = list(coefficients)
        if self.bodies is not None:
            here = self.bodies.there(hit.surface)
            for j, value in enumerate(self.bodies.on_palette(hit)):
                mixed[j] = dr.select(here, value, mixed[j])
        if self.interfaces is not None:
            factor = dr.select(self.interfaces.there(hit.surface), self.interfaces.at(hit)[0], 1.0)
            for j in self.places:
                mixed[j] = mixed[j] * factor
        return mixed

    def gamma(self, hit: SurfaceHit, plain: Float) -> Float | None:
        """γ of the facets at hits [rad], `plain` of surfaces without a texture of it; None where no surface has one."""
        if self.widths is None:
            return None
        return dr.select(self.widths.there(hit.surface), self.widths.at(hit)[0], plain)


def surface_element(
    materials: Materials, first: UInt, hit: SurfaceHit, colours: SurfaceColours | None, thickness: Float | None
) -> Element:
    """Surfaces as elements where rays hit them; first: number of the material of the first one.

    thickness: of sheets, between the points of hits on their two sides [m]; None where no surface lets light through.
    """
    material = first + hit.surface
    gamma = None if colours is None else colours.gamma(hit, materials.read(material, "gamma"))
    across = None
    if thickness is not None:
        across = hit.flat * dr.select(materials.read(material, FAR_BODY) > 0.0, -thickness, 0.0)
    return Element(hit.normal, material, gamma=gamma, across=across, ground=hit.ground)


def _pixels(u: Float, v: Float, width: UInt, height: UInt, smooth: Bool) -> list[tuple[UInt, Float]]:
    """Four pixels around a place of an image and their shares; one of them where it is not smooth. It repeats."""
    jit = arrays()
    width, height = dr.maximum(width, 1), dr.maximum(height, 1)  # lanes that are done read 0, by which none is divided
    w, h, half = jit.Float(width), jit.Float(height), dr.select(smooth, 0.5, jit.Float(0))
    x, y = (u - dr.floor(u)) * w - half, (1.0 - (v - dr.floor(v))) * h - half
    left, top = dr.floor(x), dr.floor(y)
    right, down = dr.select(smooth, x - left, 0.0), dr.select(smooth, y - top, 0.0)
    # a place at the very edge may round to the number of pixels: it repeats, too
    columns = [jit.UInt(left + w) % width, jit.UInt(left + 1.0 + w) % width]
    rows = [jit.UInt(top + h) % height, jit.UInt(top + 1.0 + h) % height]
    return [
        (rows[i] * width + columns[j], (down if i else 1.0 - down) * (right if j else 1.0 - right))
        for i in (0, 1)
        for j in (0, 1)
    ]
