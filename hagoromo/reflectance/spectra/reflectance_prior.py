"""ReflectancePrior: the prior of a surface's spectrum, a mixture of Gaussians over spectra of mean 1.

Learnt from measured spectra, or from draws of a physical family: about each spectrum a narrow and a wide Gaussian,
with the covariance of its neighbourhood. Or defined by smoothness alone. The brightness is free.

Families of surfaces that are drawn from the physics of their colour: dyed textiles, paints, human skin.

No measured spectrum is in them. The ranges are choices of this package, wide on purpose, and no table of a source.
Each draw is a spectrum (wavelengths,) on `WAVELENGTHS`, from the mixing law of Kubelka & Munk 1931,
R∞ = 1 + q − √(q² + 2q) with q = K/S, seen through the surface as Saunderson 1942 states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.reflectance.pigment import Pigment, skin_colour
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, read_spectra, surfaces

# Of the mixture; chosen so that 95 % bands hold 95 % of measured spectra of sets of data that were kept out whole.
NEIGHBOURS = 20
SPREAD = 0.5  # variance of a Gaussian, in units of its neighbours' mean squared distance along each direction
COMMON = 0.03  # share of it along the principal directions of all spectra
FINE = 0.002  # standard deviation of white detail that no neighbour has, of a spectrum of mean 1
# How likely it is before the readings that a surface is of one drawn family, or smooth and no more, over measured ones.
ODDS_OF_DRAWN = 1.0 / 6.0
# Of the narrow and the wide Gaussian about a spectrum: factor of `SPREAD`, and standard deviations of the ends of the
# spectrum, where few cameras look and dyes open up, and of smooth detail that no neighbour has.
PARTS = ((1.0, 0.0, 0.0), (3.0, 1.0, 0.1))
UNLIKE_CLASS, UNLIKE_SURFACES = 0.15, 0.3  # weight of the wide Gaussians: of one class of surfaces, of all surfaces
RED_END, VIOLET_END = (700.0, 25.0), (400.0, 15.0)  # centre and width of the ends [nm]
VIOLET_SHARE = 0.1  # of the variance of the red end
DETAIL_WIDTH = 20.0  # [nm] correlation length of smooth detail
MODEL_ERROR = 0.025  # standard deviation of smooth detail that a drawn family lacks
FEWEST = 4  # spectra
SMOOTH_HEIGHTS = (0.05, 0.2, 0.6)  # standard deviations of the smooth prior, for spectra of mean 1
SMOOTH_WIDTHS = (30.0, 80.0)  # [nm] correlation lengths of the smooth prior
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


@dataclass(frozen=True, eq=False)
class ReflectancePrior:
    """A mixture over the shape of a spectrum on `WAVELENGTHS`.

    centres: (parts, wavelengths), of mean 1. covariances: (parts, wavelengths, wavelengths), positive definite.
    weights: (parts,), of sum 1; None: all alike. odds: how likely the class is before the readings, over another of 1.
    """

    name: str
    centres: NDArray[np.float64]
    covariances: NDArray[np.float64]
    weights: NDArray[np.float64] | None = None
    odds: float = 1.0

    @property
    def log_weights(self) -> NDArray[np.float64]:
        """ln of the weight of each part (parts,)."""
        count = len(self.centres)
        return np.log(np.full(count, 1.0 / count) if self.weights is None else self.weights)

    @staticmethod
    def from_spectra(
        name: str, spectra: ArrayLike, unlike: float = UNLIKE_CLASS, model_error: float = 0.0, odds: float = 1.0
    ) -> ReflectancePrior:
        """Learnt from `spectra` (n, wavelengths) on `WAVELENGTHS`, four or more, none of them black.

        unlike: weight of surfaces that are less like the spectra than these are like each other, 0…1: larger where they
        are a sample of many classes. model_error: standard deviation of smooth detail that the spectra lack, of mean 1;
        0 for measured ones. odds: see the class.
        """
        measured = np.asarray(spectra, np.float64)
        if measured.ndim != 2 or measured.shape[1] != len(WAVELENGTHS) or len(measured) < FEWEST:
            shape = f"({FEWEST} or more, {len(WAVELENGTHS)})"
            raise InputError(f"prior {name!r} is learnt from spectra of shape {shape}: given {measured.shape}")
        if not np.isfinite(measured).all() or (measured.mean(axis=1) <= 0.0).any():
            raise InputError(f"prior {name!r} has a spectrum that is black or not finite: remove it")
        centres = measured / measured.mean(axis=1, keepdims=True)
        distance = np.sum((centres[:, None] - centres) ** 2, axis=2)
        nearest = np.argsort(distance, axis=1, kind="stable")[:, 1 : NEIGHBOURS + 1]
        away = centres[nearest] - centres[:, None]
        local = np.einsum("nka,nkb->nab", away, away) / nearest.shape[1]
        spread = SPREAD * ((1.0 - COMMON) * local + COMMON * np.cov(centres.T))
        parts = [wide * spread + _unshared(ends, np.hypot(detail, model_error)) for wide, ends, detail in PARTS]
        weights = np.repeat([(1.0 - unlike) / len(centres), unlike / len(centres)], len(centres))
        return ReflectancePrior(name, np.concatenate([centres] * len(PARTS)), np.concatenate(parts), weights, odds)

    @staticmethod
    def load(source: str | Path) -> ReflectancePrior:
        """By name, or learnt from a CSV file (see `read_spectra`).

        Names: "surfaces" (see `surfaces`), "smooth", and the families "skin", "textile" and "pigment", which are drawn
        from the physics of their colour over ranges of our choice (`family`), without any measured spectrum.
        """
        if str(source).lower().endswith(".csv"):
            return ReflectancePrior.from_spectra(Path(source).stem, read_spectra(source))
        if source == "surfaces":
            return _surfaces()
        if source == "smooth":
            return _smooth()
        if source in FAMILIES:
            return _family(str(source))
        known = ", ".join(PRIORS)
        raise InputError(f"no prior of reflectance is called {str(source)!r}: give {known} or a CSV file")


@cache
def _family(name: str) -> ReflectancePrior:
    return ReflectancePrior.from_spectra(name, family(name), UNLIKE_SURFACES, MODEL_ERROR, ODDS_OF_DRAWN)


def _unshared(ends: float, detail: float) -> NDArray[np.float64]:
    """Covariance (wavelengths, wavelengths) of what neighbours do not share: the ends, and detail."""
    red, violet = (np.exp(-0.5 * ((WAVELENGTHS - at) / width) ** 2) for at, width in (RED_END, VIOLET_END))
    kernel = ends**2 * (np.outer(red, red) + VIOLET_SHARE * np.outer(violet, violet))
    kernel += detail**2 * np.exp(-0.5 * ((WAVELENGTHS[:, None] - WAVELENGTHS) / DETAIL_WIDTH) ** 2)
    return kernel + FINE**2 * np.eye(len(WAVELENGTHS))


@cache
def _surfaces() -> ReflectancePrior:
    return ReflectancePrior.from_spectra("surfaces", surfaces(), UNLIKE_SURFACES)


@cache
def _smooth() -> ReflectancePrior:
    off = WAVELENGTHS[:, None] - WAVELENGTHS
    kernels = [h**2 * np.exp(-0.5 * (off / width) ** 2) for h in SMOOTH_HEIGHTS for width in SMOOTH_WIDTHS]
    narrow = np.array(kernels) + FINE**2 * np.eye(len(WAVELENGTHS))
    wide = np.array(kernels) + _unshared(PARTS[-1][1], 0.0)  # dyes open up at the red end
    weights = np.repeat([(1.0 - UNLIKE_SURFACES) / len(kernels), UNLIKE_SURFACES / len(kernels)], len(kernels))
    centres = np.ones((2 * len(kernels), len(WAVELENGTHS)))
    return ReflectancePrior("smooth", centres, np.concatenate([narrow, wide]), weights, ODDS_OF_DRAWN)


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
PRIORS = ("surfaces", "smooth", *FAMILIES)  # names that `ReflectancePrior.load` knows
