"""Drawn: a figure of the paper as the bytes of its EXR and PNG, from the cache where it was drawn before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hagoromo.camera.camera import Camera
from hagoromo.files.cache import cache
from hagoromo.files.whole import scratch_folder, write_bytes
from hagoromo.image.render import render
from hagoromo.image.scene.settings import Settings
from hagoromo.progress import Progress, part_of, silent
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.reflectance_record import reflectance_from_record
from hagoromo_matter.demo.figures import Cast
from hagoromo_matter.demo.samples import FOCAL_MM, PRESET
from hagoromo_matter.demo.size import Size

SUFFIXES = (".exr", ".png")
BOXES = 0.5  # of the work on a figure, when its boxes are there
Files = dict[str, bytes]  # suffix → the bytes of a file

_casts: dict[tuple[Any, ...], Cast] = {}  # that this process draws figures of; one at a time


def drawn(name: str, materials: Mapping[str, Any], size: Size, progress: Progress = silent) -> Files:
    """The files of the figure `name`. materials: records of the measured reflectances, by name."""
    return cache().kept(
        ["figure", name, materials, size.of_figures()],
        lambda folder: {suffix: (folder / f"figure{suffix}").read_bytes() for suffix in SUFFIXES},
        lambda: _draw(name, materials, size, progress),
        _write,
    )


def is_drawn(name: str, materials: Mapping[str, Any], size: Size) -> bool:
    """Whether the cache has the figure `name`."""
    return cache().has(["figure", name, materials, size.of_figures()])


def draw_all(names: Sequence[str], materials: Mapping[str, Any], size: Size) -> None:
    """Put figures and their boxes into the cache."""
    for name in names:
        drawn(name, materials, size)


def _draw(name: str, materials: Mapping[str, Any], size: Size, progress: Progress) -> Files:
    camera = Camera.preset(PRESET, FOCAL_MM, size.figure_binning)
    scene = _cast(materials, size).scene(name, camera, part_of(progress, 0.0, BOXES, "boxes"))
    settings = Settings(samples=size.figure_samples, seed=size.seed)
    image = render(scene, settings, part_of(progress, BOXES, 1.0 - BOXES, "rays"))
    with scratch_folder() as home:
        image.save(home / "figure.exr", camera.response)
        return {suffix: (home / f"figure{suffix}").read_bytes() for suffix in SUFFIXES}


def _cast(materials: Mapping[str, Any], size: Size) -> Cast:
    """The cast of these materials, whose parts are built once in this process."""
    key = (repr(materials), repr(size.of_figures()))
    if key not in _casts:
        measured: dict[str, Reflectance] = {
            part: reflectance_from_record(record, f"material {part}") for part, record in materials.items()
        }
        _casts.clear()
        _casts[key] = Cast(measured, size.resolution, size.seed, size.without)
    return _casts[key]


def _write(files: Files, folder: Path) -> None:
    for suffix, data in files.items():
        write_bytes(folder / f"figure{suffix}", data)
