"""Turning: figure 8 as a film: the angel and the nun turn once, each where it stands, before camera, lamps and ground.

Enters: the folder of a demo, whose measured reflectances it takes. Leaves: a scene file with its motion, volume boxes
and mesh, the film of it, and what the documentation shows (`plates.py` writes the page).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hagoromo.app.progress_bar import progress_bar
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.files.record import read_json
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_file, whole_folder, write_text
from hagoromo.image.film.film import film
from hagoromo.image.scene import Scene
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo.progress import Progress, part_of
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo_matter.demo.figures import MM, PAPER_FIGURES, Cast
from hagoromo_matter.demo.measured import reflectances_of
from hagoromo_matter.demo.plates import FILM
from hagoromo_matter.demo.samples import FOCAL_MM, PRESET
from hagoromo_matter.demo.size import SIZES
from hagoromo_matter.figure.figure import PART_MATERIALS

FIGURE = "figure_8_whole"
SECONDS, RATE = 8.0, 12.0  # of the film, and frames a second
LONGER_SIDE = 400  # px
SAMPLES = 2  # rays a pixel
POSTER_QUALITY = 88
BUILDING = 0.3  # of the time, when the boxes are there


def write_turning(demo: Path, out: Path, docs: Path, progress: Progress) -> None:
    """The scene and its film in the folder `out`, and `docs`/figures/figure_8_turning.webm with its first picture."""
    import cv2

    scene = out / "scene" / "scene.toml"
    if not scene.exists():
        _write_scene(demo, scene.parent, part_of(progress, 0.0, BUILDING, "boxes"))
    made = film(scene, out / "turning.webm", progress=part_of(progress, BUILDING, 1.0 - BUILDING), force=True)
    assert made.film is not None
    first = read_png(made.frames / "frame_00000.png")
    written, poster = cv2.imencode(".jpg", first[..., 2::-1], [cv2.IMWRITE_JPEG_QUALITY, POSTER_QUALITY])
    if not written:
        raise InputError(f"the first frame of {made.frames} cannot be written as JPEG: render it again")
    for name, data in (("jpg", poster.tobytes()), ("webm", made.film.read_bytes())):
        with whole_file(docs / "figures" / f"{FILM}.{name}", force=True) as partial:
            partial.write_bytes(data)


def _write_scene(demo: Path, folder: Path, progress: Progress) -> None:
    """The scene of the figure with its boxes and its mesh."""
    size = SIZES[read_json(demo / "results.json")["size"]["name"]]
    found = reflectances_of(read_materials(demo / "measure" / "materials.json"), size)
    cast = Cast(found, size.resolution, size.seed, size.without)
    scene = cast.scene(FIGURE, Camera.preset(PRESET, FOCAL_MM, size.figure_binning).limited(LONGER_SIDE), progress)
    with whole_folder(folder) as home:
        boxes, keys = [], []
        for who, (x, y, turn) in PAPER_FIGURES[FIGURE].figures.items():
            for part in PART_MATERIALS[who]:
                name = f"{who}_{part}"
                cast.box(who, part).save(home / f"{name}.zarr")
                place = {"position": [MM * x, MM * y, 0.0], "rotation_deg": [0.0, 0.0, turn]}
                boxes.append({"file": f"{name}.zarr", "name": name, **place})
                keys += [
                    {"box": name, "time": time, "rotation_deg": [0.0, 0.0, turn + 360.0 * time / SECONDS]}
                    for time in (0.0, SECONDS)
                ]
        _write_ground(scene, home / "ground.ply")
        write_text(home / "scene.toml", toml_text(_tables(scene, boxes, keys)))


def _tables(scene: Scene, boxes: list[dict[str, Any]], keys: list[dict[str, Any]]) -> dict[str, Any]:
    camera = scene.camera
    return {
        "camera": {
            "size": [camera.width, camera.height], "focal": list(camera.focal), "principal": list(camera.principal),
            "world_to_camera": camera.world_to_camera.ravel().tolist(),
        },
        "lamp": [record_from_lamp(lamp) for lamp in scene.lamps],
        "box": boxes,
        "surface": [
            {"mesh": "ground.ply", "name": ground.name, "reflectance": ground.reflectance.record()}
            for ground in scene.surfaces
        ],
        "render": {"samples": SAMPLES},
        "motion": {"seconds": SECONDS, "frames_per_second": RATE, "between": "linear", "box": keys},
    }  # fmt: skip


def _write_ground(scene: Scene, path: Path) -> None:
    """The background as a mesh."""
    import trimesh

    (ground,) = scene.surfaces
    trimesh.Trimesh(ground.vertices, ground.faces, process=False).export(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder of a demo")
    parser.add_argument("out", type=Path, help="folder of the scene and its film")
    parser.add_argument("docs", type=Path, help="folder of the documentation")
    given = parser.parse_args()
    with progress_bar("turning") as bar:
        write_turning(given.demo, given.out, given.docs, bar)
