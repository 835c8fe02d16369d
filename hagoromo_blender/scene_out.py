"""A scene of Blender as a scene of Hagoromo: scene.toml, its meshes and its boxes in one folder.

Units are Blender's: metres, and watts that lamps radiate in all directions together (W/m² of a sun). A point lamp of P
has the intensity P / 4π, a lamp of area A the radiance P / (π A), as in Cycles.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .boxes import EXTINCTION, KEY, copied
from .command import Refused, run
from .look import GREY, pixels_of, write_image
from .meshes import OF_MESHES, GltfFile
from .motion import OpenShutter, key_of
from .toml_out import toml_of

LARGEST_SUN = 5e-3  # tangent of half the angle of a sun that is left out without a warning
TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])  # Blender's cameras look along −z with y up
FROM_RIGID = 1e-4  # largest departure of a box's pose from a rigid one


def written(
    depsgraph: bpy.types.Depsgraph,
    folder: Path,
    size: tuple[int, int],
    all_orders: bool = False,
    frame_set: Callable[[int, float], None] | None = None,
) -> tuple[Path, list[str], bool]:
    """Write the scene into a folder that exists. Gives scene.toml, what was lost, and whether something moves while
    the shutter is open. frame_set: evaluates the scene at another time; None: without motion blur.

    all_orders: of boxes that were built for light of the first order, the extinction becomes that of their elements.

    `Refused` where there is no camera, no lamp, or nothing to see.
    """
    scene, made = depsgraph.scene, GltfFile(folder)
    if scene.camera is None:
        raise Refused("the scene has no camera: add one (Add › Camera)")
    motion = OpenShutter(depsgraph, frame_set)
    motion.camera()
    boxes, lamps = [], []
    for each in depsgraph.object_instances:
        shown, pose = each.object, each.matrix_world.copy()
        if not each.show_self or shown.hide_render:
            continue
        if shown.type == "LIGHT":
            lamps.append((shown, pose))
            if motion.of(key_of(each)) is not None:
                made.lost.add(f"{shown.name}: the motion of a lamp while the shutter is open")
        elif shown.type == "VOLUME":
            if KEY in shown:
                file = copied(Path(shown[KEY]), folder, f"box_{len(boxes)}.zarr").name
                motion.add("box", len(boxes), key_of(each), pose, made.lost)
                boxes.append({"file": file, "name": shown.name, **_rigid(shown)})
                if all_orders and shown[EXTINCTION] == "isotropic":
                    boxes[-1]["extinction"] = "projected"
                    made.lost.add(
                        f"{shown.name}: its extinction is that of its elements here, as light of all orders needs"
                    )
            else:
                made.lost.add(f"{shown.name}: a volume that is no box of Hagoromo is left out (Add › Volume opens one)")
        elif shown.type in OF_MESHES:
            made.add(each, motion)
    if not made.meshes and not boxes:
        raise Refused("nothing is visible: the scene needs a mesh or a volume box that is rendered")
    tables = [_lamp(shown, pose, made.lost) for shown, pose in lamps]
    for number, (shown, _) in enumerate(lamps):
        made.lamp(f"lamp {number}", shown.data.color)
    record: dict[str, Any] = {"camera": _camera(depsgraph.scene.camera.evaluated_get(depsgraph), scene, size)}
    surfaces, spectra = _converted(made, folder)
    world = _world(scene, folder, made.lost)
    if not lamps and not world:
        raise Refused("nothing gives light: add a lamp, or a world that is not black")
    for number, (kind, table) in enumerate(tables):
        table |= {"spectrum": spectra[f"lamp {number}"], "name": lamps[number][0].name}
        record.setdefault(kind, []).append(table)
    record |= {"surface": surfaces, "box": boxes} | ({"environment": world} if world else {})
    record["motion"] = motion.table()
    for what in ("surface", "box"):  # keyframes say where they stand
        for number in {key[what] for key in motion.keys[what]}:
            first = next(key for key in motion.keys[what] if key[what] == number)
            record[what][number].pop("pose", None)
            record[what][number] |= {key: first[key] for key in ("position", "rotation_deg")}
    text = toml_of({key: value for key, value in record.items() if value})
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder / "scene.toml", sorted(made.lost), bool(record["motion"])


def _converted(made: GltfFile, folder: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Surfaces by Hagoromo's own reader of glTF, and the spectra of lamps by their names."""
    bare = not made.meshes
    if bare:  # a glTF has a mesh: a triangle that is not taken over
        made.record["materials"].append(GREY)
        at = made.accessor(np.eye(3), "VEC3")
        made.record["meshes"].append({"primitives": [{"attributes": {"POSITION": at}, "material": 0}]})
        made.record["nodes"].append({"mesh": 0})
    said = run("convert", made.write(), "--out", folder / "surfaces")
    made.lost |= {line.removeprefix("lost: ") for line in said.splitlines() if line.startswith("lost: ")}
    found = tomllib.loads((folder / "surfaces" / "scene.toml").read_text(encoding="utf-8"))
    spectra = {lamp["name"]: lamp.get("spectrum", 1.0) for lamp in found.get("lamp", ())}
    surfaces = [] if bare else sorted(found["surface"], key=lambda each: int(each["name"]))
    for surface in surfaces:
        surface.pop("normal_texture", None)
        for key in ("body_texture", "gamma_texture", "beta_texture"):
            if key in surface:
                surface[key]["file"] = f"surfaces/{surface[key]['file']}"
        known = dict(made.meshes[int(surface["name"])])
        if surface.get("optics"):
            known = {key: value for key, value in known.items() if not key.endswith("_texture")}
        surface |= {"mesh": f"surfaces/{surface['mesh']}", **known}
    return surfaces, spectra


def _camera(camera: bpy.types.Object, scene: bpy.types.Scene, size: tuple[int, int]) -> dict[str, Any]:
    """The camera: focal length and principal point [px] by sensor, fit and shift; the pose in OpenCV's axes."""
    lens, (width, height) = camera.data, size
    if lens.type != "PERSP":
        raise Refused(f"camera {camera.name} is {lens.type.lower()}: Hagoromo has cameras of perspective alone")
    across = lens.sensor_fit == "HORIZONTAL" or (lens.sensor_fit == "AUTO" and width >= height)
    side = width if across else height
    sensor = lens.sensor_height if lens.sensor_fit == "VERTICAL" else lens.sensor_width
    focal = lens.lens / sensor * side
    principal = [width / 2 - lens.shift_x * side, height / 2 + lens.shift_y * side]
    place, turn, _ = camera.matrix_world.decompose()
    pose = np.array(Matrix.LocRotScale(place, turn, None)) @ TO_OPENCV
    made = {
        "size": list(size), "focal": [focal, focal], "principal": principal,
        "world_to_camera": np.linalg.inv(pose).ravel().tolist(), "name": camera.name,
    }  # fmt: skip
    if lens.dof.use_dof:
        focus = lens.dof.focus_distance
        if lens.dof.focus_object is not None:
            aim = lens.dof.focus_object.matrix_world.translation - place
            focus = -(turn.inverted() @ aim).z
        made |= {"aperture_mm": lens.lens / lens.dof.aperture_fstop, "focus_mm": 1000.0 * focus}
    return made


def _lamp(shown: bpy.types.Object, pose: Matrix, lost: set[str]) -> tuple[str, dict[str, Any]]:
    """The table of scene.toml that a lamp belongs to, and its keys but for spectrum and name."""
    lamp, place, axis = shown.data, list(pose.translation), pose.to_3x3() @ Vector((0.0, 0.0, -1.0))
    axis.normalize()
    power = lamp.energy * 2.0 ** getattr(lamp, "exposure", 0.0)
    if lamp.type == "SUN":
        if math.tan(0.5 * lamp.angle) > LARGEST_SUN:
            lost.add(f"{shown.name}: the angle of the sun: it is a point infinitely far away")
        return "lamp", {"to_lamp": list(-axis), "intensity": power}
    if lamp.type == "AREA":
        return "area_lamp", _area(shown, pose, power, lost)
    if lamp.type == "POINT" and lamp.shadow_soft_size > 0.0:
        radius = lamp.shadow_soft_size
        return "area_lamp", {"radius": radius, "position": place, "radiance": power / (4.0 * math.pi**2 * radius**2)}
    keys: dict[str, Any] = {"position": place, "intensity": power / (4.0 * math.pi)}
    if lamp.type == "SPOT":
        edge = 0.5 * lamp.spot_size * (1.0 - 0.5 * lamp.spot_blend)
        keys |= {"axis": list(axis), "axis_power": max(math.log(0.5) / math.log(max(math.cos(edge), 1e-6)), 1e-3)}
        lost.add(f"{shown.name}: the edge of its cone: light falls as cos^μ, half of it at the cone's edge")
    return "lamp", keys


def _area(shown: bpy.types.Object, pose: Matrix, power: float, lost: set[str]) -> dict[str, Any]:
    """A rectangle of the same area."""
    lamp, scale = shown.data, pose.to_scale()
    sides = [lamp.size, lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size]
    if lamp.shape in ("DISK", "ELLIPSE"):
        sides = [0.5 * math.sqrt(math.pi) * side for side in sides]
        lost.add(f"{shown.name}: its round shape: it is a rectangle of the same area")
    across, along = (side * factor for side, factor in zip(sides, scale, strict=False))
    turn = pose.to_quaternion()
    edges = [list(turn @ Vector((0.0, along, 0.0))), list(turn @ Vector((across, 0.0, 0.0)))]  # it shines along −z
    return {"edges": edges, "position": list(pose.translation), "radiance": power / (math.pi * across * along)}


def _rigid(shown: bpy.types.Object) -> dict[str, Any]:
    """The pose of a box, which may be moved and turned."""
    pose = np.array(shown.matrix_world)
    if np.abs(pose[:3, :3].T @ pose[:3, :3] - np.eye(3)).max() > FROM_RIGID or np.linalg.det(pose) < 0.0:
        raise Refused(f"{shown.name} is scaled: a volume box can be moved and turned; build it in another size")
    return {"pose": pose.ravel().tolist()}


def _world(scene: bpy.types.Scene, folder: Path, lost: set[str]) -> dict[str, Any] | None:
    """Light of the world's Background node: one colour, or an image around it all."""
    world = scene.world
    output = world and world.node_tree and world.node_tree.get_output_node("ALL")
    links = output.inputs["Surface"].links if output else ()
    node = links[0].from_node if links else None
    if node is None or node.type != "BACKGROUND":
        return None
    strength = float(node.inputs["Strength"].default_value)
    colour = node.inputs["Color"]
    if strength <= 0.0 or (not colour.is_linked and max(colour.default_value[:3]) <= 0.0):
        return None
    file = folder / "world.exr"
    if not colour.is_linked:
        values = np.tile(np.array(colour.default_value[:3], np.float32), (8, 16, 1))
    else:
        source = colour.links[0].from_node
        if source.type != "TEX_ENVIRONMENT" or source.image is None:
            lost.add("the world: it is made by nodes that are no image, and left out")
            return None
        values = pixels_of(source.image)
    write_image(file, values)
    return {"file": file.name, "scale": strength, "visible": not scene.render.film_transparent}
