"""The page of the study of responses: its tables and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hagoromo as hg

CHANNEL_COLOURS = {"R": "#b03a2e", "G": "#2e7d32", "B": "#1f4e8c"}
FITS = {"hagoromo": "correlation", "knowing the truth": "correlation_knowing_the_truth"}


def write_response_page(home: Path, record: dict[str, Any]) -> None:
    """Write response.md and response.png to the folder `home`."""
    _plot(home / "response.png", record["faults"])
    page = hg.page_text("response.md.j2", "studies", record=record, fits=FITS, rows=_rows(record["rows"]))
    (home / "response.md").write_text(page, encoding="utf-8", newline="\n")


def _rows(rows: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for each kind of readings and each fit."""
    return [
        {"readings": name, "fit": fit, "correlation": row[key], "of": row if key == "correlation" else None}
        for name, row in rows.items()
        for fit, key in FITS.items()
    ]


def _plot(path: Path, faults: dict[str, dict[str, Any]]) -> None:
    """Correlation and coverage of every case."""
    from matplotlib.figure import Figure

    labels, scores = [], []
    for group, cases in faults.items():
        labels += [group, *(f"{name}  " for name in cases)]
        scores += [None, *cases.values()]
    figure = Figure(figsize=(11.0, 0.27 * len(labels) + 1.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for row, score in enumerate(scores):
        if score is not None:
            _draw(left, right, row, score, labelled=row == 1)
    left.set(xscale="log", xlabel="1 − correlation with the true curve: median (dot) to 10th percentile of the cameras")
    left.set_yticks(range(len(labels)), labels, fontsize=8)
    for tick, score in zip(left.get_yticklabels(), scores, strict=True):
        tick.set_fontweight("bold" if score is None else "normal")
    left.invert_yaxis()
    right.set(xlabel="values within their 95 % intervals [%]", xlim=(min(right.get_xlim()[0], 88.0), 100.5))
    right.axvspan(92.0, 98.0, color="#eee", zorder=0)
    right.axvline(95.0, color="#999", linewidth=0.8, zorder=0)
    for axes in (left, right):
        axes.grid(alpha=0.25)
        axes.xaxis.label.set_fontsize(8)
        axes.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)  # above
    figure.savefig(path, dpi=110)


def _draw(left: Any, right: Any, row: int, score: dict[str, Any], labelled: bool) -> None:
    """One case: its correlation on the axes `left`, its coverage on `right`."""
    for shift, (channel, colour) in zip((-0.22, 0.0, 0.22), CHANNEL_COLOURS.items(), strict=True):
        of = score["correlation"][channel]
        median, tenth = 1.0 - of["median"], 1.0 - of["p10"]
        left.plot((median, tenth), [row + shift] * 2, color=colour, linewidth=1.0)
        left.plot(median, row + shift, "o", color=colour, markersize=4, label=channel if labelled else None)
    kinds = (("coverage", "#444", "all values"), ("coverage_above_5_percent", "none", "above 5 % of the peak"))
    for key, fill, name in kinds:
        share = 100.0 * score[key]
        right.plot(share, row, "o", color="#444", mfc=fill, markersize=5, label=name if labelled else None)
