"""BodyBasis: the spectra that a body colour known as camera values is a sum of, so that it shines under other lamps.

Of all spectra that the camera reads as it did, the one that is likeliest among measured surfaces, brightness left free:
B = S Mᵀ (M S Mᵀ)⁻¹, M the readings relative to white and S the mean of r rᵀ over surfaces r of mean 1. M B = 1: under
the lamp of the photographs the camera's values come back exactly.
Pratt and Mancill 1976, "Spectral estimation techniques for the spectral calibration of a color image scanner".
"""

from __future__ import annotations

import numpy as np

from hagoromo.camera.response import Response
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, surfaces
from hagoromo.reflectance.spectra.spectrum_estimate import reading_matrix

DETAIL = 1e-4  # variance of detail that no surface has, of a spectrum of mean 1: keeps the inverse tame


def body_basis(response: Response | None, lamp: Spectrum) -> tuple[Spectrum, ...]:
    """A spectrum per channel of `response` under `lamp`; `smooth_rgb_basis` where no response is known.

    Single spectra may be below 0; their sum for a colour of a surface is not, or hardly.
    """
    if response is None:
        return smooth_rgb_basis()
    shapes = surfaces() / surfaces().mean(axis=1, keepdims=True)
    spread = shapes.T @ shapes / len(shapes) + DETAIL * np.eye(len(WAVELENGTHS))
    matrix = reading_matrix(lamp, response)
    columns = spread @ matrix.T @ np.linalg.inv(matrix @ spread @ matrix.T)
    return tuple(Spectrum(WAVELENGTHS, column) for column in columns.T)
