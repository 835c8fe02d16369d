"""The command line of the fuzzer: see `fuzz`."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from fuzz.run import COUNT, fuzzed, report, swapped


def main() -> int:
    """0 if every spoilt file was read or refused in one line, else 1."""
    parser = argparse.ArgumentParser(prog="fuzz", description="Spoilt files of every kind must be refused in one line.")
    parser.add_argument("--reader", action="append", default=[], help="only these readers")
    parser.add_argument("--seed", type=int, help="one mutation again, with its verdict; -1: the good sample")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=COUNT, help="mutations of each reader")
    parser.add_argument("--minutes", type=float, default=0.0, help="go on with more seeds until the time is over")
    parser.add_argument("--processes", type=int, default=1, help="how many work at a time")
    parser.add_argument("--keep", type=Path, help="folder for the list of faults, or for the file of --seed")
    parser.add_argument("--swaps", action="store_true", help="instead: each node of JSON and TOML, by each type")
    given = parser.parse_args()
    if given.seed is not None:
        return _once(given.reader[0], given.seed, given.keep)
    if given.swaps:
        outcome = swapped(given.reader, given.processes)
    else:
        outcome = fuzzed(given.reader, given.first, given.count, given.minutes, given.processes)
    print(report(outcome))
    if given.keep is not None:
        given.keep.mkdir(parents=True, exist_ok=True)
        (given.keep / "faults.json").write_text(json.dumps(outcome.faults, indent=1), encoding="utf-8")
    return 1 if outcome.faults else 0


def _once(name: str, seed: int, keep: Path | None) -> int:
    from fuzz.judge import FAULT, judged
    from fuzz.readers import READERS
    from fuzz.worker import bound_memory, sample_of, written

    reader = READERS[name]
    bound_memory()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as scratch:
        path = written(reader, sample_of(reader), seed, keep or Path(scratch))
        verdict = judged(reader.read, path)
    print(f"{verdict.outcome}: {verdict.kind}\n{verdict.text}")
    return 1 if verdict.outcome == FAULT else 0


if __name__ == "__main__":
    sys.exit(main())
