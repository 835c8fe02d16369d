"""Spectral EXR, by the layout of Fichet et al. (2021): a channel per wavelength, S0 for light, T for reflectance.

Channels are named S0.550,000000nm; the header has spectralLayoutVersion and, for light, emissiveUnits. Polarisation
(S1 to S3) and bispectral channels are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.image.picture.image import Image
from hagoromo.light.colour import colour_matching, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum

CHANNEL = re.compile(
    r"(S0|T)\.(\d*,?\d+(?:[Ee][+-]?\d+)?|\d+,)(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)"
)  # Fichet et al. (2021), section 3
SCALES = {
    None: 1.0, "Y": 1e24, "Z": 1e21, "E": 1e18, "P": 1e15, "T": 1e12, "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "da": 1e1,
    "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
LIGHT_SPEED = 299_792_458.0  # m/s
VERSION = "1.0"
UNITS = "W.m^-2.sr^-1.nm^-1"
WAVELENGTHS = tuple(range(400, 701, 10))  # nm


@dataclass(frozen=True, eq=False)
class SpectralPicture:
    """values: (height, width, wavelengths); wavelengths [nm], rising; is_light: radiance, else reflectance."""

    values: NDArray[np.float32]
    wavelengths: NDArray[np.float64]
    is_light: bool

    def linear_srgb(self) -> NDArray[np.float64]:
        """Linear sRGB (height, width, 3): of light, Y = 1 where the radiance is 1; of reflectance, under D65.

        Between wavelengths values are linear; beyond the first and the last there is none.
        """
        lamp = Spectrum.constant(1.0) if self.is_light else Spectrum.named("D65")
        fine = np.arange(np.ceil(self.wavelengths[0]), np.floor(self.wavelengths[-1]) + 0.5)
        tents = np.stack([np.interp(fine, self.wavelengths, row) for row in np.eye(len(self.wavelengths))])
        curves = np.stack([curve.at(fine) for curve in colour_matching()]) * lamp.at(fine)
        everywhere = np.arange(360.0, 831.0)
        white = np.sum(colour_matching()[1].at(everywhere) * lamp.at(everywhere))
        return srgb_from_xyz(self.values.astype(np.float64) @ (tents @ curves.T / white))


def spectral_picture(image: Image, wavelengths: Sequence[float] = WAVELENGTHS) -> SpectralPicture:
    """Spectral radiance of a rendered image at `wavelengths` [nm], in the unit of its lamps' spectra over π sr.

    L(λ) = Σ_k E_k(λ) Σ_j w_kj c_j(λ), with the weights w of lamp group k and the palette's spectra E and c.
    """
    at = np.asarray(wavelengths, float)
    palette = image.palette
    colours = np.stack([colour.at(at) for colour in palette.colours])
    spectra = np.concatenate([lamp.at(at) * colours for lamp in palette.lamps])
    return SpectralPicture((image.weights @ spectra.astype(np.float32)).astype(np.float32), at, True)


def write_spectral_exr(path: str | Path, picture: SpectralPicture, half: bool = False) -> None:
    """Write a spectral picture, with its linear sRGB as R, G, B for programs that know no spectra."""
    kind = "S0" if picture.is_light else "T"
    channels = {
        f"{kind}.{wavelength:.6f}nm".replace(".", ",").replace(f"{kind},", f"{kind}."): picture.values[..., k]
        for k, wavelength in enumerate(picture.wavelengths)
    }
    rgb = picture.linear_srgb()
    channels |= {name: rgb[..., k].astype(np.float32) for k, name in enumerate("RGB")}
    header = {"spectralLayoutVersion": VERSION} | ({"emissiveUnits": UNITS} if picture.is_light else {})
    write_exr(path, channels, header, half)


def is_spectral(channels: Mapping[str, object]) -> bool:
    """Whether the channels of an EXR are those of a spectral picture."""
    return any(CHANNEL.fullmatch(name) for name in channels)


def read_spectral_exr(path: str | Path) -> SpectralPicture:
    """The spectral picture in an EXR; of one with light and reflectance its light. `InputError` where it has none."""
    return spectral_of_channels(read_exr(path)[0], str(path))


def spectral_of_channels(channels: Mapping[str, NDArray[np.float32]], where: str) -> SpectralPicture:
    """The spectral picture of the channels of an EXR."""
    found = {name: CHANNEL.fullmatch(name) for name in channels}
    kinds = {match[1] for match in found.values() if match}
    if not kinds:
        raise InputError(f"{where} has no spectral channels (S0.550,000000nm or T.550,000000nm): give a spectral EXR")
    kind = "S0" if "S0" in kinds else "T"
    at = {_nanometres(match, where): name for name, match in found.items() if match and match[1] == kind}
    if len(at) != sum(1 for match in found.values() if match and match[1] == kind):
        raise InputError(f"{where} has two channels of one wavelength: it is damaged")
    waves = np.array(sorted(at))
    if len(waves) < 2:
        raise InputError(f"{where} has one wavelength: a spectrum has two or more")
    return SpectralPicture(np.stack([channels[at[wave]] for wave in waves], axis=-1), waves, kind == "S0")


def _nanometres(match: re.Match[str], where: str) -> float:
    number = float(match[2].replace(",", ".")) * SCALES[match[3]]
    length = number if match[4] == "m" else LIGHT_SPEED / number if number else 0.0
    if not 1e-8 <= length <= 1e-3:
        raise InputError(f"{where} has the channel {match[0][:40]}, which is no wavelength of light")
    return round(1e9 * length, 6)
