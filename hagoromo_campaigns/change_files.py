"""The files of a Change: change.json, regions.csv, change.exr and, of a line, section.csv and section.png."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.exr import write_exr
from hagoromo.files.record import write_json
from hagoromo.files.whole import write_text
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.inspection.profile_files import LINES, draw_profiles, figure_png, table_text
from hagoromo_campaigns.change import Change
from hagoromo_campaigns.region import ChangedRegion

SECTION, SECTION_PICTURE = "section.csv", "section.png"
SECTION_INCH = (6.4, 4.6)
MARKED, GREY = "#c00000", "#bdbdb8"  # of what is significant, and of the band of the difference
RECORD, TABLE, MAPS = "change.json", "regions.csv", "change.exr"


def write_change(change: Change, home: Path) -> None:
    """Write the files that `Change.write_into` lists."""
    write_json(home / RECORD, change.record())
    write_text(home / TABLE, table(change))
    units = {f"unit.{one.name}": one.unit for one in change.quantities}
    write_exr(home / MAPS, channels(change), {"comment": "; ".join(f"{k}: {v}" for k, v in units.items())})

    if change.section is not None:
        write_text(home / SECTION, table_text(change.section.columns()))
        (home / SECTION_PICTURE).write_bytes(figure_png(section_figure(change)))


def section_figure(change: Change) -> Any:
    """The heights of both dates with their bands, and below them their difference, significant places marked."""
    from matplotlib.figure import Figure

    section = change.section
    assert section is not None
    figure = Figure(figsize=SECTION_INCH, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    draw_profiles(upper, {change.before.name: section.before, change.after.name: section.after})
    upper.set_xlabel("")
    distance, difference, half = section.before.distance, section.difference, NORMAL_95 * section.error
    lower.fill_between(distance, difference - half, difference + half, color=GREY, linewidth=0, label="95 % band")
    lower.plot(distance, difference, color=LINES[0], linewidth=1.0, label="after − before")
    lower.plot(distance, np.where(section.significant, difference, np.nan), color=MARKED, linewidth=2.4,
               label="significant")  # fmt: skip
    lower.axhline(0.0, color="#808080", linewidth=0.6)
    lower.set_xlabel(f"distance along the chord [{section.unit}]", fontsize=9)
    lower.set_ylabel(f"difference [{section.unit}]", fontsize=9)
    lower.legend(frameon=False, fontsize=8, ncols=3, loc="best")
    for axis in (upper, lower):
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)
    return figure


def table(change: Change) -> str:
    """regions.csv: a row for each region, and lamp; numbers are those of the record."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, [field.name for field in fields(ChangedRegion)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(region.record() for region in change.regions)
    return text.getvalue()


def channels(change: Change) -> dict[str, NDArray[np.float64]]:
    """The channels of change.exr."""
    found: dict[str, NDArray[np.float64]] = {}
    for one in change.quantities:
        for label, value in one.value.items():
            name = one.name if len(one.value) == 1 else f"{one.name}.{label}"
            found[name], found[f"error.{name}"] = np.nan_to_num(value), np.nan_to_num(one.error[label])
        found[f"p.{one.name}"] = np.nan_to_num(one.significance.p, nan=1.0)
        found[f"significant.{one.name}"] = one.significance.found.astype(np.float64)
        found[f"compared.{one.name}"] = one.compared.astype(np.float64)
    return found
