"""Hagoromo in Blender 5: a render engine, volume boxes as objects, and meshes dressed with skin, hair and cloth.

An extension: `make blender` packs this folder. Blender's own Python runs it; whatever Hagoromo computes is done by the
command `hagoromo` in a process of its own, so nothing has to be installed into Blender.
"""

import bpy

from . import command, engine
from .boxes import OpenVolumeBox
from .dress import Dress
from .menus import InMenu

PARTS = (
    command,
    engine,
    InMenu(OpenVolumeBox, bpy.types.VIEW3D_MT_volume_add, "VOLUME_DATA"),
    InMenu(Dress, bpy.types.VIEW3D_MT_object, "MOD_CLOTH"),
)


def register() -> None:
    """What Blender calls when the extension is switched on."""
    for part in PARTS:
        part.register()


def unregister() -> None:
    """What Blender calls when it is switched off."""
    for part in reversed(PARTS):
        part.unregister()
