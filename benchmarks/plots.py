"""Plots of the records, as PNG: how the time of a frame grows, and what bounds the march."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tables import Rows, slope

from hagoromo.files.whole import whole_file

COLOURS = {"mapped_s": "#b5471d", "unshaded_s": "#2f5d9b"}
LABELS = {"mapped_s": "shadow maps made anew", "unshaded_s": "no shadows"}
GREY = "#777777"


def growth(found: Mapping[str, Rows], path: Path) -> None:
    """Frame time against resolution, pixels, lamps and boxes; what grows with resolution, and how much."""
    figure, panels = _figure(2, 3, 11.0, 6.4)
    _times(panels[0], found["resolution"], "voxels", "voxels along an edge of the same shell")
    _relative(panels[1], found["resolution"])
    _times(panels[2], found["pixels"], "pixels", "pixels of the picture")
    _times(panels[3], found["lamps"], "lamps", "lamps, a map each")
    for axis, arranged, title in (
        (panels[4], "side by side", "boxes side by side, the same matter cut"),
        (panels[5], "overlapped", "boxes overlapped, the same matter in parts"),
    ):
        _times(axis, [row for row in found["boxes"] if row["arranged"] == arranged], "boxes", title)
    panels[1].legend(fontsize=7.5, frameon=False)
    _save(figure, path)


def bound(found: Mapping[str, Any], path: Path) -> None:
    """The frame beside its walk alone [ms]; rates of gathers against the size of the table."""
    figure, (bars, rates) = _figure(1, 2, 10.0, 3.6)
    times = [1e3 * found["parts_s"][key] for key in ("whole", "walk")]
    bars.barh(["march", "walk alone"], times, color=["#444444", COLOURS["unshaded_s"]])
    bars.invert_yaxis()
    bars.set_xlabel("time of a frame of 512² pixels [ms]", fontsize=9)
    bars.set_xlim(right=1.2 * max(times))
    size = np.array([row["bytes"] for row in found["gather_rates"]]) / 2**20
    rates.loglog(size, [row["per_s"] / 1e9 for row in found["gather_rates"]], "o-", color=GREY, label="at random")
    _plain(rates.xaxis, (1.0,))
    _plain(rates.yaxis)
    rates.set_xlabel("table [MiB]", fontsize=9)
    rates.set_ylabel("gathers of 32 bits [10⁹/s]", fontsize=9)
    rates.legend(fontsize=7.5, frameon=False)
    _save(figure, path)


def _times(axis: Any, rows: Rows, across: str, label: str) -> None:
    """Frame times against `across`, both logarithmic, with the slope of each line."""
    for key, colour in COLOURS.items():
        name = f"{LABELS[key]}, slope {slope(rows, across, key):.2f}"
        axis.loglog([row[across] for row in rows], [row[key] for row in rows], "o-", color=colour, label=name)
    _ticks(axis, [row[across] for row in rows])
    axis.set_xlabel(label, fontsize=9)
    axis.set_ylabel("time of a frame [s]", fontsize=9)
    axis.legend(fontsize=7.5, frameon=False)


def _relative(axis: Any, rows: Rows) -> None:
    """All that grows with resolution, over its value at the coarsest."""
    styles = {
        "lattice": (":", GREY, "voxels of the lattice"), "kept_bricks": ("--", GREY, "kept bricks"),
        "samples": ("-", "#3b7d5a", "samples of matter"),
        **{key: ("o-", colour, f"time, {LABELS[key]}") for key, colour in COLOURS.items()},
    }  # fmt: skip
    for key, (style, colour, label) in styles.items():
        axis.loglog(
            [r["voxels"] for r in rows], [r[key] / rows[0][key] for r in rows], style, color=colour, label=label
        )
    _ticks(axis, [row["voxels"] for row in rows])
    axis.set_xlabel("voxels along an edge of the same shell", fontsize=9)
    axis.set_ylabel("over its value at the left [1]", fontsize=9)


def _ticks(axis: Any, places: Sequence[float]) -> None:
    """Ticks where something was measured."""
    names = [f"{int(np.sqrt(n))}²" if n > 1e4 else str(n) for n in places]
    axis.set_xticks(places, names)
    axis.set_xticks([], minor=True)
    _plain(axis.yaxis)


def _plain(scale: Any, parts: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Numbers of a logarithmic scale as one writes them, at `parts` of every power of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    scale.set_major_locator(LogLocator(subs=parts))
    scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    scale.set_minor_formatter(NullFormatter())


def _figure(rows: int, columns: int, width: float, height: float) -> tuple[Any, list[Any]]:
    """A figure of its own, apart from pyplot's global state [inch], and its panels row by row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in panels:
        axis.tick_params(labelsize=8)
        axis.grid(which="major", color="#e4e4e4", linewidth=0.7)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, list(panels)


def _save(figure: Any, path: Path) -> None:
    with whole_file(path, force=True) as file:
        figure.savefig(file, format="png", dpi=130)
