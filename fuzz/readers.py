"""Readers: every function that reads a file, with a good sample of it."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fuzz import (
    boxes,
    curves,
    gltf_scenes,
    meshes,
    mitsuba_scenes,
    pictures,
    recipes,
    records,
    tables,
    usd_scenes,
    viewer,
    volumes,
)  # fmt: skip
from fuzz.trees import spoilt_json
from fuzz.verbs import SLOW, VERBS, WORDS
from fuzz.viewer_session import image_session, scene_session, spoil


class Reader(NamedTuple):
    """write: makes a good sample, a file or a folder, at the path it is given. read: takes the path of it.

    entry: what `read` takes, of an existing folder that `write` fills. share: of the usual number of mutations, for
    what takes long. good: whether the sample is read; one of a kind that is always refused tries the refusal. spoil:
    spoils the files of a sample, if not one of them is to be spoilt as its kind is. swaps: how deep nodes of JSON and
    TOML are swapped, each by a value of each type. works: whether it does more than read, and may take its time.
    """

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], Any]
    entry: str = ""
    share: float = 1.0
    good: bool = True
    spoil: Callable[[dict[str, bytes], np.random.Generator], None] | None = None
    swaps: int = 99
    works: bool = False

    @property
    def in_folder(self) -> bool:
        """Whether `write` fills a folder that is there already."""
        return bool(self.entry) or "." not in self.name


def _info(path: Path) -> Any:
    """All facts, as the command prints them."""
    from hagoromo.app.info import info

    return json.dumps(info(path), ensure_ascii=False).encode()


def _plan(path: Path) -> Any:
    """The plan of a recipe."""
    from hagoromo.matter.recipe import planned

    return planned(path)


def _tables(path: Path) -> Any:
    """The tables of a recipe and its material, without the plan, which takes long."""
    from hagoromo.files.record import decode, read_toml
    from hagoromo.matter.recipe import Recipe, _OfKind, kind_names, kind_of

    tables, where = read_toml(path), str(path)
    name = decode(tables, _OfKind, where).kind
    kind = kind_of(name if name in kind_names() else "solid")
    table = decode(tables, kind.record, where)
    element = kind.element_of(table) if kind.element_of else kind.element or "plane"
    return Recipe(table, element, path.parent, where).material


def _draft(path: Path) -> Any:
    from hagoromo_matter.cloth.weave import LINEN
    from hagoromo_matter.cloth.wif import cloth_of, read_wif

    return cloth_of(read_wif(path), LINEN.warp, LINEN.weft)


def _colmap(path: Path) -> Any:
    from hagoromo_formats.cameras.colmap import read_colmap, read_points

    return read_colmap(path), read_points(path)


def _array(path: Path) -> Any:
    from hagoromo.files.zarr_arrays import open_array
    from hagoromo.volume.store.zarr_blocks import ZarrBlocks

    blocks = ZarrBlocks(open_array(path), {})
    return [blocks.voxels(tile) for tile in blocks.tiles()]


def _exposure(path: Path) -> Any:
    from hagoromo.photograph.development.exposure import StatedExposure, read_exposure

    return read_exposure(path, StatedExposure(transfer="linear")), _info(path)


def _pixels(path: Path) -> Any:
    from hagoromo.photograph.pixels import default_channels, read_pixels
    from hagoromo.photograph.transforms import ImageSettings

    return read_pixels(path, ImageSettings(), default_channels(3), "bilinear", str(path)), _info(path)


def _float_exposure(path: Path) -> Any:
    from hagoromo.image.picture.compare import compare

    return compare(path, path), _pixels(path)


def _picture(path: Path) -> Any:
    from hagoromo.image.picture.any_picture import read_any_picture

    return read_any_picture(path).linear


def _profile(path: Path) -> Any:
    """The colours of a profile by itself: packed in a PNG its numbers are hardly ever spoilt."""
    from hagoromo.files.icc import linear_by
    from hagoromo.files.reading import reading

    with reading(path, "ICC profile"):
        return linear_by(path.read_bytes(), np.linspace(0.0, 1.0, 12).reshape(2, 2, 3), str(path))


def _lens(path: Path) -> Any:
    """The camera of a photograph by a database, and its names."""
    from hagoromo.files.exif import Exif
    from hagoromo_formats.cameras.lensfun import camera_by_lensfun

    exif = Exif(focal_mm=20.0, camera="Acme Acme One", lens="Acme 20mm f/2")
    return camera_by_lensfun((60, 40), exif, database=path), _info(path)


def _late(module: str, name: str) -> Callable[[Path], Any]:
    """A function of the package by name, imported when it is called: workers start quickly."""

    def read(path: Path) -> Any:
        found: Any = __import__(module, fromlist=["_"])
        return functools.reduce(getattr, name.split("."), found)(path)

    return read


def _views(kind: str, name: str) -> Callable[[Path], None]:
    return lambda folder: records.views(folder, kind, name)


def _colmap_model(text: bool) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        records.views(folder, "colmap-text" if text else "colmap", "model")
        records.points(folder / "model", binary=not text)

    return write


def _curve(path: Path) -> Any:
    from hagoromo.photograph.development.transfer import Transfer

    return Transfer.load(path, 255).light(np.arange(256, dtype=np.uint8).reshape(16, 16))


def _mask(path: Path) -> Any:
    from hagoromo.photograph.pixels import read_mask

    return read_mask(path, (13, 17))


def _response(path: Path) -> Any:
    from hagoromo.calibration.response.calibrate_response import calibrate_response

    return calibrate_response(path)


def _batch(path: Path) -> Any:
    """The steps, their keys, and what is known of the inputs; nothing is run."""
    from hagoromo.app.batch.batch import batch

    return batch(path, path.parent / "out", dry_run=True), _info(path)


def _sheet(path: Path) -> Any:
    from hagoromo.measurement.measurement_files import read_surface

    return read_surface(path.parent / "measured"), _plan(path)


READ_TEXTURE = _late("hagoromo.image.scene.surface_texture", "SurfaceTexture.from_file")
LOAD_SCENE = _late("hagoromo.image.scene.scene_file", "load_scene")
READ_VIEWS = _late("hagoromo.camera.formats.camera_file", "read_views")
LOAD_BOX = _late("hagoromo.volume.store.box_store", "load_box")
READ_MAP = _late("hagoromo.light.environment", "Environment.from_file")
READ_EXIF = _late("hagoromo.files.exif", "read_exif")
HAS_ALEMBIC = find_spec("alembic3d") is not None
HAS_USD = find_spec("pxr") is not None
HAS_VISER = find_spec("viser") is not None
HAS_VTK = find_spec("vtkmodules") is not None  # an extra
READ_VOLUME = _late("hagoromo.files.volume_file", "read_volume")
READ_CURVES = _late("hagoromo_formats.curves.curve_file", "read_curves")
READ_MESH = _late("hagoromo.files.mesh", "read_mesh")
READ_PARTS = _late("hagoromo.files.mesh", "read_parts")
SIMPLE = (
    Reader("scene.toml", records.scene, LOAD_SCENE, "scene.toml"),
    Reader("view-scene.session", scene_session, viewer.read_of("scene.toml"), share=0.5, good=HAS_VISER, spoil=spoil),
    Reader("view-image.session", image_session, viewer.read_of("a.exr"), share=0.3, good=HAS_VISER, spoil=spoil),
    Reader("motion", records.motion, _late("hagoromo.image.scene.motion", "read_motion"), "scene.toml"),
    *(
        Reader(f"recipe-{name}.toml", records.recipe(name), _tables)
        for name in ("linen", "jacquard", "stockinette", "covert", "down", "wing", "skin", "solid")
    ),
    Reader("plan-solid.toml", records.recipe("solid"), _plan, share=0.5),
    Reader("plan-mesh", records.mesh_recipe, _plan, "a.toml", share=0.5),
    Reader("plan-relief", records.relief_recipe, _sheet, "a.toml", share=0.3),
    Reader("batch", records.batch, _batch, "batch.toml"),
    Reader("batch-arguments", recipes.write, recipes.read, "batch.toml", spoil=recipes.spoil),
    Reader("capture", records.capture, _late("hagoromo.photograph.capture", "load_capture")),
    Reader("capture-info", records.capture, _info, "transforms.json"),
    Reader("measurement", records.measured, _late("hagoromo.measurement.measurement", "Measurement.load")),
    Reader("materials.json", records.materials, _info),
    Reader("lamps.json", records.lamps, _late("hagoromo.photograph.lamp_files", "load_lamps")),
    Reader("lamps-info.json", records.lamps, _info),
    Reader("lamps-of-balls.json", records.lamps_of_balls,
           _late("hagoromo.calibration.lamps.lamp_calibration", "LampCalibration.load")),
    Reader("lab-kept.json", records.lab_kept, records.read_lab_kept),
    Reader("lab-message.json", records.lab_message, records.read_lab_message),
    Reader("rig.json", records.rig, _late("hagoromo.photograph.rig", "Rig.load")),
    Reader("camera.json", records.camera, _late("hagoromo.camera.formats.camera_file", "read_camera")),
    Reader("camera-calibration.json", records.camera,
           _late("hagoromo.calibration.camera.calibrate_camera", "CameraCalibration.load")),
    Reader("nerfstudio", _views("nerfstudio", "a.json"), READ_VIEWS, "a.json"),
    Reader("opencv-yaml", _views("opencv", "a.yml"), READ_VIEWS, "a.yml"),
    Reader("opencv-json", _views("opencv", "b.json"), READ_VIEWS, "b.json"),
    Reader("middlebury", _views("middlebury", "a_par.txt"), READ_VIEWS, "a_par.txt"),
    Reader("colmap-text", _colmap_model(True), _colmap, "model"),
    Reader("colmap-binary", _colmap_model(False), _colmap, "model"),
    Reader("rgl.bsdf", tables.rgl, _late("hagoromo_formats.reflectances.rgl", "read_rgl"), share=0.3),
    Reader("reflectance.csv", tables.csv,
           _late("hagoromo_formats.reflectances.table_csv", "read_reflectance_csv")),
    Reader("wif.wif", records.text(records.WIF), _draft),
    Reader("map.hdr", pictures.map_hdr, READ_MAP),
    Reader("map.exr", pictures.map_exr, READ_MAP, share=0.3),
    Reader("texture.png", pictures.png, READ_TEXTURE, share=0.3),
    Reader("ies.ies", records.text(records.IES), _info),
    Reader("lensfun.xml", records.text(records.LENSFUN), _lens),
    Reader("mesh.ply", records.text(records.PLY), READ_MESH),
    Reader("mesh.obj", records.text(records.OBJ), READ_MESH),
    Reader("mesh-parts.obj", records.text(records.OBJ_OF_PARTS), READ_PARTS),
    Reader("mesh-parts.glb", meshes.glb, READ_PARTS, share=0.5),
    Reader("mesh-parts.ply", meshes.ply, READ_PARTS, share=0.5),
    Reader("mesh.off", records.text(records.OFF), READ_MESH),
    Reader("mesh-binary.ply", meshes.ply, READ_MESH),
    Reader("mesh.vtp", meshes.vtp, READ_MESH, share=0.1, good=HAS_VTK),
    Reader("mesh.abc", meshes.abc, READ_MESH, share=0.1, good=HAS_ALEMBIC),
    Reader("mesh.stl", meshes.stl, READ_MESH),
    Reader("mesh-text.stl", meshes.stl_text, READ_MESH),
    Reader("mesh.glb", meshes.glb, READ_MESH),
    Reader("mesh-inside.gltf", meshes.gltf_inside, READ_MESH),
    Reader("curves.hair", curves.hair, READ_CURVES),
    Reader("curves.abc", curves.abc, READ_CURVES, share=0.1, good=HAS_ALEMBIC),
    Reader("curves.glb", curves.glb, READ_CURVES),
    Reader("curves.obj", records.text(curves.OBJ), READ_CURVES),
    Reader("mesh-gltf", meshes.gltf, READ_MESH, "a.gltf"),
    Reader("scene.gltf", gltf_scenes.scene, gltf_scenes.read, share=0.5),
    Reader("mitsuba", mitsuba_scenes.scene, mitsuba_scenes.read, "a.xml", share=0.3),
    Reader("scene.usda", usd_scenes.scene, usd_scenes.read, share=0.1, good=HAS_USD),
    Reader("scene.usdc", usd_scenes.scene_binary if HAS_USD else usd_scenes.scene, usd_scenes.read, share=0.1,
           good=HAS_USD),
    Reader("scene.usdz", usd_scenes.scene_archive, usd_scenes.read, share=0.1, good=HAS_USD),
    Reader("mesh.serialized", mitsuba_scenes.serialized,
           _late("hagoromo_formats.mitsuba.serialized", "read_serialized")),
    Reader("spectrum.csv", records.spectrum, _late("hagoromo.light.spectrum", "Spectrum.from_csv")),
    Reader("spectrum.spdx", records.text(records.SPDX), _late("hagoromo.light.spectrum", "read_spectrum_file")),
    Reader("spectrum.spd", records.text("400 0.5\n500 1 # peak\n600 0.25\n"),
           _late("hagoromo.light.spectrum", "read_spectrum_file")),
    Reader("table.csv", records.spectrum, _info),
    Reader("prior.csv", records.spectra,
           _late("hagoromo.reflectance.spectra.reflectance_prior", "ReflectancePrior.load"), share=0.3),
    Reader("response.csv", records.response, _late("hagoromo.camera.response", "Response.load")),
    Reader("spectra.csv", records.spectra, _late("hagoromo.reflectance.spectra.prior_spectra", "read_spectra")),
    Reader("pairs.csv", records.pairs, _response, share=0.1),
    Reader("transfer.csv", records.curve, _curve),
    Reader("calibrated-response", records.calibrated_response,
           _late("hagoromo.calibration.response.calibrate_response", "ResponseCalibration.load"), "a.csv"),
    Reader("scan-lines.exr", pictures.exr, _float_exposure),
    Reader("tiles.exr", pictures.exr_tiles, _float_exposure, share=0.1),
    Reader("parts.exr", pictures.exr_parts, _pixels, share=0.1),
    Reader("rendered.exr", pictures.rendered, _late("hagoromo.image.picture.image", "read_image")),
    Reader("a.hdr", pictures.hdr, _picture),
    Reader("spectral.exr", pictures.spectral, _late("hagoromo.image.picture.spectral_exr", "read_spectral_exr")),
    Reader("8-bit.png", pictures.png, _pixels),
    Reader("profile.png", pictures.png_profile, _picture),
    Reader("profile.icc", pictures.icc, _profile),
    Reader("16-bit.png", pictures.png_deep, _pixels),
    Reader("palette.png", pictures.png_kinds, _pixels),
    Reader("mask.png", pictures.mask, _mask),
    Reader("progressive.jpg", pictures.jpeg, _pixels),
    Reader("grey.jpg", pictures.jpeg_grey, _exposure),
    Reader("strips.tif", pictures.tiff, _exposure),
    Reader("deflate.tif", pictures.tiff_packed, _pixels),
    Reader("lzw.tif", pictures.tiff_lzw, _pixels),
    Reader("bilevel.tif", pictures.tiff_bilevel, _pixels, good=False),
    Reader("float.tif", pictures.tiff_float, _info),
    Reader("raw.dng", pictures.dng, _exposure, share=0.1),
    Reader("packed.dng", pictures.dng_packed, _exposure, share=0.1),
    Reader("exif.tif", pictures.exif, READ_EXIF),
    Reader("exif.jpg", pictures.exif_jpeg, READ_EXIF),
    Reader("development.exr", pictures.development,
           _late("hagoromo.photograph.development.development", "Development.load")),
    Reader("points.exr", records.points_file, _late("hagoromo.photograph.pixels", "read_points")),
    Reader("box.zarr", boxes.box, LOAD_BOX),
    Reader("shell.zarr", boxes.shell, LOAD_BOX, share=0.5),
    *(
        Reader(f"v3-{name}.zarr", functools.partial(boxes.array_v3, codec=name), _array)
        for name in ("zstd", "gzip", "blosc")
    ),
    *(
        Reader(name, write, READ_VOLUME, share=share, good=HAS_VTK or not name.endswith((".vti", ".slc")))
        for name, (write, share) in volumes.SAMPLES.items()
    ),
    Reader("plan-volume", volumes.recipe, _plan, "a.toml", share=0.5),
    Reader("v3-shards.zarr", functools.partial(boxes.array_v3, shards=True), _array),
    *(
        Reader(f"v2-{name}.zarr", functools.partial(boxes.array_v2, codec=name), _array)
        for name in ("zlib", "gzip", "blosc", "lz4", "bz2")
    ),
)  # fmt: skip
COMMANDS = tuple(
    Reader(
        f"verb-{name}",
        verb.write,
        verb.read,
        WORDS,
        0.1 if name in SLOW else 0.15,
        spoil=verb.spoil,
        swaps=0 if name in SLOW else 1,
        works=True,
    )
    for name, verb in VERBS.items()
)
READERS = {reader.name: reader for reader in (*SIMPLE, *COMMANDS)}


def palette_spoilt(path: Path, random: np.random.Generator) -> None:
    """A rendered EXR that is whole but for one of the two texts among its attributes."""
    from hagoromo.files.exr import read_exr

    pictures.rendered(path)
    texts = read_exr(path)[1]
    key = ("palette", "hagoromo")[int(random.integers(2))]
    spoilt = spoilt_json(texts[key].encode(), random)
    pictures.rendered(path, **{"palette" if key == "palette" else "metadata": spoilt[:100_000]})
