"""BodyBasis: basis spectra of a body colour that is known as camera values, so that it can be rendered under any lamp.

Of all spectra with the same camera values, the most likely one among measured surfaces, at any brightness:
B = S Mᵀ (M S Mᵀ)⁻¹, M the readings relative to white and S the mean of r rᵀ over surfaces r of mean 1. M B = 1: under
the lamp of the photographs the camera's values are reproduced exactly.
Pratt and Mancill 1976, "Spectral estimation techniques for the spectral calibration of a color image scanner".
"""

from __future__ import annotations

import numpy as np

from hagoromo.camera.response import Response
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, surfaces
from hagoromo.reflectance.spectra.spectrum_estimate import reading_matrix

DETAIL = 1e-4  # variance added to S, for spectra of mean 1: keeps the inverse well conditioned


def body_basis(response: Response | None, lamp: Spectrum) -> tuple[Spectrum, ...]:
    """A basis spectrum per channel of `response` under `lamp`; `smooth_rgb_basis` without a response.

    Single basis spectra may be negative; their sum for the colour of a surface is practically never.
    """
    if response is None:
        return smooth_rgb_basis()
    shapes = surfaces() / surfaces().mean(axis=1, keepdims=True)
    spread = shapes.T @ shapes / len(shapes) + DETAIL * np.eye(len(WAVELENGTHS))
    matrix = reading_matrix(lamp, response)
    columns = spread @ matrix.T @ np.linalg.inv(matrix @ spread @ matrix.T)
    return tuple(Spectrum(WAVELENGTHS, column) for column in columns.T)
