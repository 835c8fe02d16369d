"""The study of forecasts: relative errors of photographs left out, beside those that were expected of them.

    python -m studies.forecasts ../shared/data/uw_psm --out out/forecasts.json

Of each object each lamp is left out in turn; the others are measured, and say how far off the photograph under a lamp
there will be. Lamps are inside the hull of the others or outside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.image.relight.learnt import learn
from hagoromo.measurement.lamp_departure import lamp_departure
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.surface.depth import surface_from_normals
from studies.table import print_table
from studies.uw_psm import FOCAL, PIXEL, read_lamps, read_object, shrunk

OBJECTS = ("gray", "cat", "owl")
COLUMNS = "lamps", "photographs", "expected as before", "expected", "found", "found / expected"


def forecast_study(folder: Path, objects: Sequence[str] = OBJECTS, shrink: int = 4) -> list[dict[str, Any]]:
    """A row a photograph: object, lamp, outside [°], errors expected and found."""
    lamps = read_lamps(folder)[1]
    rows = []
    for name in objects:
        capture = shrunk(read_object(folder, name, lamps), shrink)
        rows += [{"object": name, "lamp": k, **_one(capture, k)} for k in range(len(capture.photographs))]
    return rows


def _one(capture: hg.Capture, lamp: int) -> dict[str, float]:
    """Photograph `lamp` predicted by the others, on their normals."""
    held = capture.photographs[lamp]
    rest = replace(capture, photographs=tuple(one for one in capture.photographs if one is not held))
    solved = hg.solve_normals(rest)
    camera, modes = held.camera, solved.modes
    surface = surface_from_normals(solved.normals, camera, FOCAL * PIXEL, solved.own_variance, draws=0, modes=modes)
    learnt = learn(replace(rest, points=surface.points, normals=solved.normals), solved)
    departure = lamp_departure(solved, tuple(one.lamps[0] for one in rest.photographs))
    assert learnt is not None and departure is not None
    views, towards = solved.views, np.asarray(held.lamps[0].to_lamp)
    to_lamp = np.broadcast_to(towards, views.points.shape)
    shown = predicted(solved.fit, to_lamp[None], views.to_eye)[0]
    value = learnt.added(shown, to_lamp) * held.lamps[0].direction_and_irradiance(views.points)[1]
    known = held.mask[views.rows, views.columns]
    true = held.values[views.rows, views.columns][known]
    outside = learnt.outside(towards)
    return {
        "outside_deg": float(np.degrees(outside)),
        "before": float(np.hypot(learnt.error, departure.photograph)),
        "expected": float(np.hypot(learnt.forecast.error(outside), departure.photograph)),
        "found": float(np.sqrt(np.mean((value.T[known] - true) ** 2) / np.mean(true**2))),
    }


def main(
    folder: Positional[Path], out: Path, objects: tuple[str, ...] = OBJECTS, shrink: int = 4, force: bool = False
) -> None:
    """Study forecasts.

    Args:
        folder: the photographs of uw_psm.
        out: the record, a JSON file.
        objects: names of its objects.
        shrink: photographs are means over squares of so many pixels.
        force: overwrite the record.
    """
    with hg.whole_file(out, force) as partial:
        rows = forecast_study(folder, objects, shrink)
        hg.write_json(partial, {"hagoromo": hg.__version__, "rows": rows})
    inside = [row for row in rows if row["outside_deg"] < 0.1]
    sets = {"inside": inside, "outside": [row for row in rows if row not in inside]}
    print_table("forecasts", COLUMNS, [_shown(name, part) for name, part in sets.items() if part])
    print(f"wrote {out}")


def _shown(name: str, rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    before, expected, found = (np.array([row[key] for row in rows]) for key in ("before", "expected", "found"))
    means = (f"{np.sqrt(np.mean(one**2)):.3f}" for one in (before, expected, found))
    return name, str(len(rows)), *means, f"{np.sqrt(np.mean((found / expected) ** 2)):.2f}"


if __name__ == "__main__":
    tyro.cli(main)
