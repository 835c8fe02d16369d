"""The files of a Change: change.json, regions.csv and change.exr."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.campaigns.change import Change
from hagoromo.campaigns.region import ChangedRegion
from hagoromo.files.exr import write_exr
from hagoromo.files.record import write_json
from hagoromo.files.whole import write_text

RECORD, TABLE, MAPS = "change.json", "regions.csv", "change.exr"


def write_change(change: Change, home: Path) -> None:
    """Write the files that `Change.write_into` lists."""
    write_json(home / RECORD, change.record())
    write_text(home / TABLE, table(change))
    units = {f"unit.{one.name}": one.unit for one in change.quantities}
    write_exr(home / MAPS, channels(change), {"comment": "; ".join(f"{k}: {v}" for k, v in units.items())})


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
