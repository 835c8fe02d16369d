"""Development of a viewer's picture: weights → linear sRGB, balanced to a white, exposed, through a tone curve."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_white, srgb_from_camera
from hagoromo.files.icc import SRGB
from hagoromo.image.picture.image import Image, auto_exposure
from hagoromo.image.picture.ocio_view import ACES, PROFILES, OcioConfiguration
from hagoromo.image.picture.shown import DisplayTransform, DisplayView
from hagoromo.light.colour import srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo_page.viewer.view_state import TONES, ViewTransform

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
    if development.tone not in TONES:
        return _view(development.ocio, development.tone).numbers(linear)
    return srgb_encode(shoulder(linear) if development.tone == "shoulder" else linear)


@lru_cache(maxsize=8)
def tones(ocio: str) -> tuple[str, ...]:
    """Curves and views that a viewer may choose: those of a display like a browser's, where OpenColorIO is installed.

    ocio: configuration; "": that of ACES. `InputError` for one that cannot be read, or without OpenColorIO.
    """
    if not ocio and find_spec("PyOpenColorIO") is None:
        return TONES
    configuration = OcioConfiguration(ocio or ACES)
    return *TONES, *configuration.displays[_display(configuration)]


@lru_cache(maxsize=8)
def _view(ocio: str, view: str) -> DisplayTransform:
    place = ocio or ACES
    return DisplayTransform(DisplayView(_display(OcioConfiguration(place)), view, place))


def _display(configuration: OcioConfiguration) -> str:
    """The first display that shows sRGB; without one that of the configuration."""
    known = [display for display in configuration.displays if PROFILES.get(display) == SRGB]
    return known[0] if known else configuration.chosen(None, None)[0]


def shoulder(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values above SHOULDER compressed to below 1, with its slope of 1 there: bright colours keep their drawing."""
    above = np.maximum(linear - SHOULDER, 0.0) / (1.0 - SHOULDER)
    return np.where(linear > SHOULDER, SHOULDER + (1.0 - SHOULDER) * above / (1.0 + above), linear)
