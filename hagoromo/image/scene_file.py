"""Scene TOML → Scene and render Settings. Metres; degrees where a key says so; paths lie inside the file's folder.

    [camera]     preset = "canon_eos_kiss_digital", focal_mm = 55.0
                 or file = "camera.json" (of calibrate camera)
                 or size = [width, height], focal = [α_x, α_y], principal, distortion (OpenCV's 4, 5 or 8), all in px
                 binning; eye, target, up, or world_to_camera; response (name or CSV), sensor (table), name
    [[lamp]]     position (near) or to_lamp (far), intensity, spectrum (name, number, CSV or table), name
    [[box]]      file = "name.zarr" or recipe = "matter.toml" (see `matter.build`), tau, materials (list), name, place
    [[surface]]  shape (sphere, rectangle, disk, cylinder, cube) or mesh = "name.ply", smooth, name, place, reflectance
    [render]     samples, shadows, shadow_resolution, tolerance, seed

A reflectance is {alpha, beta, gamma [rad], n, body_colour, interface_colour, element, name}, or a measured one:
{file = "materials.json", material = "name", element, response, lamp}. A place is position, rotation_deg (about x, then
y, then z) and, for surfaces, scale (a number, or one an axis); or pose. Poses are 16 numbers by rows. A box is moved
from where it was built.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import PRESETS, Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import (
    anything,
    count,
    flag,
    inside,
    list_of,
    number,
    numbers,
    one_of,
    positive,
    read_toml,
    table,
    take,
    text,
)
from hagoromo.image.scene import Scene
from hagoromo.image.settings import SHADOWS, Settings
from hagoromo.image.surface import SHAPES, Surface
from hagoromo.matter.build import build
from hagoromo.photograph.transforms import lamp_from_record, sensor_from_record
from hagoromo.reflectance.material.material_table import reflectance_from_table
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box

NOWHERE = (0.0, 0.0, 0.0)
SCENE = {
    "camera": table, "lamp": (list_of(table), []), "box": (list_of(table), []), "surface": (list_of(table), []),
    "render": (table, {}),
}  # fmt: skip
CAMERA = {
    "preset": (one_of(*PRESETS), None), "focal_mm": (positive, 55.0), "file": (text, None),
    "size": (numbers(2), None), "focal": (numbers(2), None), "principal": (numbers(2), None),
    "distortion": (numbers(), (0.0,) * 8), "binning": (count, 1), "eye": (numbers(3), None),
    "target": (numbers(3), NOWHERE), "up": (numbers(3), (0.0, 0.0, 1.0)), "world_to_camera": (numbers(16), None),
    "response": (text, None), "sensor": (table, None), "name": (text, None),
}  # fmt: skip
PLACE = {"position": (numbers(3), None), "rotation_deg": (numbers(3), None), "pose": (numbers(16), None)}
BOX = {
    "file": (text, None), "recipe": (text, None), "tau": (positive, None), "materials": (list_of(table), None),
    "name": (text, None), **PLACE,
}  # fmt: skip
SURFACE = {
    "shape": (one_of(*SHAPES), None), "mesh": (text, None), "smooth": (flag, True), "scale": (anything, 1.0),
    "reflectance": table, "name": (text, ""), **PLACE,
}  # fmt: skip
RENDER = {
    "samples": count, "shadows": one_of(*SHADOWS), "shadow_resolution": count,
    "tolerance": number, "seed": count,
}  # fmt: skip


def load_scene(path: str | Path) -> tuple[Scene, Settings]:
    """The scene in a TOML file and how it is to be rendered.

    `InputError` names the file, the table and the key that is wrong; an unknown key together with the known ones.
    """
    path = Path(path)
    record, folder = take(read_toml(path), SCENE, str(path)), path.parent
    kinds = {key: (kind, getattr(Settings, key)) for key, kind in RENDER.items()}
    try:
        scene = Scene(
            _camera(record["camera"], folder, f"{path} [camera]"),
            tuple(lamp_from_record(one, folder, f"{path} lamp {i + 1}") for i, one in enumerate(record["lamp"])),
            tuple(_box(one, folder, f"{path} box {i + 1}") for i, one in enumerate(record["box"])),
            tuple(_surface(one, folder, f"{path} surface {i + 1}") for i, one in enumerate(record["surface"])),
        )
        return scene, Settings(**take(record["render"], kinds, f"{path} [render]"))
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error


def scene_and_settings(scene: Scene | str | Path, settings: Settings | None = None) -> tuple[Scene, Settings]:
    """The scene, loaded where `scene` is the path of a TOML file; `settings`, else the file's, else the defaults."""
    if isinstance(scene, Scene):
        return scene, settings or Settings()
    loaded, stated = load_scene(scene)
    return loaded, settings or stated


def _camera(record: dict[str, Any], folder: Path, where: str) -> Camera:
    key = take(record, CAMERA, where)
    given = [name for name in ("preset", "file", "size") if key[name] is not None]
    if len(given) != 1:
        raise InputError(f"{where}: give one of preset, file or size (with focal): given {', '.join(given) or 'none'}")
    camera = _lens(key, given[0], folder, where)
    if key["response"] is not None:
        camera = replace(camera, response=Response.load(key["response"], folder))
    if key["sensor"] is not None:
        camera = replace(camera, sensor=sensor_from_record(key["sensor"], 16, 1.0, 100.0, where))
    camera = replace(camera, name=key["name"] or camera.name).binned(key["binning"])
    if (key["eye"] is None) == (key["world_to_camera"] is None):
        raise InputError(f"{where}: give either eye (with target and up) or world_to_camera")
    if key["eye"] is not None:
        return camera.look_at(key["eye"], key["target"], key["up"])
    return camera.with_pose(np.reshape(key["world_to_camera"], (4, 4)))


def _lens(key: dict[str, Any], given: str, folder: Path, where: str) -> Camera:
    if given == "preset":
        return Camera.preset(key["preset"], key["focal_mm"])
    if given == "file":
        return read_camera(inside(folder, key["file"]))
    if key["focal"] is None:
        raise InputError(f"{where}: size needs focal = [α_x, α_y] [px] beside it")
    width, height = key["size"]
    return Camera(width, height, key["focal"], key["principal"] or (width / 2, height / 2), key["distortion"])


def _box(record: dict[str, Any], folder: Path, where: str) -> VolumeBox:
    key = take(record, BOX, where)
    if (key["file"] is None) == (key["recipe"] is None):
        raise InputError(f"{where}: give either file (a box.zarr) or recipe (a matter.toml)")
    box = load_box(inside(folder, key["file"])) if key["file"] else build(inside(folder, key["recipe"]))
    box = replace(box, **{name: key[name] for name in ("tau", "name") if key[name] is not None})
    if key["materials"] is not None:
        listed = [
            reflectance_from_table(material, folder, f"{where} material {i + 1}")
            for i, material in enumerate(key["materials"])
        ]
        box = box.with_materials(listed)
    return box.with_pose(_pose(key, where) @ box.pose)


def _surface(record: dict[str, Any], folder: Path, where: str) -> Surface:
    key = take(record, SURFACE, where)
    if (key["shape"] is None) == (key["mesh"] is None):
        raise InputError(f"{where}: give either shape ({', '.join(SHAPES)}) or mesh (a file)")
    scale = key["scale"] if isinstance(key["scale"], list) else [key["scale"]] * 3
    scale = take({"scale": scale}, {"scale": numbers(3)}, where)["scale"]
    pose = _pose(key, where) @ np.diag([*scale, 1.0])
    reflectance = reflectance_from_table(key["reflectance"], folder, f"{where} reflectance")
    if key["mesh"] is None:
        return Surface(reflectance, key["shape"], pose=pose, name=key["name"])
    name = key["name"] or Path(key["mesh"]).stem
    return Surface.from_file(inside(folder, key["mesh"]), reflectance, pose=pose, smooth=key["smooth"], name=name)


def _pose(key: dict[str, Any], where: str) -> NDArray[np.float64]:
    """(4, 4) of a place, without its scale."""
    if key["pose"] is not None:
        if key["position"] is not None or key["rotation_deg"] is not None:
            raise InputError(f"{where}: pose says all: leave position and rotation_deg out")
        return np.reshape(key["pose"], (4, 4))
    pose = np.eye(4)
    for axis, angle in enumerate(np.radians(key["rotation_deg"] or NOWHERE)):
        turn, (i, j) = np.eye(4), ((axis + 1) % 3, (axis + 2) % 3)
        turn[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        pose = turn @ pose
    pose[:3, 3] = key["position"] or NOWHERE
    return pose
