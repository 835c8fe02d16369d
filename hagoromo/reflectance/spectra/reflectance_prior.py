"""ReflectancePrior: the prior of a surface's spectrum, a mixture of Gaussians over spectra of mean 1.

Learnt from measured spectra: one Gaussian per spectrum, with the covariance of its neighbourhood. Or defined by
smoothness alone. The brightness is free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, read_spectra, surfaces

# Of the mixture; chosen so that 95 % regions hold 95 % of measured spectra that were excluded from the prior.
NEIGHBOURS = 20
SPREAD = 0.5  # variance of a Gaussian, in units of its neighbours' mean squared distance along each direction
COMMON = 0.03  # share of it along the principal directions of all spectra
FINE = 0.002  # standard deviation of detail that no neighbour has, of a spectrum of mean 1
FEWEST = 4  # spectra
SMOOTH_HEIGHTS = (0.05, 0.2, 0.6)  # standard deviations of the smooth prior, for spectra of mean 1
SMOOTH_WIDTHS = (30.0, 80.0)  # [nm] correlation lengths of the smooth prior


@dataclass(frozen=True, eq=False)
class ReflectancePrior:
    """A mixture, all parts of one weight, over the shape of a spectrum on `WAVELENGTHS`.

    centres: (parts, wavelengths), of mean 1. covariances: (parts, wavelengths, wavelengths), positive definite.
    """

    name: str
    centres: NDArray[np.float64]
    covariances: NDArray[np.float64]

    @staticmethod
    def from_spectra(name: str, spectra: ArrayLike) -> ReflectancePrior:
        """Learnt from `spectra` (n, wavelengths) on `WAVELENGTHS`, four or more, none of them black."""
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
        return ReflectancePrior(name, centres, spread + FINE**2 * np.eye(len(WAVELENGTHS)))

    @staticmethod
    def load(source: str | Path) -> ReflectancePrior:
        """By name, "surfaces" (see `surfaces`) or "smooth", or learnt from a CSV file (see `read_spectra`)."""
        if str(source).lower().endswith(".csv"):
            return ReflectancePrior.from_spectra(Path(source).stem, read_spectra(source))
        if source == "surfaces":
            return _surfaces()
        if source == "smooth":
            return _smooth()
        raise InputError(f"no prior of reflectance is called {str(source)!r}: give surfaces, smooth or a CSV file")


@cache
def _surfaces() -> ReflectancePrior:
    return ReflectancePrior.from_spectra("surfaces", surfaces())


@cache
def _smooth() -> ReflectancePrior:
    off = WAVELENGTHS[:, None] - WAVELENGTHS
    kernels = [h**2 * np.exp(-0.5 * (off / width) ** 2) for h in SMOOTH_HEIGHTS for width in SMOOTH_WIDTHS]
    covariances = np.array(kernels) + FINE**2 * np.eye(len(WAVELENGTHS))
    return ReflectancePrior("smooth", np.ones((len(kernels), len(WAVELENGTHS))), covariances)
