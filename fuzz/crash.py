"""Crash points: every verb that writes is killed at its k-th file operation, for every k, and run again.

After the kill a target is the old one or the new one, whole; after the same command has run again it is the new one,
and nothing is left beside it. `--full` lets the disk be full instead, after so many bytes of every file.

An operation is what the interpreter reports (opening to write, renaming, removing, making folders) or `os.fsync`, on a
path in the folder of the case; the kill comes before it. Writes within compiled libraries are not seen, except by
`--strace`, which kills at the k-th call of the system by any thread.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

from fuzz.crash_cases import CASES, Case

CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "hagoromo.rename")
CALLS = "mkdir,rename,renameat2,unlink,unlinkat,rmdir,link,fsync,ftruncate,write,pwrite64"
OLD = b"what was there before"
ALL_RIGHT, NO_STATUS = 0, 70  # the second of a command that ended in a traceback
LIMITS = (0, 1, 100, 1000, 3000, 10_000, 30_000)  # bytes of a file after which the disk is full
IN_MEMORY = "/dev/shm" if os.path.isdir("/dev/shm") else None  # there, nothing waits for a disk
SECONDS = 300  # after which a command counts as hanging


@dataclass(frozen=True)
class Run:
    """How a command ended: exit status (negative: the signal), its lines on standard error, operations seen."""

    status: int
    said: str
    operations: int


def watch(folder: Path, kill_at: int | None, count: Path | None) -> None:
    """Count the file operations of this process in `folder`, and kill it before number `kill_at` (from 1)."""
    done, here, sync = 0, str(folder), os.fsync

    def met() -> None:
        nonlocal done
        done += 1
        if done == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
        if count is not None:
            os.pwrite(file, str(done).encode(), 0)

    def heard(event: str, given: tuple[Any, ...]) -> None:
        if event == "open":
            changes = bool(given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)) if isinstance(given[2], int) else False
        else:
            changes = event in CHANGES
        if changes and (str(given[0]).startswith(here) or given[-1] not in (-1, None, given[0])):
            met()

    def synced(number: int) -> None:
        met()
        sync(number)

    file = os.open(count, os.O_RDWR | os.O_CREAT) if count is not None else -1
    os.fsync = synced
    sys.addaudithook(heard)


def command(arguments: list[str]) -> int:
    """Run a command in this process."""
    from hagoromo.app.cli import main

    return main(arguments)


def run(
    case: Case, folder: Path, force: bool, kill_at: int | None = None, limit: int | None = None, traced: bool = False
) -> Run:
    """Run the command of `case` in `folder`, in a process of its own; traced: operations are calls of the system."""
    count = folder.parent / "count"
    count.unlink(missing_ok=True)
    arguments = [*case.given(folder), *(["--force"] if force else [])]
    if traced:
        return _traced(arguments, folder.parent / "calls", kill_at)
    if not case.forked:
        options = [f"{folder}", f"{kill_at or 0}", f"{-1 if limit is None else limit}", f"{count}"]
        ended = subprocess.run(
            [sys.executable, "-m", "fuzz.crash", "--child", *options, *arguments], stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, timeout=SECONDS, check=False,
        )  # fmt: skip
        status, said = ended.returncode, ended.stderr
    else:
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            try:
                sys.stdout, sys.stderr = open(os.devnull, "w"), os.fdopen(writing, "w")
                os._exit(_in_child(folder, kill_at, limit, count, arguments))
            finally:
                os._exit(NO_STATUS)
        os.close(writing)
        with os.fdopen(reading, "rb") as file:
            said = file.read()
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    counted = int(count.read_text() or 0) if count.exists() else 0
    return Run(status, said.decode(errors="replace"), counted)


def _traced(arguments: list[str], calls: Path, kill_at: int | None) -> Run:
    """Run a command under strace; any of its threads is killed at its call number `kill_at`."""
    kill = [] if kill_at is None else ["-e", f"inject={CALLS}:signal=SIGKILL:when={kill_at}"]
    strace = ["strace", "-f", "-qq", "-o", str(calls), "-e", f"trace={CALLS}", *kill]
    ended = subprocess.run(
        [*strace, sys.executable, "-B", "-m", "hagoromo", *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=SECONDS, check=False,
    )  # fmt: skip
    threads = Counter(line.split()[0] for line in calls.read_text(errors="replace").splitlines())
    return Run(ended.returncode, ended.stderr.decode(errors="replace"), max(threads.values(), default=0))


def _in_child(folder: Path, kill_at: int | None, limit: int | None, count: Path, arguments: list[str]) -> int:
    status = NO_STATUS
    try:
        watch(folder, kill_at, None if limit is not None else count)
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        status = command(arguments)
    except BaseException:
        import traceback

        traceback.print_exc()
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    sys.stdout.flush()
    sys.stderr.flush()
    return status


def digest(path: Path) -> str:
    """What is at `path`: a digest of its files, or empty where there is nothing."""
    if not path.exists():
        return ""
    found = blake2b(digest_size=8)
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        found.update(str(file.relative_to(path)).encode() + (file.read_bytes() if file.is_file() else b"/"))
    return found.hexdigest()


def states(case: Case, folder: Path) -> list[str]:
    """The digest of each target."""
    return [digest(folder / name) for name in case.targets]


def beside(case: Case, folder: Path, inputs: set[str]) -> list[str]:
    """What lies in the folder beside inputs and targets."""
    return sorted(set(os.listdir(folder)) - inputs - set(case.targets))


def put_old(case: Case, folder: Path) -> None:
    """Older targets, as Hagoromo may have written them."""
    for name in case.targets:
        if case.folder:
            (folder / name).mkdir()
            (folder / name / ".hagoromo").touch()
            (folder / name / "old").write_bytes(OLD)
        else:
            (folder / name).write_bytes(OLD)


def faults(case: Case, home: Path, most: int, full: bool, traced: bool) -> Iterator[str]:
    """Kill (or fill the disk of) a case at up to `most` points; yields "" for each clean one, else what was wrong."""
    for force in (False, True):
        fresh = home / "fresh"
        _renew(home, fresh)
        inputs = set(os.listdir(fresh))
        if force:
            put_old(case, fresh)
        first = run(case, fresh, force, traced=traced)
        assert first.status == ALL_RIGHT, f"{case.name}: {first.said}"
        new = states(case, fresh)
        points = list(LIMITS) if full else list(range(1, first.operations + 1))
        step = max(len(points) / most, 1.0)
        for point in sorted({points[min(int(k * step), len(points) - 1)] for k in range(min(most, len(points)))}):
            _renew(home, fresh)
            if force:
                put_old(case, fresh)
            old = states(case, fresh)
            if full:
                wrong = _filled(case, fresh, force, point, (old, new), inputs)
            else:
                ended = run(case, fresh, force, kill_at=point, traced=traced)
                wrong = _killed(case, fresh, force, ended, (old, new), inputs)
            yield f"{case.name}{' --force' if force else ''} at {point}: {wrong}" if wrong else ""


def _load(case: Case, home: Path) -> None:
    """Run a case in this process, so that its children need not load what it needs."""
    import cv2

    cv2.setNumThreads(1)  # a child has none of the threads
    shutil.copytree(home / "inputs", home / "loaded")
    with contextlib.redirect_stdout(None):
        assert command(case.given(home / "loaded")) == ALL_RIGHT


def _renew(home: Path, fresh: Path) -> None:
    shutil.rmtree(fresh, ignore_errors=True)
    shutil.copytree(home / "inputs", fresh)


def _killed(
    case: Case, folder: Path, force: bool, ended: Run, known: tuple[list[str], list[str]], inputs: set[str]
) -> str:
    """What is wrong after a command was killed, or after the same command has run again."""
    old, new = known
    if ended.status not in (-signal.SIGKILL, ALL_RIGHT):
        return f"status {ended.status}: {ended.said[-200:]}"
    found = states(case, folder)
    for name, state, before, after in zip(case.targets, found, old, new, strict=True):
        if state not in (before, after):
            return f"{name} is {'lost' if not state else 'neither old nor new'}"
    if len(found) > 1 and found[0] == new[0] and found != new:
        return f"{case.targets[0]} is new without {', '.join(case.targets[1:])}"
    again = run(case, folder, force)
    exists = not force and again.status == 2 and "exists" in again.said
    if again.status != ALL_RIGHT and not exists:
        return f"run again: status {again.status}: {again.said[-200:]}"
    return _unlike(case, folder, new, inputs)


def _filled(
    case: Case, folder: Path, force: bool, point: int, known: tuple[list[str], list[str]], inputs: set[str]
) -> str:
    """What is wrong after a disk that was full once a file had `point` bytes."""
    old, new = known
    ended = run(case, folder, force, limit=point)
    if ended.status == ALL_RIGHT:
        return _unlike(case, folder, new, inputs)
    lines = [line for line in ended.said.splitlines() if not line.startswith("hagoromo: warning:")]
    if ended.status != 2 or len(lines) != 1:
        return f"status {ended.status}: {ended.said[-300:]}"
    if states(case, folder) != old:
        return "the target has changed"
    left = beside(case, folder, inputs)
    if left and not case.resumes:
        return f"left behind: {', '.join(left)}"
    again = run(case, folder, force)
    if again.status != ALL_RIGHT:
        return f"run again: status {again.status}: {again.said[-200:]}"
    return _unlike(case, folder, new, inputs)


def _unlike(case: Case, folder: Path, new: list[str], inputs: set[str]) -> str:
    """What is wrong with a folder in which all targets should be new, and nothing else there."""
    if states(case, folder) != new:
        return "another result than that of an undisturbed run"
    left = beside(case, folder, inputs)
    return f"left behind: {', '.join(left)}" if left else ""


def main() -> int:
    """Run the cases; prints a table, and each fault that was not clean."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=10**6, help="points of each verb, spread evenly (default: all)")
    parser.add_argument("--full", action="store_true", help="a full disk in place of kills")
    parser.add_argument("--strace", action="store_true", help="kill at calls of the system, by strace")
    parser.add_argument("--verbs", nargs="*", default=[], help="names of cases (default: all)")
    asked = parser.parse_args()
    tried, unclean = Counter[str](), Counter[str]()
    for case in CASES:
        if asked.verbs and case.name not in asked.verbs:
            continue
        with tempfile.TemporaryDirectory(prefix="hagoromo-crash-", dir=IN_MEMORY) as scratch:
            home = Path(scratch).resolve()
            (home / "inputs").mkdir()
            case.make(home / "inputs")
            if case.forked:
                _load(case, home)
            for wrong in faults(case, home, asked.most, asked.full, asked.strace):
                tried[case.name] += 1
                unclean[case.name] += bool(wrong)
                if wrong:
                    print(wrong, flush=True)
        print(f"{case.name:28} tried {tried[case.name]:4}, unclean {unclean[case.name]:4}", flush=True)
    print(f"{'all':28} tried {tried.total():4}, unclean {unclean.total():4}")
    return int(unclean.total() > 0 or not tried.total())


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        where, when, bytes_, note = sys.argv[2:6]
        limit = None if int(bytes_) < 0 else int(bytes_)
        sys.exit(_in_child(Path(where), int(when) or None, limit, Path(note), sys.argv[6:]))
    sys.exit(main())
