"""Real data: where each set comes from, its licence, and whether the files beside the checkout are the ones it held.

    python -m tests.data [FOLDER]

Prints a table of the sets in `tests/data.toml`. Exit status: 0 where every file that is present has the SHA-256 that
`tests/data.sha256` states, absent sets included; 2 where a file differs or a set lacks files, which are named.
A test that needs a set is marked `@real_data("uw_psm")` and skipped without it, with one reason for all.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
NEEDS_DATA = "real data"  # how the reasons of skipped tests begin
DATA = Path(os.environ.get("HAGOROMO_DATA", HERE.parents[1] / "shared" / "data"))


def real_data(path: str | Path) -> pytest.MarkDecorator:
    """Skip a test where `path`, a set or a file of one, is not in `DATA`: `DATA / path` is what it then reads."""
    reason = f"{NEEDS_DATA} {path} is absent from ../shared/data: `make data` says where it comes from"
    return pytest.mark.skipif(not (DATA / path).exists(), reason=reason)


@dataclass(frozen=True)
class DataSet:
    """A set as `data.toml` states it; sums: the SHA-256 of each file, by its path under the data folder."""

    name: str
    what: str
    source: str
    licence: str
    sums: dict[str, str]

    def faults(self, folder: Path) -> list[str] | None:
        """One line for each file that is missing or differs; None where the whole set is absent."""
        if not (folder / self.name).is_dir():
            return None
        faults = []
        for path, stated in self.sums.items():
            if not (folder / path).is_file():
                faults.append(f"{path} is missing")
            elif hashlib.sha256((folder / path).read_bytes()).hexdigest() != stated:
                faults.append(f"{path} differs: its SHA-256 is not {stated[:12]}…")
        return faults


def data_sets() -> list[DataSet]:
    """All sets that tests and studies know."""
    sums: dict[str, dict[str, str]] = {}
    for line in (HERE / "data.sha256").read_text(encoding="utf-8").splitlines():
        digest, path = line.split("  ", 1)
        sums.setdefault(path.split("/", 1)[0], {})[path] = digest
    records = tomllib.loads((HERE / "data.toml").read_text(encoding="utf-8"))
    return [DataSet(name, sums=sums.get(name, {}), **record) for name, record in records.items()]


def report(folder: Path) -> int:
    """Print the table and the faults; the exit status."""
    rows, faults = [("set", "state", "licence", "source", "what")], []
    for data_set in data_sets():
        wrong = data_set.faults(folder)
        faults += wrong or []
        state = "absent" if wrong is None else f"{len(wrong)} wrong" if wrong else f"{len(data_set.sums)} files ok"
        rows.append((data_set.name, state, data_set.licence, data_set.source, data_set.what))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    for fault in faults:
        print(f"{fault}: take the set from its source again", file=sys.stderr)
    return 2 if faults else 0


if __name__ == "__main__":
    sys.exit(report(Path(sys.argv[1]) if sys.argv[1:] else DATA))
