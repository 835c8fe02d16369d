"""Read: a scene of Mitsuba, XML or dictionary → a folder with scene.toml, a PLY for each mesh, cameras.json.

Only what is listed here is read, and nothing of it is run: other plugins are refused by name. Lengths are metres, the
world is the file's. Colours R, G, B become spectra by the basis of Mallett & Yuksel 2019, white is 1 everywhere.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.nerfstudio import write_transforms
from hagoromo.errors import InputError
from hagoromo.files.checks import inside, sized_file
from hagoromo.files.exr import write_exr
from hagoromo.files.mesh import read_mesh, uv_of
from hagoromo.files.reading import reading
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_folder, write_text
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.environment import FROM_MITSUBA
from hagoromo_formats.mitsuba.bsdfs import ALL_KINDS, WHITE, Converter
from hagoromo_formats.mitsuba.serialized import read_serialized
from hagoromo_formats.mitsuba.textures import ply_of
from hagoromo_formats.mitsuba.xml_tree import read_xml

Table = Mapping[str, Any]
Matrix = NDArray[np.float64]
SHAPES = ("sphere", "rectangle", "disk", "cylinder", "cube")
MESHES = ("obj", "ply", "serialized")
SENSORS = ("perspective", "thinlens")
EMITTERS = ("point", "directional", "spot", "area", "constant", "envmap")
IGNORED = {"film", "sampler", "integrator", "rfilter", "medium", "texture", "volume", "phase", "bsdf"}
INTEGRATORS = (
    "path",
    "direct",
    "volpath",
    "volpathmis",
    "prb",
    "prbvolpath",
    "aov",
    "depth",
    "moment",
    "ptracer",
    "stokes",
)
MOST_SHAPES = 2000
LARGEST_MAP = 1 << 32  # bytes
DEFAULT_FILM = 768, 576  # px
DIAGONAL_35MM = math.hypot(36.0, 24.0)
RECTANGLE = 1e-4  # of its size, by which a mesh that is a lamp may miss a rectangle


def scene_from_mitsuba(source: str | Path | Mapping[str, Any], out: str | Path, force: bool = False) -> list[str]:
    """Write a scene of Mitsuba as a folder that `render` takes: scene.toml, meshes, cameras.json.

    source: an .xml file, or the dictionary that `mitsuba.load_dict` takes, whose files are then in this folder.
    Returns what is lost or made up, a line each. `InputError` for plugins that are not read, and for damaged files.
    """
    if isinstance(source, Mapping):
        table, home, where = _plain(source, 0), Path(), "the dictionary"
    else:
        table, home, where = read_xml(source), Path(source).parent, str(source)
    with whole_folder(out, force) as folder, reading(where, "a scene of Mitsuba"):
        scene = _Scene(home, folder)
        write_text(folder / "scene.toml", toml_text(scene.record(table, where)))
        load_scene(folder / "scene.toml")  # what is no scene is refused here
    return scene.lost


def _plain(value: Any, depth: int) -> Any:
    """A dictionary of Mitsuba with its transforms as arrays."""
    if depth > 64:
        raise InputError("the dictionary nests more than 64 deep: it is refused")
    if isinstance(value, Mapping):
        return {key: _plain(each, depth + 1) for key, each in value.items()}
    if hasattr(value, "matrix"):
        return np.array(value.matrix, float).reshape(4, 4)
    if isinstance(value, (bool, int, float, str, np.ndarray)):
        return value
    if isinstance(value, (list, tuple)):
        pairs = bool(value) and isinstance(value[0], (list, tuple))
        return [tuple(each) for each in value] if pairs else np.array(value, float)
    raise InputError(f"the dictionary holds a {type(value).__name__}, which is made already: give its dictionary")


class _Scene:
    def __init__(self, home: Path, folder: Path) -> None:
        self.home, self.folder = home, folder
        self.lost: list[str] = []
        self.bsdfs = Converter(home, self.lost, folder)
        self.cameras: dict[str, Camera] = {}
        self.sections: dict[str, list[dict[str, Any]]] = {"lamp": [], "area_lamp": [], "surface": []}
        self.environment: dict[str, Any] | None = None
        self.hidden = False

    def record(self, table: Table, where: str) -> dict[str, Any]:
        if table.get("type") != "scene":
            raise InputError(f"{where} is no scene of Mitsuba: give one of type 'scene'")
        parts = {name: part for name, part in table.items() if isinstance(part, Mapping)}
        self.hidden = any(part.get("hide_emitters") is True for part in parts.values())
        for name, part in parts.items():
            self.add(part, f"{part.get('type')} {part.get('id', name)!r}")
        self.bsdfs.nest_glass()
        if not self.cameras:
            raise InputError(f"{where} has no camera: give a sensor, {' or '.join(SENSORS)}")
        write_transforms(self.folder / "cameras.json", self.cameras)
        name, camera = next(iter(self.cameras.items()))
        lens = {"aperture_mm": 1e3 * camera.aperture, "focus_mm": 1e3 * camera.focus} if camera.aperture else {}
        record: dict[str, Any] = {
            "camera": {
                "size": [camera.width, camera.height], "focal": list(camera.focal), "principal": list(camera.principal),
                "world_to_camera": camera.world_to_camera.ravel().tolist(), "name": name, **lens,
            },
            **{key: tables for key, tables in self.sections.items() if tables},
        }  # fmt: skip
        return record | ({"environment": self.environment} if self.environment else {})

    def add(self, part: Table, who: str) -> None:
        kind = part["type"]
        if kind in (*SHAPES, *MESHES):
            self.shape(part, who)
        elif kind in SENSORS:
            name = str(part.get("id", f"camera {len(self.cameras) + 1}"))
            self.cameras[name] = self.camera(part, name, who)
        elif kind in EMITTERS:
            self.emitter(part, who)
        elif kind in ALL_KINDS or kind in INTEGRATORS or part.get("tag") in IGNORED:
            return
        else:
            known = ", ".join((*SHAPES, *MESHES, *SENSORS, *EMITTERS))
            raise InputError(
                f"the scene has a {part.get('tag', 'plugin')} {kind!r}, which is not read: give one of {known}"
            )

    def camera(self, part: Table, name: str, who: str) -> Camera:
        film = next((each for each in _parts(part) if each["type"] in ("hdrfilm", "specfilm", "ldrfilm")), {})
        width, height = (int(film.get(key, size)) for key, size in zip(("width", "height"), DEFAULT_FILM, strict=True))
        if "crop_width" in film or "crop_offset_x" in film:
            self.bsdfs.say(f"{who}: the crop of its film")
        focal = _focal(part, width, height, who)
        offset = [float(part.get(f"principal_point_offset_{axis}", 0.0)) for axis in "xy"]
        principal = (width * (0.5 - offset[0]), height * (0.5 - offset[1]))
        place = _place(part)
        axes = place[:3, :3] / np.linalg.norm(place[:3, :3], axis=0)
        if np.linalg.det(axes) < 0.0:
            self.bsdfs.say(f"{who}: it mirrors its picture")
            axes[:, 0] *= -1.0
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes @ np.diag([-1.0, -1.0, 1.0]), place[:3, 3]
        lens: dict[str, Any] = {}
        if part["type"] == "thinlens":
            lens = {"aperture": 2.0 * float(part["aperture_radius"]), "focus": float(part["focus_distance"])}
        return Camera(width, height, (focal, focal), principal, name=name, **lens).with_pose(np.linalg.inv(pose))

    def light(self, part: Any, strength: str, who: str) -> dict[str, Any]:
        """The spectrum of a lamp, of mean 1, and its strength by the name of its key."""
        whole = self.bsdfs.colour(part, WHITE, who)
        mean = float(whole.mean())
        if not mean > 0.0:
            raise InputError(f"{who} has no light between 400 and 700 nm: remove it, or give it some")
        spectrum = {} if np.ptp(whole.values) == 0.0 else {"spectrum": whole.scaled(1.0 / mean).record()}
        return {strength: mean, **spectrum}

    def emitter(self, part: Table, who: str) -> None:
        kind, place, name = part["type"], _place(part), str(part.get("id", ""))
        if kind == "constant":
            write_exr(self.folder / "constant.exr", dict.fromkeys("RGB", np.ones((8, 16), np.float32)))
            self.surround({"file": "constant.exr", **self.light(part.get("radiance"), "scale", who)}, who)
        elif kind == "envmap":
            self.map(part, place, who)
        elif kind == "directional":
            along = np.asarray(part["direction"], float) if "direction" in part else place[:3, 2]
            to_lamp = (-along / np.linalg.norm(along)).tolist()
            light = self.light(part.get("irradiance"), "intensity", who)
            self.sections["lamp"].append({"to_lamp": to_lamp, **light, "name": name})
        elif kind in ("point", "spot"):
            where = np.asarray(part["position"], float) if "position" in part else place[:3, 3]
            light = self.light(part.get("intensity"), "intensity", who)
            lamp = {"position": where.tolist(), **light, "name": name}
            self.sections["lamp"].append(lamp | (self.beam(part, place, who) if kind == "spot" else {}))
        else:
            raise InputError(f"{who} is an area emitter without a shape: put it into one")

    def beam(self, part: Table, place: Matrix, who: str) -> dict[str, Any]:
        """The cone of a spot: full up to the beam's width, then linear in the angle to nothing."""
        edge = float(part.get("cutoff_angle", 20.0))
        full = min(float(part.get("beam_width", 0.75 * edge)), 0.999 * edge)
        if any(each["type"] == "bitmap" for each in _parts(part)):
            self.bsdfs.say(f"{who}: the picture that it throws")
        angles, values = ([0.0, full, edge], [1.0, 1.0, 0.0]) if full > 0.02 else ([0.0, edge], [1.0, 0.0])
        axis = place[:3, 2] / np.linalg.norm(place[:3, 2])
        return {"axis": axis.tolist(), "profile": {"lateral": [0.0], "vertical": angles, "intensity": [values]}}

    def map(self, part: Table, place: Matrix, who: str) -> None:
        if "filename" not in part:
            raise InputError(f"{who} names no file: give filename, an .exr or .hdr")
        source = inside(self.home, str(part["filename"]))
        file = f"environment{source.suffix.lower()}"
        shutil.copyfile(sized_file(source, LARGEST_MAP, "an environment"), self.folder / file)
        turn = place[:3, :3] @ FROM_MITSUBA.T
        if np.linalg.det(turn) < 0.0 or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise InputError(f"{who} is scaled or mirrored by to_world: give a turn")
        self.bsdfs.say(f"{who}: its light between the middles of pixels: a pixel is even here")
        scale = {"scale": float(part["scale"])} if "scale" in part else {}
        self.surround({"file": file, "rotation_deg": angles_of(turn), **scale}, who)

    def surround(self, record: dict[str, Any], who: str) -> None:
        if self.environment is not None:
            raise InputError(f"{who} is a second environment: give one")
        self.environment = record | {"visible": not self.hidden, "name": who}

    def shape(self, part: Table, who: str) -> None:
        number = len(self.sections["surface"]) + len(self.sections["area_lamp"]) + 1
        if number > MOST_SHAPES:
            raise InputError(f"the scene has more than {MOST_SHAPES} shapes: join them")
        place, light = _place(part), next((each for each in _parts(part) if each["type"] == "area"), None)
        mesh = self.mesh(part, who) if part["type"] in MESHES else None
        if light is not None:
            self.area_lamp(part, light, place, mesh, who)
            return
        if any(each.get("tag") == "medium" or name in ("interior", "exterior") for name, each in part.items()
               if isinstance(each, Mapping)):  # fmt: skip
            self.bsdfs.say(f"{who}: the medium in it")
        on_top = part.get("flip_tex_coords", part["type"] == "obj") is True
        self.bsdfs.on_top = None if mesh is not None and mesh[2] is None else on_top and mesh is not None
        bsdfs = (each for each in _parts(part) if each["type"] in ALL_KINDS or each.get("tag") == "bsdf")
        keys = self.bsdfs.surface(next(bsdfs, None), who)
        if keys is None:
            self.bsdfs.say(f"{who}: it has no surface (null), and is left out")
            return
        name = {"name": str(part.get("id", part["type"]))}
        if mesh is None:
            pose = _unit_place(part, place)
            if part["type"] == "sphere":
                _radius(pose, who)
            self.sections["surface"].append({"shape": part["type"], "pose": pose.ravel().tolist(), **keys, **name})
            return
        vertices, faces, uv = mesh
        columns = {} if uv is None else dict(zip(("u", "v"), uv.T, strict=True))
        file = f"mesh_{number}.ply"
        (self.folder / file).write_bytes(ply_of(vertices @ place[:3, :3].T + place[:3, 3], faces, columns))
        smooth = {"smooth": False} if part.get("face_normals") is True else {}
        self.sections["surface"].append({"mesh": file, **smooth, **keys, **name})

    def mesh(self, part: Table, who: str) -> tuple[Matrix, NDArray[Any], Matrix | None]:
        """Vertices before the place, faces and the UVs of the vertices."""
        path = inside(self.home, str(part.get("filename", "")))
        if part["type"] == "serialized":
            return *read_serialized(path, int(part.get("shape_index", 0))), None
        if path.suffix.lower() != f".{part['type']}":
            raise InputError(f"{who} names {path.name}: give a .{part['type']}")
        mesh = read_mesh(path)
        return np.asarray(mesh.vertices, float), np.asarray(mesh.faces), uv_of(mesh)

    def area_lamp(self, part: Table, light: Table, place: Matrix, mesh: Any, who: str) -> None:
        """A sphere, rectangle or tube that shines. A mesh: a rectangle if it is one, else a sphere of the same area."""
        lamp = self.light(light.get("radiance"), "radiance", who)
        lamp |= {"visible": not self.hidden, "name": str(part.get("id", ""))}
        self.bsdfs.say("lamps with a size neither reflect nor hide what is behind them")
        if part["type"] == "sphere":
            pose = _unit_place(part, place)
            lamp |= {"position": pose[:3, 3].tolist(), "radius": _radius(pose, who)}
        elif part["type"] in ("rectangle", "disk"):
            if part["type"] == "disk":
                self.bsdfs.say(f"{who}: the shape of the lamp: it is a square of the same area")
            lamp |= _square(
                place, math.sqrt(math.pi) if part["type"] == "disk" else 2.0, part.get("flip_normals") is True
            )
        elif part["type"] == "cylinder" and part.get("flip_normals") is not True:
            pose = _unit_place(part, place)  # its axis is the third one
            radii = np.linalg.norm(pose[:3, :2], axis=0)
            lamp |= {"position": (pose[:3, 3] + 0.5 * pose[:3, 2]).tolist(), "along": pose[:3, 2].tolist()}
            lamp |= {"radius": float(np.sqrt(radii.prod()))}
        elif mesh is not None:
            vertices = mesh[0] @ place[:3, :3].T + place[:3, 3]
            lamp |= self.shining_mesh(vertices, mesh[1], part.get("flip_normals") is True, who)
        else:
            raise InputError(
                f"{who} shines and is a {part['type']}: give a sphere, a rectangle, a disk, a cylinder or a mesh"
            )
        self.sections["area_lamp"].append(lamp)

    def shining_mesh(self, vertices: Matrix, faces: NDArray[Any], flip: bool, who: str) -> dict[str, Any]:
        """A rectangle where the mesh is one, else a sphere of the same area."""
        found = _rectangle_of(vertices, faces)
        if found is not None:
            return {"position": found[0].tolist(), "edges": (found[1][::-1] if flip else found[1]).tolist()}
        area, middle = _area_and_middle(vertices, faces)
        self.bsdfs.say(f"{who}: the shape of the lamp: it is a sphere of the same area")
        return {"position": middle.tolist(), "radius": math.sqrt(area / (4.0 * math.pi))}


def _parts(part: Table) -> Iterator[Table]:
    return (each for each in part.values() if isinstance(each, Mapping) and "type" in each)


def _place(part: Table) -> Matrix:
    place = np.asarray(part.get("to_world", np.eye(4)), float)
    if place.shape != (4, 4) or not np.isfinite(place).all() or not np.allclose(place[3], (0, 0, 0, 1)):
        raise InputError(f"{part['type']}: to_world is no place: give an affine 4 × 4 matrix")
    return place


def _focal(part: Table, width: int, height: int, who: str) -> float:
    """Focal length [px] of a field of view [°] along an axis, or of a lens before a film of 36 × 24 mm [mm]."""
    axis = str(part.get("fov_axis", "x"))
    if "focal_length" in part:
        degrees = 2.0 * math.degrees(
            math.atan(0.5 * DIAGONAL_35MM / float(str(part["focal_length"]).removesuffix("mm")))
        )
        axis = "diagonal"
    elif "fov" in part:
        degrees = float(part["fov"])
    else:
        raise InputError(f"{who} has no field of view: give fov or focal_length")
    sizes = {"x": width, "y": height, "diagonal": math.hypot(width, height), "smaller": min(width, height),
             "larger": max(width, height)}  # fmt: skip
    if axis not in sizes or not 0.0 < degrees < 180.0:
        raise InputError(f"{who} has a fov of {degrees:g}° along {axis!r}: give 0 to 180 along {', '.join(sizes)}")
    return 0.5 * sizes[axis] / math.tan(0.5 * math.radians(degrees))


def _unit_place(part: Table, place: Matrix) -> Matrix:
    """The place of the shape of unit size, with its own centre and radius, or ends."""
    own = np.eye(4)
    if part["type"] == "sphere":
        own[:3, :3] *= float(part.get("radius", 1.0))
        own[:3, 3] = np.asarray(part.get("center", np.zeros(3)), float)
    if part["type"] == "cylinder":
        ends = [np.asarray(part.get(key, default), float) for key, default in (("p0", (0, 0, 0)), ("p1", (0, 0, 1)))]
        along, radius = ends[1] - ends[0], float(part.get("radius", 1.0))
        length = float(np.linalg.norm(along))
        side = np.cross((0.0, 1.0, 0.0) if abs(along[1]) < 0.9 * length else (1.0, 0.0, 0.0), along)
        side /= np.linalg.norm(side)
        own[:3, :3] = np.column_stack([radius * side, radius * np.cross(along / length, side), along])
        own[:3, 3] = ends[0]
    return place @ own


def _radius(place: Matrix, who: str) -> float:
    """The radius of a unit sphere at a place."""
    scale = float(np.linalg.norm(place[:3, 0]))
    if not np.allclose(place[:3, :3].T @ place[:3, :3], scale * scale * np.eye(3), rtol=0.0, atol=1e-5 * scale * scale):
        raise InputError(f"{who} is no sphere by its to_world: scale it alike along all axes")
    return scale


def _square(place: Matrix, side: float, flip: bool) -> dict[str, Any]:
    """Middle and sides of a square about the origin at a place, which shines along its normal; flip: the other way."""
    edges = side * place[:3, :2].T
    normal = np.linalg.inv(place[:3, :3]).T @ (0.0, 0.0, 1.0)
    if (np.cross(*edges) @ normal < 0.0) != flip:
        edges = edges[::-1]
    return {"position": place[:3, 3].tolist(), "edges": edges.tolist()}


def _rectangle_of(vertices: Matrix, faces: NDArray[Any]) -> tuple[Matrix, Matrix] | None:
    """Middle and sides (2, 3) of two triangles that make a rectangle; the cross product of the sides is its normal."""
    used = np.unique(vertices[faces].reshape(-1, 3).round(12), axis=0)
    if len(faces) != 2 or len(used) != 4:
        return None
    first = vertices[faces[0]]
    lengths = np.linalg.norm(first - np.roll(first, -1, axis=0), axis=1)
    corner = (int(np.argmax(lengths)) + 2) % 3  # opposite of the longest side
    start, one, two = (first[(corner + k) % 3] for k in range(3))
    edges, size = np.array([one - start, two - start]), float(lengths.max())
    square = abs(edges[0] @ edges[1]) <= RECTANGLE * size * size
    closed = np.linalg.norm(used - (one + two - start), axis=1).min() <= RECTANGLE * size
    return (used.mean(axis=0), edges) if square and closed else None


def _area_and_middle(vertices: Matrix, faces: NDArray[Any]) -> tuple[float, Matrix]:
    corners = vertices[faces]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    total = float(areas.sum())
    if not total > 0.0:
        raise InputError("a lamp of the scene has no area: give its shape one")
    return total, (areas @ corners.mean(axis=1)) / total


def angles_of(turn: Matrix) -> list[float]:
    """Turns about x, then y, then z [°] that make a rotation."""
    y = math.asin(min(max(-turn[2, 0], -1.0), 1.0))
    if abs(turn[2, 0]) < 1.0 - 1e-12:
        x, z = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:
        x, z = math.atan2(-turn[1, 2], turn[1, 1]), 0.0
    return [math.degrees(angle) for angle in (x, y, z)]
