"""The study of what limits a relit photograph: causes of its error, each taken away by an oracle.

    python -m studies.relit_limits ../shared/data/uw_psm --out out/relit_limits

Enters: the folder of the uw_psm set (see `uw_psm`); photographs are halved, or more (`--shrink`). Leaves: results.json
and table.md, which docs/relighting.md has. An oracle uses the photograph that is kept aside: it shows what is left when
one cause is gone, and is no prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.image.relight.learnt import Learnt, learn
from hagoromo.measurement.normals.normals import least_squares_fit
from studies.command import command
from studies.predicted_photograph import forecast
from studies.relit_objects import HELD
from studies.rig import evened, flat_field, unevenness
from studies.table import print_table
from studies.uw_psm import OBJECTS, read_lamps, read_object, shrunk

Array = NDArray[np.float64]
COLUMNS = {
    "lambert": "Lambert",
    "fit": "fit",
    "shadows": "fit, shadows learnt",
    "learnt": "fit, shadows and misfit learnt",
    "gain": "the same, oracle: the lamp's strength",
    "plane": "the same, oracle: the lamp's strength and fall-off",
    "seen": "oracle: a fit that has seen the photograph",
    "lambert_rig": "Lambert, lamps evened by other objects",
    "learnt_rig": "learnt, lamps evened by other objects",
    "noise": "noise",
}


def relit_limits(
    folder: str | Path, shrink: int = 2, progress: hg.Progress = hg.silent
) -> dict[str, dict[str, list[float]]]:
    """Relative root mean square errors, by object and column, of each photograph of HELD.

    Photographs are means over squares of `shrink` pixels.
    """
    lamps = read_lamps(folder)[1]
    captures = {name: shrunk(read_object(folder, name, lamps), shrink) for name in OBJECTS}
    whole = {}
    for i, (name, capture) in enumerate(captures.items()):
        progress(0.4 * i / len(captures), f"all lamps, {name}")
        whole[name] = hg.solve_normals(capture)
    rigs = {name: unevenness(solved) for name, solved in whole.items()}
    results = {}
    for i, (name, capture) in enumerate(captures.items()):
        progress(0.4 + 0.6 * i / len(captures), name)
        others = [rig for other, rig in rigs.items() if other != name]
        even = evened(capture, others, flat_field(others, captures[name].photographs[0].mask.shape))
        plain, rig = _errors(capture), _errors(even)
        results[name] = plain | {f"{key}_rig": rig[key] for key in ("lambert", "learnt")}
        results[name]["seen"] = [_seen(capture, whole[name], number) for number in HELD]
    progress(1.0, "")
    return results


def _errors(capture: hg.Capture) -> dict[str, list[float]]:
    """Errors of the photographs of HELD, predicted from the others of `capture`."""
    rest = replace(capture, photographs=tuple(p for k, p in enumerate(capture.photographs) if k not in HELD))
    camera, solved = capture.photographs[0].camera, hg.solve_normals(rest)
    distance = float(np.linalg.norm(camera.position))
    points = hg.points_from_normals(solved.normals, camera, distance, solved.variance)
    learnt = learn(replace(rest, points=points), solved)
    assert learnt is not None
    views, errors = hg.views_from_capture(rest), {key: [] for key in COLUMNS}
    lambert = least_squares_fit(views)
    for number in HELD:
        photograph, to_lamp = capture.photographs[number], np.asarray(capture.photographs[number].lamps[0].to_lamp)
        of = _Compared(photograph, solved.views)
        fit = forecast(solved.fit, solved.views, to_lamp)
        everywhere = np.broadcast_to(to_lamp, (fit.shape[1], 3))
        found = learnt.added(fit, everywhere)
        errors["lambert"].append(_Compared(photograph, views).error(forecast(lambert, views, to_lamp)))
        errors["fit"].append(of.error(fit))
        errors["shadows"].append(of.error(replace(learnt, neighbours=None).added(fit, everywhere)))
        errors["learnt"].append(of.error(found))
        errors["gain"].append(of.error(of.scaled(found, falls_off=False)))
        errors["plane"].append(of.error(of.scaled(found, falls_off=True)))
        errors["noise"].append(of.noise)
    return errors


def _seen(capture: hg.Capture, solved: hg.NormalMap, number: int) -> float:
    """Error of photograph `number`, which is one of those that `solved` was fitted to, with cast shadows and all."""
    camera = capture.photographs[0].camera
    points = hg.points_from_normals(solved.normals, camera, float(np.linalg.norm(camera.position)), solved.variance)
    learnt = learn(replace(capture, points=points), solved)
    assert isinstance(learnt, Learnt)
    views, to_lamp = solved.views, solved.views.to_lamp[number]
    fit = forecast(solved.fit, views, to_lamp.mean(axis=0) / np.linalg.norm(to_lamp.mean(axis=0)))
    found = solved.fit.evenness(views.place)[number] * replace(learnt, neighbours=None).added(fit, to_lamp)
    return _Compared(capture.photographs[number], views).error(found)


class _Compared:
    """A photograph at the pixels of `views`, of which all in its mask are compared."""

    def __init__(self, photograph: hg.Photograph, views: hg.Views) -> None:
        self.mask = photograph.mask[views.rows, views.columns]
        light = views.light[0].T
        self.true = (photograph.values[views.rows, views.columns] / light).T.astype(np.float64)
        self.scale = float(np.sqrt(np.mean(self.true[:, self.mask] ** 2)))
        variance = (photograph.variance[views.rows, views.columns] / light**2).T
        self.noise = float(np.sqrt(np.mean(variance[:, self.mask]))) / self.scale
        self.place = views.place

    def error(self, prediction: Array) -> float:
        """Relative root mean square error of a prediction (C, P)."""
        return float(np.sqrt(np.mean((prediction - self.true)[:, self.mask] ** 2))) / self.scale

    def scaled(self, prediction: Array, falls_off: bool) -> Array:
        """`prediction` times the factor, constant or linear over the image, that leaves least squares."""
        shapes = [np.ones(len(self.place)), *(self.place.T if falls_off else ())]
        columns = np.stack([(prediction * shape)[:, self.mask].ravel() for shape in shapes], axis=1)
        factors = np.linalg.lstsq(columns, self.true[:, self.mask].ravel(), rcond=None)[0]
        return prediction * (np.stack(shapes, axis=1) @ factors)


def page(results: dict[str, dict[str, list[float]]], shrink: int) -> str:
    """The table as Markdown: errors in %, and how much less than Lambert's."""
    held = ", ".join(map(str, HELD))
    lines = [
        f"Relative root mean square error [%], mean of lamps {held}, kept aside; photographs of 1/{shrink} size.",
        "In brackets: how many per cent less it is than least-squares Lambert's on the same photographs; of evened "
        "Lambert, than of plain Lambert.",
        "",
        "| object | " + " | ".join(COLUMNS.values()) + " |",
        "|---" * (len(COLUMNS) + 1) + "|",
    ]
    for name, errors in results.items():
        lines.append(f"| {name} | " + " | ".join(_cells(errors)) + " |")
    return "\n".join(lines) + "\n"


def _cells(errors: dict[str, list[float]]) -> list[str]:
    means, cells = {key: float(np.mean(errors[key])) for key in COLUMNS}, []
    for key, mean in means.items():
        lambert = means["lambert_rig" if key.endswith("_rig") else "lambert"]
        bare = key in ("lambert", "noise")
        by = f"{100 * (1 - mean / (means['lambert'] if key == 'lambert_rig' else lambert)):+.0f}"
        cells.append(f"{100 * mean:.1f}" if bare else f"{100 * mean:.1f} ({by})")
    return cells


def main(folder: Positional[Path], out: Path, shrink: int = 2, force: bool = False) -> None:
    """Take the error of relit photographs apart.

    Args:
        folder: the uw_psm set.
        out: folder to write.
        shrink: pixels of a side of the squares over which photographs are averaged.
        force: replace an existing folder.
    """
    with hg.whole_folder(out, force) as home, hg.progress_bar("limits of relit photographs") as progress:
        results = relit_limits(folder, shrink, progress)
        record = {"hagoromo": hg.__version__, "held": list(HELD), "shrink": shrink, "objects": results}
        hg.write_json(home / "results.json", record)
        (home / "table.md").write_text(page(results, shrink), encoding="utf-8", newline="\n")
    rows: Sequence[list[str]] = [[name, *_cells(errors)] for name, errors in results.items()]
    print_table("what limits a relit photograph [%]", ("object", *COLUMNS.values()), rows)


if __name__ == "__main__":
    command(main)
