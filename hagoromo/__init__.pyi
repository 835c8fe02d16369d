# The public names, in the order in which data flow. Everything else may change without notice.
# ruff: noqa: I001 - the order is that of the data, not of the alphabet

from .version import __version__ as __version__
from .errors import InputError as InputError

# Light and cameras
from .light.spectrum import Spectrum as Spectrum
from .light.lamp import Lamp as Lamp
from .camera.response import Response as Response
from .camera.sensor import Sensor as Sensor
from .camera.camera import Camera as Camera
from .camera.formats.camera_file import read_camera as read_camera, read_views as read_views, write_views as write_views

# Photographs
from .photograph.photograph import Photograph as Photograph
from .photograph.development.exposure import StatedExposure as StatedExposure, read_exposure as read_exposure
from .photograph.development.development import (
    CalibrationFrames as CalibrationFrames,
    Development as Development,
    develop_exposures as develop_exposures,
)
from .photograph.development.develop import develop as develop
from .photograph.gather import gather as gather
from .photograph.lit_photographs import capture as capture, load_lamps as load_lamps
from .photograph.convert import convert as convert
from .photograph.capture import Capture as Capture, load_capture as load_capture, save_capture as save_capture

# Calibration
from .calibration.camera.board import Board as Board
from .calibration.camera.calibrate_camera import (
    CameraCalibration as CameraCalibration,
    calibrate_camera as calibrate_camera,
)
from .calibration.lamps.lamp_calibration import LampCalibration as LampCalibration
from .calibration.lamps.calibrate_lamps import MatteReference as MatteReference, calibrate_lamps as calibrate_lamps
from .calibration.lamps.uncalibrated.far_lamps import SelfCalibration as SelfCalibration
from .calibration.lamps.uncalibrated.calibrate_from_object import (
    calibrate_lamps_from_object as calibrate_lamps_from_object,
)
from .calibration.response.chart import chart_spectra as chart_spectra
from .calibration.response.calibrate_response import (
    Pairs as Pairs,
    ResponseCalibration as ResponseCalibration,
    calibrate_response as calibrate_response,
    read_pairs as read_pairs,
)
from .calibration.response.chart_response import response_from_chart as response_from_chart

# Reflectance and its measurement
from .reflectance.reflectance import Reflectance as Reflectance
from .reflectance.spectra.reflectance_prior import ReflectancePrior as ReflectancePrior
from .reflectance.spectra.spectrum_estimate import (
    Reading as Reading,
    SpectrumEstimate as SpectrumEstimate,
    reflectance_spectrum as reflectance_spectrum,
)
from .reflectance.material.materials_file import read_materials as read_materials
from .measurement.known_shape import measure as measure

from .reflectance.sampling import density_to_lamp as density_to_lamp, sample_to_lamp as sample_to_lamp

# Volume boxes
from .volume.box import VolumeBox as VolumeBox
from .volume.store.box_store import load_box as load_box, save_box as save_box
from .volume.store.zarr_plan import box_from_zarr as box_from_zarr
from .matter.build import build as build, build_to as build_to

# Scenes and images
from .image.surface import Surface as Surface
from .image.scene import Scene as Scene
from .image.scene_file import load_scene as load_scene
from .transport.lighting import Palette as Palette
from .image.image import Image as Image, read_image as read_image
from .image.settings import Settings as Settings
from .image.simulate import simulate as simulate
from .image.render import render as render
from .image.ray_march import RayLight as RayLight, RayMarch as RayMarch, march as march
from .image.preview import Preview as Preview, preview as preview
from .image.compare import Comparison as Comparison, compare as compare

# Any file or folder that the package knows
from .app.info import info as info
from .app.schemas import json_schema as json_schema, schema_names as schema_names, write_schemas as write_schemas
