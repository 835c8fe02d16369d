"""Blender, where a Python that has bpy is there: what it finds in a file."""

import json
import os
import subprocess

import pytest


def in_blender(tmp_path, name):
    """What Blender finds in a USD file: its camera, lamps and meshes with their materials."""
    python = os.environ.get("HAGOROMO_TEST_BPY", "")
    if not python:
        pytest.skip("needs HAGOROMO_TEST_BPY, a Python that has bpy")
    code = """
import bpy, json, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=sys.argv[1])
found = {}
for o in bpy.data.objects:
    e = {"type": o.type, "matrix": [list(r) for r in o.matrix_world]}
    if o.type == "CAMERA":
        e |= {"ratio": o.data.lens / o.data.sensor_width, "shift": [o.data.shift_x, o.data.shift_y]}
    if o.type == "LIGHT":
        sizes = [getattr(o.data, name, 0) for name in ("size", "size_y")]
        e |= {"kind": o.data.type, "energy": o.data.energy, "sizes": sizes}
    if o.type == "MESH":
        e |= {"points": [list(o.matrix_world @ v.co) for v in o.data.vertices], "inputs": {}}
        for node in [node for m in o.data.materials for node in m.node_tree.nodes if node.type == "BSDF_PRINCIPLED"]:
            for key in ("Base Color", "Roughness", "IOR", "Specular Tint", "Normal"):
                nodes = [link.from_node for link in node.inputs[key].links]
                while nodes and nodes[0].type not in ("TEX_IMAGE", "ATTRIBUTE"):  # back to what it is made of
                    nodes = [link.from_node for each in nodes[0].inputs for link in each.links]
                image = getattr(nodes[0], "image", None) if nodes else None
                value = node.inputs[key].default_value
                e["inputs"][key] = (
                    [image.filepath, image.colorspace_settings.name] if image
                    else nodes[0].attribute_name if nodes else list(value) if hasattr(value, "__len__") else value
                )
    found[o.name] = e
print("FOUND" + json.dumps(found))
"""
    done = subprocess.run([python, "-c", code, str(tmp_path / name)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.split("FOUND")[1].splitlines()[0])
