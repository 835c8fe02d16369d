"""Textures of a surface of a scene TOML: body_texture, beta_texture and gamma_texture of [[surface]]."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.record import Record, about, decode
from hagoromo.image.surface_texture import MOST_SPECTRA, SurfaceTexture
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.reflectance import LARGEST_GAMMA


class BodyTexture(Record, frozen=True, kw_only=True):
    """The body colour of a surface from place to place: an image, or the colours of the vertices of its mesh."""

    file: Annotated[str | None, about("image on the UVs: PNG, JPEG, TIFF (sRGB), EXR or .hdr (linear)")] = None
    spectra: Annotated[
        Annotated[list[Annotated[Any, SOURCE]], Meta(max_length=MOST_SPECTRA)] | None,
        about("spectrum of each channel of the image, which is then linear; default: R, G, B of linear sRGB"),
    ] = None
    vertex_colours: Annotated[bool, about("whether the colours of the mesh's vertices are taken, in place of file")] = (
        False
    )
    smooth: Annotated[bool, about("whether values between the middles of pixels are interpolated")] = True


class BetaTexture(Record, frozen=True, kw_only=True):
    """A factor on beta, 0…1, from place to place: the first channel of an image, linear."""

    file: Annotated[str, about("image on the UVs: PNG, JPEG, TIFF, EXR or .hdr, its first channel, linear")]
    smooth: Annotated[bool, about("whether values between the middles of pixels are interpolated")] = True


class GammaTexture(Record, frozen=True, kw_only=True):
    """The half width of the facets γ from place to place: the first channel of an image, or of colours of vertices."""

    file: Annotated[str | None, about("image on the UVs: PNG, JPEG, TIFF, EXR or .hdr, its first channel, linear")] = (
        None
    )
    vertex_colours: Annotated[
        bool, about("whether R of the colours of the mesh's vertices is taken, linear, in place of file")
    ] = False
    range: Annotated[
        tuple[float, float],
        about("γ [rad] of the values 0 and 1 of the image (of 8 bits: 0 and 255), in a straight line between them"),
    ] = (0.0, 1.0)
    smooth: Annotated[bool, about("whether values between the middles of pixels are interpolated")] = True


def body_texture_from(record: dict[str, Any] | None, folder: Path, where: str) -> SurfaceTexture | bool | None:
    """The image of a table body_texture of a file in `folder`; True for the colours of the mesh's vertices."""
    if record is None:
        return None
    where = f"{where} body_texture"
    key = decode(record, BodyTexture, where)
    if (key.file is None) != key.vertex_colours:
        raise InputError(f"{where}: give either file (an image) or vertex_colours = true")
    if key.file is None:
        if key.spectra is not None:
            raise InputError(
                f"{where}: spectra are of an image, and the colours of vertices are R, G, B: leave them out"
            )
        return True
    with described(where):
        spectra = None if key.spectra is None else [Spectrum.load(one, folder) for one in key.spectra]
        return SurfaceTexture.from_file(inside(folder, key.file), spectra, key.smooth)


def beta_texture_from(record: dict[str, Any] | None, folder: Path, where: str) -> SurfaceTexture | None:
    """The image of a table beta_texture of a file in `folder`; None without one."""
    if record is None:
        return None
    where = f"{where} beta_texture"
    key = decode(record, BetaTexture, where)
    with described(where):
        return SurfaceTexture.from_file(inside(folder, key.file), smooth=key.smooth, colour=False)


def gamma_texture_from(
    record: dict[str, Any] | None, folder: Path, where: str
) -> SurfaceTexture | tuple[float, float] | None:
    """The half widths [rad] of a table gamma_texture of a file in `folder`; its range for colours of the mesh's
    vertices; None without one.
    """
    if record is None:
        return None
    where = f"{where} gamma_texture"
    key = decode(record, GammaTexture, where)
    if not all(0.0 <= end <= LARGEST_GAMMA for end in key.range):
        given = ", ".join(f"{end:g}" for end in key.range)
        raise InputError(f"{where}: range is [{given}]: give γ of the values 0 and 1, 0 to {LARGEST_GAMMA:.4g} rad")
    if (key.file is None) != key.vertex_colours:
        raise InputError(f"{where}: give either file (an image) or vertex_colours = true")
    if key.file is None:
        return key.range
    with described(where):
        return SurfaceTexture.from_file(inside(folder, key.file), smooth=key.smooth, colour=False).between(*key.range)
