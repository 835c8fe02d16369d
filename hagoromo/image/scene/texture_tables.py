"""Texture tables: the textures of the surfaces of a scene as kernels read them, by the colours of a palette."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.scene.surface import Same, Surface
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.transport.palette import Palette, position_of
from hagoromo.transport.surface_colours import SurfaceColours, TextureOfSurface
from hagoromo.transport.surface_relief import SurfaceRelief, slopes_of, tangents_of


def key_of_textures(surfaces: Sequence[Surface], palette: Palette) -> tuple[Hashable, ...]:
    """Key of `surface_colours`, equal where these are the same."""
    figures = [(s.figure, Same(s.uv), *s.textures, tuple(_places(s, palette))) for s in surfaces]
    laws = [(s.reflectance.alpha, s.reflectance.body_law) if _recoloured(s) else () for s in surfaces]
    return len(palette.colours), *figures, *laws


def surface_colours(surfaces: Sequence[Surface], palette: Palette) -> SurfaceColours:
    """The textures of surfaces on the device."""
    one, unit = np.ones((1, 1), np.float32), np.eye(len(palette.bodies), dtype=np.float32)
    bodies = [_texture(s, _shown(s), unit[_places(s, palette)]) for s in surfaces]
    factors = [_texture(s, s.beta_texture, one) for s in surfaces]
    widths = [_texture(s, s.gamma_texture, one) for s in surfaces]
    first = len(palette.bodies)
    return SurfaceColours(bodies, factors, widths, range(first, first + len(palette.interfaces)))


def surface_relief(surfaces: Sequence[Surface]) -> SurfaceRelief | None:
    """The images of normals and heights of surfaces on the device; None where there are none."""
    if not any(any(s.reliefs) for s in surfaces):
        return None
    three, two = np.ones((3, 1), np.float32), np.ones((2, 1), np.float32)
    normals = [_texture(s, s.normal_texture, three) for s in surfaces]
    slopes: list[TextureOfSurface | None] = []
    for s in surfaces:
        heights = _texture(s, s.bump_texture, two)
        slopes.append(heights and replace(heights, values=slopes_of(heights.values[..., 0])))
    return SurfaceRelief(normals, slopes, [_tangents(s) for s in surfaces])


def _tangents(surface: Surface) -> NDArray[np.float32] | None:
    if surface.uv is None or surface.vertices is None or not any(surface.reliefs):
        return None
    assert surface.faces is not None
    return tangents_of(surface.vertices @ surface.pose[:3, :3].T, surface.faces, surface.uv)


def _places(surface: Surface, palette: Palette) -> list[int]:
    """Of the spectra of its texture of the body, the places on the palette."""
    texture = surface.body_texture
    return [position_of(spectrum, palette.bodies) for spectrum in texture.spectra] if texture else []


def _recoloured(surface: Surface) -> bool:
    """Whether the law of the body changes the colours of its texture."""
    texture, made = surface.body_texture, surface.reflectance
    return texture is not None and made.shown_colour(texture.values, made.alpha) is not texture.values


def _shown(surface: Surface) -> SurfaceTexture | None:
    """The texture of its body as it shows: each value of a place as if it were a body colour of its own."""
    texture, made = surface.body_texture, surface.reflectance
    if texture is None or not _recoloured(surface):
        return texture
    values = made.shown_colour(texture.values.astype(np.float64), made.alpha)
    return SurfaceTexture(values, texture.spectra, texture.of, texture.smooth, texture.name, texture.tiles)


def _texture(
    surface: Surface, texture: SurfaceTexture | None, on_palette: NDArray[np.float32]
) -> TextureOfSurface | None:
    """A texture of a surface as kernels take it."""
    if texture is None:
        return None
    if texture.of == "image" and surface.uv is not None:
        assert surface.faces is not None
        return TextureOfSurface(texture.values, texture.smooth, on_palette, surface.faces, surface.uv)
    corners = surface.faces if texture.of == "vertices" else None
    return TextureOfSurface(texture.values, texture.smooth, on_palette, corners)
