"""Scenes of USD: cameras, lamps (UsdLux), meshes and shapes → a folder with scene.toml, a PLY for each mesh.

The world is metres, z up. A lamp's intensity · 2^exposure · colour, in nits or lux, is taken number for number as our
radiance, or irradiance of far lamps; the colour white is a constant spectrum. A UsdPreviewSurface becomes a body with
facets of GGX, a metal, or glass.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.nerfstudio import write_transforms
from hagoromo.camera.pose import opencv_from_opengl
from hagoromo.errors import InputError
from hagoromo.files.checks import inside, sized_file
from hagoromo.files.exr import write_exr
from hagoromo.files.reading import reading
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_folder, write_text
from hagoromo.image.scene.motion import read_motion
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.surface import RELIEFS, TEXTURES
from hagoromo.light.colour import linear_colour, srgb_encode
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.torrance_sparrow import normal_fresnel
from hagoromo_formats.mitsuba.bsdfs import Converter
from hagoromo_formats.mitsuba.read import LARGEST_MAP, angles_of
from hagoromo_formats.scenes.pbr import PbrMaterial, rgb, surface_of
from hagoromo_formats.scenes.pbr_textures import gloss_of_colours
from hagoromo_formats.scenes.usd_motion import Placed, camera_keys, motion_table, placed
from hagoromo_formats.scenes.usd_parts import NORMAL, UsdMesh, UsdParts, read_usd
from hagoromo_formats.scenes.usd_stage import unpacked
from hagoromo_formats.scenes.usd_textures import UsdTextures

Table = dict[str, Any]
Matrix = NDArray[np.float64]
HEIGHT = 720  # px, where the file has no render settings
MOST_SURFACES = 2000
GREY = (0.8, 0.8, 0.8)  # of what has neither material nor colour
TENTH = 0.1  # of a unit: that of focal lengths and apertures
SAME_RATIO = 0.01  # of pictures and apertures, that they are one
MOST_CONE = 179.0  # degrees
# columns: axes of our maps in the frame of DomeLight (pole +y, middle +z, +x a quarter to its left)
DOME = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
POLE_Z = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
UNMOVED = np.eye(4)
ROUND = 1e-4  # relative difference of the scales along the axes of a sphere


def scene_from_usd(path: str | Path, out: str | Path, force: bool = False) -> list[str]:
    """Write the scene in a USD file as a folder: scene.toml, a PLY for each mesh, cameras.json.

    Returns what is lost, a line each, or "made up: …". `InputError` where it has no surface, and as of `read_usd`.
    """
    with unpacked(path) as file:
        return _scene_from(file, Path(path), out, force)


def _scene_from(file: Path, path: Path, out: str | Path, force: bool) -> list[str]:
    parts = read_usd(file)
    if not (parts.meshes or parts.shapes):
        raise InputError(f"{path} has no mesh and no shape: give a scene with surfaces")
    if len(parts.meshes) + len(parts.shapes) > MOST_SURFACES:
        raise InputError(f"{path} has more than {MOST_SURFACES} surfaces: join them")
    with whole_folder(out, force) as folder, reading(path, "USD"):
        scene = _UsdScene(parts, path, file.parent, folder)
        write_text(folder / "scene.toml", toml_text(scene.record()))
        load_scene(folder / "scene.toml")  # what is no scene is refused here
        if scene.keys["camera"] or scene.keys["surface"]:
            read_motion(folder / "scene.toml")
    return list(dict.fromkeys(scene.lost))


class _UsdScene:
    def __init__(self, parts: UsdParts, path: Path, home: Path, folder: Path) -> None:
        self.parts, self.home, self.folder = parts, home, folder
        self.lost = list(parts.lost)
        self.bodies = Converter(home, self.lost)
        self.path = path
        self.known: dict[tuple[str, bool, bool], Table] = {}  # tables of materials
        self.environment: Table | None = None
        self.keys: dict[str, list[Table]] = {"camera": [], "surface": []}
        self.shutter = 0.0, 0.0
        self.lamps: list[Table] = []
        self.area_lamps: list[Table] = []

    def record(self) -> Table:
        surfaces = self.meshes()
        for table in self.parts.shapes:
            surfaces.append(self.shape(table, len(surfaces)))
        cameras = self.cameras()
        for lamp in self.parts.lamps:
            self.lamp(lamp, f"lamp {lamp['name']!r}")
        first = next(iter(cameras.values()))
        if not (self.lamps or self.area_lamps or self.environment):
            self.lamps.append({"to_lamp": (-first.camera_to_world[:3, 2]).tolist(), "name": "camera"})
            self.lost.append("made up: the file has no lamp: one shines from the camera")
        write_transforms(self.folder / "cameras.json", cameras)
        lens = {"aperture_mm": 1e3 * first.aperture, "focus_mm": 1e3 * first.focus} if first.aperture else {}
        sections = {"lamp": self.lamps, "area_lamp": self.area_lamps, "surface": surfaces}
        return {
            "camera": {
                "size": [first.width, first.height], "focal": list(first.focal), "principal": list(first.principal),
                "world_to_camera": first.world_to_camera.ravel().tolist(), "name": next(iter(cameras)), **lens,
            },
            **{key: tables for key, tables in sections.items() if tables},
            **({"environment": self.environment} if self.environment else {}),
            **({"motion": motion_table(self.parts.clock, self.keys, self.shutter)} if any(self.keys.values()) else {}),
        }  # fmt: skip

    def cameras(self) -> dict[str, Camera]:
        """The perspective ones by name; where there is none, one that sees everything from along −y."""
        cameras: dict[str, Camera] = {}
        for table in self.parts.cameras:
            name = table["name"] if table["name"] not in cameras else f"{table['name']}_{len(cameras) + 1}"
            if table["projection"] != "perspective":
                self.lost.append(f"camera {name!r}: it is {table['projection']}")
                continue
            for key, what in (("clippingRange", "clipping range"), ("clippingPlanes", "clipping planes")):
                if table[key] is not None and len(table[key]):
                    self.lost.append(f"cameras: their {what}")
            if table["exposure"]:
                self.lost.append(f"camera {name!r}: its exposure")
            cameras[name] = self.camera(table, name)
            if len(cameras) == 1:
                self.shutter = float(table["shutter:open"]), float(table["shutter:close"])
                self.keys["camera"] = camera_keys(*_motion(table)) if table["motion"] else []
            elif table["motion"]:
                self.lost.append(f"camera {name!r}: its motion, as the first one's is read")
        if not cameras:
            self.lost.append("made up: the file has no camera: one looks along y at all of it")
            cameras["camera"] = self.whole_view()
        return cameras

    def camera(self, table: Table, name: str) -> Camera:
        """Shifts of the aperture are those of the principal point."""
        length, across, high = (float(table[key]) for key in ("focalLength", "horizontalAperture", "verticalAperture"))
        if not min(length, across, high) > 0.0:
            raise ValueError(f"camera {name!r} has a focal length or aperture that is not above 0")
        width, height = self.parts.size or (0, HEIGHT)
        if not width or abs(width * high / (height * across) - 1.0) > SAME_RATIO:
            width = max(round(height * across / high), 1)
            self.lost.append("made up: the size of the picture, by the aperture")
        shift = [float(table[f"{key}ApertureOffset"]) / size for key, size in (("horizontal", across),
                                                                               ("vertical", high))]  # fmt: skip
        lens: Table = {}
        if table["fStop"] > 0.0 and table["focusDistance"] > 0.0:
            unit = self.parts.metres
            lens = {"aperture": TENTH * unit * length / table["fStop"], "focus": unit * table["focusDistance"]}
        place = _matrix(table)
        place[:3, :3] /= np.linalg.norm(place[:3, :3], axis=0)
        focal, principal = (
            (width * length / across, height * length / high),
            (width * (0.5 - shift[0]), height * (0.5 + shift[1])),
        )
        return Camera(width, height, focal, principal, name=name, **lens).with_pose(
            np.linalg.inv(opencv_from_opengl(place))
        )

    def whole_view(self) -> Camera:
        corners = [mesh.vertices for mesh in self.parts.meshes] + [
            _matrix(each)[:3, 3:].T for each in self.parts.shapes
        ]
        low, high = np.min([c.min(axis=0) for c in corners], axis=0), np.max([c.max(axis=0) for c in corners], axis=0)
        middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low)) or 1.0
        eye = middle - np.array([0.0, 0.5 * (high - low)[1] + 1.5 * size, 0.0])
        lens = Camera(960, HEIGHT, (1000.0, 1000.0), (480.0, 360.0))
        return lens.look_at(eye.tolist(), middle.tolist(), (0, 0, 1))

    def meshes(self) -> list[Table]:
        import trimesh
        from trimesh.visual import ColorVisuals, TextureVisuals

        tables = []
        for number, mesh in enumerate(self.parts.meshes):
            file = f"mesh_{number + 1}.ply"
            body, visual = self.body(mesh.material, mesh.colour, mesh.name, mesh), None
            if any("file" in body.get(key, ()) for key in (*TEXTURES, *RELIEFS)):
                visual = TextureVisuals(mesh.uv)
            elif "body_texture" in body and mesh.colours is not None:
                visual = ColorVisuals(vertex_colors=srgb_encode(np.clip(mesh.colours, 0.0, 1.0)))
            moved, place = self.moved(mesh.name, len(tables), mesh.motion), {}
            vertices = mesh.vertices
            if moved is not None:
                place, back = self.at_rest(len(tables)), np.linalg.inv(moved.places[0])
                vertices = vertices @ back[:3, :3].T + back[:3, 3]
            whole = trimesh.Trimesh(vertices, mesh.faces, process=False, visual=visual)
            data: Any = whole.export(file_type="ply")
            (self.folder / file).write_bytes(data)
            smooth = {} if mesh.smooth else {"smooth": False}
            tables.append({"mesh": file, "name": mesh.name, **smooth, **place, **body})
        if any(mesh.smooth for mesh in self.parts.meshes):
            self.lost.append("normals: those of the surfaces stand in their place")
        return tables

    def moved(self, name: str, number: int, motion: Table | None, local: Matrix = UNMOVED) -> Placed | None:
        """The motion of surface `number`, whose keyframes are added; None where it stands still, or a line says why."""
        if motion is None:
            return None
        places, times = _motion({"motion": motion})
        found = placed(places @ local, times)
        if found is None:
            self.lost.append(f"{name!r}: its motion, which is not of shifts and turns alone")
            return None
        self.keys["surface"] += found.keys(surface=number)
        return found

    def at_rest(self, number: int) -> Table:
        """Where a surface that moves stands at the first time."""
        key = next(each for each in self.keys["surface"] if each["surface"] == number)
        return {"position": key["position"], "rotation_deg": key["rotation_deg"]}

    def shape(self, table: Table, number: int) -> Table:
        place, kind = _matrix(table), {"Sphere": "sphere", "Cube": "cube", "Plane": "rectangle"}[table["kind"]]
        if kind == "sphere":
            place[:3, :3] *= float(table["radius"])
            scale = np.linalg.norm(place[:3, 0])
            if not np.allclose(place[:3, :3].T @ place[:3, :3], scale**2 * np.eye(3), rtol=0, atol=ROUND * scale**2):
                raise InputError(f"sphere {table['name']!r} is scaled unlike along its axes: make it a mesh")
        elif kind == "cube":
            place[:3, :3] *= 0.5 * float(table["size"])
        else:
            axes = {"X": [2, 1, 0], "Y": [0, 2, 1], "Z": [0, 1, 2]}[str(table["axis"])]  # width, length, normal
            place[:3, :3] = place[:3, axes] * (0.5 * float(table["width"]), 0.5 * float(table["length"]), 1.0)
        body = self.body(table["material"], table["colour"], table["name"])
        if table["motion"] is not None:
            local = np.linalg.inv(_matrix(table)) @ place
            moved = self.moved(table["name"], number, table["motion"], local)
            if moved is not None:
                size = np.diag(moved.own[:3, :3])
                if np.allclose(moved.own[:3, :3], np.diag(size), atol=ROUND * np.abs(size).max()):
                    rest = {"scale": np.abs(size).tolist(), **self.at_rest(number)}
                    return {"shape": kind, **rest, "name": table["name"], **body}
                self.keys["surface"] = [key for key in self.keys["surface"] if key["surface"] != number]
                self.lost.append(f"{table['name']!r}: its motion, as it is sheared: make it a mesh")
        return {"shape": kind, "pose": place.ravel().tolist(), "name": table["name"], **body}

    def body(self, path: str, colour: list[float] | None, who: str, mesh: UsdMesh | None = None) -> Table:
        """The keys reflectance, optics and textures of a surface, of its material or else its displayColor."""
        known = self.parts.materials.get(path)
        painted = {} if mesh is None or mesh.colours is None else {"body_texture": {"vertex_colours": True}}
        if not known:
            if known is not None:
                self.lost.append(
                    f"material {path}: it is no UsdPreviewSurface; a matt one of the display colour stands"
                )
            elif colour is None:
                self.lost.append(f"made up: {who!r} and others without a material are light grey")
            plain = {"type": "diffuse", "reflectance": rgb(colour or GREY)}
            return (self.bodies.surface(plain, who) or {}) | painted
        uv = None if mesh is None else mesh.uv
        key = path, uv is not None, bool(painted)
        if key not in self.known or (known["painted"] and not painted):
            self.known[key] = self.made(known, path, colour, mesh) | (painted if known["painted"] else {})
        return self.known[key]

    def made(self, known: Table, path: str, colour: list[float] | None, mesh: UsdMesh | None) -> Table:
        """The keys of a material, whose files are written."""
        who, name, textures = f"material {path}", f"texture_{len(self.known) + 1}", known["textures"]
        if known["textured"]:
            self.lost.append(f"{who}: textures of {', '.join(known['textured'])}")
        uv = None if mesh is None else mesh.uv
        lost = list(textures) if uv is None else [key for key in textures if known["painted"]]
        if lost:
            why = "where a surface has no UVs" if uv is None else "beside colours of vertices"
            self.lost.append(f"{who}: textures of {', '.join(lost)}, {why}")
            textures = {key: each for key, each in textures.items() if key not in lost}
        if {"diffuseColor"} & {*lost, *known["textured"]} or known["painted"]:
            known = known | {"diffuseColor": colour or GREY}
        if known["painted"] and mesh is not None and mesh.colours is not None:
            known = known | {"diffuseColor": np.full(3, np.clip(mesh.colours, 0.0, 1.0).max())}
        specular = textures.get("specularColor") if known["useSpecularWorkflow"] else None
        maps: dict[str, Any] = {}
        pictures = UsdTextures(self.path, self.home, self.folder, textures, who, name)
        if specular is not None:
            specular_colour, factors, varied = gloss_of_colours(pictures.colours(specular))
            if varied:
                self.lost.append(f"{who}: the colour of its gloss by place, of which the mean stands")
            known = known | {"specularColor": specular_colour}
            maps = {} if known["painted"] else {"specular_map": factors, "tiles": pictures.tiles}
        look, images = self.look(known, path)._replace(**maps), dict[str, Any]()
        if uv is not None:
            look, images = pictures.of(look, uv)
        self.lost += pictures.lost
        look = look._replace(textured=look.textured or known["painted"])
        made = surface_of(look, self.bodies, who, self.folder, name)
        if made.get("optics") and any(key in textures for key in ("diffuseColor", NORMAL)):
            self.lost.append(f"{who}: the textures of its {made['optics']}")
            return made
        return made | images

    def look(self, known: Table, path: str) -> PbrMaterial:
        """A UsdPreviewSurface. Where it states the colour of its gloss, F0, that is a factor on that of its index."""
        if any(known["emissiveColor"]) or known["clearcoat"]:
            self.lost.append(f"material {path}: its own light or clear coat")
        n = max(float(known["ior"]), 1.0)
        if known["opacity"] < 0.5:
            return PbrMaterial(np.ones(3), float(known["roughness"]), n=n, glass=True)
        if known["opacity"] < 1.0:
            self.lost.append(f"material {path}: its opacity of {known['opacity']:g}; it is opaque")
        made = PbrMaterial(np.array(known["diffuseColor"], float), float(known["roughness"]), n=n)
        if not known["useSpecularWorkflow"]:
            return made._replace(metallic=float(known["metallic"]))
        tint = np.array(known["specularColor"], float) / max(normal_fresnel(n), 1e-6)
        return made._replace(specular=min(float(tint.max()), 1.0), tint=tint / max(min(float(tint.max()), 1.0), 1e-6))

    def lamp(self, table: Table, who: str) -> None:
        rgb = np.array(table["color"], float) * float(table["intensity"]) * 2.0 ** float(table["exposure"])
        if table["enableColorTemperature"]:
            rgb = rgb * _blackbody(float(table["colorTemperature"]))
        rgb = np.clip(rgb, 0.0, None)
        if not rgb.max() > 0.0:
            self.lost.append(f"{who}, which is dark")
            return
        if table["diffuse"] != 1.0 or table["specular"] != 1.0:
            self.lost.append(f"{who}: its factors of diffuse and specular light")
        if table["shaping:ies:file"]:
            self.lost.append(f"{who}: its IES file")
        kind, place = table["kind"], _matrix(table)
        if table["motion"]:
            self.lost.append(f"{who}: its motion: the earliest time is read")
        if kind.startswith("DomeLight"):
            self.dome(table, place, rgb, who)
        elif kind == "DistantLight":
            self.distant(table, place, rgb, who)
        else:
            self.finite(table, place, rgb, who)

    def distant(self, table: Table, place: Matrix, rgb: Matrix, who: str) -> None:
        """Irradiance: π sin² of half the angle times the radiance, or what a lamp without size or normalised states."""
        angle = math.radians(float(table["angle"]))
        if angle > 0.0:
            self.lost.append(f"{who}: its size of {math.degrees(angle):g}°")
            rgb = rgb if table["normalize"] else rgb * math.pi * math.sin(0.5 * angle) ** 2
        back = place[:3, 2] / np.linalg.norm(place[:3, 2])
        self.lamps.append({"to_lamp": back.tolist(), **_light("intensity", rgb), "name": table["name"]})

    def finite(self, table: Table, place: Matrix, rgb: Matrix, who: str) -> None:
        """A sphere, rectangle, disk or cylinder; a shaped one becomes a point."""
        kind, where = table["kind"], place[:3, 3].tolist()
        scales = np.linalg.norm(place[:3, :3], axis=0)
        scale = float(np.prod(scales)) ** (1.0 / 3.0)
        radius, common = scale * float(table["radius"]), {"name": table["name"]}
        if kind == "SphereLight":
            area = 4.0 * math.pi * radius**2
        elif kind == "RectLight":
            area = scales[0] * scales[1] * float(table["width"]) * float(table["height"])
        elif kind == "DiskLight":
            area = scales[0] * scales[1] * math.pi * float(table["radius"]) ** 2
        else:
            area = 2.0 * math.pi * radius * float(scales[0]) * float(table["length"])
        shaping = self.shaping(table, place)
        point = kind == "SphereLight" and (table["treatAsPoint"] or shaping or not radius)
        if table["normalize"] or not area:  # by the area in units of the file
            rgb = rgb * self.parts.metres**2 / (area or 1.0)
        if point:
            if not table["treatAsPoint"]:
                self.lost.append(f"{who}: its size, it shines from a point")
            light = _light("intensity", rgb * 0.25 * (area or 1.0))
            self.lamps.append({"position": where, **light, **shaping, **common})
            return
        if shaping:
            self.lost.append(f"{who}: the shape of its beam")
        common |= {"position": where, "visible": True, **_light("radiance", rgb)}
        self.lost.append("lamps with a size neither reflect nor hide what is behind them")
        if kind == "SphereLight":
            self.area_lamps.append({"radius": radius, **common})
        elif kind == "CylinderLight":
            along = float(table["length"]) * place[:3, 0]
            self.area_lamps.append({"radius": radius, "along": along.tolist(), **common})
        else:
            if kind == "DiskLight":
                self.lost.append(f"{who}: its shape: it is a square of the same area")
            side = math.sqrt(math.pi) * float(table["radius"])
            width, high = (side, side) if kind == "DiskLight" else (float(table["width"]), float(table["height"]))
            edges = np.array([high * place[:3, 1], width * place[:3, 0]])
            if np.cross(*edges) @ place[:3, 2] > 0.0:  # it shines along −z
                edges = edges[::-1]
            self.area_lamps.append({"edges": edges.tolist(), **common})

    def shaping(self, table: Table, place: Matrix) -> Table:
        """Axis and fall-off: cos to the power of focus within a cone, whose edge is smooth; nothing of a plain lamp."""
        focus, cone = float(table["shaping:focus"]), float(table["shaping:cone:angle"])
        axis = {"axis": (-place[:3, 2] / np.linalg.norm(place[:3, 2])).tolist()}
        if cone >= 90.0:
            return {**axis, "axis_power": focus} if focus > 0.0 else {}
        edge = min(max(cone, 0.1), MOST_CONE)
        start = edge * (1.0 - min(max(float(table["shaping:cone:softness"]), 0.0), 1.0))
        angles = np.unique([0.0, *np.linspace(0.0, start, 19), *np.linspace(start, edge, 17)])
        share = np.clip((angles - start) / max(edge - start, 1e-9), 0.0, 1.0)
        values = np.cos(np.radians(angles)) ** focus * (1.0 - share * share * (3.0 - 2.0 * share))
        values[-1] = 0.0
        table = {"lateral": [0.0], "vertical": angles.tolist(), "intensity": [values.tolist()]}
        return {**axis, "profile": table}

    def dome(self, table: Table, place: Matrix, rgb: Matrix, who: str) -> None:
        if self.environment is not None:
            self.lost.append(f"{who}: it is a second environment")
            return
        self.environment = {"visible": True, "name": table["name"], **_light("scale", rgb)}
        source = table["texture:file"]
        if not source:
            write_exr(self.folder / "constant.exr", dict.fromkeys("RGB", np.ones((8, 16), np.float32)))
            self.environment["file"] = "constant.exr"
            return
        if table["texture:format"] not in ("automatic", "latlong"):
            raise InputError(f"{who} has a map of format {table['texture:format']!r}: give latlong")
        file = inside(self.home, str(source))
        name = f"environment{file.suffix.lower()}"
        shutil.copyfile(sized_file(file, LARGEST_MAP, "an environment"), self.folder / name)
        turn = place[:3, :3] / np.linalg.norm(place[:3, :3], axis=0)
        if np.linalg.det(turn) < 0.0 or not np.allclose(turn @ turn.T, np.eye(3), atol=ROUND):
            raise InputError(f"{who} is mirrored or sheared: give a turn")
        pole = POLE_Z if table["poleAxis"] == "Z" else np.eye(3)
        self.environment |= {"file": name, "rotation_deg": angles_of(turn @ pole @ DOME)}


def _motion(table: Table) -> tuple[Matrix, list[float]]:
    """Places (n, 4, 4) of a thing that moves, and their time codes."""
    return np.array(table["motion"]["places"], np.float64).reshape(-1, 4, 4), table["motion"]["times"]


def _matrix(table: Table) -> Matrix:
    return np.array(table["place"], np.float64).reshape(4, 4)


def _light(strength: str, rgb: Matrix) -> Table:
    """Strength of the brightest channel, and the spectrum that has the colours under D65; white is 1 everywhere."""
    top = float(rgb.max())
    return {strength: top} if np.ptp(rgb) == 0.0 else {strength: top, "spectrum": upsampled(rgb / top).record()}


def _blackbody(kelvin: float) -> Matrix:
    """Linear sRGB of Planck's law, of luminance 1."""
    waves = np.arange(360.0, 831.0, 5.0)
    second = 1.438776877e7  # nm K
    values = waves**-5.0 / np.expm1(second / (waves * max(kelvin, 100.0)))
    rgb = np.clip(linear_colour(Spectrum(waves, values / values.max()), Spectrum.constant(1.0)), 0.0, None)
    return rgb / float(rgb @ (0.2126, 0.7152, 0.0722))
