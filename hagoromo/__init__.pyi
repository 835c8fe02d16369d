# The public names, in the order in which data flow. Everything else may change without notice.
# ruff: noqa: I001 - the order is that of the data, not of the alphabet

from .version import __version__ as __version__
from .errors import InputError as InputError
from .progress import Progress as Progress, part_of as part_of, silent as silent

# Files: bytes and numbers, whatever they mean
from .files.whole import whole_file as whole_file, whole_folder as whole_folder
from .files.record import read_json as read_json, read_toml as read_toml, write_json as write_json
from .files.sources import made_from as made_from
from .files.table import read_table as read_table, write_table as write_table
from .files.png import read_png as read_png, write_png as write_png
from .files.exr import read_exr as read_exr, write_exr as write_exr

# Light and cameras
from .light.emitting_surface import SurfaceEmission as SurfaceEmission
from .light.spectrum import Spectrum as Spectrum
from .light.lamp_profile import LampProfile as LampProfile
from .light.lamp import Lamp as Lamp
from .light.area_lamp import AreaLamp as AreaLamp
from .light.environment import Environment as Environment
from .light.colour import (
    delta_e_2000 as delta_e_2000,
    srgb_decode as srgb_decode,
    srgb_encode as srgb_encode,
    srgb_from_xyz as srgb_from_xyz,
    xyz_from_srgb as xyz_from_srgb,
)
from .camera.response import Response as Response, camera_response as camera_response, camera_white as camera_white
from .camera.sensor import Sensor as Sensor, develop_raw as develop_raw, expose_raw as expose_raw
from .camera.camera import Camera as Camera
from .camera.formats.camera_file import read_camera as read_camera, read_views as read_views, write_views as write_views

# Photographs
from .photograph.photograph import Photograph as Photograph
from .photograph.rig import Rig as Rig
from .photograph.development.exposure import StatedExposure as StatedExposure, read_exposure as read_exposure
from .photograph.development.development import CalibrationFrames as CalibrationFrames, Development as Development
from .photograph.development.develop import develop as develop
from .photograph.lamp_files import load_lamps as load_lamps, write_lp as write_lp
from .photograph.developing import Developing as Developing
from .photograph.capture_folder import Captured as Captured
from .photograph.lit_photographs import capture as capture
from .photograph.capture import Capture as Capture, load_capture as load_capture, save_capture as save_capture

# Calibration
from .calibration.views.capture_views import CapturedViews as CapturedViews, capture_views as capture_views
from .calibration.views.known_length import KnownBall as KnownBall, KnownLength as KnownLength
from .calibration.views.reconstruct import ViewsSettings as ViewsSettings
from .calibration.views.view_light import ViewLight as ViewLight
from .calibration.camera.board import Board as Board
from .calibration.camera.calibrate_camera import (
    CameraCalibration as CameraCalibration,
    calibrate_camera as calibrate_camera,
)
from .calibration.lamps.lamp_calibration import LampCalibration as LampCalibration
from .calibration.lamps.calibrate_lamps import MatteReference as MatteReference, calibrate_lamps as calibrate_lamps
from .calibration.lamps.ball import Ball as Ball, find_ball as find_ball
from .calibration.lamps.reading import LampReading as LampReading
from .calibration.lamps.lamps_from_ball import lamps_from_ball as lamps_from_ball
from .calibration.lamps.uncalibrated.far_lamps import SelfCalibration as SelfCalibration
from .calibration.lamps.uncalibrated.calibrate_from_object import (
    calibrate_lamps_from_object as calibrate_lamps_from_object,
)
from .calibration.rig.calibrate_rig import calibrate_rig as calibrate_rig
from .calibration.response.chart import chart_spectra as chart_spectra
from .calibration.response.calibrate_response import (
    Pairs as Pairs,
    calibrate_response as calibrate_response,
    read_pairs as read_pairs,
    response_from_chart as response_from_chart,
)
from .calibration.response.response_calibration import ResponseCalibration as ResponseCalibration

# Reflectance and its measurement
from .reflectance.reflectance import Reflectance as Reflectance, interface_albedo as interface_albedo
from .reflectance.torrance_sparrow import Cosines as Cosines, fresnel as fresnel, torrance_sparrow as torrance_sparrow
from .reflectance.pigment import Pigment as Pigment, skin_colour as skin_colour
from .reflectance.spectra.reflectance_prior import ReflectancePrior as ReflectancePrior
from .reflectance.spectra.prior_spectra import read_spectra as read_spectra
from .reflectance.spectra.spectrum_estimate import (
    Reading as Reading,
    SpectrumEstimate as SpectrumEstimate,
    estimate_spectrum as estimate_spectrum,
    reading_matrix as reading_matrix,
    reflectance_spectrum as reflectance_spectrum,
)
from .reflectance.spectra.spectrum_map import SpectrumMap as SpectrumMap, estimate_spectra as estimate_spectra
from .reflectance.material.material_estimate import MaterialEstimate as MaterialEstimate
from .reflectance.material.materials_file import read_materials as read_materials, write_materials as write_materials
from .measurement.measurement import Measurement as Measurement
from .measurement.measure import measure as measure
from .measurement.health.health import Check as Check, Health as Health
from .measurement.health.examine import check_photographs as check_photographs
from .measurement.sight import Sight as Sight
from .measurement.observations import Observations as Observations
from .measurement.material.material_fit import fit_material as fit_material
from .measurement.material.lack_of_fit import LackOfFit as LackOfFit, lack_of_fit as lack_of_fit
from .measurement.material.estimate import estimate_material as estimate_material
from .measurement.reflectance_table import ReflectanceTable as ReflectanceTable, fit_table as fit_table
from .measurement.normals.views import Views as Views, views_from_capture as views_from_capture
from .measurement.normals.normals import (
    NormalMap as NormalMap,
    least_squares_lambert as least_squares_lambert,
    robust_lambert as robust_lambert,
    solve_normals as solve_normals,
)
from .measurement.surface.depth import points_from_normals as points_from_normals
from .measurement.surface.shape import solve_shape as solve_shape
from .measurement.inspection.profile import HeightProfile as HeightProfile, profile as profile
from .measurement.inspection.maps import InspectionMaps as InspectionMaps, inspection_maps as inspection_maps
from .measurement.inspection.curvature import Curvature as Curvature
from .measurement.inspection.stretch import Stretch as Stretch

from .reflectance.sampling import density_to_lamp as density_to_lamp, sample_to_lamp as sample_to_lamp

# Volume boxes
from .volume.box import VolumeBox as VolumeBox
from .volume.store.box_store import load_box as load_box, save_box as save_box
from .volume.store.zarr_plan import box_from_zarr as box_from_zarr
from .matter.build import build as build, build_to as build_to
from .matter.relief.relief import Relief as Relief, relief_plan as relief_plan

# Scenes and images
from .image.scene.surface import Surface as Surface
from .image.scene.surface_texture import SurfaceTexture as SurfaceTexture
from .image.scene.scene import Scene as Scene
from .image.scene.scene_file import load_scene as load_scene
from .transport.palette import Palette as Palette
from .image.picture.shown import DisplayView as DisplayView
from .image.picture.image import Image as Image, read_image as read_image
from .image.expose import expose as expose
from .image.scene.settings import Settings as Settings
from .image.path.unfinished import RenderInterrupted as RenderInterrupted
from .image.simulate import simulate as simulate, visible_shape as visible_shape
from .image.render import render as render
from .image.recipe_sheet import RecipeSheet as RecipeSheet, recipe_sheet as recipe_sheet
from .image.film.film import Filmed as Filmed, Turn as Turn, film as film
from .image.full.gradient import ColourGradient as ColourGradient, full_gradient as full_gradient
from .image.ray_gradient import RayGradient as RayGradient, RayLight as RayLight
from .image.ray_march import RayMarch as RayMarch, march as march
from .image.preview import Preview as Preview, preview as preview
from .image.spectra.spectra import Marks as Marks, RegionSpectra as RegionSpectra, spectra as spectra
from .image.spectra.spectra_files import spectra_table as spectra_table
from .image.spectra.spectra_plot import spectra_plot as spectra_plot
from .image.spectra.spectrum_colour import (
    SpectrumColour as SpectrumColour,
    spectrum_colour as spectrum_colour,
    spectrum_difference as spectrum_difference,
)
from .image.picture.compare import Comparison as Comparison, compare as compare, delta_e_map as delta_e_map
from .image.picture.spectral_exr import (
    SpectralPicture as SpectralPicture,
    read_spectral_exr as read_spectral_exr,
    spectral_picture as spectral_picture,
    write_spectral_exr as write_spectral_exr,
)
from .image.relight.prediction import Prediction as Prediction
from .image.relight.relighting import Relighting as Relighting
from .image.relight.relight import relight as relight

# Many captures, many machines
from .cluster.connection import TrustedScheduler as TrustedScheduler
from .app.batch.batch import batch as batch
from .app.batch.table import Outcome as Outcome

# Any file or folder that the package knows; progress on a terminal
from .app.info import info as info
from .app.doctor import doctor as doctor
from .app.schemas import json_schema as json_schema, schema_names as schema_names, write_schemas as write_schemas
from .app.progress_bar import progress_bar as progress_bar

# What the packages beside the core add: for type checkers. When the program runs, they are found by the entry points of
# the group hagoromo.names.

# A box from photographs of many views
from hagoromo_recovery.recovered import Recovered as Recovered, RecoveredMesh as RecoveredMesh, Score as Score
from hagoromo_recovery.errors import Errors as Errors
from hagoromo_recovery.evidence import Evidence as Evidence
from hagoromo_recovery.recover import RecoverySettings as RecoverySettings, recover as recover

# Two measurements of one object, at two dates
from hagoromo_campaigns.change import Change as Change, CommonChange as CommonChange, change as change
from hagoromo_campaigns.region import ChangedRegion as ChangedRegion
from hagoromo_campaigns.cross_section import CrossSection as CrossSection

# Files of other programs
from hagoromo_formats.convert import ConvertOptions as ConvertOptions, convert as convert
from hagoromo_formats.archive.archive import archive as archive
from hagoromo_formats.archive.profile import ArchiveProfile as ArchiveProfile
from hagoromo_formats.relightable.export import export as export

# A page that can be sent round, the viewer in a notebook, reports
from hagoromo_page.publication.publish import Published as Published, publish as publish
from hagoromo_page.publication.publish_scene import PublishedScene as PublishedScene, publish_scene as publish_scene
from hagoromo_page.raking import RakingFilm as RakingFilm, raking as raking
from hagoromo_page.viewer.notebook import Shown as Shown, show as show
from hagoromo_page.report.measure_report import write_measure_report as write_measure_report
from hagoromo_page.report.change_page import write_change_report as write_change_report
from hagoromo_page.report.recovery_page import write_recovery_report as write_recovery_report
from hagoromo_page.report.relight_page import write_relight_report as write_relight_report
from hagoromo_page.report.page import (
    page_drawing as page_drawing,
    page_picture as page_picture,
    page_text as page_text,
    write_page as write_page,
)

# The paper end to end, and its studio's background
from hagoromo_matter.demo.demo_call import demo as demo
from hagoromo_matter.demo.sweep import sweep as sweep
