"""Pigment: the body colour of skin from its melanin and blood, with a model of two layers.

Enters: a `Pigment`, volume fractions; leaves: a Spectrum, the diffuse reflectance of skin without surface reflection.
The epidermis absorbs only (Claridge et al. 2003); the dermis under it is thick and scatters (Kubelka & Munk 1931).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta

from hagoromo.files.record import Fraction, Record, about, decode
from hagoromo.light.spectrum import Spectrum

EPIDERMIS = 60e-4  # thickness [cm]; Whitton & Everall 1973 measure 37–84 µm away from palms and soles
VESSEL = 30e-4  # diameter of the small vessels that hold the blood [cm]; those of the upper plexus have 10–50 µm
INDEX = 1.4  # refractive index of skin; Jacques 2013
GRAMS, MOLAR_MASS = 150.0, 64_500.0  # haemoglobin in a litre of whole blood [g/l], and its molar mass [g/mol]; Prahl
# molar extinction of haemoglobin [1/(cm mol/l)]: nm, with oxygen, without; excerpt of Prahl's table (omlc.org/spectra/
# hemoglobin), compiled from measurements of Gratzer and of Kollias
HAEMOGLOBIN = (
    (380, 109564, 145232), (390, 167748, 167780), (400, 266232, 223296), (410, 466840, 303956), (414, 524280, 342596),
    (420, 480360, 407560), (430, 246072, 528600), (434, 165332, 552160), (440, 102580, 413280), (444, 81444, 282724),
    (450, 62816, 103292), (454, 53552, 36170), (460, 44480, 23389), (470, 33209, 16156), (480, 26629, 14550),
    (490, 23684, 16684), (500, 20933, 20862), (510, 20035, 25774), (520, 24202, 31590), (530, 39957, 39036),
    (536, 49752, 43592), (542, 53292, 48148), (550, 43016, 53412), (556, 34477, 54540), (560, 32613, 53788),
    (566, 36495, 48828), (570, 44496, 45072), (576, 55540, 40092), (580, 50104, 37020), (584, 34640, 34333),
    (590, 14401, 28324), (596, 5684, 19800), (600, 3200, 14677), (610, 1506, 9444), (620, 942, 6510),
    (630, 610, 5149), (640, 442, 4345), (650, 368, 3750), (660, 320, 3227), (670, 294, 2795), (680, 278, 2408),
    (690, 276, 2052), (700, 290, 1794), (710, 314, 1540), (720, 348, 1326), (730, 390, 1102),
)  # fmt: skip


class Pigment(NamedTuple):
    """Pigments of skin: volume fractions of melanosomes in the epidermis and of blood in the dermis, and the oxygenated
    share of haemoglobin; the defaults are those of fair skin.

    Melanosomes: 0.013–0.06 in fair, 0.11–0.16 in brown and 0.18–0.43 in dark skin (Jacques 1998).
    """

    melanin: float = 0.015
    blood: float = 0.014
    oxygenation: float = 0.8


class PigmentRecord(Record, frozen=True):
    """A body colour of skin, by its pigments."""

    melanin: Annotated[Fraction, about("volume fraction of melanosomes in the epidermis, 0…1")] = 0.015
    blood: Annotated[float, Meta(ge=0, le=0.2), about("volume fraction of blood in the dermis, 0…0.2")] = 0.014
    oxygenation: Annotated[Fraction, about("share of the haemoglobin that carries oxygen, 0…1")] = 0.8


def skin_colour(pigment: Pigment) -> Spectrum:
    """Diffuse reflectance of skin at 380–730 nm, 0…1, from below the surface, without the interface reflection.

    R = T² R∞, T = exp(−2 μ_e d), R∞ = 1 + K/S − √(K²/S² + 2 K/S), K = 2 μ_d, S = ¾ μ_s′ − ¼ μ_d (Star et al. 1988),
    inside a surface by Saunderson 1942. Values at 380, 390 … 730 nm and at the peaks of haemoglobin.

    >>> pale, dark = (skin_colour(Pigment(melanin=share)).mean() for share in (0.01, 0.2))
    >>> pale > 0.3 > 0.1 > dark
    True
    """
    nm, with_oxygen, without = np.array(HAEMOGLOBIN, float).T
    molar = pigment.oxygenation * with_oxygen + (1.0 - pigment.oxygenation) * without
    blood = np.log(10.0) * molar * GRAMS / MOLAR_MASS  # [1/cm], as all below
    melanin = 6.6e11 * nm**-3.33  # Jacques 1998, "Skin Optics"
    baseline = 0.244 + 85.3 * np.exp(-(nm - 154.0) / 66.2)  # Jacques 1998, skin without melanin and blood
    scattering = 46.0 * (nm / 500.0) ** -1.421  # reduced; Jacques 2013, "Optical properties of biological tissues"
    epidermis = pigment.melanin * melanin + (1.0 - pigment.melanin) * baseline
    dermis = pigment.blood * blood * _packed(blood * VESSEL) + (1.0 - pigment.blood) * baseline
    ratio = 2.0 * dermis / np.fmax(0.75 * scattering - 0.25 * dermis, 1e-3 * scattering)
    deep = 1.0 + ratio - np.sqrt(ratio * ratio + 2.0 * ratio)
    return Spectrum(nm, _through_surface(deep * np.exp(-4.0 * epidermis * EPIDERMIS)))


def pigment_from_record(record: Mapping[str, Any], where: str = "pigment") -> Pigment:
    """A Pigment from a table of some of its fields; `InputError` for fractions outside their range."""
    pigments = decode(record, PigmentRecord, where)
    return Pigment(pigments.melanin, pigments.blood, pigments.oxygenation)


def _packed(depth: Any) -> Any:
    """Absorption of blood in vessels of an optical depth x, relative to evenly spread blood: (1 − e^−x) / x.

    Svaasand 1995.
    """
    return -np.expm1(-depth) / depth


def _through_surface(inside: Any) -> Any:
    """Reflectance through the surface: transmission into the skin and internal reflection (Saunderson 1942)."""
    outer = ((INDEX - 1.0) / (INDEX + 1.0)) ** 2
    inner = 0.668 + 0.0636 * INDEX + 0.710 / INDEX - 1.440 / INDEX**2  # diffuse; Egan & Hilgeman 1979
    return (1.0 - outer) * (1.0 - inner) * inside / (1.0 - inner * inside)
