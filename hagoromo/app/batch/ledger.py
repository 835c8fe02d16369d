"""Ledger: which command made each result of a batch, from what, so that a rerun does only what changed.

A file per step in `.batch/` beside the results, written when the step begins and when it is done: a result that a run
began belongs to the batch, even if the run was killed, and is made again; any other file is somebody's own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hagoromo.app.batch.plan import Step
from hagoromo.app.written import Written
from hagoromo.errors import InputError
from hagoromo.files.content import content
from hagoromo.files.leftovers import tidy
from hagoromo.files.record import read_json, save_json
from hagoromo.files.stores import address
from hagoromo.version import __version__

FOLDER = ".batch"
CONTENTS = "contents.json"  # digests of inputs that were read, with size and time of change
LEFT = (".lock", ".writing")  # ends of hidden names beside a file that was being written


@dataclass(frozen=True)
class Ledger:
    """The ledger of the batch whose results are in the folder `home`."""

    home: str

    def entry(self, out: Path) -> dict[str, Any]:
        """What is known of a result: its key, and `content` once it is whole; empty for a result of nobody's."""
        try:
            record = read_json(self._file(out))
        except InputError:
            return {}
        return record if isinstance(record, dict) else {}

    def is_done(self, step: Step, key: str) -> bool:
        """Whether the result is there, made by the command of that key, and as it was then (names and sizes)."""
        entry = self.entry(step.out)
        return entry.get("key") == key and entry.get("content") == state(step.written) != "absent"

    def begin(self, step: Step, key: str) -> None:
        """Note that the result of a step is being made."""
        self._write(step.out, {"key": key})

    def done(self, step: Step, key: str) -> None:
        """Note that the result of a step is whole."""
        self._write(step.out, {"key": key, "content": state(step.written)})

    def _write(self, out: Path, entry: dict[str, str]) -> None:
        file = self._file(out)
        file.parent.mkdir(parents=True, exist_ok=True)
        save_json(file, entry, force=True)

    def _file(self, out: Path) -> Path:
        name = hashlib.sha256(out.relative_to(self.home).as_posix().encode(errors="surrogateescape")).hexdigest()
        return Path(self.home) / FOLDER / name[:2] / f"{name}.json"

    def digests(self) -> dict[str, list[Any]]:
        """Input → its digest, and size and time of change of its files when it was read."""
        try:
            record = read_json(Path(self.home) / FOLDER / CONTENTS)
        except InputError:
            return {}
        return record if isinstance(record, dict) else {}

    def tidy(self) -> None:
        """Deal with what a killed run left beside its files, which this run may not write again."""
        for left in list((Path(self.home) / FOLDER).rglob(".*.json.*")):
            if left.suffix in LEFT:
                tidy(left.with_name(left.stem.removeprefix(".")))

    def keep_digests(self, digests: dict[str, list[Any]]) -> None:
        """Keep them for the next run."""
        (Path(self.home) / FOLDER).mkdir(parents=True, exist_ok=True)
        save_json(Path(self.home) / FOLDER / CONTENTS, digests, force=True)


def state(written: Written) -> str:
    """Digest of names and sizes of all that a step wrote; "absent" where its result lacks."""
    if not written.files[0].exists():
        return "absent"
    sizes = [(file.name, file.stat().st_size) for place in written.there() for file in _files(place)]
    return hashlib.sha256(json.dumps(sizes).encode()).hexdigest()


def _files(place: Path) -> list[Path]:
    return [file for file in (sorted(place.rglob("*")) if place.is_dir() else [place]) if file.is_file()]


def keys_of(steps: Sequence[Step], digests: dict[str, str]) -> list[str]:
    """The key of every step: of version, command, settings, content of what it reads, keys of the steps it needs.

    digests: of every input, by its path.
    """
    keys: list[str] = []
    for step in steps:
        reads = sorted((read.label, digests[str(read.path)]) for read in step.inputs)
        record = [__version__, step.says, step.out.suffix, reads, [keys[number] for number in step.needs]]
        keys.append(hashlib.sha256(json.dumps(record).encode()).hexdigest())
    return keys


def stamp(path: Path) -> list[Any]:
    """Size and time of change of a file, or of the files of a folder together: another stamp, another content.

    Of what is in a store: what the store says of its objects.
    """
    if address(path):
        return [content(path)]
    stats = [(file.relative_to(path).as_posix(), file.stat()) for file in _files(path)]
    text = json.dumps([(name, facts.st_size, facts.st_mtime_ns) for name, facts in stats])
    return [hashlib.sha256(text.encode()).hexdigest()]
