"""Textures of a surface of a scene TOML: body_texture, beta_texture, … of [[surface]].

A file such as wall.<UDIM>.png is all of its tiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from msgspec import Meta

from hagoromo.errors import InputError, described
from hagoromo.files.record import Record, about, decode, one_of
from hagoromo.image.scene.surface_texture import MOST_SPECTRA, SurfaceTexture
from hagoromo.image.scene.tiled_image import TextureFiles
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.reflectance.reflectance import LARGEST_GAMMA

Table = TypeVar("Table", bound=Record)


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


class NormalTexture(Record, frozen=True, kw_only=True):
    """Normals from place to place, in the tangent space of the UVs: an image of (normal + 1) / 2, linear."""

    file: Annotated[str, about("image on the UVs: PNG, JPEG, TIFF, EXR or .hdr, its R, G, B linear")]
    green: Annotated[
        Annotated[str, one_of("opengl", "directx")],
        about("where green points: along v, as OpenGL, Blender and glTF have it, or against v, as DirectX"),
    ] = "opengl"
    smooth: Annotated[bool, about("whether values between the middles of pixels are interpolated")] = True


class BumpTexture(Record, frozen=True, kw_only=True):
    """Heights from place to place, by which normals are turned: the first channel of an image, linear."""

    file: Annotated[str, about("image on the UVs: PNG, JPEG, TIFF, EXR or .hdr, its first channel, linear")]
    height_mm: Annotated[
        float, about("height of the value 1 (of 8 bits: 255) over the value 0 [mm]; below 0: a depth under it")
    ]
    smooth: Annotated[bool, about("whether values between the middles of pixels are interpolated")] = True


def body_texture_from(record: dict[str, Any] | None, files: TextureFiles, where: str) -> SurfaceTexture | bool | None:
    """The image of a table body_texture of a scene file; True for the colours of the mesh's vertices."""
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
        spectra = None if key.spectra is None else [Spectrum.load(one, files.folder) for one in key.spectra]
        return SurfaceTexture.from_file(files.place(key.file), spectra, key.smooth)


def beta_texture_from(record: dict[str, Any] | None, files: TextureFiles, where: str) -> SurfaceTexture | None:
    """The image of a table beta_texture of a scene file; None without one."""

    def made(key: BetaTexture) -> SurfaceTexture:
        return SurfaceTexture.from_file(files.place(key.file), smooth=key.smooth, colour=False)

    return _image_from(record, BetaTexture, f"{where} beta_texture", made)


def gamma_texture_from(
    record: dict[str, Any] | None, files: TextureFiles, where: str
) -> SurfaceTexture | tuple[float, float] | None:
    """The half widths [rad] of a table gamma_texture of a scene file; its range for colours of the mesh's
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
        return SurfaceTexture.from_file(files.place(key.file), smooth=key.smooth, colour=False).between(*key.range)


def normal_texture_from(record: dict[str, Any] | None, files: TextureFiles, where: str) -> SurfaceTexture | None:
    """The image of a table normal_texture of a scene file; None without one."""

    def made(key: NormalTexture) -> SurfaceTexture:
        return SurfaceTexture.normals_from_file(files.place(key.file), key.smooth, key.green == "directx")

    return _image_from(record, NormalTexture, f"{where} normal_texture", made)


def bump_texture_from(record: dict[str, Any] | None, files: TextureFiles, where: str) -> SurfaceTexture | None:
    """The heights [m] of a table bump_texture of a scene file; None without one."""

    def made(key: BumpTexture) -> SurfaceTexture:
        stored = SurfaceTexture.from_file(files.place(key.file), smooth=key.smooth, colour=False)
        top = 1e-3 * abs(key.height_mm)
        return stored.between(0.0, top) if key.height_mm >= 0.0 else stored.between(top, 0.0)

    return _image_from(record, BumpTexture, f"{where} bump_texture", made)


def _image_from(
    record: dict[str, Any] | None, kind: type[Table], where: str, made: Callable[[Table], SurfaceTexture]
) -> SurfaceTexture | None:
    """What is `made` of a table that is always an image; None without one."""
    if record is None:
        return None
    key = decode(record, kind, where)
    with described(where):
        return made(key)
