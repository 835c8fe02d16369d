"""The verb render: scene TOML → EXR (linear, with its weights) and PNG beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene_file import load_scene

MODES = ("march",)


def render_scene(
    scene_toml: str | Path,
    out_exr: str | Path,
    mode: str = "march",
    force: bool = False,
    tolerance: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> list[Path]:
    """Render the scene file by `mode`; the paths written, EXR and PNG. Existing ones are refused before the work.

    tolerance: in place of the one that the file states.
    """
    if mode not in MODES:
        raise InputError(f"mode is {mode!r}: this version renders by {', '.join(MODES)}")
    for path in (Path(out_exr), Path(out_exr).with_suffix(".png")):
        if path.exists() and not force:
            raise InputError(f"{path} exists: choose another name or add --force")
    scene, settings = load_scene(scene_toml)
    if tolerance is not None:
        settings = replace(settings, tolerance=tolerance)
    tell = progress or (lambda share, step: None)
    image = render(scene, settings, lambda share: tell(share, "rays"))
    return image.write(out_exr, scene.camera.response, force)
