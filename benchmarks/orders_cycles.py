"""The child of orders_rivals.py: a lattice of matter by Blender's Cycles, on its CPU. Run by the Python that has bpy.

Reads one JSON line a picture, {"walks": …, "seed": …}, and answers with {"file": …, "cpu_s": …}. Cycles has no phase
function of matte spheres: it gets Henyey and Greenstein's of the same mean cosine, −4/9.
"""

import glob
import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

sys.path += glob.glob(sys.prefix + "/lib/python*/site-packages/bpy/*/python/lib/python*/site-packages")

MEAN_COSINE = -4.0 / 9.0
BOUNCES = 1024


def volume(job, folder):
    """The lattice as a volume object."""
    import openvdb

    held = np.load(folder / "lattice.npz")
    size = job["edges"][0] / held["extinction"].shape[2]
    grids = []
    for name in ("extinction", "albedo"):
        grid = openvdb.FloatGrid()
        grid.copyFromArray(np.ascontiguousarray(held[name].transpose(2, 1, 0)), tolerance=0.0)
        grid.name, grid.transform = name, openvdb.createLinearTransform(voxelSize=size)
        grid.transform.postTranslate([low + 0.5 * size for low in job["low"]])
        grids.append(grid)
    openvdb.write(str(folder / "matter.vdb"), grids)
    data = bpy.data.volumes.new("matter")
    data.filepath = str(folder / "matter.vdb")
    data.materials.append(material())
    data.render.space, data.render.step_size = "WORLD", size
    return bpy.data.objects.new("matter", data)


def material():
    """Scattering by albedo · extinction, and absorption of the rest."""
    made = bpy.data.materials.new("matter")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    kinds = {
        "extinction": "Attribute", "albedo": "Attribute", "scatter": "VolumeScatter", "absorb": "VolumeAbsorption",
        "sum": "AddShader", "out": "OutputMaterial",
    }  # fmt: skip
    node = {name: tree.nodes.new(f"ShaderNode{kind}") for name, kind in kinds.items()}
    node["extinction"].attribute_name, node["albedo"].attribute_name = "extinction", "albedo"
    node["scatter"].inputs["Anisotropy"].default_value = MEAN_COSINE
    for name in ("scatter", "absorb"):  # both take their colour: density · c, density · (1 − c)
        tree.links.new(node["extinction"].outputs["Fac"], node[name].inputs["Density"])
        tree.links.new(node["albedo"].outputs["Fac"], node[name].inputs["Color"])
    tree.links.new(node["scatter"].outputs[0], node["sum"].inputs[0])
    tree.links.new(node["absorb"].outputs[0], node["sum"].inputs[1])
    tree.links.new(node["sum"].outputs[0], node["out"].inputs["Volume"])
    return made


def placed(job):
    """The scene of a job."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, folder = bpy.context.scene, Path(job["folder"])
    link = scene.collection.objects.link
    link(volume(job, folder))
    for x, y, z, intensity in job["lamps"]:
        light = bpy.data.lights.new("lamp", "POINT")
        light.energy, light.shadow_soft_size = 4.0 * np.pi * intensity, 0.0  # [W], all around
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = (x, y, z)
        link(lamp)
    data = bpy.data.cameras.new("camera")
    data.sensor_width, data.lens, data.clip_end = 1.0, job["focal"], 1000.0
    camera = bpy.data.objects.new("camera", data)
    back = (Vector(job["eye"]) - Vector(job["target"])).normalized()
    right = Vector(job["up"]).cross(back).normalized()
    turned = Matrix((right, back.cross(right), back)).transposed().to_4x4()
    camera.matrix_world = Matrix.Translation(job["eye"]) @ turned
    link(camera)
    scene.camera = camera
    world = bpy.data.worlds.new("dark")
    world.use_nodes = True
    world.node_tree.nodes.clear()
    scene.world = world
    return scene


def settings(scene, job):
    """Unbiased, all orders, on the CPU."""
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    cycles = scene.cycles
    cycles.max_bounces = cycles.volume_bounces = cycles.transparent_max_bounces = BOUNCES
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0
    if hasattr(cycles, "volume_biased"):
        cycles.volume_biased = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    render = scene.render
    render.resolution_x = render.resolution_y = job["pixels"]
    render.resolution_percentage, render.use_persistent_data = 100, True
    render.threads_mode, render.threads = "FIXED", job["threads"]
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.image_settings.color_mode = "RGB"
    scene.view_settings.view_transform = "Raw"


def main():
    """Answer until the lines end."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    scene, folder = placed(job), Path(job["folder"])
    settings(scene, job)
    print(json.dumps({"version": bpy.app.version_string}), flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        scene.cycles.samples, scene.cycles.seed = asked["walks"], asked["seed"]
        scene.render.filepath = str(folder / "picture.exr")
        begin = time.process_time()
        bpy.ops.render.render(write_still=True)
        taken = time.process_time() - begin
        image = bpy.data.images.load(scene.render.filepath, check_existing=False)
        width, height = image.size
        values = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
        np.save(folder / "picture.npy", values.reshape(height, width, 4)[::-1, :, 1])
        print(json.dumps({"file": str(folder / "picture.npy"), "cpu_s": taken}), flush=True)


if __name__ == "__main__":
    main()
