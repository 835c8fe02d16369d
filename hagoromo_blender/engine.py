"""The render engine: a frame of Blender, still or of an animation, by `hagoromo render`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from .command import Refused, run
from .scene_out import written

MODES = (
    ("march", "First order", "Light that is reflected once, with its shadows; without noise"),
    ("full", "All orders, solved", "Light of all orders on a coarse grid, mended by random walks"),
    ("path", "All orders, walks", "Light of all orders by random walks, with noise"),
)
FOR_ALL = ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT", "BLENDER_RENDER")  # panels that other engines share
NOT_OURS = ("EEVEE", "FREESTYLE", "SIMPLIFY", "GREASE")


class RenderSettings(bpy.types.PropertyGroup):
    """What `hagoromo render` is asked for."""

    mode: bpy.props.EnumProperty(items=MODES, name="Light", default="march")  # pyrefly: ignore
    samples: bpy.props.IntProperty(  # pyrefly: ignore
        name="Samples", description="Rays a pixel; in walks, walks a pixel", default=1, min=1, max=1 << 16
    )
    error: bpy.props.FloatProperty(  # pyrefly: ignore
        name="Error", description="All orders: error at which to stop, root mean square over mean; 0: by samples",
        default=0.0, min=0.0, max=1.0, precision=3,
    )  # fmt: skip
    times: bpy.props.IntProperty(  # pyrefly: ignore
        name="Times", description="Motion blur without walks: the mean of so many pictures", default=16, min=1, max=1024
    )
    seed: bpy.props.IntProperty(name="Seed", default=0, min=0)  # pyrefly: ignore


class Engine(bpy.types.RenderEngine):
    """F12, and the frames of an animation."""

    bl_idname = "HAGOROMO"
    bl_label = "Hagoromo"
    bl_use_preview = False
    bl_use_shading_nodes_custom = False

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Write the scene, render it, and take the picture over; a fault is one line in Blender's report."""
        render = depsgraph.scene.render
        share = render.resolution_percentage / 100
        size = int(render.resolution_x * share), int(render.resolution_y * share)
        try:
            with tempfile.TemporaryDirectory(prefix="hagoromo-blender-") as folder:
                picture = self._picture(depsgraph, Path(folder), size)
        except Refused as why:
            self.report({"ERROR"}, f"Hagoromo: {why}")
            return
        result = self.begin_result(0, 0, *size)
        result.layers[0].passes["Combined"].rect.foreach_set(picture.ravel())
        self.end_result(result)

    def _picture(self, depsgraph: bpy.types.Depsgraph, folder: Path, size: tuple[int, int]) -> np.ndarray:
        """(height, width, 4) linear sRGB and alpha, from below."""
        asked, out = depsgraph.scene.hagoromo, folder / "picture.exr"
        scene, lost, moves = written(depsgraph, folder, size, asked.mode != "march", self._at)
        for line in lost:
            self.report({"WARNING"}, f"Hagoromo: lost: {line}")
        words = ["--mode", asked.mode, "--samples", asked.samples, "--seed", asked.seed]
        if asked.mode != "march" and asked.error > 0.0:
            words += ["--error", round(asked.error, 6)]
        if moves and asked.mode != "path":
            words += ["--times", asked.times]
        run("render", scene, "--out", out, *words, progress=self._goes_on)
        return pixels(out)

    def _at(self, frame: int, part: float) -> None:
        self.frame_set(frame, part)

    def _goes_on(self, share: float) -> bool:
        self.update_progress(share)
        return not self.test_break()


def pixels(path: Path) -> np.ndarray:
    """(height, width, 4) R, G, B and A of an EXR, from below, as Blender counts rows."""
    import OpenImageIO as oiio

    held = oiio.ImageInput.open(str(path))
    if held is None:
        raise Refused(f"the picture {path.name} cannot be read: {oiio.geterror()}")
    names = list(held.spec().channelnames)
    values = np.asarray(held.read_image(format=oiio.FLOAT)).reshape(held.spec().height, held.spec().width, -1)
    held.close()
    picture = np.stack([values[..., names.index(name)] if name in names else np.ones(values.shape[:2], np.float32)
                        for name in "RGBA"], axis=2)  # fmt: skip
    return np.ascontiguousarray(picture[::-1])


class RenderPanel(bpy.types.Panel):
    """Settings of the engine, in the properties of the render."""

    bl_label = "Hagoromo"
    bl_idname = "RENDER_PT_hagoromo"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "render"
    COMPAT_ENGINES = {Engine.bl_idname}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Where the engine is chosen."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context: bpy.types.Context) -> None:
        """The fields."""
        asked = context.scene.hagoromo
        self.layout.use_property_split = True
        times = ("times",) if asked.mode != "path" and context.scene.render.use_motion_blur else ()
        for name in ("mode", "samples", *(("error",) if asked.mode != "march" else ()), *times, "seed"):
            self.layout.prop(asked, name)


CLASSES = RenderSettings, Engine, RenderPanel


def _panels() -> list[type]:
    """Panels of Blender that serve engines in general: camera, light, material, output, world."""
    return [
        panel for panel in bpy.types.Panel.__subclasses__()
        if set(FOR_ALL) & getattr(panel, "COMPAT_ENGINES", set()) and not any(w in panel.__name__ for w in NOT_OURS)
    ]  # fmt: skip


def register() -> None:
    """The engine, its settings and panels."""
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.hagoromo = bpy.props.PointerProperty(type=RenderSettings)
    for panel in _panels():
        panel.COMPAT_ENGINES.add(Engine.bl_idname)  # pyrefly: ignore


def unregister() -> None:
    """The same back."""
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(Engine.bl_idname)  # pyrefly: ignore
    del bpy.types.Scene.hagoromo
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
