"""Display: camera values as sRGB pictures, and pictures as text for an HTML page."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.light.colour import srgb_encode
from hagoromo.photograph.photograph import DISPLAY_KEY

JPEG_QUALITY = 92


def exposure(linear: ArrayLike, alpha: ArrayLike | None = None) -> float:
    """Factor that brings the 99.5th percentile of the brightest channel, where there is matter, to DISPLAY_KEY."""
    linear = np.asarray(linear)
    pixels = linear.reshape(-1, linear.shape[-1]) if alpha is None else linear[np.asarray(alpha) > 0.5]
    bright = float(np.percentile(pixels.max(axis=-1), 99.5)) if pixels.size else 0.0
    return DISPLAY_KEY / bright if bright > 0.0 else 1.0


def data_uri(picture: NDArray[np.uint8], lossless: bool = False, quality: int = JPEG_QUALITY) -> str:
    """`picture` (height, width[, 3]) as the text of a JPEG, or PNG where `lossless`, that an <img> shows."""
    import cv2

    suffix = ".png" if lossless else ".jpg"
    settings = [] if lossless else [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, encoded = cv2.imencode(suffix, picture[..., ::-1] if picture.ndim == 3 else picture, settings)
    return f"data:image/{'png' if lossless else 'jpeg'};base64,{base64.b64encode(encoded.tobytes()).decode()}"


def shown(values: ArrayLike, matrix: NDArray[np.float64], scale: float) -> NDArray[np.uint8]:
    """Camera values (height, width, 3) as an sRGB picture: matrix of `srgb_from_camera`, exposed by `scale`."""
    return srgb_encode(np.asarray(values) @ matrix.T * scale)
