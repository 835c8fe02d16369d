"""Read once: boxes, recipes and meshes that a scene names are read the first time, and kept for its next tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from hagoromo.image.scene.scene_file import Readers, readers
from hagoromo.image.scene.surface import Surface
from hagoromo.reflectance.reflectance import Reflectance

Read = TypeVar("Read")


def read_once() -> Readers:
    """Readers of the files of a scene, which read each file once."""
    anew = readers()
    return Readers(_once(anew.box), _once(anew.recipe), _meshes_once(anew.mesh))


def _once(read: Callable[[Path], Read]) -> Callable[[Path], Read]:
    kept: dict[Path, Read] = {}

    def once(path: Path) -> Read:
        if path not in kept:
            kept[path] = read(path)
        return kept[path]

    return once


def _meshes_once(read: Callable[..., Surface]) -> Callable[..., Surface]:
    kept: dict[tuple[Path, bool, tuple[float, float] | None], Surface] = {}

    def once(
        path: Path,
        reflectance: Reflectance,
        vertex_colours: bool = False,
        vertex_gamma: tuple[float, float] | None = None,
        **record: Any,
    ) -> Surface:
        key = path, vertex_colours, vertex_gamma
        if key not in kept:
            kept[key] = read(path, reflectance, *key[1:])
        return replace(kept[key], reflectance=reflectance, **record)

    return once
