"""Volume boxes as objects: a box is shown as the OpenVDB of its voxels, and keeps where it came from.

Its material for Cycles is the nearest that Cycles has: matter of the same extinction, whose albedo is that of the
body, and which scatters as matte spheres do in the mean. Cycles has neither planes, fibres nor gloss for volumes.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from pathlib import Path

import bpy
from mathutils import Matrix

from .command import Refused, run

KEY = "hagoromo_box"  # of an object: the path of its box
EXTINCTION = "hagoromo_extinction"  # what the box was built for: "isotropic" or "projected"
MEAN_COSINE = -4.0 / 9.0  # of matte spheres


class OpenVolumeBox(bpy.types.Operator):
    """Open a volume box of Hagoromo (a folder such as cloth.zarr) as an object"""

    bl_idname = "hagoromo.open_box"
    bl_label = "Open Volume Box"
    bl_options = {"REGISTER", "UNDO"}
    directory: bpy.props.StringProperty(name="Box", subtype="DIR_PATH")  # pyrefly: ignore

    def execute(self, _context: bpy.types.Context) -> set[str]:
        """Convert, and add the object."""
        try:
            opened(Path(bpy.path.abspath(self.directory)))
        except Refused as why:
            self.report({"ERROR"}, str(why))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}


def opened(box: Path, pose: Matrix | None = None) -> bpy.types.Object:
    """An object that shows a box, where it was built or moved by `pose`."""
    box = box.resolve()
    facts = dict(line.split(": ", 1) for line in run("info", box).splitlines() if ": " in line)
    if facts.get("kind") != "volume box":
        raise Refused(f"{box} is no volume box: choose a folder that hagoromo build wrote, such as cloth.zarr")
    data = bpy.data.volumes.new(box.stem)
    data.filepath = str(_grids(box))
    size = float(facts["voxel_size"])
    data.render.space, data.render.step_size = "WORLD", size
    data.materials.append(_material(box.stem, json.loads(facts["tau"])))
    shown = bpy.data.objects.new(box.stem, data)
    shown[KEY], shown[EXTINCTION] = str(box), facts["extinction"]
    shown.matrix_world = pose or Matrix.Identity(4)
    bpy.context.scene.collection.objects.link(shown)
    return shown


def _grids(box: Path) -> Path:
    """The box as OpenVDB, made anew where the box is another than before."""
    number = hashlib.sha256(f"{box} {(box / 'zarr.json').stat().st_mtime_ns}".encode()).hexdigest()[:16]
    kept = _folder() / f"{box.stem} {number}.vdb"
    if not kept.exists():
        run("convert", box, "--out", kept)
    return kept


def _folder() -> Path:
    """Where the grids of boxes are kept."""
    try:
        return Path(bpy.utils.extension_path_user(__package__ or "", path="boxes", create=True))
    except ValueError:  # not run as an extension
        folder = Path(tempfile.gettempdir()) / "hagoromo boxes"
        folder.mkdir(exist_ok=True)
        return folder


def _material(name: str, extinction: float) -> bpy.types.Material:
    """Scattering of albedo times extinction, and absorption of the rest. extinction: where the density is 1 [1/m]."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    kinds = {
        "density": "Attribute", "colour": "Attribute", "extinction": "Math", "scatter": "VolumeScatter",
        "absorb": "VolumeAbsorption", "sum": "AddShader", "out": "OutputMaterial",
    }  # fmt: skip
    node = {key: tree.nodes.new(f"ShaderNode{kind}") for key, kind in kinds.items()}
    for column, each in enumerate(node.values()):
        each.location = (220.0 * column, 0.0)
    node["density"].attribute_name, node["colour"].attribute_name = "density", "colour"
    node["extinction"].operation, node["extinction"].inputs[1].default_value = "MULTIPLY", extinction
    node["scatter"].inputs["Anisotropy"].default_value = MEAN_COSINE
    tree.links.new(node["density"].outputs["Fac"], node["extinction"].inputs[0])
    for key in ("scatter", "absorb"):  # Cycles: extinction times colour, and times what colour lacks of 1
        tree.links.new(node["extinction"].outputs[0], node[key].inputs["Density"])
        tree.links.new(node["colour"].outputs["Color"], node[key].inputs["Color"])
    tree.links.new(node["scatter"].outputs[0], node["sum"].inputs[0])
    tree.links.new(node["absorb"].outputs[0], node["sum"].inputs[1])
    tree.links.new(node["sum"].outputs[0], node["out"].inputs["Volume"])
    return made


def copied(box: Path, folder: Path, name: str) -> Path:
    """The box in a folder: by links where the disk is the same, else as a copy."""
    if not box.is_dir():
        raise Refused(f"the box {box} is gone: open it again from where it is now")

    def put(source: str, target: str) -> None:
        try:
            Path(target).hardlink_to(source)
        except OSError:
            shutil.copy2(source, target)

    shutil.copytree(box, folder / name, copy_function=put)
    return folder / name
