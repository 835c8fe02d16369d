"""The results as one table: Markdown for people, JSON for programs, with machine, versions and date."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file

PACKAGES = ("hagoromo", "drjit", "mitsuba", "vtk", "numba", "numpy", "scipy")
HEADER = (
    "| scene | who | setting | s/frame | relative error | mean | × ours | peak MiB | first picture, cold | cached |\n"
    "|---|---|---|---:|---:|---:|---:|---:|---:|---:|\n"
)
LEGEND = """
* s/frame: median of warm frames, ours and theirs in turn. Ours: medium, shadow maps and picture anew each time.
* relative error: rmse over the root mean square of the reference, where there is matter; the reference is our march
  at a tolerance of 0.0025 with marched shadows, of 0.00016 where there are none. mean: mean radiance over that of the
  reference.
* × ours: time over that of the quickest of our settings with no larger error (a fifth is taken for equal); in brackets
  where none of ours is as accurate, over the most accurate. Nothing is extrapolated: where our error is much smaller,
  theirs would take longer to reach it than the table says.
* peak MiB: largest resident memory of the process. first picture: from the start of the process, at the first setting,
  with imports, reading and compiling; cold: no kernel cache, on the first scene of each; cached: with that of before.
"""


@dataclass(frozen=True)
class PeerRow:
    """One contender at one setting on one scene, or why it is absent. Times [s], peak [MiB]."""

    scene: str
    who: str
    setting: str = ""
    seconds: float = 0.0
    rounds: int = 0
    error: float = 0.0
    mean: float = 0.0
    ratio: float | None = None
    against: str = ""
    as_accurate: bool = True
    peak: float = 0.0
    first_cold: float | None = None
    first_cached: float | None = None
    absent: str = ""


def write(folder: Path, rows: Sequence[PeerRow]) -> list[Path]:
    """Write `peers.md` and `peers.json` into `folder`, over older ones; their paths."""
    record = machine()
    paths = [folder / "peers.md", folder / "peers.json"]
    with whole_file(paths[0], force=True) as text, whole_file(paths[1], force=True) as data:
        text.write_text(markdown(rows, record), encoding="utf-8", newline="\n")
        write_json(data, {"machine": record, "rows": [asdict(row) for row in rows]})
    return paths


def markdown(rows: Sequence[PeerRow], record: dict[str, Any]) -> str:
    """The page: machine, table, legend."""
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    head = f"# Peers\n\n{record['date']}; {record['processor']}, {record['cores']} cores, load {record['load']:.1f} "
    head += f"before the end; {record['system']}, Python {record['python']}; {versions}.\n\n"
    return head + HEADER + "".join(_line(row) for row in rows) + LEGEND


def machine() -> dict[str, Any]:
    """What the figures were taken on."""
    return {
        "date": time.strftime("%Y-%m-%d %H:%M"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": {name: found for name in PACKAGES if (found := _version(name))},
    }


def _line(row: PeerRow) -> str:
    if row.absent:
        cells = [row.scene, row.who, row.absent.replace("|", "/"), *[""] * 7]
    else:
        ratio = "" if row.ratio is None else f"{row.ratio:.1f}" if row.as_accurate else f"({row.ratio:.1f})"
        cells = [row.scene, row.who, row.setting, _number(row.seconds, 3), _number(row.error, 5), _number(row.mean, 4)]
        cells += [ratio, _number(row.peak, 0), _number(row.first_cold, 1), _number(row.first_cached, 1)]
    return "| " + " | ".join(cells) + " |\n"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").split("\n") if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
