"""Scenes of glTF 2.0: cameras, lamps (KHR_lights_punctual) and meshes → a folder with scene.toml, and a scene → .glb.

The world is the file's, metres, y up in most. Lamps take candela and lux for our intensities; their colours become
smooth spectra. Materials become ours as `pbr` says, with textures of base colour and gloss; a cone of a spot becomes
cos^μ that is half where the cone's smooth edge is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.nerfstudio import write_transforms
from hagoromo.camera.pose import opencv_from_opengl, opengl_from_opencv
from hagoromo.errors import InputError
from hagoromo.files.gltf import placed_nodes
from hagoromo.files.mesh import MeshPart, read_gltf
from hagoromo.files.reading import reading
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_file, whole_folder, write_text
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.shape_mesh import shape_mesh
from hagoromo.image.scene.surface import Surface
from hagoromo.light.colour import linear_colour
from hagoromo.light.other_programs import InOtherPrograms
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo_formats.mitsuba.bsdfs import Converter
from hagoromo_formats.scenes.gltf_textures import (
    NEAREST,
    body_texture_of,
    extensions_of,
    is_of_squares,
    material_of,
    normal_texture_of,
    textured_visual,
    vertex_colours,
)
from hagoromo_formats.scenes.pbr import PbrMaterial, lost_gloss, surface_of
from hagoromo_formats.scenes.pbr_textures import look_of

LIGHTS = "KHR_lights_punctual"
ONE_OF_SEVERAL = re.compile(r"_[0-9a-f]{6}$")  # what trimesh adds to the name of a node whose mesh has several parts
HEIGHT = 720  # px: a camera of glTF has a field of view and no pixels
MOST_SURFACES = 2000
WIDEST_CONE = math.pi / 2 - 1e-3
AROUND, BALL_HALVINGS = 128, 5  # corners of what is round, halvings of the edges of an icosahedron
WRITTEN_MAPS = ("baseColorTexture", "metallicRoughnessTexture")
Matrix = NDArray[np.float64]


def scene_from_gltf(path: str | Path, out: str | Path, force: bool = False) -> list[str]:
    """Write the scene in a .glb or .gltf file as a folder: scene.toml, a PLY for each mesh, cameras.json.

    Returns what was made up: a camera or a lamp where the file has none; and what is lost. `InputError` where it has
    no mesh.
    """
    record, parts = read_gltf(path, numbered=True)
    if not parts:
        raise InputError(f"{path} has no mesh in its scene: give a glTF with triangles")
    if len(parts) > MOST_SURFACES:
        raise InputError(f"{path} has {len(parts)} meshes, a scene {MOST_SURFACES} at most: join them")
    bounds = np.array([np.min([part.vertices.min(axis=0) for part in parts], axis=0),
                       np.max([part.vertices.max(axis=0) for part in parts], axis=0)])  # fmt: skip
    made: list[str] = []
    with reading(path, "glTF"):
        placed = list(placed_nodes(record))
        cameras = dict(_cameras(record, placed))
        lamps = list(_lamps(record, placed))
    if not cameras:
        cameras["camera"] = _camera_of(bounds)
        made.append("the file has no camera: one looks along −z at all of it")
    if not lamps:
        first = next(iter(cameras.values()))
        towards = first.camera_to_world[:3, 3] - bounds.mean(axis=0)
        lamps.append({"to_lamp": towards.tolist(), "name": "camera"})
        made.append("the file has no lamp: one shines from the camera")
    with whole_folder(out, force) as folder:
        surfaces = list(_surfaces(parts, record, folder, Path(path), made))
        write_transforms(folder / "cameras.json", cameras)
        camera = next(iter(cameras.values()))
        text = toml_text({
            "camera": {
                "size": [camera.width, camera.height], "focal": list(camera.focal), "principal": list(camera.principal),
                "world_to_camera": camera.world_to_camera.ravel().tolist(), "name": next(iter(cameras)),
            },
            "lamp": lamps,
            "surface": surfaces,
        })  # fmt: skip
        write_text(folder / "scene.toml", text)
    return made


def _cameras(record: Mapping[str, Any], placed: list[tuple[Mapping[str, Any], Matrix]]) -> Iterator[tuple[str, Camera]]:
    known = record.get("cameras", [])
    for number, (node, place) in enumerate((node, place) for node, place in placed if "camera" in node):
        view = known[node["camera"]]
        if view.get("type") != "perspective":
            continue  # orthographic ones have no place that lamps and boxes know
        lens = view["perspective"]
        focal = 0.5 * HEIGHT / math.tan(0.5 * float(lens["yfov"]))
        width = max(round(HEIGHT * float(lens.get("aspectRatio", 4 / 3))), 1)
        name = str(node.get("name") or view.get("name") or f"camera {number + 1}")
        camera = Camera(width, HEIGHT, (focal, focal), (0.5 * width, 0.5 * HEIGHT), name=name)
        yield (
            f"{name}_{number + 1}" if number else name,
            camera.with_pose(np.linalg.inv(opencv_from_opengl(_rigid(place)))),
        )


def _rigid(place: Matrix) -> Matrix:
    """A place without its scale."""
    rigid = place.copy()
    rigid[:3, :3] /= np.linalg.norm(place[:3, :3], axis=0)
    return rigid


def _lamps(record: Mapping[str, Any], placed: list[tuple[Mapping[str, Any], Matrix]]) -> Iterator[dict[str, Any]]:
    """Records of lamps as scene.toml has them. They shine along −z of their nodes."""
    known = record.get("extensions", {}).get(LIGHTS, {}).get("lights", [])
    for node, place in placed:
        number = node.get("extensions", {}).get(LIGHTS, {}).get("light")
        if number is None:
            continue
        light = known[number]
        back = (place[:3, 2] / np.linalg.norm(place[:3, 2])).tolist()
        lamp: dict[str, Any] = {
            "intensity": float(light.get("intensity", 1.0)),
            "spectrum": _spectrum(light.get("color", (1, 1, 1))).record(),
            "name": str(node.get("name") or light.get("name") or f"lamp {number + 1}"),
        }
        if light.get("type") == "directional":
            yield lamp | {"to_lamp": back}
        elif light.get("type") == "spot":
            spot = light.get("spot", {})
            edge = 0.5 * (float(spot.get("innerConeAngle", 0.0)) + float(spot.get("outerConeAngle", math.pi / 4)))
            power = math.log(0.5) / math.log(math.cos(min(max(edge, 1e-2), WIDEST_CONE)))
            yield lamp | {"position": place[:3, 3].tolist(), "axis": [-x for x in back], "axis_power": power}
        else:
            yield lamp | {"position": place[:3, 3].tolist()}


def _spectrum(rgb: Any) -> Spectrum:
    """A smooth spectrum of linear colours 0…1; that of white is 1."""
    red, green, blue = smooth_rgb_basis()
    weights = np.clip(np.array(rgb, float)[:3], 0.0, None)
    values = sum(w * band.values for w, band in zip(weights, (red, green, blue), strict=True))
    return Spectrum(red.wavelengths, values)


def _surfaces(
    parts: Sequence[MeshPart], record: Mapping[str, Any], folder: Path, path: Path, made: list[str]
) -> Iterator[dict[str, Any]]:
    """Records of surfaces as scene.toml has them; their files are written, and what is lost is added to `made`."""
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

    materials = record.get("materials", [])
    known = {node.get("name") for node in record.get("nodes", ())}
    to = Converter(folder, [])
    for number, part in enumerate(parts):
        visual = ColorVisuals() if part.uv is None else TextureVisuals(uv=part.uv)
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False, visual=visual)
        file = f"mesh_{number + 1}.ply"
        texture_name = f"texture_{number + 1}"
        with reading(path, "glTF"):
            used = int(part.material) if part.material.isdecimal() else None
            material = {} if used is None else materials[used]
            colours = vertex_colours(part.colours)
            look, lost = material_of(path, record, material, mesh, folder, texture_name)
            texture, largest, lost_body = body_texture_of(path, record, material, mesh, colours, folder, texture_name)
            normals, lost_normals = normal_texture_of(path, record, material, mesh, folder, texture_name)
            if look.mapped and "vertex_colours" in (texture or {}):
                lost.append(f"{texture_name}: its textures of gloss, as its colours are of vertices")
                look = look._replace(roughness_map=None, specular_map=None)
            if largest is not None:
                look = look._replace(base=largest, textured=True)
            who = f"material {material.get('name') or (-1 if used is None else used)}"
            tables = surface_of(look, to, who, folder, texture_name)
            if normals and not tables.get("optics"):
                tables["normal_texture"] = normals
        if tables.get("optics") and texture:
            lost.append(f"{texture_name}: the texture of its mirror or glass")
            texture = None
        made += [f"lost: {each}" for each in [*lost_body, *lost_normals, *lost]]
        if texture is None and not any("texture" in key for key in tables):
            mesh.visual = ColorVisuals()
        data: Any = mesh.export(file_type="ply")
        (folder / file).write_bytes(data)
        node = part.node if part.node in known else ONE_OF_SEVERAL.sub("", part.node)
        named = {"mesh": file, "name": node if node in known else f"mesh {number + 1}"}
        yield named | tables | ({"body_texture": texture} if texture else {})
    made += [f"lost: {each}" for each in to.lost]


def _camera_of(bounds: Any) -> Camera:
    """A camera that sees a box (2, 3) from along z."""
    low, high = np.asarray(bounds, float)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0
    lens = Camera(960, HEIGHT, (1000.0, 1000.0), (480.0, 360.0))
    eye = middle + np.array([0.0, 0.0, 0.5 * (high - low)[2] + 1.5 * size])
    return lens.look_at(eye.tolist(), middle.tolist(), (0, 1, 0))


def gltf_from_scene(scene: Scene, out: str | Path, force: bool = False) -> list[str]:
    """Write camera, lamps and surfaces of a scene as .glb, with textures of body and γ; returns what is lost."""
    import trimesh
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    meshes, looks, lost_textures, squares = trimesh.Scene(), {}, [], set()
    for number, surface in enumerate(scene.surfaces):
        name = f"{surface.name or surface.shape}_{number + 1}"
        vertices, faces = triangles_of(surface)
        look, colours = look_of(surface, vertices)
        visual, lost_here = textured_visual(surface, look, colours, (vertices, faces), name)
        lost_textures += lost_here
        placed = vertices @ surface.pose[:3, :3].T + surface.pose[:3, 3]
        plain = TextureVisuals(material=PBRMaterial(name=name, metallicFactor=0.0))
        mesh = trimesh.Trimesh(placed, faces, process=False, visual=visual or plain)
        meshes.add_geometry(mesh, node_name=name, geom_name=name)
        squares |= {(name, "baseColorTexture")} if is_of_squares(surface.body_texture) else set()
        squares |= set() if look.smooth else {(name, "metallicRoughnessTexture")}
        looks[name] = look
    if not meshes.geometry:
        raise InputError("the scene has no surface, and glTF holds no volume boxes: write these as .nrrd or .vti")

    of_lights = list[str]()

    def further(tree: dict[str, Any]) -> None:
        _add_materials(tree, looks, squares)
        _add_camera(tree, scene.camera)
        of_lights.extend(_add_lights(tree, (*scene.lamps, *scene.wide_lights)))

    data = export_glb(meshes, tree_postprocessor=further)
    with whole_file(out, force) as partial:
        partial.write_bytes(data)
    lost = [f"{len(scene.boxes)} volume boxes"] if scene.boxes else []
    lost += ["the distortion of the lens"] if any(scene.camera.distortion) else []
    lost += of_lights + lost_textures + list(lost_gloss(scene.surfaces, "gltf"))
    lost.append("spectra (colours are linear sRGB)")
    return [*lost, "where between two pixels the optical axis is"]


def _add_materials(tree: dict[str, Any], looks: Mapping[str, PbrMaterial], squares: set[tuple[str, str]]) -> None:
    """The factors of all materials. Each mesh has one of its name; trimesh makes none for colours of vertices.

    looks: by their names. squares: names, and keys of textures that are not interpolated.
    """
    materials = tree.setdefault("materials", [])
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            if "material" not in primitive:
                primitive["material"] = len(materials)
                materials.append({"name": mesh["name"]})
    for material in materials:
        pbr = material.setdefault("pbrMetallicRoughness", {})
        name, textures = material["name"], {key: pbr[key] for key in WRITTEN_MAPS if key in pbr}
        for key, texture in textures.items():
            if (name, key) in squares:
                samplers = tree.setdefault("samplers", [])
                tree["textures"][texture["index"]]["sampler"] = len(samplers)
                samplers.append({"magFilter": NEAREST})
        look = looks[name]
        factors = {"baseColorFactor": [*look.base.tolist(), 1.0], "metallicFactor": look.metallic}
        material["pbrMetallicRoughness"] = factors | {"roughnessFactor": look.roughness} | textures
        material["extensions"] = extensions_of(look, textures.get("metallicRoughnessTexture"))
        tree["extensionsUsed"] = sorted({*tree.get("extensionsUsed", ()), *material["extensions"]})


def _add_node(tree: dict[str, Any], node: dict[str, Any], place: Matrix) -> None:
    tree["nodes"].append(node | {"matrix": place.T.ravel().tolist()})
    tree["scenes"][tree.get("scene", 0)]["nodes"].append(len(tree["nodes"]) - 1)


def _add_camera(tree: dict[str, Any], camera: Camera) -> None:
    lens = {"yfov": 2 * math.atan(0.5 * camera.height / camera.focal[1]), "znear": 1e-3,
            "aspectRatio": camera.width / camera.focal[0] * camera.focal[1] / camera.height}  # fmt: skip
    tree["cameras"] = [{"type": "perspective", "perspective": lens, "name": camera.name or "camera"}]
    _add_node(tree, {"camera": 0, "name": camera.name or "camera"}, opengl_from_opencv(camera.camera_to_world))


def _add_lights(tree: dict[str, Any], lights: Sequence[InOtherPrograms]) -> list[str]:
    """Those that glTF has; returns what is lost."""
    forms, lost = list[dict[str, Any]](), dict[str, None]()
    for light in lights:
        form, lines = light.gltf()
        lost |= dict.fromkeys(lines)
        if form is None:
            continue
        rgb = np.clip(linear_colour(form.spectrum, Spectrum.constant(1.0)), 0.0, None)
        top, name = float(rgb.max()) or 1.0, light.name or f"lamp {len(forms) + 1}"
        stated = {"type": form.kind, "color": (rgb / top).tolist(), "intensity": form.strength * top, "name": name}
        if form.cone is not None:
            stated["spot"] = dict(zip(("innerConeAngle", "outerConeAngle"), form.cone, strict=True))
        _add_node(tree, {"name": name, "extensions": {LIGHTS: {"light": len(forms)}}}, form.place)
        forms.append(stated)
    if forms:
        tree.setdefault("extensions", {})[LIGHTS] = {"lights": forms}
        tree.setdefault("extensionsUsed", []).append(LIGHTS)
    return list(lost)


def triangles_of(surface: Surface) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices and faces of a surface before its pose; of what is round AROUND corners."""
    if surface.vertices is not None and surface.faces is not None:
        return np.asarray(surface.vertices), np.asarray(surface.faces)
    return shape_mesh(surface.shape, AROUND, BALL_HALVINGS)[:2]
