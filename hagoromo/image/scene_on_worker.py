"""A scene on a worker: read once, and kept ready for rays or walks until another one is asked for.

The file, and what it names, must lie where all workers find the same: a worker whose files differ refuses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.files.content import content_with_named
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.scene.modes import Mode
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import load_for_picture, load_scene
from hagoromo.image.scene.settings import Settings

Ready = TypeVar("Ready")
TASKS_PER_WORKER = 8  # of a picture, or of one step of its walks, so that none waits long for the last


def task_size(work: int, workers: int, least: int, most: int) -> int:
    """Rays or pixels of one task, of so many in all."""
    return min(max(-(-work // (TASKS_PER_WORKER * max(workers, 1))), least), most)


@dataclass(frozen=True)
class SceneOrder:
    """A scene file as a worker is to render it. digest: of the file and what it names."""

    path: str
    digest: str
    settings: Settings
    mode: Mode = "march"

    @classmethod
    def of(cls, scene: str | Path, settings: Settings, mode: Mode) -> SceneOrder:
        """Of a file that lies here."""
        path = Path(scene).absolute()
        return cls(str(path), content_with_named(path, quick=True), settings, mode)

    def scene(self) -> Scene:
        """The scene that is rendered: by mode path, as it moves while its shutter is open."""
        if self.mode == "march":
            return load_for_picture(self.path, self.settings)[0]
        if self.mode == "path":
            from hagoromo.image.film.shutter import scene_with_shutter  # which renders, as workers do
            from hagoromo.image.render import motion_with_shutter

            motion = motion_with_shutter(self.path)
            if motion is not None:
                return scene_with_shutter(self.path, motion)[0]
        return load_scene(self.path)[0]  # light of higher orders comes from all of a box


class HeldScene:
    """A scene that a worker has read, and one thing at a time that was made of it. cache: what is on the device."""

    def __init__(self, order: SceneOrder) -> None:
        if content_with_named(order.path, quick=True) != order.digest:
            raise InputError(
                f"{order.path}, or a file that it names, is another one on a worker: put them where all find the same"
            )
        self.scene = order.scene()
        self.order, self.cache = order, SceneCache(cache())
        self._made: tuple[Any, Any] | None = None

    @cached_property
    def lit_by_points(self) -> tuple[Scene, dict[str, Any]]:
        """The scene under lamps only, as rays take it, and what metadata say of them."""
        return lit_by_points(self.scene, self.order.settings)

    def ready(self, key: Any, make: Callable[[], Ready]) -> Ready:
        """What `make` gives, unless the last thing had the same key; the last thing is let go before."""
        if self._made is None or self._made[0] != key:
            self._made = None
            self._made = key, make()
        return self._made[1]


_held: list[HeldScene] = []  # one at most


def held_scene(order: SceneOrder) -> HeldScene:
    """The scene of an order, read now unless this worker has it."""
    if not _held or _held[0].order != order:
        _held.clear()  # before another one takes memory
        _held.append(HeldScene(order))
    return _held[0]
