"""Turning: figure 8 as a film: the angel and the nun turn once, each where it stands, before camera, lamps and ground.

Enters: the folder of a demo, whose measured reflectances it takes. Leaves: a scene file with its motion, volume boxes
and mesh, the film of it, and what the documentation shows (`plates.py` writes the page).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hagoromo.app.progress_bar import progress_bar
from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.files.whole import whole_file
from hagoromo.image.film.film import film
from hagoromo.progress import Progress, part_of
from hagoromo_matter.demo.figure_scene import camera_of, cast_of, resized_scene, write_figure_scene
from hagoromo_matter.demo.plates import FILM

FIGURE = "figure_8_whole"
SECONDS, RATE = 8.0, 12.0  # of the film, and frames a second
LONGER_SIDE = 1620  # px, where no other is asked for
SAMPLES = 2  # rays a pixel
POSTER_QUALITY = 88
BUILDING = 0.3  # of the time, when the boxes are there


def write_turning(demo: Path, out: Path, docs: Path | None, progress: Progress, pixels: int = LONGER_SIDE) -> None:
    """The scene and its film in the folder `out`, and `docs`/figures/figure_8_turning.webm with its first picture.

    docs: None: the film alone. pixels: along its longer side.
    """
    import cv2

    scene = out / "scene" / "scene.toml"
    built = scene.exists()
    if not built:
        boxes = part_of(progress, 0.0, BUILDING, "boxes")
        write_figure_scene(cast_of(demo), FIGURE, camera_of(pixels), scene.parent, SAMPLES, SECONDS, RATE, boxes)
    drawing = progress if built else part_of(progress, BUILDING, 1.0 - BUILDING)
    made = film(resized_scene(scene, pixels), out / "turning.webm", progress=drawing, force=True)
    if docs is None:
        return
    assert made.film is not None
    first = read_png(made.frames / "frame_00000.png")
    written, poster = cv2.imencode(".jpg", first[..., 2::-1], [cv2.IMWRITE_JPEG_QUALITY, POSTER_QUALITY])
    if not written:
        raise InputError(f"the first frame of {made.frames} cannot be written as JPEG: render it again")
    for name, data in (("jpg", poster.tobytes()), ("webm", made.film.read_bytes())):
        with whole_file(docs / "figures" / f"{FILM}.{name}", force=True) as partial:
            partial.write_bytes(data)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder of a demo")
    parser.add_argument("out", type=Path, help="folder of the scene and its film")
    parser.add_argument("docs", type=Path, nargs="?", help="folder of the documentation; none: the film alone")
    parser.add_argument("--pixels", type=int, default=LONGER_SIDE, help="along the longer side, such as 400")
    given = parser.parse_args()
    with progress_bar("turning") as bar:
        write_turning(given.demo, given.out, given.docs, bar, given.pixels)
