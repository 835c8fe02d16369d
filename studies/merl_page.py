"""The page of the MERL study: its table and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg

LINES = {  # of the plot: a colour for each model, solid by the package and dashed by SciPy
    "Gaussian": ("#8c8c8c", "-"),
    "Gaussian, SciPy": ("#8c8c8c", "--"),
    "Student-t, coloured": ("#3b7d5a", "-"),
    "Student-t, coloured, SciPy": ("#3b7d5a", "--"),
    "by evidence": ("#1f4e8c", "-"),
    "GGX + Lambert, SciPy": ("#b5651d", "--"),
    "GGX + Lambert, coloured, SciPy": ("#d9a066", "--"),
}
SHOWN = tuple(method for method in LINES if method not in ("Gaussian", "Student-t, coloured"))  # of each material


def write_merl_page(home: Path, record: dict[str, Any]) -> None:
    """Write merl.md and merl.png to the folder `home`."""
    _plot(home / "merl.png", record)
    materials = {kind: _materials(record, kind) for kind in record["summary"]}
    parts = {"rows": _rows(record), "shown": SHOWN, "materials": materials}
    page = hg.page_text("merl.md.j2", "studies", record=record, **parts)
    (home / "merl.md").write_text(page, encoding="utf-8", newline="\n")


def _rows(record: dict[str, Any]) -> list[list[str]]:
    rows = []
    for kind, of in record["summary"].items():
        for method, figures in of["error"].items():
            cells = [f"{100 * figures[key]:.1f} %" for key in ("quartile_1", "median", "quartile_3")]
            cells.append(f"{100 * figures['worst']:.0f} % ({figures['worst_material']})")
            nearer = [f"{100 * figures[key]:.0f} %" for key in ("nearer_than_ggx", "nearer_than_ggx_coloured")]
            rows.append([kind, method, *cells, *("" if "GGX" in method else share for share in nearer)])
    return rows


def _materials(record: dict[str, Any], kind: str) -> list[list[str]]:
    """Of each material its name, the errors of the methods SHOWN in per cent, and ν."""
    rows = [row for row in record["rows"] if row["truth"] == kind]
    return [
        [
            row["material"],
            *(f"{100 * row['error'][method]:.1f}" for method in SHOWN),
            "∞" if row["nu"] is None else f"{row['nu']:.2f}",
        ]
        for row in rows
    ]


def _plot(path: Path, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    fits = list(record["summary"])
    figure = Figure(figsize=(5.0 * len(fits), 3.6), layout="constrained")
    axes = figure.subplots(1, len(fits), sharey=True, squeeze=False)[0]
    for axis, fit in zip(axes, fits, strict=True):
        rows = [row for row in record["rows"] if row["truth"] == fit]
        for method, (colour, dashes) in LINES.items():
            errors = np.sort([100.0 * row["error"][method] for row in rows])
            share = (np.arange(len(errors)) + 1.0) / len(errors)
            axis.step(errors, share, where="post", color=colour, linestyle=dashes, label=method)
        axis.axvline(100.0 * record["noise"], color="#999", linewidth=0.8, linestyle=":")
        axis.set_xscale("log")
        axis.set_ylim(0.0, 1.0)
        axis.set_title(f"truth: {fit}", fontsize=10)
        axis.set_xlabel("median relative error of a material [%]", fontsize=9)
    axes[0].set_ylabel("share of the materials below", fontsize=9)
    axes[0].legend(fontsize=7, frameon=False, loc="lower right")
    figure.savefig(path, dpi=120)
