"""Worker: a process that tries seeds of readers one after the other, and writes a line of JSON about each.

    python -m fuzz.worker RESULTS READER:FIRST:COUNT…

Before each try its reader and seed are written to RESULTS.now, so that a crash or a hang has a name.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fuzz.costs import costs
from fuzz.judge import FAULT, REFUSED, FuzzVerdict, judged
from fuzz.mutators import JSON, spoil_one
from fuzz.readers import READERS, Reader, palette_spoilt
from fuzz.trees import swaps
from fuzz.verbs import WORDS

MEMORY = 6 << 30  # [byte] of addresses beyond those that the process starts with: what wants more fails
GOOD = -1  # the seed of the good sample
SWAPS = 1 << 40  # the seed of the first swap: each node of each JSON or TOML file by a value of each type
WITH_TREES = (*JSON, ".toml")


class FuzzSample(NamedTuple):
    """files: of a good sample, name in the folder → bytes. is_file: whether it is one file, not a folder."""

    files: dict[str, bytes]
    is_file: bool


class FuzzJob(NamedTuple):
    """Seeds `first` to first + count of a reader."""

    reader: str
    first: int
    count: int

    def __str__(self) -> str:
        return f"{self.reader}:{self.first}:{self.count}"


def main(arguments: list[str]) -> None:
    """Try the jobs that the command line names."""
    results = Path(arguments[0])
    bound_memory()
    with results.open("a", encoding="utf-8") as out, tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        for text in arguments[1:]:
            name, first, count = text.rsplit(":", 2)
            results.with_suffix(".now").write_text(json.dumps([name, int(first)]))
            sample = sample_of(READERS[name])
            for seed in (GOOD, *range(int(first), int(first) + int(count))):
                if seed >= SWAPS and swapped_file(READERS[name], sample, seed - SWAPS) is None:
                    break
                results.with_suffix(".now").write_text(json.dumps([name, seed]))
                verdict = tried(READERS[name], sample, seed, Path(scratch))
                print(json.dumps({"reader": name, "seed": seed, **verdict._asdict()}), file=out, flush=True)
    results.with_suffix(".now").unlink(missing_ok=True)


def bound_memory() -> None:
    """Let this process take `MEMORY` more addresses, where the system can bound them."""
    try:
        import resource
    except ImportError:
        return
    import psutil

    limit = psutil.Process().memory_info().vms + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def sample_of(reader: Reader) -> FuzzSample:
    """The good sample of a reader."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        home = Path(folder) / reader.name
        if reader.in_folder:
            home.mkdir()
        reader.write(home)
        if home.is_file():
            return FuzzSample({reader.name: home.read_bytes()}, True)
        files = sorted(path for path in home.rglob("*") if path.is_file())
        return FuzzSample({path.relative_to(home).as_posix(): path.read_bytes() for path in files}, False)


def tried(reader: Reader, sample: FuzzSample, seed: int, scratch: Path) -> FuzzVerdict:
    """The verdict on the sample spoilt by `seed`; a good one must be read."""
    path = written(reader, sample, seed, scratch)
    with costs() as wrong:
        verdict = judged(reader.read, path)
    if wrong() and verdict.outcome != FAULT and not reader.works:
        verdict = FuzzVerdict(FAULT, wrong(), f"{wrong()}: {verdict.text}")
    if seed == GOOD and reader.good and verdict.outcome == REFUSED:
        verdict = FuzzVerdict(FAULT, "the good sample is refused", verdict.text)
    shutil.rmtree(scratch / "try", ignore_errors=True)
    return verdict


def swapped_file(reader: Reader, sample: FuzzSample, number: int) -> tuple[str, bytes] | None:
    """The name and the bytes of the file of a swap; None behind the last one."""
    if reader.name not in _swaps:
        _swaps.clear()
        trees = sorted(name for name in sample.files if name.endswith(WITH_TREES) and name != WORDS)
        made = ((name, data) for name in trees for data in swaps(name, sample.files[name], reader.swaps))
        _swaps[reader.name] = list(made)
    every = _swaps[reader.name]
    return every[number] if number < len(every) else None


_swaps: dict[str, list[tuple[str, bytes]]] = {}


def written(reader: Reader, sample: FuzzSample, seed: int, scratch: Path) -> Path:
    """The path to read: the spoilt sample in the folder `scratch`."""
    swap = swapped_file(reader, sample, seed - SWAPS) if seed >= SWAPS else None
    random = None if seed == GOOD or swap else np.random.default_rng([zlib.crc32(reader.name.encode()), seed])
    home = scratch / "try"
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir(parents=True)
    if random and reader.name == "rendered.exr" and random.random() < 0.6:
        palette_spoilt(home / reader.name, random)
        return home / reader.name
    files = dict(sample.files) | (dict([swap]) if swap else {})
    if random:
        (reader.spoil or spoil_one)(files, random)
    inside = home if sample.is_file else home / reader.name
    for name, data in files.items():
        (inside / name).parent.mkdir(parents=True, exist_ok=True)
        (inside / name).write_bytes(data)
    return inside / reader.name if sample.is_file else inside / reader.entry


if __name__ == "__main__":
    main(sys.argv[1:])
