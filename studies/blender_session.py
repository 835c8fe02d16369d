"""Scenes in Blender, rendered there by Hagoromo and by Cycles: run by the Python that has bpy (`make cycles`).

    .venv/cycles/bin/python studies/blender_session.py surfaces|mapped|moving|dressed FOLDER

Leaves in FOLDER, which exists: hagoromo.npy and cycles.npy, (height, width, 3) linear sRGB, of the scene of surfaces,
of squares with images of normals, heights and by UDIM, or of a cube that moves;
march, full, cycles_1 and cycles of a ball that is dressed with skin, and ball.zarr.
"""

import glob
import math
import sys
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path += [*glob.glob(sys.prefix + "/lib/python*/site-packages/bpy/*/python/lib/python*/site-packages"), str(ROOT)]

SAMPLES = 256  # of Cycles


def started(width, height):
    """An empty scene with the extension, of linear pictures."""
    import hagoromo_blender

    bpy.ops.wm.read_factory_settings(use_empty=True)
    hagoromo_blender.register()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    cycles = scene.cycles
    cycles.samples, cycles.device, cycles.pixel_filter_type, cycles.filter_width = SAMPLES, "CPU", "BOX", 1.0
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0
    return scene


def added(name, data, place, turn=(0.0, 0.0, 0.0)):
    """An object of the scene."""
    made = bpy.data.objects.new(name, data)
    made.location, made.rotation_euler = place, turn
    bpy.context.scene.collection.objects.link(made)
    return made


def lamp(kind, place, energy, turn=(0.0, 0.0, 0.0), **keys):
    """A lamp of the scene."""
    data = bpy.data.lights.new(kind, kind)
    data.energy = energy
    for name, value in keys.items():
        setattr(data, name, value)
    added(kind, data, place, turn)


def camera(place, turn, lens, **shift):
    """The scene's camera."""
    data = bpy.data.cameras.new("camera")
    data.lens, data.clip_start = lens, 0.001
    for name, value in shift.items():
        setattr(data, name, value)
    bpy.context.scene.camera = added("camera", data, place, turn)


def painted(shown, colour):
    """A matt body on an object."""
    made = bpy.data.materials.new("matt")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    out, body = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    body.inputs["Color"].default_value = (*colour, 1.0)
    tree.links.new(body.outputs[0], out.inputs["Surface"])
    shown.data.materials.append(made)


def world(folder):
    """Dim light from all around that differs from side to side."""
    from hagoromo_blender.look import write_image

    values = np.full((16, 32, 3), 0.05, np.float32)
    values[:8] += np.linspace(0.0, 0.4, 32, dtype=np.float32)[None, :, None] * [1.0, 0.5, 0.2]
    write_image(folder / "sky.exr", values)
    made = bpy.data.worlds.new("sky")
    made.use_nodes = True
    node = made.node_tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = bpy.data.images.load(str(folder / "sky.exr"))
    made.node_tree.links.new(node.outputs["Color"], made.node_tree.nodes["Background"].inputs["Color"])
    bpy.context.scene.world = made


def rendered(engine, folder, name):
    """The picture as (height, width, 3), from above, in a file."""
    from hagoromo_blender.engine import pixels

    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = engine, str(folder / f"{name}.exr")
    bpy.ops.render.render(write_still=True)
    np.save(folder / f"{name}.npy", pixels(folder / f"{name}.exr")[::-1, :, :3])


def surfaces(folder):
    """A floor, a ball, and a cube of two materials under lamps of every kind and a sky, by light of the first order."""
    scene = started(240, 160)
    lamp("POINT", (1.0, -0.5, 2.0), 60.0, shadow_soft_size=0.0)
    lamp("SUN", (0.0, 0.0, 2.0), 0.7, (0.3, 0.4, 0.0), angle=0.0)
    lamp(
        "AREA",
        (-0.5, 1.0, 1.5),
        30.0,
        (-0.5, -0.3, 0.2),
        shape="RECTANGLE",
        size=0.5,
        size_y=0.25,
        color=(1.0, 0.6, 0.3),
    )
    lamp("POINT", (-1.5, -0.5, 1.0), 40.0, shadow_soft_size=0.1, color=(0.3, 0.6, 1.0))
    bpy.ops.mesh.primitive_plane_add(size=3.0)
    painted(bpy.context.object, (0.5, 0.5, 0.5))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(0.3, 0.1, 0.3), segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    painted(bpy.context.object, (0.6, 0.1, 0.1))
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(-0.5, -0.1, 0.2), rotation=(0.0, 0.0, 0.5))
    painted(bpy.context.object, (0.1, 0.2, 0.6))
    painted(bpy.context.object, (0.7, 0.7, 0.2))
    bpy.context.object.data.polygons[5].material_index = 1
    camera((0.0, -3.0, 2.0), (math.radians(60.0), 0.0, 0.05), 45.0, shift_x=0.06, shift_y=-0.03)
    world(folder)
    scene.hagoromo.samples, scene.cycles.max_bounces = 16, 0
    rendered("HAGOROMO", folder, "hagoromo")
    rendered("CYCLES", folder, "cycles")


def with_images(shown, base=None, normals=None, heights=None):
    """A matt Principled material with images on an object."""
    made = bpy.data.materials.new("images")
    made.use_nodes = True
    tree = made.node_tree
    body = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    body.inputs["Base Color"].default_value = (0.6, 0.6, 0.6, 1.0)
    body.inputs["Roughness"].default_value, body.inputs["Specular IOR Level"].default_value = 1.0, 0.0

    def image(held):
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image = held
        return node.outputs["Color"]

    if base is not None:
        tree.links.new(image(base), body.inputs["Base Color"])
    if normals is not None:
        node = tree.nodes.new("ShaderNodeNormalMap")
        tree.links.new(image(normals), node.inputs["Color"])
        tree.links.new(node.outputs["Normal"], body.inputs["Normal"])
    if heights is not None:
        node = tree.nodes.new("ShaderNodeBump")
        node.inputs["Distance"].default_value, node.inputs["Strength"].default_value = 0.1, 1.0
        tree.links.new(image(heights), node.inputs["Height"])
        tree.links.new(node.outputs["Normal"], body.inputs["Normal"])
    shown.data.materials.append(made)


def mapped(folder):
    """Squares: normals of an image, heights of one, and greys by UDIM; turned, so that tangents are, too."""
    from hagoromo_blender.look import write_image

    scene = started(192, 64)
    lamp("SUN", (0.0, 0.0, 2.0), 3.0, (0.5, 0.3, 0.0), angle=0.0)
    u, v = np.meshgrid(*[(np.arange(64) + 0.5) / 64 * 2.0 * math.pi] * 2)  # from below, as Blender counts rows
    normal = np.stack([0.4 * np.sin(u), 0.3 * np.cos(2 * v), np.ones_like(u)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    heights = np.repeat((0.5 + 0.5 * np.sin(u) * np.cos(v))[..., None], 3, axis=-1)
    images = []
    for name, values in (("normals", 0.5 + 0.5 * normal), ("heights", heights)):
        one = bpy.data.images.new(name, 64, 64, float_buffer=True, is_data=True)
        one.pixels.foreach_set(np.concatenate([values, np.ones((64, 64, 1))], axis=-1).astype(np.float32).ravel())
        images.append(one)
    for number, grey in ((1001, 0.8), (1002, 0.4)):
        write_image(folder / f"tile.{number}.png", np.full((32, 32, 3), grey, np.float32))
    tiled = bpy.data.images.load(str(folder / "tile.1001.png"))
    tiled.source, tiled.filepath = "TILED", str(folder / "tile.<UDIM>.png")
    tiled.tiles.new(1002)
    for place, keys in ((-1.0, {"normals": images[0]}), (0.0, {"heights": images[1]}), (1.0, {"base": tiled})):
        bpy.ops.mesh.primitive_plane_add(size=0.8, location=(place, 0.0, 0.0), rotation=(0.1, 0.0, 0.4))
        with_images(bpy.context.object, **keys)
    uv = bpy.context.object.data.uv_layers.active.uv
    for each in uv:
        each.vector = (2.0 * each.vector[0], each.vector[1])
    camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 50.0)
    scene.hagoromo.samples, scene.cycles.max_bounces = 16, 0
    rendered("HAGOROMO", folder, "hagoromo")
    rendered("CYCLES", folder, "cycles")


def moving(folder):
    """A cube that moves by its own width while the shutter is open, seen from above."""
    scene = started(64, 16)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    lamp("SUN", (0.0, 0.0, 2.0), 3.0, angle=0.0)
    bpy.ops.mesh.primitive_cube_add(size=0.5)
    painted(bpy.context.object, (0.5, 0.5, 0.5))
    for frame, x in ((0, -1.0), (2, 1.0)):
        bpy.context.object.location = (x, 0.0, 0.0)
        bpy.context.object.keyframe_insert("location", frame=frame)
    scene.frame_set(1)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    scene.render.motion_blur_position = "CENTER"
    camera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0), 180.0)
    scene.hagoromo.mode, scene.hagoromo.samples, scene.cycles.max_bounces = "path", SAMPLES, 0
    rendered("HAGOROMO", folder, "hagoromo")
    rendered("CYCLES", folder, "cycles")


def dressed(folder):
    """A flat ball on a table that is dressed with skin, by the first order and by all orders."""
    scene = started(400, 300)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.006, location=(0.01, 0.02, 0.012), segments=48, ring_count=24)
    bpy.context.object.scale, bpy.context.object.rotation_euler = (1.0, 1.0, 0.7), (0.0, 0.0, 0.3)
    bpy.ops.hagoromo.dress(recipe="skin", voxel_mm=0.06, out=str(folder / "ball.zarr"))
    lamp("POINT", (0.05, -0.03, 0.06), 0.08, shadow_soft_size=0.0)
    lamp("POINT", (-0.05, -0.03, 0.03), 0.03, shadow_soft_size=0.0)
    bpy.ops.mesh.primitive_plane_add(size=0.06, location=(0.01, 0.02, 0.007))
    painted(bpy.context.object, (0.5, 0.5, 0.5))
    camera((0.01, -0.04, 0.042), (math.radians(65.0), 0.0, 0.0), 100.0)
    cycles = scene.cycles
    cycles.samples = SAMPLES // 4
    for mode, name, bounces in (("march", "cycles_1", 0), ("full", "cycles", 32)):
        cycles.max_bounces = cycles.volume_bounces = bounces
        scene.hagoromo.mode = mode
        rendered("HAGOROMO", folder, mode)
        rendered("CYCLES", folder, name)


if __name__ == "__main__":
    {"surfaces": surfaces, "mapped": mapped, "moving": moving, "dressed": dressed}[sys.argv[1]](Path(sys.argv[2]))
