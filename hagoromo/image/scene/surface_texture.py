"""SurfaceTexture: a parameter of a surface's reflectance that differs from place to place, by an image or by vertices.

A body colour is a sum of a few spectra with weights of each place, so that pictures keep exact weights; R, G, B become
the three spectra of Mallett & Yuksel 2019, as those of environments do. Factors on beta and half widths γ have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import MAGIC, read_exr
from hagoromo.files.hdr import STARTS, read_hdr
from hagoromo.files.memory import require
from hagoromo.files.picture import read_picture
from hagoromo.light.colour import srgb_decode
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum

KINDS = ("image", "vertices")
MOST_SPECTRA = 8  # of a texture: each is a part of every kernel
MOST_TEXELS = 1 << 27  # of an image
LARGEST_VALUE = 100.0  # weights of a spectrum
TEXELS_AT_ONCE = 1 << 20
BYTES_PER_NUMBER = 40.0  # while a texture is checked and brought to the device


class ImageOfParts(Protocol):
    """An image that several files make, see `TiledImage`."""

    @property
    def grid(self) -> tuple[int, int]:
        """How many of them there may be, across and up."""
        ...

    def read(self, read: Callable[[Path], tuple[NDArray[np.float32], bool]], /) -> tuple[NDArray[np.float32], bool]:
        """What `_read` gives of them together."""
        ...


ImagePlace: TypeAlias = str | Path | ImageOfParts


@dataclass(frozen=True, eq=False)
class SurfaceTexture:
    """Values over a surface, 0 or more: an "image" (height, width[, k]), or of "vertices" (n[, k]) of its mesh.

    spectra: k of them, whose sum Σ_k value_k · spectrum_k is the body colour, in place of that of the reflectance.
    Without spectra three values are linear R, G, B, which become spectra by `upsampled`, and one is a grey; more need
    spectra. Values that are no colours have spectra (). Images lie on the UVs of the mesh, or of the shape (Mitsuba's),
    their first row at v = 1, and repeat beyond 0…1. smooth: whether values between the middles of pixels are
    interpolated. tiles: how many images of UDIM it was laid together from, across and up. `InputError` for values that
    are negative or not finite, and for images that are too large.

    >>> checker = hg.SurfaceTexture([[1.0, 0.2], [0.2, 1.0]], smooth=False)
    >>> checker.values.shape, checker.spectra[0].at([550.0]).tolist()
    ((2, 2, 1), [1.0])
    """

    values: NDArray[np.float32]
    spectra: tuple[Spectrum, ...]
    of: str
    smooth: bool
    name: str
    tiles: tuple[int, int]

    def __init__(
        self,
        values: ArrayLike,
        spectra: Sequence[Spectrum] | None = None,
        of: str = "image",
        smooth: bool = True,
        name: str = "texture",
        tiles: tuple[int, int] = (1, 1),
    ) -> None:
        if of not in KINDS:
            raise InputError(f"{name}: a texture is of {of!r:.40}: give one of {', '.join(KINDS)}")
        numbers = _numbers(values, of, name)
        if spectra is None and numbers.shape[-1] == 3 and not np.ptp(numbers, axis=-1).any():
            numbers = numbers[..., :1]  # all grey
        chosen = _spectra(numbers.shape[-1], name) if spectra is None else tuple(spectra)
        if chosen and len(chosen) != numbers.shape[-1]:
            raise InputError(
                f"{name} has {numbers.shape[-1]} values a place and {len(chosen)} spectra: give one for each value"
            )
        numbers = np.ascontiguousarray(numbers)
        numbers.flags.writeable = False
        keep = object.__setattr__
        made = {"values": numbers, "spectra": chosen, "of": of, "smooth": smooth, "name": name, "tiles": tiles}
        for key, value in made.items():
            keep(self, key, value)

    def __repr__(self) -> str:
        """The name, the size and the number of values of a place."""
        size = " × ".join(str(side) for side in self.values.shape[:-1][::-1])
        return f"SurfaceTexture({self.name!r}, {size}, {self.values.shape[-1]} values)"

    @classmethod
    def from_file(
        cls,
        path: str | Path | ImageOfParts,
        spectra: Sequence[Spectrum] | None = None,
        smooth: bool = True,
        colour: bool = True,
    ) -> SurfaceTexture:
        """The image in a PNG, JPEG, TIFF, EXR or Radiance file, whose alpha is not taken.

        Of 8 or 16 bits, R, G, B without `spectra` are sRGB and are decoded; other values are linear, 0…1. colour:
        False takes no colours, but the first channel, linear. `InputError` for a damaged file, or another one.
        """
        numbers, encoded = _read(path)
        if colour and spectra is None:
            numbers = srgb_decode(255.0 * numbers) if encoded else numbers
        elif not colour:
            numbers = numbers[..., :1]
        return cls(numbers, spectra, smooth=smooth, name=str(path), tiles=_tiles(path))

    @classmethod
    def normals_from_file(
        cls, path: str | Path | ImageOfParts, smooth: bool = True, directx: bool = False
    ) -> SurfaceTexture:
        """An image of normals, (normal + 1) / 2 in R, G, B, linear. directx: green counts against v, and is turned.

        `InputError` for a damaged file, and for one of a single channel.
        """
        numbers, _ = _read(path)
        if numbers.shape[-1] != 3:
            raise InputError(f"{path} has one channel: an image of normals has R, G and B; heights are a bump_texture")
        if directx:
            numbers[..., 1] = 1.0 - numbers[..., 1]
        return cls(numbers, (), smooth=smooth, name=str(path), tiles=_tiles(path))

    def between(self, first: float, last: float) -> SurfaceTexture:
        """The first value v of each place as first + (last − first) v, without spectra: half widths γ [rad], say."""
        low, high = np.float32(first), np.float32(last)
        values = low + (high - low) * self.values[..., :1]
        return SurfaceTexture(values, of=self.of, smooth=self.smooth, name=self.name, tiles=self.tiles)

    def brightest(self) -> float:
        """The largest value of the sum Σ value_k · spectrum_k, anywhere, at any wavelength; a bound of it, up to 1."""
        flat = self.values.reshape(-1, self.values.shape[-1])
        knots = np.unique(np.concatenate([spectrum.wavelengths for spectrum in self.spectra]))
        basis = np.unique(np.array([spectrum.at(knots) for spectrum in self.spectra], np.float32), axis=1)
        bound = float((flat.max(axis=0) @ np.maximum(basis, 0.0)).max())
        if bound <= 1.0 + 1e-6:
            return min(bound, 1.0)
        starts = range(0, len(flat), TEXELS_AT_ONCE)
        tops = [max(float((flat[s : s + TEXELS_AT_ONCE] @ b).max()) for s in starts) for b in basis.T]
        return max(tops)

    def purest(self) -> list[Spectrum]:
        """The body colours of the places where each of the spectra exceeds the others most."""
        flat = self.values.reshape(-1, self.values.shape[-1])
        knots = np.unique(np.concatenate([spectrum.wavelengths for spectrum in self.spectra]))
        basis = np.array([spectrum.at(knots) for spectrum in self.spectra])
        places = [int(np.argmax(2.0 * flat[:, k] - flat.sum(axis=1))) for k in range(flat.shape[1])]
        return [Spectrum(knots, flat[place].astype(np.float64) @ basis) for place in places]

    def record(self) -> dict[str, object]:
        """What metadata say of it: not the values themselves."""
        size, channels = self.values.shape[:-1][::-1], self.values.shape[-1]
        return {
            "name": self.name, "of": self.of, "size": list(size), "values": channels, "smooth": self.smooth,
            "spectra": [spectrum.record() for spectrum in self.spectra],
        }  # fmt: skip


def _spectra(count: int, name: str) -> tuple[Spectrum, ...]:
    if count == 1:
        return (Spectrum.constant(1.0),)
    if count == 3:
        return tuple(upsampled(row) for row in np.eye(3))
    raise InputError(f"{name} has {count} values a place: give 1 (grey) or 3 (R, G, B), or as many spectra")


def _numbers(values: ArrayLike, of: str, name: str) -> NDArray[np.float32]:
    """(height, width, k) or (n, k)."""
    places = 2 if of == "image" else 1
    try:
        given = np.asarray(values)
        if given.dtype.kind not in "biuf":
            raise TypeError(given.dtype)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: a texture must hold numbers") from error
    shape = given.shape
    if len(shape) not in (places, places + 1) or 0 in shape:
        size = " × ".join(map(str, shape)) or "one number"
        wanted = "(height, width) or (height, width, values)" if of == "image" else "(vertices,) or (vertices, values)"
        raise InputError(f"{name} is {size}: give {wanted}")
    count, each = math.prod(shape[:places]), shape[places] if len(shape) > places else 1
    if count > MOST_TEXELS or each > MOST_SPECTRA:
        raise InputError(f"{name} has {count} places of {each} values: {MOST_TEXELS} of {MOST_SPECTRA} are possible")
    require(BYTES_PER_NUMBER * count * each, name)
    with np.errstate(over="ignore"):
        numbers = np.array(given, np.float32).reshape(*shape[:places], each)
    wrong = ~((numbers >= 0.0) & (numbers <= LARGEST_VALUE))
    if wrong.any():
        first = np.argwhere(wrong)[0]
        where = f"row {first[0]}, column {first[1]}" if of == "image" else f"vertex {first[0]}"
        value = numbers[tuple(first)]
        raise InputError(
            f"{name} has {int(wrong.sum())} values outside 0…{LARGEST_VALUE:g}, first {value:.4g} in {where}: mend it"
        )
    return numbers


def _tiles(path: ImagePlace) -> tuple[int, int]:
    return (1, 1) if isinstance(path, (str, Path)) else path.grid


def _read(path: ImagePlace) -> tuple[NDArray[np.float32], bool]:
    """(height, width, channels) without alpha, and whether they are encoded for displays, where they are colours."""
    if not isinstance(path, (str, Path)):
        return path.read(_read)
    with existing_file(path).open("rb") as file:
        start = file.read(16)
    if start.startswith(STARTS):
        return read_hdr(path), False
    if start.startswith(MAGIC):
        channels, _ = read_exr(path)
        names = "RGB" if all(name in channels for name in "RGB") else "Y" if "Y" in channels else ""
        if not names:
            raise InputError(f"{path} has the channels {', '.join(channels)[:80]}: a texture has R, G and B, or Y")
        return np.stack([channels[name] for name in names], axis=-1), False
    stored = read_picture(path)
    whole = stored.reshape(*stored.shape[:2], -1)
    kept = whole[..., : 3 if whole.shape[-1] >= 3 else 1]
    require(BYTES_PER_NUMBER * kept.size, str(path))
    return kept.astype(np.float32) / np.float32(np.iinfo(stored.dtype).max), True
