"""A mesh is dressed: a recipe of skin, hair, cloth or a solid is built on it, and comes back as a box in its place.

Its extinction is "projected" whatever the recipe states, as light of all orders needs it.
"""

from __future__ import annotations

import struct
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .boxes import opened
from .command import Refused, run
from .meshes import OF_MESHES, whole_numbers
from .toml_out import toml_of

ON_A_MESH = ("skin", "hair", "solid")  # kinds that take [shape] form = "mesh"; cloth takes it with lay = "mesh"
CLOTH = ("cloth", "knit")
NAMES = ("skin", "hair", "linen", "solid", "satin", "twill", "stockinette")


class Dress(bpy.types.Operator):
    """Build a recipe of Hagoromo on the active mesh, and open the box in its place"""

    bl_idname = "hagoromo.dress"
    bl_label = "Dress with Hagoromo"
    bl_options = {"REGISTER", "UNDO"}
    recipe: bpy.props.EnumProperty(  # pyrefly: ignore
        name="Recipe", items=[(name, name.capitalize(), "") for name in NAMES], default="skin"
    )
    file: bpy.props.StringProperty(name="Own recipe", description="A .toml in place of it", subtype="FILE_PATH")  # pyrefly: ignore
    voxel_mm: bpy.props.FloatProperty(  # pyrefly: ignore
        name="Voxel", description="Edge of a voxel [mm]; 0: that of the recipe", default=0.0, min=0.0, precision=3
    )
    out: bpy.props.StringProperty(name="Box", description="Where the box is written", subtype="DIR_PATH")  # pyrefly: ignore
    hide: bpy.props.BoolProperty(name="Hide the mesh", default=True)  # pyrefly: ignore

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """On a mesh, or what becomes one."""
        return context.active_object is not None and context.active_object.type in OF_MESHES

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build, and open."""
        shown = context.active_object
        try:
            box = dressed(shown.evaluated_get(context.evaluated_depsgraph_get()), self._recipe(), self._out(shown))
        except Refused as why:
            self.report({"ERROR"}, str(why))
            return {"CANCELLED"}
        if self.hide:
            shown.hide_render = True
            shown.hide_set(True)
        context.view_layer.objects.active = box
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the recipe."""
        return context.window_manager.invoke_props_dialog(self)

    def _recipe(self) -> dict[str, Any]:
        """The recipe that is chosen, of the voxel that is asked for."""
        file = Path(bpy.path.abspath(self.file)) if self.file else _shipped(self.recipe)
        try:
            recipe = tomllib.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise Refused(f"the recipe {file} cannot be read: {error}") from error
        return recipe | ({"voxel_mm": round(self.voxel_mm, 6)} if self.voxel_mm > 0.0 else {})

    def _out(self, shown: bpy.types.Object) -> Path:
        """A folder that is not there yet: the one that is asked for, or one beside the .blend."""
        if self.out:
            return Path(bpy.path.abspath(self.out))
        if not bpy.data.filepath:
            raise Refused("save the .blend first, or give a folder for the box: the box is written beside it")
        beside, number = Path(bpy.data.filepath).parent, 0
        while (path := beside / f"{shown.name} {self.recipe}{f' {number}' if number else ''}.zarr").exists():
            number += 1
        return path


def dressed(shown: bpy.types.Object, recipe: dict[str, Any], out: Path) -> bpy.types.Object:
    """The box of a recipe on an evaluated object, opened where the object stands."""
    vertices, faces, uv = _triangles(shown)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not high[2] > low[2]:
        raise Refused(f"{shown.name} is flat: its height is 0; a recipe needs a body")
    shape = {"form": "mesh", "file": "mesh.ply", "height_mm": 1000.0 * float(high[2] - low[2])}
    kind = recipe.get("kind")
    if kind in CLOTH:
        if uv is None:
            raise Refused(f"{shown.name} has no UV map: cloth lies on a mesh by it; unwrap it first")
        recipe = recipe | {"lay": "mesh"}
    elif kind not in ON_A_MESH:
        raise Refused(f"a recipe of kind {kind!r} takes no mesh: give one of {', '.join(ON_A_MESH + CLOTH)}")
    with tempfile.TemporaryDirectory(prefix="hagoromo-dress-") as folder:
        (Path(folder) / "mesh.ply").write_bytes(_ply(vertices, faces, uv))
        text = toml_of(recipe | {"shape": shape, "extinction": "projected"})
        (Path(folder) / "recipe.toml").write_text(text, encoding="utf-8")
        run("build", Path(folder) / "recipe.toml", "--out", out)
    middle = 0.5 * (low + high)
    return opened(out, Matrix.Translation(Vector((middle[0], middle[1], low[2]))))  # recipes stand it on z = 0


def _shipped(name: str) -> Path:
    """The recipe that comes with the program, written out by it."""
    folder = Path(tempfile.gettempdir()) / "hagoromo recipes"
    folder.mkdir(exist_ok=True)
    file = folder / f"{name}.toml"
    file.write_text(run("recipes", "--name", name), encoding="utf-8")
    return file


def _triangles(shown: bpy.types.Object) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices (n, 3) in the world [m], faces (m, 3), and UV (n, 2) where there is a map, whose seams part vertices."""
    mesh = shown.to_mesh()
    mesh.calc_loop_triangles()
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", places)
    faces = whole_numbers(mesh.loop_triangles, "vertices", 3).ravel()
    pose, uv = np.array(shown.matrix_world), None
    if mesh.uv_layers.active:
        loops, at = whole_numbers(mesh.loop_triangles, "loops", 3).ravel(), np.empty(2 * len(mesh.loops), np.float32)
        mesh.uv_layers.active.uv.foreach_get("vector", at)
        corners = np.concatenate([faces[:, None], at.reshape(-1, 2)[loops]], axis=1)
        kept, faces = np.unique(corners, axis=0, return_inverse=True)
        places, uv = places.reshape(-1, 3)[kept[:, 0].astype(int)], kept[:, 1:]
    shown.to_mesh_clear()
    return places.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3], faces.reshape(-1, 3), uv


def _ply(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None) -> bytes:
    """A binary PLY."""
    columns = "xyz" if uv is None else "xyzuv"
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in columns]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    values = vertices if uv is None else np.concatenate([vertices, uv], axis=1)
    indices = b"".join(struct.pack("<B3i", 3, *map(int, face)) for face in faces)
    return "\n".join(head).encode() + np.ascontiguousarray(values, "<f4").tobytes() + indices
