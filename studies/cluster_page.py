"""The page of the study of many machines: tables of what was measured here and simulated, and the plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hagoromo as hg

KINDS = {
    "film, frames": "8 s of figure 8: a frame is a step of a batch",
    "film, tiles": "8 s of figure 8: tiles of a frame on all workers, frame after frame",
    "film, kept": "8 s of figure 8: frames, of which a worker keeps the boxes ready (not built)",
    "captures": "10,000 captures: a capture is a step of a batch",
}
COLOURS = ("#1f4e8c", "#b5651d", "#7a7a7a", "#2e7d32")
SHOWN = (1, 100, 1000)  # workers in the table


def write_cluster_page(home: Path, record: dict[str, Any]) -> None:
    """Write cluster.md and cluster.png to the folder `home`."""
    _plot(home / "cluster.png", record["simulated"]["rows"])
    rows = [row for row in record["simulated"]["rows"] if row["workers"] in SHOWN]
    by_full = [[row for row in record["full"]["rows"] if row["shared"] == shared] for shared in (False, True)]
    full = list(zip(*by_full, strict=True))
    page = hg.page_text("cluster.md.j2", "studies", record=record, kinds=KINDS, rows=rows, full=full, hours=hours)
    (home / "cluster.md").write_text(page, encoding="utf-8", newline="\n")


def hours(seconds: float) -> str:
    """A time in the unit that suits it."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def _plot(path: Path, rows: list[dict[str, Any]]) -> None:
    """Speed over one worker against their number."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for (kind, title), colour in zip(KINDS.items(), COLOURS, strict=True):
        points = [(row["workers"], row["speed"]) for row in rows if row["kind"] == kind]
        axes.plot(*zip(*points, strict=True), "o-", color=colour, label=title, markersize=3.5)
    most = max(row["workers"] for row in rows)
    axes.plot((1, most), (1, most), ":", color="black", linewidth=0.8, label="as many times as there are workers")
    axes.set(xscale="log", yscale="log", xlabel="workers", ylabel="speed over one worker")
    axes.legend(fontsize=7, frameon=False)
    axes.grid(alpha=0.25)
    figure.savefig(path, dpi=110)
