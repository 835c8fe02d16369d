"""Publish a scene: volume boxes before one camera → one page on which a lamp is moved around them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.whole import whole_file
from hagoromo.image.box_camera import box_camera
from hagoromo.image.scene.given_scene import scene_and_settings
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.progress import Progress, part_of, silent
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box
from hagoromo_page.publication.document import document
from hagoromo_page.publication.publish import LIMIT_BYTES
from hagoromo_page.publication.stack_lamps import stack_under
from hagoromo_page.publication.stack_page import stack_page
from hagoromo_page.publication.weight_stack import framed

LAMPS = 64  # over the hemisphere: 18° apart
LONGEST_SIDE = 512  # px of the picture
SAMPLES = 4  # rays a pixel of a box alone


@dataclass(frozen=True)
class PublishedScene:
    """path: of the page. size: of the file [bytes]. width, height: of the picture [px]. lamps: that are stored.

    stored_error, error_between: root mean square error of display values, of 255, under the stored lamps, and under
    each of them as predicted from the others.
    """

    path: Path
    size: int
    width: int
    height: int
    lamps: int
    stored_error: float
    error_between: float

    def __str__(self) -> str:
        """One line."""
        return (
            f"{self.width} × {self.height} px under {self.lamps} lamps, {self.size / 1e6:.2f} MB; "
            f"error {self.stored_error:.1f} of 255 under these lamps, {self.error_between:.1f} between them (rms)"
        )


def publish_scene(
    scene: Scene | VolumeBox | str | Path,
    out: str | Path,
    *,
    lamps: int = LAMPS,
    error: float | None = None,
    title: str = "",
    settings: Settings | None = None,
    limit: int = LIMIT_BYTES,
    force: bool = False,
    progress: Progress = silent,
) -> PublishedScene:
    """A page on which a scene, seen by its camera, is lit by lamps that are moved, in any browser from 2023 on.

    The scene is rendered under each of `lamps` far lamps, evenly over the hemisphere in front of the camera, as
    geometric weights: spectra of lamps and cameras are chosen on the page, exactly. Between the stored lamps the
    weights are interpolated; the errors of both are on the page and in the result. Highlights and edges of shadows
    narrower than the distance of the lamps fade between them: with `error` [of 255] lamps are added where they do,
    until the error between them is below it, or there are 512. More lamps take more bytes: see `limit`.

    scene: a `Scene`, the path of a scene TOML, or a volume box or its path, which is seen from the front. Its own lamps
    give their spectra only. out: NAME.html, of at most `limit` bytes; the picture is reduced where it must be.
    title: of the page; without one the name of the box or of the file.

    `InputError` for another name, a number of lamps or an error that cannot be, or a page that cannot fit.
    """
    target = Path(out)
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{target}: the page of a scene is one file: give a name such as page.html")
    file = Path(scene).stem if isinstance(scene, (str, Path)) else ""
    if not isinstance(scene, (Scene, VolumeBox)) and Path(scene).suffix.lower() != ".toml":
        scene = load_box(scene)
    if isinstance(scene, VolumeBox):
        settings = settings or Settings(samples=SAMPLES)
        scene = Scene(box_camera(scene, LONGEST_SIDE), (Lamp(to_lamp=(0.0, -1.0, 1.0)),), (scene,))
        scene = scene.with_camera(framed(scene, LONGEST_SIDE))
    shown, stated = scene_and_settings(scene, settings)
    shown = replace(shown, camera=shown.camera.limited(LONGEST_SIDE))
    stack, colours = stack_under(shown, lamps, error, stated, part_of(progress, 0.0, 0.9))
    named = title or next((box.name for box in shown.boxes if box.name), file or "Volume box")
    page, packed = stack_page(stack, colours, named, limit)
    text = document(page.viewer)
    with whole_file(target, force) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
    progress(1.0, "")
    return PublishedScene(
        target, len(text.encode()), *page.size, len(stack.directions), packed.stored_error, packed.error_between
    )
