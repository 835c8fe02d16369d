"""The study of forecasts: relative errors of photographs kept aside, beside those that were expected of them.

    python -m studies.forecasts ../shared/data/uw_psm --out out/forecasts.json

The other photographs are measured, and say how far off one under a further lamp will be. Of real objects each lamp is
kept aside in turn. Of simulated ones, with evenly and unevenly strong lamps, lamps within MEASURED_TILT of the camera's
axis are measured, but for some; these, and lamps far outside, are kept aside. Predictions are the fit's on its normals,
in the cast shadows of its own surface, as boxes throw them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.image.relight.forecast import ShownLight
from hagoromo.image.relight.learnt import learn
from hagoromo.measurement.lamp_departure import lamp_departure
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.surface.depth import surface_from_normals
from studies.cast_shadow import lit_share
from studies.command import command
from studies.glossy_objects import OBJECTS as SIMULATED
from studies.glossy_objects import ROUGH, STRENGTH_ERROR, glossy_object
from studies.table import print_table
from studies.uw_psm import FOCAL, PIXEL, read_lamps, read_object, shrunk

REAL = ("gray", "cat", "owl")
MEASURED_TILT, FAR_TILT = 48.0, 52.0  # [°] of a lamp from the camera's axis: measured below, kept aside above
TILTS, LAMPS, SIZE = 78.0, 36, 72  # largest tilt [°], lamps and pixels of simulated objects
UNEVEN = 0.04  # relative error of the strengths stated, of uneven lamps
RANGES = {"inside": (-1.0, 0.1), "outside by up to 20°": (0.1, 20.0), "outside by more": (20.0, 90.0)}
COLUMNS = "objects", "lamps", "photographs", "expected", "found", "found / expected"  # medians


def real_rows(folder: Path, objects: Sequence[str], shrink: int) -> list[dict[str, Any]]:
    """A row a photograph: set, object, outside [°], errors expected and found."""
    lamps = read_lamps(folder)[1]
    rows = []
    for name in objects:
        capture = shrunk(read_object(folder, name, lamps), shrink)
        for number in range(len(capture.photographs)):
            rows += _kept_aside(capture, [number], {"set": f"real, {name}", "object": name})
    return rows


def simulated_rows(objects: Sequence[str], seeds: int) -> list[dict[str, Any]]:
    """As `real_rows`, of simulated objects."""
    rows = []
    for name in objects:
        for kind, error in (("even", STRENGTH_ERROR), ("uneven", UNEVEN)):
            for seed in range(seeds):
                capture, _ = glossy_object(name, seed, SIZE, LAMPS, TILTS, error)
                towards = np.array([one.lamps[0].to_lamp for one in capture.photographs])
                tilt = np.degrees(np.arccos(np.clip(towards[:, 2], -1.0, 1.0)))
                near, far = np.flatnonzero(tilt < MEASURED_TILT), np.flatnonzero(tilt > FAR_TILT)
                captured = replace(capture, photographs=tuple(capture.photographs[k] for k in [*near, *far]))
                kept = [*range(2, len(near), 4), *range(len(near), len(near) + len(far))]
                which = "rough" if name in ROUGH else "glossy"
                rows += _kept_aside(captured, kept, {"set": f"{which}, {kind} lamps", "object": name, "seed": seed})
    return rows


def _kept_aside(capture: hg.Capture, kept: Sequence[int], said: dict[str, Any]) -> list[dict[str, Any]]:
    """Photographs `kept` aside, predicted by the others."""
    held = [capture.photographs[k] for k in kept]
    rest = replace(capture, photographs=tuple(p for k, p in enumerate(capture.photographs) if k not in kept))
    solved, camera = hg.solve_normals(rest), capture.photographs[0].camera
    surface = surface_from_normals(
        solved.normals, camera, FOCAL * PIXEL, solved.own_variance, draws=0, modes=solved.modes
    )
    views, points = solved.views, surface.points

    def passed(lamp: hg.Lamp) -> np.ndarray:
        return lit_share(points, camera, np.asarray(lamp.to_lamp))[views.rows, views.columns]

    shares = np.stack([passed(one.lamps[0]) for one in rest.photographs])
    learnt = learn(replace(rest, points=points, normals=solved.normals), solved, passed=shares)
    departure = lamp_departure(solved, tuple(one.lamps[0] for one in rest.photographs))
    assert learnt is not None and departure is not None
    rows = []
    for photograph in held:
        (lamp,) = photograph.lamps
        share, to_lamp = passed(lamp), np.broadcast_to(np.asarray(lamp.to_lamp), views.points.shape)
        shown = share * predicted(solved.fit, to_lamp[None], views.to_eye)[0]
        added = learnt.added(shown, to_lamp, share)
        value = added * lamp.direction_and_irradiance(views.points)[1]
        known = photograph.mask[views.rows, views.columns]
        true = photograph.values[views.rows, views.columns][known]
        direction = np.asarray(lamp.to_lamp)
        outside = learnt.outside(direction)
        found = float(np.sqrt(np.mean((value.T[known] - true) ** 2) / np.mean(true**2)))
        expected = learnt.forecast.expected(direction, ShownLight.of(added), departure.photographs)
        rows.append(said | {"outside_deg": float(np.degrees(outside)), "expected": expected, "found": found})
    return rows


def main(
    folder: Positional[Path],
    out: Path,
    real: tuple[str, ...] = REAL,
    simulated: tuple[str, ...] = SIMULATED,
    seeds: int = 1,
    shrink: int = 4,
    force: bool = False,
) -> None:
    """Study forecasts.

    Args:
        folder: the photographs of uw_psm.
        out: the record, a JSON file.
        real: names of its objects.
        simulated: names of simulated objects.
        seeds: how many of each.
        shrink: real photographs are means over squares of so many pixels.
        force: overwrite the record.
    """
    with hg.whole_file(out, force) as partial:
        rows = simulated_rows(simulated, seeds) + (real_rows(folder, real, shrink) if real else [])
        hg.write_json(partial, {"hagoromo": hg.__version__, "rows": rows})
    print_table("forecasts: medians", COLUMNS, _shown(rows))
    print(f"wrote {out}")


def _shown(rows: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    shown: list[tuple[str, ...]] = []
    for name in dict.fromkeys(row["set"] for row in rows):
        for where, (low, high) in RANGES.items():
            part = [row for row in rows if row["set"] == name and low < row["outside_deg"] <= high]
            if part:
                expected, found = (np.array([row[key] for row in part]) for key in ("expected", "found"))
                medians = (f"{np.median(one):.3f}" for one in (expected, found))
                shown.append((name, where, str(len(part)), *medians, f"{np.median(found / expected):.2f}"))
    return shown


if __name__ == "__main__":
    command(main)
