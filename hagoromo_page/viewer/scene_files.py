"""Scene files: what a viewer was asked to show, and the scenes of its edited tables.

Boxes, recipes and meshes are read once; an edit of their place or material takes what was read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.names import printable
from hagoromo.files.record import read_toml
from hagoromo.files.stores import address
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_file
from hagoromo.image.box_camera import TO_KEY, box_camera
from hagoromo.image.scene.read_once import read_once
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import scene_from_tables
from hagoromo.image.scene.settings import Settings
from hagoromo.volume.store.box_store import load_box
from hagoromo_page.viewer.view_state import ViewState

PICTURE_SIDE = 1024  # px of a box's picture
BOX_LAMP = {"name": "key", "to_lamp": list(TO_KEY)}


class SceneFiles:
    """The files of a scene. folder: where the scene lies, or would. name: of the file that was opened."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        self.read = read_once()

    def scene(self, state: ViewState) -> tuple[Scene, Settings]:
        """The scene of a state, and its settings; `InputError` where its tables make none."""
        return scene_from_tables(state.tables, self.folder, self.name, self.read)

    def write(self, state: ViewState) -> Path:
        """Write the tables as a scene file of a new name beside the opened one; its path."""
        stem = Path(self.name).stem
        for number in range(1, 10_000):
            path = self.folder / f"{stem}-view{number}.toml"
            if not any(one.exists() for one in (path, path.with_suffix(".exr"), path.with_suffix(".png"))):
                break
        with whole_file(path) as partial:
            partial.write_text(toml_text(state.tables), encoding="utf-8", newline="\n")
        return path


def opened(path: Path) -> tuple[SceneFiles, ViewState]:
    """What a scene TOML, or a volume box, shows at first; `InputError` for anything else."""
    if address(path) or path.suffix.lower() == ".zarr" or (path / "zarr.json").exists():
        return _opened_box(path)
    if path.suffix.lower() != ".toml":
        if not path.is_dir():
            existing_file(path)
        raise InputError(
            f"{printable(path)} cannot be viewed: give a scene (.toml), a volume box (.zarr), a capture or a folder "
            "that measure wrote, or an EXR with weights or spectra"
        )
    files = SceneFiles(existing_file(path).parent, path.name)
    state = ViewState(read_toml(path))
    files.scene(state)
    return files, state


def _opened_box(path: Path) -> tuple[SceneFiles, ViewState]:
    """A box under one lamp, from the front and a little from above."""
    box = load_box(path)
    camera = box_camera(box, PICTURE_SIDE)
    tables: dict[str, Any] = {
        "camera": {
            "size": [camera.width, camera.height], "focal": list(camera.focal), "principal": list(camera.principal),
            "world_to_camera": camera.world_to_camera.ravel().tolist(),
        },
        "lamp": [BOX_LAMP],
        "box": [{"file": str(address(path) or path.name)}],
    }  # fmt: skip
    files = SceneFiles(Path() if address(path) else path.parent, path.name)
    return files, ViewState(tables)
