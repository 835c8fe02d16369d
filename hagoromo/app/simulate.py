"""The verb simulate: scene TOML → capture folder, one photograph per lamp, the truth beside them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hagoromo.files.whole import whole_folder
from hagoromo.image.scene_file import load_scene
from hagoromo.image.simulate import simulate as photograph_scene
from hagoromo.photograph.capture import save_capture


def simulate(
    scene_toml: str | Path,
    out: str | Path,
    force: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Photograph the scene in a file under each of its lamps alone; the capture folder written.

    An existing folder is refused before the work.
    """
    with whole_folder(out, force) as home:
        save_capture(photograph_scene(*load_scene(scene_toml), Path(out).name, progress), home)
    return Path(out)
