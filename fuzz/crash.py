"""Crash points: every verb that writes is killed at its k-th file operation, for every k, and run again.

After the kill a target is the old one or the new one, whole; after the same command has run again it is the new one,
and nothing is left beside it. `--full` lets the disk be full instead, after so many bytes of every file; `--disk` does
the work on a disk of its own that has so many pages free (Linux).

An operation is what the interpreter reports (opening to write, renaming, removing, making folders) or `os.fsync`, on a
path in the folder of the case; the kill comes before it. Writes within compiled libraries are not seen, except by
`--strace`, which kills at the k-th call of the system by any thread.
"""

from __future__ import annotations

import argparse
import contextlib
import io
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

from fuzz.crash_cases import CASES, CrashCase

CHANGES = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "hagoromo.rename")
CALLS = "mkdir,rename,renameat2,unlink,unlinkat,rmdir,link,fsync,ftruncate,write,pwrite64"
OLD = b"what was there before"
ALL_RIGHT, NO_STATUS = 0, 70  # the second of a command that ended in a traceback
LIMITS = (0, 1, 100, 1000, 3000, 10_000, 30_000)  # bytes of a file after which the disk is full
PAGES = (0, 1, 2, 3, 5, 9, 20)  # free on a disk that is really full
WIDE = 1 << 28  # bytes of such a disk before it is narrowed, and for the command again
APART = "HAGOROMO_CRASH_APART"  # set in a process that has mounts of its own
WAYS = {"full": LIMITS, "disk": PAGES}
IN_MEMORY = "/dev/shm" if os.path.isdir("/dev/shm") else None  # there, nothing waits for a disk
SECONDS = 300  # after which a command counts as hanging
Seen = dict[str, str]


@dataclass(frozen=True)
class CrashRun:
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
    os.fsync = synced  # pyrefly: ignore[bad-assignment]
    sys.addaudithook(heard)


def command(arguments: list[str]) -> int:
    """Run a command in this process."""
    from hagoromo.app.cli import main

    return main(arguments)


def run(
    case: CrashCase,
    folder: Path,
    force: bool,
    kill_at: int | None = None,
    limit: int | None = None,
    traced: bool = False,
) -> CrashRun:
    """Run the command of `case` in `folder`, in a process of its own; traced: operations are calls of the system."""
    count = folder.parent / "count"
    count.unlink(missing_ok=True)
    arguments = [*case.given(folder), *(["--force"] if force and case.forces else [])]
    if traced:
        return _traced(arguments, folder.parent / "calls", kill_at)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            signal.alarm(SECONDS)
            sys.stdout, sys.stderr = open(os.devnull, "w"), os.fdopen(writing, "w")
            os._exit(_in_child(folder, kill_at, limit, count, arguments))
        finally:
            os._exit(NO_STATUS)
    os.close(writing)
    with os.fdopen(reading, "rb") as file:
        said = file.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    counted = int(count.read_text() or 0) if count.exists() else 0
    return CrashRun(status, said.decode(errors="replace"), counted)


def _traced(arguments: list[str], calls: Path, kill_at: int | None) -> CrashRun:
    """Run a command under strace; any of its threads is killed at its call number `kill_at`."""
    kill = [] if kill_at is None else ["-e", f"inject={CALLS}:signal=SIGKILL:when={kill_at}"]
    strace = ["strace", "-f", "-qq", "-o", str(calls), "-e", f"trace={CALLS}", *kill]
    ended = subprocess.run(
        [*strace, sys.executable, "-B", "-m", "hagoromo", *arguments],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, timeout=SECONDS, check=False,
    )  # fmt: skip
    threads = Counter(line.split()[0] for line in calls.read_text(errors="replace").splitlines())
    return CrashRun(ended.returncode, ended.stderr.decode(errors="replace"), max(threads.values(), default=0))


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


def seen(folder: Path) -> Seen:
    """What is in a folder: path within it → digest of a file, or "/" for a folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        is_file = path.is_file() and not path.is_symlink()
        found[path.relative_to(folder).as_posix()] = blake2b(path.read_bytes()).hexdigest() if is_file else "/"
    return found


def states(case: CrashCase, found: Seen) -> list[Seen]:
    """What is at each target."""
    return [{k: v for k, v in found.items() if k == name or k.startswith(f"{name}/")} for name in case.targets]


def put_old(case: CrashCase, folder: Path) -> None:
    """Older targets, as Hagoromo may have written them."""
    for name in case.targets:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        if place.suffix in ("", ".zarr"):
            place.mkdir()
            (place / ".hagoromo").touch()
            (place / "old").write_bytes(OLD)
        else:
            place.write_bytes(OLD)


def faults(case: CrashCase, home: Path, asked: int, way: str, known: Counter[str]) -> Iterator[str]:
    """Kill (or fill the disk of) a case at up to `asked` points; yields "" for each clean one, else what was wrong.

    known: how many points there are is added to it.
    """
    for force in (False, True):
        fresh = home / "fresh"
        _renew(case, home, force)
        first = run(case, fresh, force, traced=way == "strace")
        assert first.status == ALL_RIGHT, f"{case.name}: {first.said}"
        new = seen(fresh)
        points = list(WAYS.get(way) or range(1, first.operations + 1))
        known[case.name] += len(points)
        most = max(asked // case.slow, 2)
        step = max(len(points) / most, 1.0)
        for point in sorted({points[min(int(k * step), len(points) - 1)] for k in range(min(most, len(points)))}):
            _renew(case, home, force)
            old = seen(fresh)
            if way in WAYS:
                wrong = _filled(case, fresh, force, point, way, old, new)
            else:
                ended = run(case, fresh, force, kill_at=point, traced=way == "strace")
                wrong = _killed(case, fresh, force, ended, old, new)
            yield f"{case.name}{' --force' if force else ''} at {point}: {wrong}" if wrong else ""


def _load(case: CrashCase, home: Path) -> None:
    """Run a case in this process, so that its children need not load what it needs, nor compile its kernels."""
    if case.prepare is not None:
        case.prepare()
    shutil.copytree(home / "inputs", home / "loaded")
    with contextlib.redirect_stdout(None), contextlib.redirect_stderr(io.StringIO()):
        assert command(case.given(home / "loaded")) == ALL_RIGHT


def _without_threads() -> None:
    """Let kernels and OpenCV run in the calling thread: a child has none of the others."""
    import cv2
    import drjit as dr

    cv2.setNumThreads(1)
    dr.set_thread_count(0)


def _renew(case: CrashCase, home: Path, force: bool) -> None:
    """The folder as it was before the command; force: with older targets."""
    fresh = home / "fresh"
    _away(fresh)
    if APART in os.environ:
        fresh.mkdir(exist_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={WIDE}", "tmpfs", str(fresh)], check=True)
    shutil.copytree(home / "inputs", fresh, dirs_exist_ok=True)
    if force:
        put_old(case, home / "fresh")


def _away(fresh: Path) -> None:
    """Remove the folder, and the disk of its own."""
    if os.path.ismount(fresh):
        subprocess.run(["umount", str(fresh)], check=True)
    shutil.rmtree(fresh, ignore_errors=True)


def _narrow(fresh: Path, pages: int | None) -> None:
    """Let the disk of its own have so many pages free; None: many."""
    here = os.statvfs(fresh)
    size = WIDE if pages is None else (here.f_blocks - here.f_bfree + pages) * here.f_frsize
    subprocess.run(["mount", "-o", f"remount,size={size}", str(fresh)], check=True)


def _killed(case: CrashCase, folder: Path, force: bool, ended: CrashRun, old: Seen, new: Seen) -> str:
    """What is wrong after a command was killed, or after the same command has run again."""
    if ended.status not in (-signal.SIGKILL, ALL_RIGHT):
        return f"status {ended.status}: {ended.said[-200:]}"
    found, before, after = (states(case, one) for one in (seen(folder), old, new))
    wrong = _neither(case, found, before, after)
    if wrong:
        return wrong
    if not case.apart and len(found) > 1 and found[0] == after[0] and found != after:
        return f"{case.targets[0]} is new without {', '.join(case.targets[1:])}"
    again = run(case, folder, force)
    exists = not force and again.status == 2 and "exists" in again.said
    if again.status != ALL_RIGHT and not exists:
        return f"run again: status {again.status}: {again.said[-200:]}"
    return _unlike(seen(folder), new)


def _filled(case: CrashCase, folder: Path, force: bool, point: int, way: str, old: Seen, new: Seen) -> str:
    """What is wrong after a disk that was full once a file had `point` bytes, or once that many pages were written."""
    if way == "disk":
        _narrow(folder, point)
        ended = run(case, folder, force)
        _narrow(folder, None)
    else:
        ended = run(case, folder, force, limit=point)
    if ended.status == ALL_RIGHT:
        return _unlike(seen(folder), new)
    lines = [line for line in ended.said.splitlines() if not line.startswith("hagoromo: warning:")]
    if ended.status not in case.fails or len(lines) > 1 or (ended.status == 2 and not lines):
        return f"status {ended.status}: {ended.said[-300:]}"
    found = seen(folder)
    if case.apart:
        wrong = _neither(case, *(states(case, one) for one in (found, old, new)))
        left = sorted(set(found) - set(old) - set(new))
        wrong = wrong or (f"left behind: {', '.join(left[:5])}" if left else "")
    elif case.grows and states(case, found) != states(case, old):
        wrong = _neither(case, *(states(case, one) for one in (found, old, new)))
    elif case.resumes:
        wrong = "" if states(case, found) == states(case, old) else "the target has changed"
    else:
        wrong = _unlike(found, old)
    if wrong:
        return wrong
    again = run(case, folder, force)
    if again.status != ALL_RIGHT:
        return f"run again: status {again.status}: {again.said[-200:]}"
    return _unlike(seen(folder), new)


def _neither(case: CrashCase, found: list[Seen], old: list[Seen], new: list[Seen]) -> str:
    """The first target that is neither old nor new; "" if there is none."""
    for name, state, before, after in zip(case.targets, found, old, new, strict=True):
        if state not in (before, after) and not (case.grows and _has_grown(name, state, after)):
            return f"{name} is {'lost' if not state else 'neither old nor new'}"
    return ""


def _has_grown(name: str, state: Seen, after: Seen) -> bool:
    """Whether a folder has its page, and no file that the whole one lacks, but for work that was cut off."""
    plain = {path for path in state if not any(part.startswith(".") for part in path.split("/"))}
    return f"{name}/report.html" in plain and plain <= after.keys()


def _unlike(found: Seen, wanted: Seen) -> str:
    """How a folder differs from what it should be, inputs and hidden names included."""
    names = sorted(name for name in found.keys() | wanted.keys() if found.get(name) != wanted.get(name))
    kinds = {True: "left behind", False: "lost"}
    parts = [kinds[name in found] if (name in found) != (name in wanted) else "different" for name in names]
    return ", ".join(f"{part}: {name}" for part, name in list(zip(parts, names, strict=True))[:5])


def _row(name: str, tried: int, known: int, unclean: int) -> str:
    return f"{name:28} tried {tried:4} of {known:5} points, unclean {unclean:4}"


def main() -> int:
    """Run the cases; prints a table, and each fault that was not clean."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--most", type=int, default=10**6, help="points of each verb, spread evenly, fewer of slow ones (default: all)"
    )
    parser.add_argument("--full", action="store_true", help="a full disk in place of kills")
    parser.add_argument("--disk", action="store_true", help="a disk of its own that is full in place of kills")
    parser.add_argument("--strace", action="store_true", help="kill at calls of the system, by strace")
    parser.add_argument("--verbs", nargs="*", default=[], help="names of cases (default: all)")
    asked = parser.parse_args()
    way = next((way for way in (*WAYS, "strace") if getattr(asked, way)), "kill")
    if way == "disk" and APART not in os.environ:
        command_line = ["unshare", "-rm", sys.executable, "-m", "fuzz.crash", *sys.argv[1:]]
        return subprocess.run(command_line, env={**os.environ, APART: "1"}, check=False).returncode
    _without_threads()
    known, tried, unclean = Counter[str](), Counter[str](), Counter[str]()
    for case in CASES:
        if asked.verbs and case.name not in asked.verbs:
            continue
        with tempfile.TemporaryDirectory(prefix="hagoromo-crash-", dir=IN_MEMORY) as scratch:
            home = Path(scratch).resolve()
            (home / "inputs").mkdir()
            case.make(home / "inputs")
            _load(case, home)
            for wrong in faults(case, home, asked.most, way, known):
                tried[case.name] += 1
                unclean[case.name] += bool(wrong)
                if wrong:
                    print(wrong, flush=True)
            _away(home / "fresh")
        print(_row(case.name, tried[case.name], known[case.name], unclean[case.name]), flush=True)
    print(_row("all", tried.total(), known.total(), unclean.total()))
    return int(unclean.total() > 0 or not tried.total())


if __name__ == "__main__":
    sys.exit(main())
