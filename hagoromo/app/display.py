"""Display: what a camera recorded, as people see it, and pictures as text that fits into an HTML page."""

from __future__ import annotations

import base64
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.camera.response import Response, camera_response, camera_white
from hagoromo.light.colour import srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.photograph import DISPLAY_KEY

JPEG_QUALITY = 92
WHITE_XYZ = np.array([0.95047, 1.0, 1.08883])  # XYZ of D65, the display's white


@lru_cache(maxsize=32)
def srgb_from_camera(response: Response, lamp: Spectrum) -> NDArray[np.float64]:
    """(3, 3): camera values ρ of eq. (10) under `lamp` → linear sRGB with the lamp as white (1, 1, 1).

    Least squares over the 24 spectra of a ColorChecker, with the lamp's own colour kept exact.
    """
    import colour

    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    patches = [Spectrum(patch.wavelengths, patch.values) for patch in chart]
    observer, ones = Response.load("cie1931"), camera_white(lamp, response)
    readings = np.array([camera_response(patch, lamp, response) / ones for patch in patches])
    xyz = np.array([camera_response(patch, lamp, observer) / camera_white(lamp, observer) for patch in patches])
    wanted = srgb_from_xyz(xyz * WHITE_XYZ)
    # rows sum to 1: M = [a, b, 1 − a − b]
    basis = readings[:, :2] - readings[:, 2:]
    rows = np.linalg.lstsq(basis, wanted - readings[:, 2:], rcond=None)[0].T
    return np.concatenate([rows, 1.0 - rows.sum(axis=1, keepdims=True)], axis=1) / ones


def exposure(linear: ArrayLike, alpha: ArrayLike | None = None) -> float:
    """Factor that brings the 99.5th percentile of the brightest channel, where there is matter, to DISPLAY_KEY."""
    linear = np.asarray(linear)
    pixels = linear.reshape(-1, linear.shape[-1]) if alpha is None else linear[np.asarray(alpha) > 0.5]
    bright = float(np.percentile(pixels.max(axis=-1), 99.5)) if pixels.size else 0.0
    return DISPLAY_KEY / bright if bright > 0.0 else 1.0


def data_uri(picture: NDArray[np.uint8], lossless: bool = False) -> str:
    """`picture` (height, width[, 3]) as the text of a JPEG, or PNG where `lossless`, that an <img> shows."""
    import cv2

    suffix = ".png" if lossless else ".jpg"
    settings = [] if lossless else [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, encoded = cv2.imencode(suffix, picture[..., ::-1] if picture.ndim == 3 else picture, settings)
    return f"data:image/{'png' if lossless else 'jpeg'};base64,{base64.b64encode(encoded.tobytes()).decode()}"


def shown(values: ArrayLike, matrix: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """Camera values (height, width, 3) as an sRGB picture: matrix of `srgb_from_camera`, exposed by `scale`."""
    return srgb_encode(np.asarray(values) @ matrix.T * scale)
