"""Textures of the materials of glTF and USD: pictures of a file → a scene's; a surface → its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files import exr
from hagoromo.files.memory import require
from hagoromo.files.picture import TIFF_STARTS, read_picture
from hagoromo.files.png import write_png
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.light.colour import linear_colour, srgb_decode, srgb_encode
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum
from hagoromo_formats.scenes.pbr import PbrMaterial, linear, of_one_size, pbr_of

KINDS = {  # first bytes → suffix
    b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg", exr.MAGIC: ".exr", **dict.fromkeys(TIFF_STARTS, ".tif")
}  # fmt: skip
AS_THEY_ARE = (".png", ".jpg")  # textures of a scene
MUCH_COLOUR = 0.02  # of the largest value: colours of gloss that differ by so much are several
ROWS_AT_ONCE = 256
BYTES_PER_PIXEL = 100.0  # of memory, of what is made of the textures of gloss
Array = NDArray[np.float64]


def written_image(
    data: bytes, factor: Array, folder: Path, name: str, path: Path, srgb: bool = True
) -> tuple[str, Array]:
    """Write an image into `folder`, each colour times its factor; returns the name of its file, and the largest.

    srgb: whether its values are encoded so; else they are linear, and what is written is encoded, in 8 bits. Colours
    above 1 are written as 1.
    """
    suffix, values = _suffix(data, name, path), picture_of(data, folder, name, path)
    values = values[..., None] if values.ndim == 2 else values
    channels = values[..., :3] if values.shape[-1] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    top, coloured = _white(channels), np.empty(channels.shape, np.uint8)

    def decode(values: NDArray[Any]) -> Array:
        values = np.clip(values * (255.0 / top), 0.0, 255.0)
        return srgb_decode(values) if srgb else values / 255.0

    largest = decode(channels.max(axis=(0, 1))) * factor
    if suffix in AS_THEY_ARE and srgb and not (factor < 1.0).any():
        (folder / f"{name}{suffix}").write_bytes(data)
        return f"{name}{suffix}", largest
    for first in range(0, len(channels), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        coloured[rows] = srgb_encode(decode(channels[rows]) * factor)
    write_png(folder / f"{name}.png", coloured)
    return f"{name}.png", largest


def _suffix(data: bytes, name: str, path: Path) -> str:
    suffix = next((suffix for start, suffix in KINDS.items() if data.startswith(start)), "")
    if not suffix:
        raise InputError(f"{path}: the image of {name} is neither PNG, JPEG, EXR nor TIFF: give one of them")
    return suffix


def picture_of(data: bytes, folder: Path, name: str, path: Path) -> NDArray[Any]:
    """The pixels (h, w[, 3 or 4]) of a PNG, JPEG, TIFF or, float32, EXR of the file `path`; `InputError` for one
    that is damaged, not finite or too large.
    """
    file = folder / f"read_{name}{_suffix(data, name, path)}"
    file.write_bytes(data)
    try:
        picture = _of_exr(file, path) if file.suffix == ".exr" else read_picture(file)
        require(BYTES_PER_PIXEL * picture.shape[0] * picture.shape[1], str(path))
        return picture
    finally:
        file.unlink()


def _of_exr(file: Path, path: Path) -> NDArray[np.float32]:
    """R, G, B and, where there is one, A of an EXR, or its grey."""
    channels, _ = exr.read_exr(file)
    names = next((each for each in (("R", "G", "B", "A"), ("R", "G", "B"), ("Y",)) if set(each) <= set(channels)), None)
    if names is None:
        raise InputError(f"{path}: a texture has the channels {', '.join(channels)}: give R, G, B or Y")
    picture = np.stack([channels[name] for name in names], axis=-1)
    if not np.isfinite(picture).all():
        raise InputError(f"{path}: a texture has pixels that are not finite: mend it")
    return picture if len(names) > 1 else picture[..., 0]


def _white(picture: NDArray[Any]) -> float:
    """What stands for 1 in a picture."""
    return 1.0 if picture.dtype == np.float32 else float(np.iinfo(picture.dtype).max)


def channel_of(picture: NDArray[Any], number: int) -> NDArray[np.float32]:
    """One of R, G, B, A of a picture, 0…1: of a grey one its value, and A of what has none 1."""
    top = np.float32(_white(picture))
    channels = picture.reshape(*picture.shape[:2], -1)
    count = channels.shape[-1]
    if number == 3 and count not in (2, 4):
        return np.ones(picture.shape[:2], np.float32)
    chosen = -1 if number == 3 else min(number, count - 1) if count >= 3 else 0
    return channels[..., chosen].astype(np.float32) / top


def gloss_of_colours(colours: Array) -> tuple[Array, Array, bool]:
    """Colours of gloss by place (h, w, 3), linear → one colour (3,), its factor by place (h, w), at most 1; and whether
    other colours are lost.
    """
    largest, mean = colours.max(axis=2), colours.mean(axis=(0, 1))
    top, colour = float(largest.max()), mean / max(float(mean.max()), 1e-9)
    varied = bool(np.ptp(colours - largest[..., None] * colour) > MUCH_COLOUR * top)
    return top * colour, largest / max(top, 1e-9), varied


def look_of(surface: Surface, vertices: Array) -> tuple[PbrMaterial, Array | None]:
    """What is nearest to a surface, and the base colours of its body_texture, linear, 0…1: (h, w, 3) of an image on its
    UVs, (n, 3) of vertices; None without one. vertices: those of its triangles.
    """
    body, uv = surface.body_texture, uvs_of(surface, vertices)
    look = pbr_of(surface, uv is not None and (body is None or body.of == "image"))
    if body is None:
        return look, None
    if body.of == "image" and uv is None:
        return look._replace(base=look.base * linear(surface.reflectance.body_colour)), None
    colours = np.clip(look.base * (body.values @ _colours_of_channels(body)), 0.0, 1.0)
    return look._replace(base=np.ones(3)), colours


def lost_textures(surface: Surface, look: PbrMaterial, colours: Array | None) -> Iterator[str]:
    """A line for each texture of a surface that is not in its look and colours."""
    if surface.body_texture is not None and colours is None:
        yield f"surface {surface.name!r}: the body_texture of its {surface.shape}"
    if surface.reflectance.beta > 0.0:
        for key, texture in (("gamma", surface.gamma_texture), ("beta", surface.beta_texture)):
            if texture is not None and not look.mapped:
                yield f"surface {surface.name!r}: its {key}_texture, as it, or its body_texture, is not on UVs"


def uvs_of(surface: Surface, vertices: Array) -> Array | None:
    """UVs of the triangles of a surface, v up; None where it has none."""
    return 0.5 * (vertices[:, :2] + 1.0) if surface.shape == "rectangle" else surface.uv


def gloss_image(look: PbrMaterial) -> NDArray[np.uint8] | None:
    """R, G, B, A of 8 bits: roughness in G, the factor on F in A; None for a look without maps."""
    if not look.mapped:
        return None
    rough, specular = of_one_size(look.roughness_map, look.specular_map)
    image = np.zeros((*rough.shape, 4), np.uint8)
    image[..., 1], image[..., 3] = np.round(255.0 * rough), np.round(255.0 * specular)
    return image


def _colours_of_channels(texture: SurfaceTexture) -> Array:
    """Linear R, G, B (k, 3) of each spectrum of a texture under D65; those of R, G, B themselves as they were given."""
    given = [one.record() for one in texture.spectra]
    if given == [upsampled(row).record() for row in np.eye(3)]:
        return np.eye(3)
    return np.stack([linear_colour(one, Spectrum.named("D65")) for one in texture.spectra])
