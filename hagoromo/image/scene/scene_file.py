"""Scene TOML → Scene and render Settings. Metres; degrees where a key says so; paths lie inside the file's folder.

The records list the keys of [camera], [[lamp]], [[box]], [[surface]] and [render] with their units. Poses are 16
numbers by rows. A place turns about x, then y, then z; a box is moved from where it was built.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import structs

from hagoromo.camera.camera import LARGEST_SIDE, PRESETS, Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.record import (
    Count,
    Matrix,
    Pair,
    Positive,
    Record,
    Vector,
    about,
    decode,
    from_to,
    like,
    one_of,
    read_toml,
    up_to,
)
from hagoromo.files.stores import address
from hagoromo.image.scene.modes import Shadows
from hagoromo.image.scene.motion_record import MotionRecord
from hagoromo.image.scene.needed_bricks import needed_bricks
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_lights import (
    SceneAreaLamp,
    SceneEnvironment,
    area_lamp_from,
    environment_from,
)
from hagoromo.image.scene.scene_surface import NOWHERE, Placement, SceneSurface, pose_of, surface_from
from hagoromo.image.scene.settings import FINEST_SHADOWS, MOST_SAMPLES, Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.photograph.transforms import LampRecord, SensorRecord, lamp_from_record, sensor_from_record
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.material.material_table import MATERIAL, reflectance_from_table
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.bricks import Bricks, Grid
from hagoromo.volume.store.box_store import holds_shell, load_box, stored_bricks
from hagoromo.volume.store.header import EXTINCTION
from hagoromo.volume.store.open_box import OpenBox, open_box

MOST_PLACES = 10_000  # lamps, boxes or surfaces of a file

LoadBox = Callable[[Path], VolumeBox]


class Readers(NamedTuple):
    """What reads the files that a scene names: a box, a recipe, and a mesh with the rest of its `Surface`."""

    box: LoadBox
    recipe: LoadBox
    mesh: Callable[..., Surface]


class SceneCamera(Record, frozen=True, kw_only=True):
    """The camera of a scene: one of `preset`, `file` or `size`; and either `eye` or `world_to_camera`."""

    preset: Annotated[Annotated[str, one_of(*PRESETS)] | None, about("a known camera")] = None
    focal_mm: Annotated[Positive, about("focal length of the preset's lens [mm]")] = 55.0
    file: Annotated[str | None, about("camera.json of `calibrate camera`")] = None
    size: Annotated[Pair | None, about("[width, height] of the image [px]")] = None
    focal: Annotated[Pair | None, about("focal lengths [α_x, α_y] [px], with size")] = None
    principal: Annotated[Pair | None, about("principal point [x, y] [px]; default: the middle")] = None
    distortion: Annotated[tuple[float, ...], about("4, 5 or 8 coefficients of OpenCV")] = (0.0,) * 8
    binning: Annotated[int, from_to(1, LARGEST_SIDE), about("pixels along each axis that are taken together")] = 1
    aperture_mm: Annotated[Positive | None, about("diameter of a thin lens [mm]; default: a pinhole")] = None
    f_number: Annotated[Positive | None, about("focal length over aperture, in place of aperture_mm, with preset")] = (
        None
    )
    focus_mm: Annotated[
        Positive | None, about("distance of the plane that is sharp, along the axis [mm]; needed with an aperture")
    ] = None
    eye: Annotated[Vector | None, about("position of the camera, world axes [m]")] = None
    target: Annotated[Vector, about("point that the camera looks at, world axes [m]")] = NOWHERE
    up: Annotated[Vector, about("direction that is up in the image, world axes")] = (0.0, 0.0, 1.0)
    world_to_camera: Annotated[Matrix | None, about("pose in OpenCV's axes, 4 × 4 by rows [m]")] = None
    response: Annotated[str | None, about("spectral response: a name or a CSV file")] = None
    sensor: Annotated[dict[str, Any] | None, like(SensorRecord), about("the sensor, for simulated photographs")] = None
    name: Annotated[str | None, about("name of the camera")] = None


class SceneBox(Placement, frozen=True, kw_only=True):
    """A volume box: a file, or a recipe that is built when the scene is loaded."""

    file: Annotated[str | None, about("volume box, a folder such as cloth.zarr, or s3://bucket/cloth.zarr")] = None
    recipe: Annotated[str | None, about("recipe in place of file: cloth.toml, or a shipped one by name: linen")] = None
    tau: Annotated[Positive | None, about("extinction coefficient where the density is 1 [1/m]")] = None
    extinction: Annotated[Extinction | None, EXTINCTION] = None
    materials: Annotated[
        list[Annotated[dict[str, Any], MATERIAL]] | None, about("materials in place of the box's own, in their order")
    ] = None
    name: Annotated[str | None, about("name of the box")] = None


class RenderRecord(Record, frozen=True, kw_only=True):
    """How a scene is rendered."""

    samples: Annotated[int, from_to(1, MOST_SAMPLES), about("rays a pixel")] = Settings.samples
    shadows: Annotated[Shadows, about("how shadows are computed")] = Settings.shadows
    shadow_resolution: Annotated[
        Annotated[int, from_to(2, FINEST_SHADOWS)] | None, about("texels a side of a shadow map; default: fitting")
    ] = None
    tolerance: Annotated[float, about("error of the picture, root mean square over its mean, 1e-4…1")] = (
        Settings.tolerance
    )
    seed: Annotated[Count, about("seed of the random numbers")] = Settings.seed
    separate_lamps: Annotated[
        bool, about("whether every lamp has weights of its own, so that `expose` can change its strength and colour")
    ] = Settings.separate_lamps
    cut: Annotated[
        tuple[float, float, float, float] | None,
        about("plane [n_x, n_y, n_z, d]: the camera sees what lies at n · x ≥ d, world axes [m]; light is not cut"),
    ] = None


class SceneRecord(Record, frozen=True, kw_only=True):
    """A scene: camera, light, volume boxes, surfaces; metres, paths inside the folder of the file."""

    version_key = "format_version"

    camera: Annotated[dict[str, Any], like(SceneCamera), about("the camera")]
    lamp: Annotated[list[Annotated[dict[str, Any], like(LampRecord)]], up_to(MOST_PLACES), about("the lamps")] = []
    area_lamp: Annotated[
        list[Annotated[dict[str, Any], like(SceneAreaLamp)]], up_to(MOST_PLACES), about("the lamps with a size")
    ] = []
    environment: Annotated[dict[str, Any] | None, like(SceneEnvironment), about("light from all around")] = None
    box: Annotated[list[Annotated[dict[str, Any], like(SceneBox)]], up_to(MOST_PLACES), about("the volume boxes")] = []
    surface: Annotated[
        list[Annotated[dict[str, Any], like(SceneSurface)]], up_to(MOST_PLACES), about("the surfaces")
    ] = []
    render: Annotated[dict[str, Any], like(RenderRecord), about("how the scene is rendered")] = {}
    motion: Annotated[dict[str, Any], like(MotionRecord), about("how the scene moves in a film")] = {}
    format_version: Annotated[Count, about("version of the format of scene files")] = 1


def load_scene(path: str | Path, progress: Progress = silent) -> tuple[Scene, Settings]:
    """The scene in a TOML file and how it is to be rendered.

    `InputError` names the file, the table and the key that is wrong; an unknown key together with the known ones.
    """
    return scene_from_tables(read_toml(path), Path(path).parent, path, readers(progress))


def load_for_picture(
    path: str | Path, settings: Settings | None = None, progress: Progress = silent
) -> tuple[Scene, Settings]:
    """As `load_scene`, for a picture by the scene's own camera, under its own lamps, and by `settings`, if given.

    Of a box in a store the chunks are read that hold bricks which that picture takes, and no others, see
    `needed_bricks`.
    """
    opened: dict[int, OpenBox] = {}

    def load(place: Path) -> VolumeBox:
        if not address(place) or holds_shell(place):
            return load_box(place)
        box = open_box(place)
        without_voxels = Bricks(box.source.shape, box.places, Grid(None, 0, 0), Grid(None, 0, 0))
        opened[id(without_voxels)] = box
        return VolumeBox.of(box.header, without_voxels)

    read = readers(progress)._replace(box=load)
    scene, stated = scene_from_tables(read_toml(path), Path(path).parent, path, read)
    if not opened:
        return scene, settings or stated
    boxes = [
        replace(box, bricks=stored_bricks(opened[id(box.bricks)], needed)) if id(box.bricks) in opened else box
        for box, needed in zip(scene.boxes, needed_bricks(scene, settings or stated), strict=True)
    ]
    return replace(scene, boxes=tuple(boxes)), settings or stated


def readers(progress: Progress = silent) -> Readers:
    """What reads the files of a scene, each time anew; boxes of recipes come from the cache, once they were built.

    progress: hears of each recipe when it begins. How many there are is not known: each takes half of what is left.
    """
    left = 1.0

    def built(recipe: Path) -> VolumeBox:
        nonlocal left
        progress(1.0 - left, f"building {recipe.name}")
        left *= 0.5
        return _built(recipe)

    return Readers(load_box, built, Surface.from_file)


def scene_from_tables(
    tables: Mapping[str, Any], folder: Path, path: str | Path, read: Readers
) -> tuple[Scene, Settings]:
    """The scene of the tables of a scene file, which lies in `folder`, and its settings. path: named in messages."""
    record, path = decode(tables, SceneRecord, str(path)), Path(path)
    try:
        scene = Scene(
            _camera(record.camera, folder, f"{path} [camera]"),
            tuple(lamp_from_record(one, folder, f"{path} lamp {i + 1}") for i, one in enumerate(record.lamp)),
            tuple(_box(one, folder, f"{path} box {i + 1}", read) for i, one in enumerate(record.box)),
            tuple(
                surface_from(one, folder, f"{path} surface {i + 1}", read.mesh) for i, one in enumerate(record.surface)
            ),
            tuple(area_lamp_from(one, folder, f"{path} area_lamp {i + 1}") for i, one in enumerate(record.area_lamp)),
            environment_from(record.environment, folder, f"{path} [environment]"),
        )
        return scene, _settings(record, path)
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error


def camera_and_settings(path: str | Path) -> tuple[Camera, Settings]:
    """The camera of a scene file and how it is to be rendered, its matter unread; `InputError` as of `load_scene`."""
    path = Path(path)
    record = decode(read_toml(path), SceneRecord, str(path))
    with described(str(path)):
        return _camera(record.camera, path.parent, f"{path} [camera]"), _settings(record, path)


def _settings(record: SceneRecord, path: Path) -> Settings:
    return Settings(**structs.asdict(decode(record.render, RenderRecord, f"{path} [render]")))


def _camera(record: dict[str, Any], folder: Path, where: str) -> Camera:
    key = decode(record, SceneCamera, where)
    given = [name for name in ("preset", "file", "size") if getattr(key, name) is not None]
    if len(given) != 1:
        raise InputError(f"{where}: give one of preset, file or size (with focal): given {', '.join(given) or 'none'}")
    camera = _lens(key, folder, where)
    if key.response is not None:
        camera = replace(camera, response=Response.load(key.response, folder))
    if key.sensor is not None:
        camera = replace(camera, sensor=sensor_from_record(key.sensor, 16, 1.0, 100.0, where))
    camera = replace(camera, name=key.name or camera.name, **_aperture(key, where)).binned(key.binning)
    if (key.eye is None) == (key.world_to_camera is None):
        raise InputError(f"{where}: give either eye (with target and up) or world_to_camera")
    if key.eye is not None:
        return camera.look_at(key.eye, key.target, key.up)
    return camera.with_pose(np.reshape(np.array(key.world_to_camera), (4, 4)))


def _aperture(key: SceneCamera, where: str) -> dict[str, Any]:
    """Aperture and focus of a camera [m]."""
    if key.aperture_mm is None and key.f_number is None:
        if key.focus_mm is not None:
            raise InputError(f"{where}: focus_mm without an aperture: a pinhole is sharp everywhere; give aperture_mm")
        return {}
    if key.focus_mm is None or (key.aperture_mm is not None and key.f_number is not None):
        raise InputError(
            f"{where}: an aperture is aperture_mm or f_number, with focus_mm: give one of them, and focus_mm"
        )
    if key.f_number is not None and key.preset is None:
        raise InputError(f"{where}: f_number needs a preset, whose focal length is known in mm: give aperture_mm")
    diameter = key.aperture_mm or key.focal_mm / (key.f_number or math.inf)
    return {"aperture": 1e-3 * diameter, "focus": 1e-3 * key.focus_mm}


def _lens(key: SceneCamera, folder: Path, where: str) -> Camera:
    if key.preset is not None:
        return Camera.preset(key.preset, key.focal_mm)
    if key.file is not None:
        return read_camera(inside(folder, key.file))
    if key.focal is None or key.size is None:
        raise InputError(f"{where}: size needs focal = [α_x, α_y] [px] beside it")
    width, height = key.size
    return Camera(int(width), int(height), key.focal, key.principal or (width / 2, height / 2), key.distortion)


def _box(record: dict[str, Any], folder: Path, where: str, read: Readers) -> VolumeBox:
    key = decode(record, SceneBox, where)
    if (key.file is None) == (key.recipe is None):
        raise InputError(f"{where}: give either file (a box.zarr) or recipe (a matter.toml)")
    box = read.box(_box_place(folder, key.file)) if key.file else read.recipe(_recipe_place(folder, key.recipe or ""))
    if box.texel and key.extinction not in (None, box.extinction):
        raise InputError(
            f"{where}: extinction is {key.extinction!r}, the box's texel was matched for {box.extinction!r}: "
            f"state it in the recipe and build the box again"
        )
    stated: dict[str, Any] = {"tau": key.tau, "name": key.name, "extinction": key.extinction}
    box = replace(box, **{name: value for name, value in stated.items() if value is not None})
    if key.materials is not None:
        listed = [
            reflectance_from_table(material, folder, f"{where} material {i + 1}")
            for i, material in enumerate(key.materials)
        ]
        box = box.with_materials(listed)
    return box.with_pose(pose_of(key, where) @ box.pose)


def _box_place(folder: Path, text: str) -> Path:
    """Where a box is: inside the folder of the scene, or in a store that the scene names."""
    return Path(text) if address(text) else inside(folder, text)


def _recipe_place(folder: Path, text: str) -> Path:
    """Where a recipe is: inside the folder of the scene, or one that comes with the package, by its name."""
    from hagoromo.matter.recipe import shipped_recipes

    place = inside(folder, text)
    return place if place.exists() else shipped_recipes().get(text, place)


def _built(recipe: Path) -> VolumeBox:
    """The box of a recipe. Only a recipe needs the matters, so that they are imported here."""
    from hagoromo.matter.build import built_box

    return built_box(recipe)
