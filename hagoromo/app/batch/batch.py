"""Batch: the steps of a recipe, run in the order of what they need, here or on Dask's workers.

A step that fails is reported with what it said, and so are those that need its result; all others go on. A step whose
key and result are as they were is not run. Nothing but results and the ledger passes between steps, so that a worker
that dies, or a run that is killed, loses what was under way and no more.

Ledger: which command made each result of a batch, from what, so that a rerun does only what changed.

A file per step in `.batch/` beside the results, written when the step begins and when it is done: a result that a run
began belongs to the batch, even if the run was killed, and is made again; any other file is somebody's own.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hagoromo.app.batch.batch_file import read_batch
from hagoromo.app.batch.plan import Step
from hagoromo.app.batch.table import Outcome
from hagoromo.app.verb import Written
from hagoromo.cluster.cluster import Workers, here_or_on
from hagoromo.errors import InputError
from hagoromo.files.content import content, digest
from hagoromo.files.leftovers import tidy
from hagoromo.files.names import printable
from hagoromo.files.record import read_json, save_json
from hagoromo.files.stores import address, forget_fetched, keep_fetched
from hagoromo.progress import Progress, silent
from hagoromo.version import __version__

SIGNALS = 128  # an exit status above is that of a signal that ended the command
FOLDER = ".batch"
CONTENTS = "contents.json"  # digests of inputs that were read, with size and time of change
LEFT = (".lock", ".writing")  # ends of hidden names beside a file that was being written


def batch(
    recipe: str | Path,
    out: str | Path,
    *,
    scheduler: str | int | None = None,
    dry_run: bool = False,
    force: bool = False,
    progress: Progress = silent,
) -> tuple[Outcome, ...]:
    """Run the steps of the recipe in a TOML file, with results in the folder `out`; what became of each.

    scheduler: see `render`; by default steps run here, one after the other. dry_run: run nothing; steps that would run
    are "not run". force: replace files that the batch did not make. A step is run again when the package's version, its
    command, the content of a file that it reads, or a step that it needs changed. Raises `InputError` for a recipe that
    is none; a step that fails raises nothing.
    """
    home = Path(out).absolute()
    steps = read_batch(recipe, home)
    ledger = Ledger(str(home))
    try:
        with here_or_on(scheduler) as workers:
            return _run(steps, ledger, workers, dry_run, force, progress)
    finally:
        forget_fetched()  # by steps that ran in this process


def _run(
    steps: Sequence[Step], ledger: Ledger, workers: Workers, dry_run: bool, force: bool, progress: Progress
) -> tuple[Outcome, ...]:
    progress(0.0, "inputs")
    if not dry_run:
        ledger.tidy()
    keys = keys_of(steps, _digests(steps, ledger, workers, dry_run))
    fresh = {number for number, step in enumerate(steps) if ledger.is_done(step, keys[number])}
    for number, step in enumerate(steps):
        if step.needs and not fresh.issuperset(step.needs):
            fresh.discard(number)
    if not (force or dry_run):
        _check_own(steps, ledger, fresh)
    run = _Run(steps, keys, fresh)
    if not dry_run:
        for done, (number, outcome) in enumerate(workers.results(run_step, run.ready(ledger), keep_errors=True), 1):
            run.finish(number, outcome)
            progress(done / max(len(steps) - len(fresh), 1), "steps")
    return tuple(run.outcomes())


def _digests(steps: Sequence[Step], ledger: Ledger, workers: Workers, dry_run: bool) -> dict[str, str]:
    """Digest of every input of the steps; one is read only where size or time of change are not as they were."""
    known = ledger.digests()
    stamps = {str(path): stamp(path) for path in {read.path for step in steps for read in step.inputs}}
    stale = [path for path, now in stamps.items() if known.get(path, [None, None])[1] != now]
    digests: dict[str, list[Any]] = {
        path: [known[path][0], now] for path, now in stamps.items() if known.get(path, [None, None])[1] == now
    }
    for number, found in workers.results(content, ((path,) for path in stale)):
        digests[stale[number]] = [found, stamps[stale[number]]]
    if stale and not dry_run:
        ledger.keep_digests(digests)
    return {path: found for path, (found, _) in digests.items()}


def _check_own(steps: Sequence[Step], ledger: Ledger, fresh: set[int]) -> None:
    for number, step in enumerate(steps):
        there = () if number in fresh else step.written.there()
        if there and not ledger.entry(step.out):
            raise InputError(f"{there[0]} exists and no batch made it: choose another name or add force (--force)")


class _Run:
    """Which steps are done, which can begin, and which never will."""

    def __init__(self, steps: Sequence[Step], keys: Sequence[str], fresh: set[int]) -> None:
        self.steps, self.keys = steps, keys
        self.known: dict[int, Outcome] = {n: Outcome(steps[n].name, steps[n].out, "unchanged") for n in fresh}
        self.lacking = [len(set(step.needs) - fresh) for step in steps]
        self.followers: dict[int, list[int]] = {}
        for number, step in enumerate(steps):
            for need in set(step.needs) - fresh:
                self.followers.setdefault(need, []).append(number)
        self.queue = deque(n for n in range(len(steps)) if n not in fresh and not self.lacking[n])
        self.sent: list[int] = []

    def ready(self, ledger: Ledger) -> Iterator[tuple[Any, ...] | None]:
        """Arguments of `run_step` for steps that can begin; None where the next must wait for one that is running."""
        while len(self.known) < len(self.steps):
            if self.queue:
                number = self.queue.popleft()
                self.sent.append(number)
                yield ledger, self.steps[number], self.keys[number]
            else:
                yield None

    def finish(self, sent: int, outcome: Outcome | InputError) -> None:
        """Take in the outcome of the step that was sent as that number, or why its worker has none."""
        number = self.sent[sent]
        step = self.steps[number]
        if isinstance(outcome, InputError):
            outcome = Outcome(step.name, step.out, "failed", str(outcome))
        self.known[number] = outcome
        for follower in self.followers.get(number, ()):
            self.lacking[follower] -= 1
            if outcome.state != "done":
                self._abandon(follower, step.name)
            elif not self.lacking[follower] and follower not in self.known:
                self.queue.append(follower)

    def _abandon(self, number: int, failed: str) -> None:
        pending = [number]
        while pending:
            one = pending.pop()
            if one not in self.known:
                step = self.steps[one]
                self.known[one] = Outcome(step.name, step.out, "not run", f"it needs the result of {failed}")
                pending += self.followers.get(one, [])

    def outcomes(self) -> Iterator[Outcome]:
        """Of all steps, in their order."""
        for number, step in enumerate(self.steps):
            yield self.known.get(number) or Outcome(step.name, step.out, "not run")


def run_step(ledger: Ledger, step: Step, key: str) -> Outcome:
    """Run the command of a step, in this process; on a worker, too."""
    from hagoromo.app.cli import carry_out

    keep_fetched()  # steps that follow may read the same boxes
    begun, errors = time.monotonic(), io.StringIO()
    if ledger.is_done(step, key):  # by a worker that died before it could say so
        return Outcome(step.name, step.out, "done")
    ledger.begin(step, key)
    step.out.parent.mkdir(parents=True, exist_ok=True)
    try:
        with (
            contextlib.chdir(step.folder),  # names that are no input must not name what lies where this runs
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(errors),
        ):
            status = carry_out(step.call.to(step.out))
    except Exception as error:
        status = 1
        errors.write(f"hagoromo: {type(error).__name__}: {printable(error)[:300]}\n")
    if status > SIGNALS:
        raise KeyboardInterrupt
    lines = errors.getvalue().strip().splitlines()
    if status == 0:
        ledger.done(step, key)
        return Outcome(step.name, step.out, "done", seconds=time.monotonic() - begun)
    said = lines[-1].removeprefix("hagoromo: ") if lines else f"it ended with status {status}"
    return Outcome(step.name, step.out, "failed", said, time.monotonic() - begun)


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
    return digest(sizes)


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
        keys.append(digest(record))
    return keys


def stamp(path: Path) -> list[Any]:
    """Size and time of change of a file, or of the files of a folder together: another stamp, another content.

    Of what is in a store: what the store says of its objects.
    """
    if address(path):
        return [content(path)]
    stats = [(file.relative_to(path).as_posix(), file.stat()) for file in _files(path)]
    return [digest([(name, facts.st_size, facts.st_mtime_ns) for name, facts in stats])]
