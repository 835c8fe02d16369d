"""Notebook: a scene or box as a picture whose lamp is moved, in a cell of a notebook."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

from hagoromo.files.whole import scratch_folder
from hagoromo.image.scene.scene import Scene
from hagoromo.progress import Progress, silent
from hagoromo.volume.box import VolumeBox
from hagoromo_page.publication.publish_scene import publish_scene

LAMPS = 16  # that a scene is rendered under
PIXELS_HIGH = 560  # of the cell's output


@dataclass(frozen=True)
class Shown:
    """page: HTML that loads nothing, under a strict content security policy; a notebook shows it in a frame."""

    page: str
    height: int = PIXELS_HIGH

    def __repr__(self) -> str:
        """Its size."""
        return f"Shown(page of {len(self.page) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        """The page in a frame of its own, which may run its script and nothing else."""
        return (
            f'<iframe sandbox="allow-scripts" style="width:100%;height:{self.height}px;border:0" '
            f'srcdoc="{escape(self.page)}"></iframe>'
        )


def show(scene: Scene | VolumeBox | str | Path, lamps: int = LAMPS, progress: Progress = silent) -> Shown:
    """A scene or volume box in a notebook, as the page of `publish_scene`: its lamp, spectra and camera are changed in
    the cell, without a server; `lamps`: under how many it is rendered now.

    For the picture alone, `hg.render(scene)` at the end of a cell shows it.
    """
    with scratch_folder() as folder:
        path = folder / "scene.html"
        publish_scene(scene, path, lamps=lamps, progress=progress)
        return Shown(path.read_text(encoding="utf-8"))
