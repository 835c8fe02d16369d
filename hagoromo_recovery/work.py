"""Work: what a recovery has found so far, in a file, so that it can be interrupted and end with the same bits.

It is written where the nodes that move are chosen anew, so that the steps between are done again. The file is whole at
any time: a new one takes the place of the old one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.formats.nerfstudio import record_from_camera
from hagoromo.errors import InputError
from hagoromo.files.array_tree import read_tree, write_tree
from hagoromo.files.whole import whole_file
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo_recovery.choices import FoundMatter
from hagoromo_recovery.descent.look import FoundLook
from hagoromo_recovery.evidence import Evidence
from hagoromo_recovery.hollows import FoundHollow
from hagoromo_recovery.matter_shape import MatterShape


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """Where levels can go on. level: its number, that after the last where all are done; step: of it. shape: what there
    is. before: the result of the level before. look: what was estimated beside it by then. random: state, as JSON, of
    the numbers that draw pixels. hollow: the one that was found by then.
    """

    level: int
    step: int
    shape: MatterShape
    before: MatterShape
    look: FoundLook
    random: str
    hollow: FoundHollow | None = None


@dataclass(frozen=True, eq=False)
class KeptWork:
    """All that was found. key: of the photographs and settings. checkpoints: of each object on the way, by name. known:
    what the photographs say of the first. matter: the law that predicts better, where both were tried.
    """

    key: str
    look: FoundLook | None = None
    matter: FoundMatter | None = None
    checkpoints: dict[str, Checkpoint] = field(default_factory=dict)
    known: Evidence | None = None


class Work:
    """A file of work, or none at all. `found` is what it holds."""

    def __init__(self, path: Path | None, photographs: Sequence[Photograph], settings: Mapping[str, Any]) -> None:
        self.path, key = path, _key(photographs, settings)
        self.found = KeptWork(key)
        if path is None or not path.exists():
            return
        self.found = read_tree(path, KeptWork)
        if self.found.key != key:
            raise InputError(
                f"{path} is work on other photographs or with other settings: give those, or remove it to start anew"
            )

    def keep(self, **changes: Any) -> None:
        """Write what has changed."""
        self.found = replace(self.found, **changes)
        if self.path is not None:
            with whole_file(self.path, force=True) as partial:
                write_tree(partial, self.found)

    def keeps(self, name: str) -> Callable[[Checkpoint], None]:
        """What writes a checkpoint of an object on the way."""

        def keep(checkpoint: Checkpoint) -> None:
            self.keep(checkpoints={**self.found.checkpoints, name: checkpoint})

        return keep

    def end(self) -> None:
        """Remove the file: the work is done."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _key(photographs: Sequence[Photograph], settings: Mapping[str, Any]) -> str:
    """A digest of photographs and settings: others have another one."""
    key = hashlib.sha256(json.dumps(dict(settings), sort_keys=True).encode())
    for p in photographs:
        for array in (p.values, p.variance, p.mask):
            key.update(np.ascontiguousarray(array).tobytes())
        key.update(json.dumps([record_from_camera(p.camera), *map(record_from_lamp, p.lamps)]).encode())
    return key.hexdigest()
