"""What is in a USD file: meshes, shapes, cameras, lamps and materials as plain numbers, read in a process of its own.

Places are in metres, z up. Numbers of cameras and lamps are those of the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.memory import require
from hagoromo.files.mesh import fans
from hagoromo.files.reading import library, reading
from hagoromo_formats.scenes.usd_stage import Places, open_stage, shown, unpacked, usd_file, value

BYTES_PER_CORNER = 200.0
SHAPES = {"Sphere": {"radius": 1.0}, "Cube": {"size": 2.0}, "Plane": {"width": 2.0, "length": 2.0, "axis": "Z"}}
CAMERA = {
    "focalLength": 50.0, "horizontalAperture": 20.955, "verticalAperture": 15.2908, "horizontalApertureOffset": 0.0,
    "verticalApertureOffset": 0.0, "fStop": 0.0, "focusDistance": 0.0, "projection": "perspective", "exposure": 0.0,
    "clippingRange": None, "clippingPlanes": None, "shutter:open": 0.0, "shutter:close": 0.0,
}  # fmt: skip
LAMP = {
    "intensity": None, "exposure": 0.0, "color": (1.0, 1.0, 1.0), "normalize": False, "enableColorTemperature": False,
    "colorTemperature": 6500.0, "diffuse": 1.0, "specular": 1.0, "radius": 0.5, "width": 1.0, "height": 1.0,
    "length": 1.0, "angle": 0.53, "treatAsPoint": False, "shaping:focus": 0.0, "shaping:cone:angle": 90.0,
    "shaping:cone:softness": 0.0, "shaping:ies:file": None, "texture:file": None, "texture:format": "automatic",
    "poleAxis": "scene",
}  # fmt: skip
LAMPS = ("SphereLight", "DiskLight", "RectLight", "CylinderLight", "DistantLight", "DomeLight", "DomeLight_1")
SURFACE = {
    "diffuseColor": (0.18, 0.18, 0.18), "roughness": 0.5, "metallic": 0.0, "ior": 1.5, "opacity": 1.0,
    "useSpecularWorkflow": 0, "specularColor": (0.0, 0.0, 0.0), "emissiveColor": (0.0, 0.0, 0.0), "clearcoat": 0.0,
}  # fmt: skip
PREVIEW, TEXTURE = "UsdPreviewSurface", "UsdUVTexture"
READERS = ("UsdPrimvarReader_float2", "UsdPrimvarReader_float3")
NORMAL = "normal"
MAPS = ("occlusion", "displacement")  # inputs that nothing here has
SAMPLER = {
    "file": None, "wrapS": "useMetadata", "wrapT": "useMetadata", "sourceColorSpace": "auto",
    "scale": (1.0, 1.0, 1.0, 1.0), "bias": (0.0, 0.0, 0.0, 0.0),
}  # fmt: skip
COLOUR, UVS = "displayColor", "st"
NEXT_SHADERS = 8  # from a texture to its UVs


class UsdMesh(NamedTuple):
    """Triangles (m, 3) of vertices (n, 3) [m], world. smooth: normals change within a triangle. material: its path.

    colour: the mean of its displayColor, linear, and colours (n, 3) where it differs from place to place. uv: (n, 2), v
    up, those that the material's textures lie on. motion: of what moves, its places at time codes, see `Places.moving`.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    smooth: bool
    material: str
    colour: list[float] | None
    uv: NDArray[np.float64] | None
    colours: NDArray[np.float64] | None
    motion: dict[str, Any] | None = None


class UsdParts(NamedTuple):
    """What is in a file. Of shapes, cameras and lamps, tables with kind, name, place (16 numbers) and their numbers.

    materials: path → numbers of a UsdPreviewSurface, textures: input → numbers of the picture that gives it, uvs: the
    name of those that they lie on, painted: whether displayColor is its colour, textured: the inputs that something
    else gives; empty: of another kind. size: (width, height) [px] of its render settings. clock:
    per_second, of its time codes, frames (a second), first and last (time codes, if stated). lost: a line for each
    thing that is not read.
    """

    meshes: list[UsdMesh]
    shapes: list[dict[str, Any]]
    cameras: list[dict[str, Any]]
    lamps: list[dict[str, Any]]
    materials: dict[str, dict[str, Any]]
    size: tuple[int, int] | None
    metres: float
    clock: dict[str, float]
    lost: list[str]


def read_usd(path: str | Path) -> UsdParts:
    """What is in a USD file; `InputError` when it is missing, damaged, too large, or names other files."""
    with unpacked(path) as file:
        arrays = read_apart(parts_by_usd, usd_file(file), "USD")
    record = json.loads(arrays["record"].tobytes())
    meshes = [
        UsdMesh(**table, vertices=arrays[f"v{k}"], faces=arrays[f"f{k}"], uv=arrays.get(f"u{k}"),
                colours=arrays.get(f"c{k}"))
        for k, table in enumerate(record.pop("meshes"))
    ]  # fmt: skip
    return UsdParts(meshes=meshes, **record)


def read_usd_mesh(path: str | Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices (n, 3) [m] and triangles (m, 3) of all meshes at their places."""
    meshes = read_usd(path).meshes
    if not meshes:
        raise InputError(f"{path} holds no meshes: give one with polygons")
    before = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, before, strict=False)]
    return np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces)


def parts_by_usd(path: Path) -> Mapping[str, NDArray[Any]]:
    """The fields of `UsdParts` as JSON, and the arrays of the meshes; run by `read_apart`."""
    with reading(path, "USD"):
        return _StageReader(path).arrays()


class _StageReader:
    def __init__(self, path: Path) -> None:
        self.path, self.corners = path, 0.0
        self.stage = open_stage(path)
        self.places = Places(self.stage)
        self.timed = any(layer.ListAllTimeSamples() for layer in self.stage.GetUsedLayers())
        self.meshes: list[dict[str, Any]] = []
        self.found: dict[str, NDArray[Any]] = {}
        self.tables: dict[str, list[dict[str, Any]]] = {"shapes": [], "cameras": [], "lamps": []}
        self.materials: dict[str, dict[str, Any]] = {}
        self.lost: list[str] = []

    def arrays(self) -> dict[str, NDArray[Any]]:
        geometry, size = library("pxr.UsdGeom"), None
        for prim in shown(self.stage):
            self.lost += self.changing(prim)
            kind = str(prim.GetTypeName())
            if kind == "Mesh":
                self.mesh(prim)
            elif kind in SHAPES:
                self.add("shapes", prim, SHAPES[kind], material=self.material(prim), colour=self.colour(prim))
            elif kind == "Camera":
                self.add("cameras", prim, CAMERA)
            elif kind in LAMPS:
                default = {"intensity": 50000.0 if kind == "DistantLight" else 1.0}
                self.add("lamps", prim, LAMP | default)
                lamp = self.tables["lamps"][-1]
                if kind != "DomeLight_1":
                    lamp["poleAxis"] = "Y"
                elif lamp["poleAxis"] == "scene":
                    lamp["poleAxis"] = geometry.GetStageUpAxis(self.stage)
            elif kind == "RenderSettings":
                size = tuple(int(x) for x in value(prim, "resolution", (2048, 1080)))
            elif prim.IsA(geometry.Gprim) or kind.endswith("Light") or kind == "PointInstancer":
                self.lost.append(f"{prim.GetPath()}, a {kind}")
        if not self.stage.HasAuthoredMetadata("metersPerUnit"):
            self.lost.append("nothing of its lengths, which state no unit: USD then says centimetres")
        record = {"meshes": self.meshes, **self.tables, "materials": self.materials, "size": size,
                  "metres": self.places.metres, "clock": self.clock(), "lost": self.lost}  # fmt: skip
        text = json.dumps(record, default=_plain).encode()
        return {"record": np.frombuffer(text, np.uint8), **self.found}

    def clock(self) -> dict[str, float]:
        """Time codes a second, frames a second, and where they are stated the first and the last time code."""
        stage = self.stage
        found = {"per_second": stage.GetTimeCodesPerSecond(), "frames": stage.GetFramesPerSecond()}
        if stage.HasAuthoredTimeCodeRange():
            found |= {"first": stage.GetStartTimeCode(), "last": stage.GetEndTimeCode()}
        if not (all(map(np.isfinite, found.values())) and found["per_second"] > 0.0):
            raise ValueError(f"its time codes are {found}")
        return found

    def changing(self, prim: Any) -> Iterator[str]:
        """A line for each attribute but its transform that changes over time."""
        for attribute in prim.GetAttributes() if self.timed else ():
            name = str(attribute.GetName())
            if attribute.ValueMightBeTimeVarying() and not name.startswith("xformOp:"):
                yield f"{prim.GetPath()}: how its {name} changes: the earliest time is read"

    def moving(self, prim: Any) -> dict[str, Any] | None:
        """See `Places.moving`."""
        return self.places.moving(prim) if self.timed else None

    def add(self, section: str, prim: Any, numbers: Mapping[str, Any], **more: Any) -> None:
        table = {key: value(prim, key, default) for key, default in numbers.items()}
        place = self.places.of(prim)
        if not np.isfinite(place).all():
            raise ValueError(f"{prim.GetPath()} has a transform that is not finite")
        name = prim.GetDisplayName() or prim.GetName()
        moved = {"motion": self.moving(prim)}
        known = {"kind": str(prim.GetTypeName()), "name": name, "place": place}
        self.tables[section].append({**known, **moved, **table, **more})

    def mesh(self, prim: Any) -> None:
        """A mesh, or one for each of its parts of another material."""
        points = np.array(value(prim, "points", ()), np.float64).reshape(-1, 3)
        counts = np.array(value(prim, "faceVertexCounts", ()), np.int64)
        corners = np.array(value(prim, "faceVertexIndices", ()), np.int64)
        self.corners += len(points) + len(corners)
        require(BYTES_PER_CORNER * self.corners, str(self.path))
        if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
            raise ValueError(f"{prim.GetPath()} names points that it does not have")
        place = self.places.of(prim)
        triangles, polygon = fans(counts, np.arange(len(corners)))
        if (value(prim, "orientation", "rightHanded") == "leftHanded") != (np.linalg.det(place[:3, :3]) < 0.0):
            triangles = triangles[:, ::-1]
        if "MeshLightAPI" in prim.GetAppliedSchemas():
            self.lost.append(f"{prim.GetPath()}: its light")
        cage = value(prim, "subdivisionScheme", "catmullClark") != "none"
        if cage:
            self.lost.append(f"{prim.GetPath()}: its subdivision, its cage is read")
        smooth = cage or self.smooth(prim, counts, corners)
        world = points @ place[:3, :3].T + place[:3, 3]
        colour, colours = self.colour(prim, True), self.by_corner(prim, COLOUR, 3, counts, corners)
        motion, sets = self.moving(prim), dict[str, NDArray[np.float64] | None]()
        for material, chosen in self.subsets(prim, len(counts)):
            faces = triangles[chosen[polygon]]
            if not len(faces):
                continue
            known = self.materials.get(material, {})
            name = known["uvs"] if known.get("textures") else ""
            if name and name not in sets:
                sets[name] = self.by_corner(prim, name, 2, counts, corners)
            uv = sets.get(name)
            painted = None if known and not known["painted"] else colours
            split = [each for each in (uv, painted) if each is not None]
            used, number = faces.ravel(), len(self.meshes)
            rows = np.column_stack([each[used] for each in (corners, *split)]) if split else corners[used]
            _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
            place_of = used[first]
            self.found |= {f"v{number}": world[corners[place_of]], f"f{number}": inverse.reshape(-1, 3)}
            for key, values in (("u", uv), ("c", painted)):
                if values is not None:
                    self.found[f"{key}{number}"] = values[place_of]
            self.meshes.append({"name": prim.GetDisplayName() or prim.GetName(), "smooth": smooth,
                                "material": material, "colour": colour, "motion": motion})  # fmt: skip

    def by_corner(
        self, prim: Any, name: str, width: int, counts: NDArray[np.int64], corners: NDArray[np.int64]
    ) -> NDArray[np.float64] | None:
        """The values (corners, width) of a primvar that differs from place to place; None without one."""
        primvar = library("pxr.UsdGeom").PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        if not primvar or not primvar.HasAuthoredValue():
            return None
        flat = primvar.ComputeFlattened(library("pxr.Usd").TimeCode.EarliestTime())
        values, kind = np.array(() if flat is None else flat, np.float64), primvar.GetInterpolation()
        if values.ndim != 2 or values.shape[1] != width or (len(values) <= 1 and width == 3):
            return None
        every = np.repeat(np.arange(len(counts)), counts)
        places = {"vertex": corners, "varying": corners, "faceVarying": np.arange(len(corners)), "uniform": every}
        of = places.get(kind, np.zeros(len(corners), np.int64))
        if of.max(initial=0) >= len(values) or not np.isfinite(values).all():
            self.lost.append(f"{prim.GetPath()}: its {name}, which has {len(values)} values")
            return None
        return values[of] if width == 2 or np.ptp(values, axis=0).max() > 0.0 else None

    def smooth(self, prim: Any, counts: NDArray[np.int64], corners: NDArray[np.int64]) -> bool:
        """Whether the normals of the file change within faces."""
        primvar = library("pxr.UsdGeom").PrimvarsAPI(prim).GetPrimvar("normals")
        if primvar and primvar.HasAuthoredValue():
            normals, kind = np.array(primvar.ComputeFlattened(), float).reshape(-1, 3), primvar.GetInterpolation()
        else:
            normals = np.array(value(prim, "normals", ()), float).reshape(-1, 3)
            kind = library("pxr.UsdGeom").PointBased(prim).GetNormalsInterpolation()
        if kind != "faceVarying":
            return len(normals) > 0 and kind in ("vertex", "varying")
        if len(normals) != len(corners):
            return False
        first = np.repeat(np.cumsum(counts) - counts, counts)
        return bool(np.abs(normals - normals[first]).max(initial=0.0) > 1e-4)

    def subsets(self, prim: Any, count: int) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        """Each material of a mesh and its faces, (count,) of truth."""
        rest = np.ones(count, bool)
        for subset in library("pxr.UsdShade").MaterialBindingAPI(prim).GetMaterialBindSubsets():
            chosen, named = np.zeros(count, bool), np.array(value(subset.GetPrim(), "indices", ()), np.int64)
            chosen[named[(named >= 0) & (named < count)]] = True
            yield self.material(subset.GetPrim()), chosen & rest
            rest &= ~chosen
        yield self.material(prim), rest

    def material(self, prim: Any) -> str:
        """The path of the material that an object has; what it is stands in `materials`."""
        shade = library("pxr.UsdShade")
        material = shade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        if not material:
            return ""
        path = str(material.GetPath())
        if path not in self.materials:
            shader = material.ComputeSurfaceSource()[0]
            known = shader and str(shader.GetIdAttr().Get()) == PREVIEW
            self.materials[path] = _preview(shader) if known else {}
        return path

    def colour(self, prim: Any, by_place: bool = False) -> list[float] | None:
        """Its displayColor, the mean of all; by_place: whether it may differ from place to place."""
        values = np.array(value(prim, "primvars:displayColor", ()), float).reshape(-1, 3)
        if not by_place and len(values) > 1 and np.ptp(values, axis=0).max() > 0.0:
            self.lost.append(f"{prim.GetPath()}: its colours by place, of which the mean stands")
        return values.mean(axis=0).tolist() if len(values) else None


def _preview(shader: Any) -> dict[str, Any]:
    """Numbers of a UsdPreviewSurface; textured: names of those that something else than a picture gives."""
    numbers, textured, textures = dict[str, Any](SURFACE), list[str](), dict[str, dict[str, Any]]()
    painted, uvs = False, UVS
    for name in (*SURFACE, NORMAL, *MAPS):
        stated, source, output = _given(shader, name)
        if source is None:
            if stated is not None and name in SURFACE:
                numbers[name] = stated
            continue
        kind = str(source.GetIdAttr().Get())
        if kind == TEXTURE and name not in MAPS:
            texture = {key: default if (found := _given(source, key)[0]) is None else found
                       for key, default in SAMPLER.items()}  # fmt: skip
            uvs, moved = _uvs_of(source)
            textures[name] = texture | {"output": output, "uvs": uvs, "moved": moved}
        elif kind == READERS[1] and name == "diffuseColor" and str(_given(source, "varname")[0]) == COLOUR:
            painted = True
        else:
            textured.append(name)
    sets = {each["uvs"] for each in textures.values()}
    uvs = textures.get("diffuseColor", {}).get("uvs", uvs)
    textured += [f"{name} on other UVs" for name, each in textures.items() if len(sets) > 1 and each["uvs"] != uvs]
    kept = {name: each for name, each in textures.items() if each["uvs"] == uvs}
    return numbers | {"textured": textured, "textures": kept, "painted": painted, "uvs": uvs}


def _given(shader: Any, name: str) -> tuple[Any, Any, str]:
    """What an input states, or else the shader that gives it and the name of its output."""
    shade, given = library("pxr.UsdShade"), shader.GetInput(name)
    for attribute in shade.Utils.GetValueProducingAttributes(given) if given else ():
        base, kind = shade.Utils.GetBaseNameAndType(attribute.GetName())
        if kind == shade.AttributeType.Output:
            return None, shade.Shader(attribute.GetPrim()), str(base)
        return attribute.Get(library("pxr.Usd").TimeCode.EarliestTime()), None, ""
    return None, None, ""


def _uvs_of(texture: Any) -> tuple[str, bool]:
    """The name of the UVs that a texture lies on, and whether they are moved."""
    moved, shader = False, texture
    for _ in range(NEXT_SHADERS):
        shader = _given(shader, "in" if moved else "st")[1]
        if shader is None:
            break
        if str(shader.GetIdAttr().Get()) == READERS[0]:
            return str(_given(shader, "varname")[0] or UVS), moved
        moved = True
    return UVS, moved


def _plain(number: Any) -> Any:
    """What JSON has no word for: vectors, arrays, paths of files."""
    if isinstance(number, np.ndarray):
        return number.ravel().tolist()
    return str(number.path) if hasattr(number, "path") else [float(x) for x in np.ravel(number)]


def usd_facts(path: Path) -> dict[str, Any]:
    """What a scene of USD holds, for `info`."""
    parts = read_usd(path)
    return {
        "kind": "USD scene", "cameras": [each["name"] for each in parts.cameras],
        "lamps": {each["name"]: each["kind"] for each in parts.lamps},
        "surfaces": {each.name: len(each.faces) for each in parts.meshes}
        | {each["name"]: each["kind"] for each in parts.shapes},
        "materials": sorted(parts.materials), "metres_per_unit": parts.metres, "not_read": parts.lost,
    }  # fmt: skip
