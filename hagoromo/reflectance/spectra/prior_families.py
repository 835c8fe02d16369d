"""Families of surfaces that are drawn from the physics of their colour: dyed textiles, paints, human skin.

No measured spectrum is in them. The ranges are choices of this package, wide on purpose, and no table of a source.
Each draw is a spectrum (wavelengths,) on `WAVELENGTHS`, from the mixing law of Kubelka & Munk 1931,
R∞ = 1 + q − √(q² + 2q) with q = K/S, seen through the surface as Saunderson 1942 states.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.reflectance.pigment import Pigment, skin_colour
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS

DRAWS = 160  # spectra of a family
ENERGY = 1e7 / WAVELENGTHS  # [1/cm]
# Dyes: broad bands, Gaussian in energy.
DYE_CENTRES = (385.0, 650.0)  # [nm]
DYE_WIDTHS = (1000.0, 3000.0)  # [1/cm]
DYE_STRENGTHS = (0.1, 25.0)  # K/S at the peak, from a tint to a deep shade
MOST_DYES = 3  # of one dyeing: trichromatic mixtures
FIBRE = (0.55, 0.92)  # reflectance of undyed fibre at long wavelengths, from raw wool to bleached cotton
YELLOWING = (0.0, 0.6)  # share of it that is lost at 400 nm, by an exponential of 60 nm
# Paints: an absorption edge (yellow to red), a band (green to violet), or both.
EDGES = (400.0, 640.0)  # [nm] of the absorption edge of yellow, orange and red inorganic pigments
EDGE_WIDTHS = (4.0, 25.0)  # [nm] of its logistic
BANDS = (500.0, 760.0)  # [nm] of the absorption band of green, blue and violet pigments
BAND_WIDTHS = (1200.0, 3500.0)  # [1/cm], standard deviation
PAINT_STRENGTHS = (0.05, 30.0)  # K/S of the absorption, tinted with white or at mass tone
BACKGROUNDS = (0.002, 0.3)  # K/S that is alike at all wavelengths: black, dirt, binder
OUTER, INNER = 0.04, 0.6  # Saunderson 1942: reflection at the surface from outside, and from inside
# Skin: shares of melanosomes and of blood, and its saturation with oxygen, of `Pigment`.
MELANIN, BLOOD, SATURATION = (0.008, 0.43), (0.002, 0.07), (0.4, 0.95)
SEEN_SURFACE = (0.0, 0.05)  # part of the surface's own reflection that is measured with the body
Array = NDArray[Any]


@cache
def family(name: str) -> Array:
    """(DRAWS, wavelengths), 0…1: the family "skin", "textile" or "pigment", the same each time."""
    random = np.random.default_rng(sum(map(ord, name)))
    spectra = np.array([FAMILIES[name](random) for _ in range(DRAWS)])
    spectra.flags.writeable = False
    return spectra


def _textile(random: np.random.Generator) -> Array:
    """Fibre with one to three dyes: K/S of fibre and dyes add."""
    fibre = random.uniform(*FIBRE) * (1.0 - random.uniform(*YELLOWING) * np.exp(-(WAVELENGTHS - 400.0) / 60.0))
    ratio = (1.0 - fibre) ** 2 / (2.0 * fibre)
    for _ in range(random.integers(1, MOST_DYES + 1)):
        ratio = ratio + _between(random, DYE_STRENGTHS) * _band(random, DYE_CENTRES, DYE_WIDTHS)
    return _deep(ratio)


def _pigment(random: np.random.Generator) -> Array:
    """A paint: an absorption edge, a band or both, over a grey background, under a surface."""
    ratio = np.full(len(WAVELENGTHS), _between(random, BACKGROUNDS))
    kind = random.integers(3)
    if kind != 1:
        off = (WAVELENGTHS - random.uniform(*EDGES)) / random.uniform(*EDGE_WIDTHS)
        ratio += _between(random, PAINT_STRENGTHS) / (1.0 + np.exp(np.clip(off, -60.0, 60.0)))
    if kind != 0:
        ratio += _between(random, PAINT_STRENGTHS) * _band(random, BANDS, BAND_WIDTHS)
    inside = _deep(ratio)
    return OUTER + (1.0 - OUTER) * (1.0 - INNER) * inside / (1.0 - INNER * inside)


def _skin(random: np.random.Generator) -> Array:
    pigment = Pigment(_between(random, MELANIN), _between(random, BLOOD), random.uniform(*SATURATION))
    return skin_colour(pigment).at(WAVELENGTHS) + random.uniform(*SEEN_SURFACE)


def _band(random: np.random.Generator, centres: tuple[float, float], widths: tuple[float, float]) -> Array:
    return np.exp(-0.5 * ((ENERGY - 1e7 / random.uniform(*centres)) / random.uniform(*widths)) ** 2)


def _between(random: np.random.Generator, limits: tuple[float, float]) -> float:
    """Log-uniform."""
    return float(np.exp(random.uniform(*np.log(limits))))


def _deep(ratio: Array) -> Array:
    return 1.0 + ratio - np.sqrt(ratio * (ratio + 2.0))  # Kubelka & Munk 1931


FAMILIES: dict[str, Callable[[np.random.Generator], Array]] = {"skin": _skin, "textile": _textile, "pigment": _pigment}
