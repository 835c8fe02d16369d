"""What the extension refuses in Blender, each in one line: run by the Python that has bpy; prints the lines."""

import glob
import sys
import tempfile
from pathlib import Path

import bpy

sys.path += [
    *glob.glob(sys.prefix + "/lib/python*/site-packages/bpy/*/python/lib/python*/site-packages"),
    str(Path(__file__).resolve().parents[2]),
]

import hagoromo_blender


def said(task):
    """The line of a task that fails."""
    try:
        task()
    except RuntimeError as error:
        print(str(error).removeprefix("Error: ").strip(), flush=True)
    else:
        print("nothing was said", flush=True)


def rendered():
    """The picture of the scene."""
    bpy.ops.render.render()


bpy.ops.wm.read_factory_settings(use_empty=True)
hagoromo_blender.register()
scene = bpy.context.scene
scene.render.engine = "HAGOROMO"
scene.render.resolution_x, scene.render.resolution_y = 32, 24
said(rendered)
scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(scene.camera)
said(rendered)
bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.0, 0.0, -2.0))
said(rendered)
said(lambda: bpy.ops.hagoromo.dress(recipe="skin", out="box.zarr"))
with tempfile.TemporaryDirectory() as folder:
    said(lambda: bpy.ops.hagoromo.open_box(directory=folder))
scene.collection.objects.link(bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT")))
scene.camera.data.type = "ORTHO"
said(rendered)
hagoromo_blender.unregister()
