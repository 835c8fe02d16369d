"""Hagoromo: from calibrated photographs to measured reflectance, volume boxes and rendered images.

    photographs ─develop→ Photograph ─calibrate→ Camera, Lamps ─measure→ Reflectance ─build→ VolumeBox ─render→ Image

The names below are public, in the order in which data flow; each is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hagoromo.calibration.camera.board import Board as Board
    from hagoromo.calibration.camera.calibrate_camera import calibrate_camera as calibrate_camera
    from hagoromo.calibration.response.calibrate_response import calibrate_response as calibrate_response
    from hagoromo.calibration.response.chart import chart_spectra as chart_spectra
    from hagoromo.calibration.response.chart_response import response_from_chart as response_from_chart
    from hagoromo.camera.camera import Camera as Camera
    from hagoromo.camera.formats.camera_file import read_views as read_views
    from hagoromo.camera.formats.camera_file import write_views as write_views
    from hagoromo.camera.response import Response as Response
    from hagoromo.camera.sensor import Sensor as Sensor
    from hagoromo.errors import InputError as InputError
    from hagoromo.image.compare import compare as compare
    from hagoromo.image.image import Image as Image
    from hagoromo.image.image import read_image as read_image
    from hagoromo.image.preview import Preview as Preview
    from hagoromo.image.preview import preview as preview
    from hagoromo.image.render import render as render
    from hagoromo.image.scene import Scene as Scene
    from hagoromo.image.scene_file import load_scene as load_scene
    from hagoromo.image.surface import Surface as Surface
    from hagoromo.light.lamp import Lamp as Lamp
    from hagoromo.light.spectrum import Spectrum as Spectrum
    from hagoromo.matter.build import build as build
    from hagoromo.measurement.known_shape import measure as measure
    from hagoromo.photograph.capture import Capture as Capture
    from hagoromo.photograph.capture import load_capture as load_capture
    from hagoromo.photograph.capture import save_capture as save_capture
    from hagoromo.photograph.development.develop import develop as develop
    from hagoromo.photograph.development.exposure import read_exposure as read_exposure
    from hagoromo.photograph.gather import gather as gather
    from hagoromo.photograph.photograph import Photograph as Photograph
    from hagoromo.reflectance.material.materials_file import read_materials as read_materials
    from hagoromo.reflectance.reflectance import Reflectance as Reflectance
    from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior as ReflectancePrior
    from hagoromo.reflectance.spectra.spectrum_estimate import Reading as Reading
    from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate as SpectrumEstimate
    from hagoromo.reflectance.spectra.spectrum_estimate import reflectance_spectrum as reflectance_spectrum
    from hagoromo.version import __version__ as __version__
    from hagoromo.volume.box import VolumeBox as VolumeBox
    from hagoromo.volume.store.box_store import load_box as load_box
    from hagoromo.volume.store.box_store import save_box as save_box
    from hagoromo.volume.store.zarr_plan import box_from_zarr as box_from_zarr

HOMES = {
    "__version__": "version",
    "InputError": "errors",
    "Spectrum": "light.spectrum",
    "Lamp": "light.lamp",
    "Response": "camera.response",
    "Sensor": "camera.sensor",
    "Camera": "camera.camera",
    "Board": "calibration.camera.board",
    "calibrate_camera": "calibration.camera.calibrate_camera",
    "calibrate_response": "calibration.response.calibrate_response",
    "chart_spectra": "calibration.response.chart",
    "response_from_chart": "calibration.response.chart_response",
    "read_views": "camera.formats.camera_file",
    "write_views": "camera.formats.camera_file",
    "read_exposure": "photograph.development.exposure",
    "develop": "photograph.development.develop",
    "Photograph": "photograph.photograph",
    "Capture": "photograph.capture",
    "load_capture": "photograph.capture",
    "save_capture": "photograph.capture",
    "gather": "photograph.gather",
    "Reflectance": "reflectance.reflectance",
    "measure": "measurement.known_shape",
    "read_materials": "reflectance.material.materials_file",
    "Reading": "reflectance.spectra.spectrum_estimate",
    "ReflectancePrior": "reflectance.spectra.reflectance_prior",
    "SpectrumEstimate": "reflectance.spectra.spectrum_estimate",
    "reflectance_spectrum": "reflectance.spectra.spectrum_estimate",
    "VolumeBox": "volume.box",
    "build": "matter.build",
    "load_box": "volume.store.box_store",
    "save_box": "volume.store.box_store",
    "box_from_zarr": "volume.store.zarr_plan",
    "Surface": "image.surface",
    "Scene": "image.scene",
    "load_scene": "image.scene_file",
    "Image": "image.image",
    "render": "image.render",
    "preview": "image.preview",
    "Preview": "image.preview",
    "read_image": "image.image",
    "compare": "image.compare",
}

__all__ = [*HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in HOMES:
        raise AttributeError(f"module 'hagoromo' has no attribute {name!r}")
    return getattr(importlib.import_module(f"hagoromo.{HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
