"""The scene and the settings of a call, which may name a file."""

from __future__ import annotations

from pathlib import Path

from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings


def scene_and_settings(scene: Scene | str | Path, settings: Settings | None = None) -> tuple[Scene, Settings]:
    """The scene, loaded where `scene` is the path of a TOML file; `settings`, else the file's, else the defaults."""
    if isinstance(scene, Scene):
        return scene, settings or Settings()
    # only a file needs the readers of boxes, cameras and recipes
    from hagoromo.image.scene.scene_file import load_scene

    loaded, stated = load_scene(scene)
    return loaded, settings or stated
