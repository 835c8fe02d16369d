"""A scene, or a mesh, as USD (.usda text, .usdc binary, .usdz archive): metres, z up, in one file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import opengl_from_opencv
from hagoromo.errors import InputError
from hagoromo.files.png import write_png
from hagoromo.files.reading import library
from hagoromo.files.udim import MARK
from hagoromo.files.whole import check_written, replaceable_file, scratch_folder, whole_file, whole_files
from hagoromo.image.film.shutter import camera_pose
from hagoromo.image.scene.motion import Motion
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_surface import NOWHERE
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.tiled_image import Tiles, tiles_of
from hagoromo.light.colour import srgb_encode
from hagoromo.light.other_programs import InOtherPrograms
from hagoromo.reflectance.torrance_sparrow import normal_fresnel
from hagoromo_formats.scenes.gltf_scene import triangles_of
from hagoromo_formats.scenes.pbr import PbrMaterial, linear, lost_gloss
from hagoromo_formats.scenes.pbr_textures import look_of, lost_textures, uvs_of
from hagoromo_formats.scenes.relief_normals import relief_normals
from hagoromo_formats.scenes.usd_motion import rest
from hagoromo_formats.scenes.usd_stage import ARCHIVE

APERTURE = 0.36  # tenths of a metre: a film of 36 mm
FAR_FOCUS = 1e6  # m
MOST_FRAMES = 5000  # of time samples; of a longer film so many, evenly
ONE = 1, 1  # tile
ROOT = Path("scene.usdc")  # of an archive
Matrix = NDArray[np.float64]
Pixels = NDArray[np.uint8] | NDArray[np.uint16]


def usd_from_scene(scene: Scene, out: str | Path, force: bool = False, motion: Motion | None = None) -> list[str]:
    """Write camera, lamps and surfaces of a scene as USD; returns what is lost, a line each.

    motion: of the scene's file, whose keyframes become time samples, and its shutter that of the camera.
    """
    if not (scene.surfaces or scene.lamps or any(len(light.stands_at) for light in scene.wide_lights)):
        raise InputError("the scene has no surface and no lamp, and this USD holds no volume boxes: write an OpenVDB")
    replaceable_file(out, force)
    writer = _Writer(Path(out))
    writer.camera(scene.camera)
    for surface in scene.surfaces:
        writer.surface(surface)
    for light in (*scene.lamps, *scene.wide_lights):
        writer.light(light)
    writer.boxes += [writer.define("Xform", box.name or "box", box.pose) for box in scene.boxes]
    if motion is not None:
        writer.move(scene, motion)
    writer.write(out, force)
    return [*writer.lost, *_lost(scene)]


def write_usd_mesh(vertices: Any, faces: Any, out: str | Path, force: bool = False) -> None:
    """Write triangles (m, 3) of vertices (n, 3) [m] as USD."""
    writer = _Writer(Path(out))
    writer.mesh("mesh", np.asarray(vertices, float), np.asarray(faces), np.eye(4))
    writer.write(out, force)


def _lost(scene: Scene) -> Iterator[str]:
    camera = scene.camera
    if scene.boxes:
        yield f"{len(scene.boxes)} volume boxes: write each as .vdb, for the empty Xform of its name"
    if any(camera.distortion):
        yield "the distortion of the lens"
    if abs(camera.focal[0] / camera.focal[1] - 1.0) > 1e-6:
        yield "pixels that are not square: the picture is as high as it was seen"
    if not all(light.visible for light in scene.wide_lights):
        yield "which lights the camera sees: programs show them or not"
    for surface in scene.surfaces:
        if surface.absorption is not None:
            yield f"surface {surface.name!r}: the absorption within its glass, which is clear"
    yield from lost_gloss(scene.surfaces, "usd")
    yield "spectra (colours are linear sRGB under D65)"


class _Writer:
    def __init__(self, out: Path) -> None:
        self.archive = out.suffix.lower() == ARCHIVE
        self.stem, self.images = (
            ROOT.stem if self.archive else out.stem,
            dict[str, NDArray[np.uint8] | NDArray[np.uint16]](),
        )
        self.lost = list[str]()
        self.usd, self.geometry, self.shade = (library(f"pxr.{name}") for name in ("Usd", "UsdGeom", "UsdShade"))
        self.layers, self.numbers = library("pxr.Sdf"), library("pxr.Gf")
        self.stage = self.usd.Stage.CreateInMemory()
        self.geometry.SetStageUpAxis(self.stage, "Z")
        self.geometry.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetDefaultPrim(self.geometry.Xform.Define(self.stage, "/scene").GetPrim())
        self.count = 0
        self.seen_by: Any = None
        self.surfaces, self.boxes = list[Any](), list[Any]()
        self.tiles: Tiles | None = None  # of the surface that is written

    def write(self, out: str | Path, force: bool) -> None:
        """The file and its images beside it, or all in an archive."""
        if not self.archive:
            beside = [Path(out).parent / name for name in self.images]
            with whole_files((out, *beside), force) as (partial, *images):
                self.stage.GetRootLayer().Export(str(partial))
                for place, image in zip(images, self.images.values(), strict=True):
                    write_png(place, image)
            return
        with whole_file(out, force) as partial, scratch_folder() as folder:
            self.stage.GetRootLayer().Export(str(folder / ROOT))
            for name, image in self.images.items():
                write_png(folder / name, image)
            done = library("pxr.UsdUtils").CreateNewUsdzPackage(str(folder / ROOT), str(partial))
            check_written(partial, out, done)

    def define(self, kind: str, name: str, place: Matrix) -> Any:
        """A new object at a place, whose path holds its name; names of any letters stand as its display name."""
        self.count += 1
        known = library("pxr.Tf").MakeValidIdentifier(name or kind)
        prim = self.stage.DefinePrim(f"/scene/{known}_{self.count}", kind)
        if name:
            prim.SetDisplayName(name)
        matrix = self.numbers.Matrix4d(np.asarray(place, float).T.tolist())
        self.geometry.Xformable(prim).AddTransformOp().Set(matrix)
        return prim

    def set(self, prim: Any, **values: Any) -> None:
        for name, given in values.items():
            prim.GetAttribute(name).Set(given)

    def camera(self, camera: Camera) -> None:
        """Focal length and apertures in tenths of a metre; shifts are those of the principal point."""
        width, height = camera.width, camera.height
        length = camera.focal[0] / width * APERTURE
        high = height / camera.focal[1] * length
        lens = {}
        if camera.aperture:
            focus = camera.focus if math.isfinite(camera.focus) else FAR_FOCUS
            lens = {"fStop": 0.1 * length / camera.aperture, "focusDistance": focus}
        self.seen_by = prim = self.define("Camera", camera.name or "camera", opengl_from_opencv(camera.camera_to_world))
        self.set(
            prim, focalLength=length, horizontalAperture=APERTURE, verticalAperture=high,
            horizontalApertureOffset=(0.5 - camera.principal[0] / width) * APERTURE,
            verticalApertureOffset=(camera.principal[1] / height - 0.5) * high,
            clippingRange=self.numbers.Vec2f(1e-3, 1e6), **lens,
        )  # fmt: skip
        settings = self.stage.DefinePrim("/Render/settings", "RenderSettings")
        settings.GetAttribute("resolution").Set(self.numbers.Vec2i(width, height))
        settings.GetRelationship("camera").SetTargets([prim.GetPath()])

    def light(self, light: InOtherPrograms) -> None:
        """A light, whose intensity is that of its brightest channel; cos^μ is shaping:focus."""
        form, lines = light.usd()
        self.lost += [line for line in lines if line not in self.lost]
        if form is None:
            return
        rgb = linear(form.spectrum) * form.strength
        top = float(rgb.max()) or 1.0
        prim = self.define(form.kind, light.name, form.place)
        self.set(prim, **{"inputs:intensity": top, "inputs:color": self.numbers.Vec3f(*(rgb / top).tolist())})
        self.set(prim, **{f"inputs:{key}": given for key, given in form.inputs.items()})
        if form.as_point:
            self.set(prim, treatAsPoint=True)
        if form.focus is not None:
            library("pxr.UsdLux").ShapingAPI.Apply(prim)
            self.set(prim, **{"inputs:shaping:focus": form.focus, "inputs:shaping:cone:angle": 90.0})

    def surface(self, surface: Surface) -> None:
        vertices, faces = triangles_of(surface)
        look, colours = look_of(surface, vertices)
        uv = uvs_of(surface, vertices)
        relief = relief_normals(surface, vertices, faces, uv)
        self.lost += [*lost_textures(surface, look, colours), *relief.lost]
        if any(each is not None and not each.smooth for each in (*surface.textures, *surface.reliefs)):
            self.lost.append(f"surface {surface.name!r}: pixels that are not interpolated, as programs do")
        if surface.shape in ("sphere", "cube"):
            kind = {"sphere": "Sphere", "cube": "Cube"}[surface.shape]
            prim = self.define(kind, surface.name or surface.shape, surface.pose)
            self.set(prim, **({"radius": 1.0} if kind == "Sphere" else {"size": 2.0}))
        else:
            smooth = surface.shape == "mesh" and surface.smooth
            prim = self.mesh(surface.name or surface.shape, vertices, faces, surface.pose, smooth)
        self.surfaces.append(prim)
        uv = None if uv is None else np.asarray(uv, float) * surface.tiles
        by_tiles = uv is not None and surface.tiles != ONE
        self.tiles = Tiles(surface.tiles, tuple(sorted(tiles_of(uv, faces)))) if by_tiles else None
        mean = look.base if colours is None else colours.reshape(-1, 3).mean(axis=0)
        self.paint(prim, mean[None] if colours is None or colours.ndim == 3 else colours)
        material = self.shade.Material.Define(self.stage, f"/scene/materials/material_{self.count}")
        path = material.GetPath()
        shader = self.shader(path.AppendChild("surface"), "UsdPreviewSurface", **_preview(look))
        if colours is not None and colours.ndim == 2:
            reader = self.shader(path.AppendChild("colours"), "UsdPrimvarReader_float3", varname="displayColor")
            self.connect(shader, "diffuseColor", reader, "result")
        if colours is not None and colours.ndim == 3:
            self.texture(shader, "diffuseColor", srgb_encode(colours), "sRGB")
        if look.roughness_map is not None:
            self.texture(shader, "roughness", _bytes(look.roughness_map))
        if look.specular_map is not None:
            grey = np.repeat(_bytes(look.specular_map)[..., None], 3, axis=2)
            self.texture(shader, "specularColor", grey, scale=(*_preview(look)["specularColor"], 1.0))
        if relief.values is not None:
            values = np.round(65535.0 * relief.values).astype(np.uint16)
            self.texture(shader, "normal", values, scale=(2.0, 2.0, 2.0, 1.0), bias=(-1.0, -1.0, -1.0, 0.0))
        if uv is not None and (look.mapped or colours is not None or relief.values is not None):
            kinds = self.layers.ValueTypeNames
            primvar = self.geometry.PrimvarsAPI(prim).CreatePrimvar("st", kinds.TexCoord2fArray, "vertex")
            primvar.Set(library("pxr.Vt").Vec2fArray.FromNumpy(np.ascontiguousarray(uv, np.float32)))
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        self.shade.MaterialBindingAPI.Apply(prim).Bind(material)

    def move(self, scene: Scene, motion: Motion) -> None:
        """Time samples of camera, surfaces and boxes at the keyframes and at each frame; a time code is a frame."""
        rate, geometry = motion.rate, self.geometry
        self.stage.SetTimeCodesPerSecond(rate)
        self.stage.SetFramesPerSecond(rate)
        self.stage.SetStartTimeCode(0.0)
        self.stage.SetEndTimeCode(rate * motion.seconds)
        frames = np.linspace(0.0, motion.seconds, min(math.ceil(motion.seconds * rate), MOST_FRAMES) + 1)
        every = [(float(rate * time), motion.at(float(time))) for time in sorted({*frames.tolist(), *motion.key_times})]
        if motion.shutter is not None:
            opened, closed = (rate * each for each in motion.shutter)
            self.set(self.seen_by, **{"shutter:open": opened, "shutter:close": closed})
        if motion.camera:
            (place,) = geometry.Xformable(self.seen_by).GetOrderedXformOps()
            for code, tables in every:
                pose = opengl_from_opencv(np.linalg.inv(camera_pose(tables["camera"], scene)))
                place.Set(self.numbers.Matrix4d(pose.T.tolist()), code)
        things = {"surface": (motion.surfaces, self.surfaces, scene.surfaces),
                  "box": (motion.boxes, self.boxes, scene.boxes)}  # fmt: skip
        for what, (keyed, prims, of) in things.items():
            for number in keyed:
                own = np.asarray(np.linalg.inv(rest(motion.tables[what][number])) @ of[number].pose, np.float64)
                places = [(code, tables[what][number]) for code, tables in every]
                self.moved(prims[number], own, places)
        if motion.lamps:
            self.lost.append("motion of lamps")

    def moved(self, prim: Any, own: Matrix, places: list[tuple[float, dict[str, Any]]]) -> None:
        """Shift and turn an object by its keys position and rotation_deg at time codes. own: what it has besides."""
        thing = self.geometry.Xformable(prim)
        thing.ClearXformOpOrder()
        shift, turn, fixed = thing.AddTranslateOp(), thing.AddRotateXYZOp(), thing.AddTransformOp()
        fixed.Set(self.numbers.Matrix4d(own.T.tolist()))
        for code, now in places:
            shift.Set(self.numbers.Vec3d(*now.get("position", NOWHERE)), code)
            turn.Set(self.numbers.Vec3f(*now.get("rotation_deg", NOWHERE)), code)

    def paint(self, prim: Any, colours: Matrix) -> None:
        """displayColor: one colour, or those of all vertices."""
        values = library("pxr.Vt").Vec3fArray.FromNumpy(np.clip(colours, 0.0, 1.0).astype(np.float32))
        kinds, how = self.layers.ValueTypeNames, "constant" if len(colours) == 1 else "vertex"
        self.geometry.PrimvarsAPI(prim).CreatePrimvar("displayColor", kinds.Color3fArray, how).Set(values)

    def shader(self, path: Any, kind: str, **inputs: Any) -> Any:
        """A shader with the numbers, colours, texts and files of its inputs."""
        shader, kinds = self.shade.Shader.Define(self.stage, path), self.layers.ValueTypeNames
        shader.CreateIdAttr(kind)
        for name, given in inputs.items():
            of = {float: kinds.Float, int: kinds.Int, str: kinds.String, list: kinds.Color3f, tuple: kinds.Float4}
            stated = given
            if isinstance(given, list):
                stated = self.numbers.Vec3f(*given)
            elif isinstance(given, tuple):
                stated = self.numbers.Vec4f(*given)
            token = name in ("sourceColorSpace", "wrapS", "wrapT")
            typed = kinds.Asset if name == "file" else kinds.Token if token else of[type(given)]
            shader.CreateInput(name, typed).Set(stated)
        return shader

    def connect(self, shader: Any, name: str, source: Any, output: str) -> None:
        """Have an output of a shader give an input of another."""
        kinds = self.layers.ValueTypeNames
        of = {
            "diffuseColor": kinds.Color3f,
            "specularColor": kinds.Color3f,
            "roughness": kinds.Float,
            "normal": kinds.Normal3f,
            "st": kinds.Float2,
        }
        made = source.CreateOutput(output, {"r": kinds.Float, "result": of[name]}.get(output, kinds.Float3))
        given = shader.GetInput(name) or shader.CreateInput(name, of[name])
        given.GetAttr().Clear()
        given.ConnectToSource(made)

    def texture(
        self,
        shader: Any,
        name: str,
        image: Pixels,
        space: str = "raw",
        **factors: tuple[float, ...],
    ) -> None:
        """A picture on the UVs that gives an input of a surface; by UDIM a file for each of its tiles. factors: its
        scale and bias.
        """
        path, stem = shader.GetPath().GetParentPath(), f"{self.stem}_{self.count}_{name}"
        file = f"{stem}.{MARK}.png" if self.tiles else f"{stem}.png"
        self.images |= self.tiles.cuts(image, file) if self.tiles else {file: image}
        inputs = {"file": f"./{file}", "sourceColorSpace": space, "wrapS": "repeat", "wrapT": "repeat"}
        made = self.shader(path.AppendChild(name), "UsdUVTexture", **inputs, **factors)
        reader = self.shader(path.AppendChild(f"{name}_uvs"), "UsdPrimvarReader_float2", varname="st")
        self.connect(made, "st", reader, "result")
        self.connect(shader, name, made, "rgb" if image.ndim == 3 else "r")

    def mesh(self, name: str, vertices: Any, faces: Any, place: Matrix, smooth: bool = False) -> Any:
        arrays, prim = library("pxr.Vt"), self.define("Mesh", name, place)
        mesh = self.geometry.Mesh(prim)
        points = np.ascontiguousarray(vertices, np.float32)
        mesh.CreatePointsAttr(arrays.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(arrays.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(arrays.IntArray.FromNumpy(np.ravel(faces).astype(np.int32)))
        mesh.CreateSubdivisionSchemeAttr("none")
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        mesh.CreateExtentAttr(arrays.Vec3fArray.FromNumpy(box))
        if smooth:
            import trimesh

            normals: Any = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
            mesh.CreateNormalsAttr(arrays.Vec3fArray.FromNumpy(np.ascontiguousarray(normals, np.float32)))
            mesh.SetNormalsInterpolation("vertex")
        return prim


def _preview(look: PbrMaterial) -> dict[str, Any]:
    """Inputs of a UsdPreviewSurface; its gloss is its specularColor, F0."""
    if look.glass:
        return {"diffuseColor": _clipped(look.base), "roughness": 0.0, "opacity": 0.0, "ior": look.n}
    made: dict[str, Any] = {"diffuseColor": _clipped(look.base), "roughness": look.roughness}
    if look.metallic:
        return {**made, "metallic": look.metallic}
    gloss = _clipped((look.specular or 0.0) * normal_fresnel(look.n) * look.tint)
    return {**made, "ior": look.n, "useSpecularWorkflow": 1, "specularColor": gloss}


def _bytes(values: Any) -> NDArray[np.uint8]:
    return np.round(255.0 * values).astype(np.uint8)


def _clipped(rgb: Any) -> list[float]:
    return [float(x) for x in np.clip(rgb, 0.0, 1.0)]
