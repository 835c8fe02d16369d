"""Development of a viewer's picture: weights → linear sRGB, balanced to a white, exposed, through a tone curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_white, srgb_from_camera
from hagoromo.image.image import Image, auto_exposure
from hagoromo.light.colour import srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo_page.viewer.view_state import ViewTransform

SHOULDER = 0.8  # linear value from which the curve "shoulder" compresses; it reaches 1 at infinity


def linear_picture(image: Image, development: ViewTransform, response: Response | None) -> NDArray[np.float64]:
    """Linear sRGB (height, width, 3) in which the chosen white is (1, 1, 1), through the camera's `response` if given.

    Without a response, and for one of other than three channels, by the eye of the CIE 1931 observer.
    """
    first = image.palette.lamps[0]
    white = first if development.white == "first lamp" else Spectrum.named(development.white)
    if response is not None and len(response.channels) == 3:
        return image.expose(response) @ srgb_from_camera(response, white).T
    observer = Response.load("cie1931")
    xyz = image.expose(observer) / camera_white(white, observer)
    return srgb_from_xyz(xyz * WHITE_XYZ)


def metered(image: Image, development: ViewTransform, response: Response | None) -> float:
    """Factor that exposes the picture as `Image.display` does."""
    return auto_exposure(linear_picture(image, development, response), image.alpha)


def toned(linear: NDArray[np.float64], development: ViewTransform, factor: float) -> NDArray[np.uint8]:
    """Display values of a linear picture: exposed, through the tone curve."""
    linear = linear * (factor * 2.0**development.stops)
    return srgb_encode(shoulder(linear) if development.tone == "shoulder" else linear)


def shoulder(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values above SHOULDER compressed to below 1, with its slope of 1 there: bright colours keep their drawing."""
    above = np.maximum(linear - SHOULDER, 0.0) / (1.0 - SHOULDER)
    return np.where(linear > SHOULDER, SHOULDER + (1.0 - SHOULDER) * above / (1.0 + above), linear)
