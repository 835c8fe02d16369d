"""Figure scene: a figure of the paper as a scene file with its boxes and its ground, for the commands that take one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.camera.camera import Camera
from hagoromo.files.record import read_json, read_toml
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import whole_folder, write_text
from hagoromo.image.scene.scene import Scene
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo.volume.box_header import Extinction
from hagoromo_matter.demo.figures import MM, PAPER_FIGURES, Cast
from hagoromo_matter.demo.measured import reflectances_of
from hagoromo_matter.demo.samples import FOCAL_MM, PRESET
from hagoromo_matter.demo.size import SIZES


def cast_of(demo: Path, resolution: float | None = None, extinction: Extinction = "isotropic") -> Cast:
    """The cast of the materials that the demo in a folder measured. resolution: of boxes; None: the demo's."""
    size = SIZES[read_json(demo / "results.json")["size"]["name"]]
    found = reflectances_of(read_materials(demo / "measure" / "materials.json"), size)
    return Cast(found, resolution or size.resolution, size.seed, size.without, extinction)


def camera_of(longer_side: int) -> Camera:
    """The camera of the figures with `longer_side` px along its picture, without a sensor."""
    whole = Camera.preset(PRESET, FOCAL_MM)
    step = whole.width / longer_side
    high = max(round(whole.height / step), 1)
    return whole.resampled(longer_side, high, (step, whole.height / high))


def write_figure_scene(
    cast: Cast, name: str, camera: Camera, folder: Path, samples: int = 4, seconds: float = 0.0,
    frames_per_second: float = 12.0, progress: Progress = silent,
) -> Path:  # fmt: skip
    """The figure `name` as `folder`/scene.toml; gives that path. samples: rays a pixel.

    seconds: of a film in which each person turns once; 0: a still.
    """
    scene = cast.scene(name, camera, progress)
    with whole_folder(folder) as home:
        boxes, keys = [], []
        for who, part in cast.parts(name):
            x, y, turn = PAPER_FIGURES[name].figures[who]
            title = f"{who}_{part}"
            cast.box(who, part).save(home / f"{title}.zarr")
            place = {"position": [MM * x, MM * y, 0.0], "rotation_deg": [0.0, 0.0, turn]}
            boxes.append({"file": f"{title}.zarr", "name": title, **place})
            keys += [
                {"box": title, "time": time, "rotation_deg": [0.0, 0.0, turn + 360.0 * time / seconds]}
                for time in (0.0, seconds)
                if seconds
            ]
        _write_ground(scene, home / "ground.ply")
        tables = _tables(scene, boxes) | {"render": {"samples": samples}}
        if seconds:
            tables["motion"] = {
                "seconds": seconds, "frames_per_second": frames_per_second, "between": "linear", "box": keys,
            }  # fmt: skip
        write_text(home / "scene.toml", toml_text(tables))
    return folder / "scene.toml"


def resized_scene(scene: Path, pixels: int) -> Path:
    """The same scene with `pixels` along the longer side of its picture, in a file beside it: its path."""
    tables = read_toml(scene)
    camera = tables["camera"]
    size = [max(round(n * pixels / max(camera["size"])), 1) for n in camera["size"]]
    scale = [new / old for new, old in zip(size, camera["size"], strict=True)]
    for key in ("focal", "principal"):
        camera[key] = [k * x for k, x in zip(scale, camera[key], strict=True)]
    path = scene.with_name(f"{scene.stem.partition('.')[0]}.{pixels}.toml")
    write_text(path, toml_text(tables | {"camera": camera | {"size": size}}))
    return path


def _tables(scene: Scene, boxes: list[dict[str, Any]]) -> dict[str, Any]:
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
    }  # fmt: skip


def _write_ground(scene: Scene, path: Path) -> None:
    """The background as a mesh."""
    import trimesh

    (ground,) = scene.surfaces
    trimesh.Trimesh(ground.vertices, ground.faces, process=False).export(path)
