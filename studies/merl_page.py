"""The page of the MERL study: its table and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg

MODEL_COLOURS = ("#1f4e8c", "#b5651d", "#3b7d5a")


def write_merl_page(home: Path, record: dict[str, Any]) -> None:
    """Write merl.md and merl.png to the folder `home`."""
    _plot(home / "merl.png", record)
    page = hg.page_text("merl.md.j2", "studies", record=record, rows=_rows(record))
    (home / "merl.md").write_text(page, encoding="utf-8")


def _rows(record: dict[str, Any]) -> list[list[str]]:
    rows = []
    for kind, of in record["summary"].items():
        for method, figures in of["error"].items():
            cells = [f"{100 * figures[key]:.1f} %" for key in ("quartile_1", "median", "quartile_3")]
            rows.append([kind, method, *cells, f"{100 * figures['worst']:.0f} % ({figures['worst_material']})"])
    return rows


def _plot(path: Path, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    fits = list(record["summary"])
    figure = Figure(figsize=(5.0 * len(fits), 3.6), layout="constrained")
    axes = figure.subplots(1, len(fits), sharey=True, squeeze=False)[0]
    for axis, fit in zip(axes, fits, strict=True):
        rows = [row for row in record["rows"] if row["truth"] == fit]
        for method, colour in zip(rows[0]["error"], MODEL_COLOURS, strict=True):
            errors = np.sort([100.0 * row["error"][method] for row in rows])
            axis.step(errors, (np.arange(len(errors)) + 1.0) / len(errors), where="post", color=colour, label=method)
        axis.axvline(100.0 * record["noise"], color="#999", linewidth=0.8, linestyle=":")
        axis.set_xscale("log")
        axis.set_ylim(0.0, 1.0)
        axis.set_title(f"truth: {fit}", fontsize=10)
        axis.set_xlabel("median relative error of a material [%]", fontsize=9)
    axes[0].set_ylabel("share of the materials below", fontsize=9)
    axes[-1].legend(fontsize=8, frameon=False, loc="lower right")
    figure.savefig(path, dpi=120)
