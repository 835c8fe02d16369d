"""Hagoromo: from calibrated photographs to measured reflectance, volume boxes and rendered images.

    photographs ─develop→ Photograph ─calibrate→ Camera, Lamps ─measure→ Reflectance ─build→ VolumeBox ─render→ Image

The names below are public, in the order in which data flow; each is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hagoromo.camera.calibrate import calibrate_camera as calibrate_camera
    from hagoromo.camera.calibrate_response import calibrate_response as calibrate_response
    from hagoromo.camera.camera import Camera as Camera
    from hagoromo.camera.response import Response as Response
    from hagoromo.camera.sensor import Sensor as Sensor
    from hagoromo.errors import InputError as InputError
    from hagoromo.light.lamp import Lamp as Lamp
    from hagoromo.light.spectrum import Spectrum as Spectrum
    from hagoromo.reflectance.reflectance import Reflectance as Reflectance
    from hagoromo.volume.box import VolumeBox as VolumeBox

__version__ = "0.1.0"

HOMES = {
    "Spectrum": "light.spectrum",
    "Lamp": "light.lamp",
    "Response": "camera.response",
    "Sensor": "camera.sensor",
    "Camera": "camera.camera",
    "calibrate_camera": "camera.calibrate",
    "calibrate_response": "camera.calibrate_response",
    "Reflectance": "reflectance.reflectance",
    "VolumeBox": "volume.box",
    "InputError": "errors",
}

__all__ = ["__version__", *HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in HOMES:
        raise AttributeError(f"module 'hagoromo' has no attribute {name!r}")
    return getattr(importlib.import_module(f"hagoromo.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
