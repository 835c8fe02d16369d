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
from hagoromo.files.library import library
from hagoromo.files.memory import require
from hagoromo.files.polygons import fans
from hagoromo.files.reading import reading
from hagoromo.files.usd_stage import Places, open_stage, shown, usd_file, value

BYTES_PER_CORNER = 100.0
SHAPES = {"Sphere": {"radius": 1.0}, "Cube": {"size": 2.0}, "Plane": {"width": 2.0, "length": 2.0, "axis": "Z"}}
CAMERA = {
    "focalLength": 50.0, "horizontalAperture": 20.955, "verticalAperture": 15.2908, "horizontalApertureOffset": 0.0,
    "verticalApertureOffset": 0.0, "fStop": 0.0, "focusDistance": 0.0, "projection": "perspective", "exposure": 0.0,
    "clippingRange": None, "clippingPlanes": None,
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
PREVIEW = "UsdPreviewSurface"


class UsdMesh(NamedTuple):
    """Triangles (m, 3) of vertices (n, 3) [m], world. smooth: normals change within a triangle. material: its path."""

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    smooth: bool
    material: str
    colour: list[float] | None


class UsdParts(NamedTuple):
    """What is in a file. Of shapes, cameras and lamps, tables with kind, name, place (16 numbers) and their numbers.

    materials: path → numbers of a UsdPreviewSurface, and textured, the inputs that are pictures; empty: of another
    kind. size: (width, height) [px] of its render settings. lost: a line for each thing that is not read.
    """

    meshes: list[UsdMesh]
    shapes: list[dict[str, Any]]
    cameras: list[dict[str, Any]]
    lamps: list[dict[str, Any]]
    materials: dict[str, dict[str, Any]]
    size: tuple[int, int] | None
    metres: float
    lost: list[str]


def read_usd(path: str | Path) -> UsdParts:
    """What is in a USD file; `InputError` when it is missing, damaged, too large, or names other files."""
    arrays = read_apart(parts_by_usd, usd_file(path), "USD")
    record = json.loads(arrays["record"].tobytes())
    meshes = [UsdMesh(**table, vertices=arrays[f"v{k}"], faces=arrays[f"f{k}"])
              for k, table in enumerate(record.pop("meshes"))]  # fmt: skip
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
        return _Reader(path).arrays()


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path, self.corners = path, 0.0
        self.stage = open_stage(path)
        self.places = Places(self.stage)
        self.meshes: list[dict[str, Any]] = []
        self.found: dict[str, NDArray[Any]] = {}
        self.tables: dict[str, list[dict[str, Any]]] = {"shapes": [], "cameras": [], "lamps": []}
        self.materials: dict[str, dict[str, Any]] = {}
        self.lost: list[str] = []

    def arrays(self) -> dict[str, NDArray[Any]]:
        geometry, size = library("pxr.UsdGeom"), None
        for prim in shown(self.stage):
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
        if any(layer.ListAllTimeSamples() for layer in self.stage.GetUsedLayers()):
            self.lost.append("motion: the earliest time is read")
        if not self.stage.HasAuthoredMetadata("metersPerUnit"):
            self.lost.append("nothing of its lengths, which state no unit: USD then says centimetres")
        record = {"meshes": self.meshes, **self.tables, "materials": self.materials, "size": size,
                  "metres": self.places.metres, "lost": self.lost}  # fmt: skip
        text = json.dumps(record, default=_plain).encode()
        return {"record": np.frombuffer(text, np.uint8), **self.found}

    def add(self, section: str, prim: Any, numbers: Mapping[str, Any], **more: Any) -> None:
        table = {key: value(prim, key, default) for key, default in numbers.items()}
        place = self.places.of(prim)
        if not np.isfinite(place).all():
            raise ValueError(f"{prim.GetPath()} has a transform that is not finite")
        name = prim.GetDisplayName() or prim.GetName()
        self.tables[section].append({"kind": str(prim.GetTypeName()), "name": name, "place": place, **table, **more})

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
        triangles, polygon = fans(counts, corners)
        if (value(prim, "orientation", "rightHanded") == "leftHanded") != (np.linalg.det(place[:3, :3]) < 0.0):
            triangles = triangles[:, ::-1]
        if "MeshLightAPI" in prim.GetAppliedSchemas():
            self.lost.append(f"{prim.GetPath()}: its light")
        cage = value(prim, "subdivisionScheme", "catmullClark") != "none"
        if cage:
            self.lost.append(f"{prim.GetPath()}: its subdivision, its cage is read")
        smooth = cage or self.smooth(prim, counts, corners)
        world = points @ place[:3, :3].T + place[:3, 3]
        for material, chosen in self.subsets(prim, len(counts)):
            faces = triangles[chosen[polygon]]
            if len(faces):
                used, inverse = np.unique(faces, return_inverse=True)
                number = len(self.meshes)
                self.found |= {f"v{number}": world[used], f"f{number}": inverse.reshape(-1, 3)}
                self.meshes.append({"name": prim.GetDisplayName() or prim.GetName(), "smooth": smooth,
                                    "material": material, "colour": self.colour(prim)})  # fmt: skip

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

    def colour(self, prim: Any) -> list[float] | None:
        """Its displayColor, the mean of all."""
        values = np.array(value(prim, "primvars:displayColor", ()), float).reshape(-1, 3)
        if len(values) > 1 and np.ptp(values, axis=0).max() > 0.0:
            self.lost.append(f"{prim.GetPath()}: its colours by place, of which the mean stands")
        return values.mean(axis=0).tolist() if len(values) else None


def _preview(shader: Any) -> dict[str, Any]:
    """Numbers of a UsdPreviewSurface; textured: names of those that something else gives."""
    shade, numbers, textured = library("pxr.UsdShade"), dict[str, Any](SURFACE), list[str]()
    for name in SURFACE:
        given = shader.GetInput(name)
        if not given:
            continue
        for attribute in shade.Utils.GetValueProducingAttributes(given):
            if shade.Utils.GetType(attribute.GetName()) == shade.AttributeType.Output:
                textured.append(name)
            elif (stated := attribute.Get()) is not None:
                numbers[name] = stated
    return numbers | {"textured": textured}


def _plain(number: Any) -> Any:
    """What JSON has no word for: vectors, arrays, paths of files."""
    if isinstance(number, np.ndarray):
        return number.ravel().tolist()
    return str(number.path) if hasattr(number, "path") else [float(x) for x in np.ravel(number)]
