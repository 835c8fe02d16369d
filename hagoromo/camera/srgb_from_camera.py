"""The matrix from the values of a camera to linear sRGB."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, camera_response, camera_white
from hagoromo.errors import InputError
from hagoromo.light.colour import srgb_from_xyz
from hagoromo.light.spectrum import Spectrum

WHITE_XYZ = np.array([0.95047, 1.0, 1.08883])  # XYZ of D65, the display's white


@lru_cache(maxsize=32)
def srgb_from_camera(response: Response, lamp: Spectrum) -> NDArray[np.float64]:
    """(3, 3): camera values ρ of eq. (10) under `lamp` → linear sRGB with the lamp as white (1, 1, 1).

    Least squares over the 24 spectra of a ColorChecker; the lamp's own colour is exact. `InputError` for a channel that
    reads no light of the lamp.
    """
    import colour

    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    patches = [Spectrum(patch.wavelengths, patch.values) for patch in chart]
    observer, ones = Response.load("cie1931"), camera_white(lamp, response)
    if not np.all(ones > 0.0):
        blind = [channel for channel, white in zip(response.channels, ones, strict=True) if not white > 0.0]
        raise InputError(f"channel {', '.join(blind)} has no response to this lamp: check curves and spectrum")
    measured = np.array([camera_response(patch, lamp, response) / ones for patch in patches])
    xyz = np.array([camera_response(patch, lamp, observer) / camera_white(lamp, observer) for patch in patches])
    wanted = srgb_from_xyz(xyz * WHITE_XYZ)
    # rows sum to 1: M = [a, b, 1 − a − b]
    basis = measured[:, :2] - measured[:, 2:]
    rows = np.linalg.lstsq(basis, wanted - measured[:, 2:], rcond=None)[0].T
    return np.concatenate([rows, 1.0 - rows.sum(axis=1, keepdims=True)], axis=1) / ones
