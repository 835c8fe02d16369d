"""Files of a profile: a table, and a plot with axes, band and the exaggeration of heights."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.names import plot_label
from hagoromo.files.plot import panels
from hagoromo.files.whole import whole_files

if TYPE_CHECKING:
    from hagoromo.measurement.inspection.profile import HeightProfile

TABLE_SUFFIX = ".csv"
LINES = ("#1a1a1a", "#b0531b")  # of the first and the second profile
BANDS = ("#9fb4cc", "#e8c3a5")
SIZE_INCH = (6.4, 3.0)
DPI = 150
ROOM = 0.08  # of the heights, above and below them
Array = NDArray[np.float64]


def write_profile(profile: HeightProfile, path: Path, force: bool = False) -> Path:
    """Write the table `path` and the plot beside it, whole or not at all; `InputError` for another ending than .csv."""
    check_table_name(path)
    with whole_files((path, path.with_suffix(".png")), force) as (table, drawn):
        table.write_text(table_text(profile.columns()), encoding="utf-8", newline="\n")
        drawn.write_bytes(figure_png(profile_figure({"": profile})))
    return path


def check_table_name(path: Path) -> Path:
    """`path`; `InputError` unless it ends in .csv."""
    if path.suffix.lower() != TABLE_SUFFIX:
        raise InputError(f"{path}: a profile is written as a table NAME.csv, with its plot NAME.png beside it")
    return path


def table_text(columns: Mapping[str, Array]) -> str:
    """CSV of columns (n,), a row for each place; a cell is empty where nothing is known."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    rows = zip(*columns.values(), strict=True)
    writer.writerows(["" if not np.isfinite(cell) else f"{cell:.9g}" for cell in row] for row in rows)
    return text.getvalue()


def profile_figure(profiles: Mapping[str, HeightProfile], size: tuple[float, float] = SIZE_INCH) -> Any:
    """A figure of one profile, or of several by their names, with 95 % bands; heights over distance, in their unit."""
    figure, (axis,) = panels(1, *size)
    draw_profiles(axis, profiles)
    return figure


def draw_profiles(axis: Any, profiles: Mapping[str, HeightProfile]) -> None:
    """Draw profiles on an axis of matplotlib."""
    axis.set_axisbelow(True)
    axis.grid(color="#e3e3e3", linewidth=0.6)
    low, high = np.inf, -np.inf
    for (name, one), line, band in zip(profiles.items(), LINES, BANDS, strict=False):
        ends = one.band_95
        said, shaded = (f"{plot_label(name)} (95 % band shaded)", None) if name else ("height", "95 % band")
        if np.isfinite(ends[0]).any():
            axis.fill_between(one.distance, *ends, color=band, alpha=0.75, linewidth=0, label=shaded)
        axis.plot(one.distance, one.height, color=line, linewidth=1.1, label=said)
        both = np.stack([one.height, *ends])
        low, high = min(low, float(np.nanmin(both))), max(high, float(np.nanmax(both)))
    first = next(iter(profiles.values()))
    room = ROOM * max(high - low, 1e-9)
    axis.set_xlim(0.0, float(np.nanmax(first.distance)))
    axis.set_ylim(low - room, high + room)
    axis.set_xlabel(f"distance along the chord [{first.unit}]", fontsize=9)
    axis.set_ylabel(f"height over the chord [{first.unit}]", fontsize=9)
    (x0, y0), (x1, y1) = first.line
    axis.set_title(
        f"from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}) px; heights drawn {_exaggeration(axis):.2g} times as high as long",
        fontsize=9,
    )
    axis.legend(frameon=False, fontsize=8, ncols=2 * len(profiles), loc="best")


def figure_png(figure: Any) -> bytes:
    """The figure as a PNG file."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=DPI, metadata={"Software": None})
    return picture.getvalue()


def _exaggeration(axis: Any) -> float:
    """How many times a unit of height is drawn longer than one of distance."""
    axis.figure.draw_without_rendering()
    box = axis.get_window_extent()
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    return float(box.height / (top - bottom) / (box.width / (right - left)))
