"""The study of relit objects: of each of the real photographs' objects a page, three lamps held out at once.

    python -m studies.relit_objects ../shared/data/uw_psm --out out/relit

Enters: the folder of the uw_psm set (see `uw_psm`), and a seed of simulated glossy objects (see `glossy_objects`).
Leaves: a folder for each object with its capture and what `relight` writes, and index.html with the figures of all; and
prints a table: how much less the boxes miss of the photographs kept aside than least-squares Lambert on the same
photographs, over all pixels of the object, clipped ones cut off at white; and the same of further predictions.
The error that the measured photographs let expect stands beside, with the lamp as stated and if it were known.
With `--rig` each real object has the rig that the other five objects give, and Lambert is shown without it and with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.calibration.rig.calibrate_rig import object_readings, rig_of
from hagoromo.measurement.lamp_departure import solve_uneven_lamps
from studies.command import command
from studies.glossy_objects import GLOSSY, glossy_object
from studies.table import print_table
from studies.uw_psm import LAMPS, OBJECTS, read_lamps, read_object, shrunk

HELD = (0, 4, 8)  # numbers of the held-out lamps
EVERY = (*OBJECTS, *GLOSSY)
PREDICTIONS = {
    "boxes": "volume boxes, rendered",
    "boxes_learnt": "volume boxes, with shadows and misfit learnt from the photographs measured",
    "normals": "reflectance on the normals, no shadows",
    "learnt": "reflectance on the normals, with shadows and misfit learnt from the photographs measured",
    "lambert": "least-squares Lambert, a yardstick",
    "lambert_rig": "least-squares Lambert, lamps evened by the rig",
}
COMPARED = ("boxes_learnt", "boxes", "normals", "learnt")  # with least-squares Lambert
RIG_TITLES = ("Lambert with the rig", "boxes, learnt, better by")
COLUMNS = ("boxes, learnt", "boxes", "own forecast", "learnt")  # of these
TITLES = [
    "object",
    *COLUMNS,
    "Lambert",
    *(f"{column} better by" for column in COLUMNS),
    "covered",
    "expected",
    "lamp known",
]
MEANS = ("relative_rmse", "delta_e_2000", "psnr", "ssim")


def relit_objects(
    folder: str | Path,
    out: str | Path,
    objects: Sequence[str] = EVERY,
    force: bool = False,
    progress: hg.Progress = hg.silent,
    seed: int = 0,
    shrink: int = 1,
    rig: bool = False,
) -> dict[str, tuple[hg.Prediction, ...]]:
    """Relight each of `objects`, write everything to the folder `out`, and give the predictions of each.

    folder: of uw_psm, for its objects alone, whose photographs are means over squares of `shrink` pixels. seed: of the
    simulated ones. rig: whether real objects have a rig, measured on the others.
    """
    lamps = read_lamps(folder)[1] if set(objects) & set(OBJECTS) else ()
    needed = [name for name in OBJECTS if lamps and (rig or name in objects)]
    real = {name: shrunk(read_object(folder, name, lamps), shrink) for name in needed}
    readings = {name: object_readings(one, _solved(one)) for name, one in real.items()} if rig else {}
    results: dict[str, tuple[hg.Prediction, ...]] = {}
    expected: dict[str, tuple[float, float] | None] = {}
    with hg.whole_folder(out, force) as home:
        for i, name in enumerate(objects):
            progress(i / len(objects), name)
            (home / name).mkdir()
            capture = glossy_object(name, seed)[0] if name in GLOSSY else real[name]
            others = [one for other, one in readings.items() if other != name]
            hg.save_capture(capture, home / name / "capture")
            held = [f"{name} {k}" for k in HELD]
            used = rig_of(others) if name in readings else None
            relighting = hg.relight(home / name / "capture", hold=held, rig=used)
            relighting.save(home / name / "relit")
            hg.write_relight_report(home / name / "relit" / "report.html", relighting)
            results[name], expected[name] = relighting.predictions, relighting.expected
        titles = [*TITLES, *RIG_TITLES] if readings else TITLES
        rows = [_row(name, relit, expected[name]) for name, relit in results.items()]
        print_table("photographs kept aside", titles, rows)
        record = {name: [one.record() for one in relit] for name, relit in results.items()}
        stated = {"hagoromo": hg.__version__, "held": list(HELD), "expected": expected}
        hg.write_json(home / "results.json", {**stated, "objects": record})
        _write_index(home / "index.html", results)
        progress(1.0, "")
    return results


def _solved(capture: hg.Capture) -> hg.NormalMap:
    return solve_uneven_lamps(capture, float(np.linalg.norm(capture.photographs[0].camera.position)))


def _row(name: str, relit: Sequence[hg.Prediction], expected: tuple[float, float] | None) -> list[str]:
    """Mean relative errors of an object, the gain over Lambert, and the errors that were expected."""
    mean = {key: float(np.mean([one.compared[key].relative_rmse for one in relit])) for key in relit[0].compared}
    *ours, lambert = (mean[key] for key in (*COMPARED, "lambert"))
    covered = sum(one.compared["boxes"].pixels for one in relit) / sum(one.object_pixels for one in relit)
    gains = [f"{100 * (1 - error / lambert):+.0f} %" for error in ours]
    row = [name, *(f"{error:.4f}" for error in (*ours, lambert)), *gains, f"{100 * covered:.0f} %"]
    row += ["", ""] if expected is None else [f"{error:.4f}" for error in expected]
    if "lambert_rig" in mean:
        row += [f"{mean['lambert_rig']:.4f}", f"{100 * (1 - mean['boxes_learnt'] / mean['lambert_rig']):+.0f} %"]
    return row


def _write_index(path: Path, results: dict[str, tuple[hg.Prediction, ...]]) -> None:
    rows = []
    for name, relit in results.items():
        for key in relit[0].compared:
            text, figures = PREDICTIONS[key], [one.compared[key] for one in relit]
            means = {k: float(np.mean([getattr(f, k) for f in figures])) for k in MEANS}
            link = Markup('<a href="{0}/relit/report.html">{0}</a>').format(name)
            rows.append(
                [link, text, f"{100 * means['relative_rmse']:.1f} %", f"{means['delta_e_2000']:.2f}",
                 f"{means['psnr']:.1f}", f"{means['ssim']:.3f}"]
            )  # fmt: skip
    objects = []
    for name, relit in results.items():
        one = relit[0]
        shown = [("photograph, held out", one.photograph), *((PREDICTIONS[k], v) for k, v in one.predictions.items())]
        pictures = [hg.page_picture(hg.srgb_encode(view), f"{name}: {text}", text) for text, view in shown]
        objects.append({"name": name, "lamp": HELD[0], "pictures": pictures})
    hg.write_page(
        path,
        "relit_objects.html.j2",
        "studies",
        lamps=LAMPS,
        held=len(HELD),
        rows=rows,
        group=max(len(relit[0].compared) for relit in results.values()),
        objects=objects,
    )


def main(
    folder: Positional[Path],
    out: Path,
    objects: tuple[str, ...] = EVERY,
    force: bool = False,
    seed: int = 0,
    shrink: int = 1,
    rig: bool = False,
) -> None:
    """Relight the objects of the set.

    Args:
        folder: the uw_psm set.
        out: folder to write.
        objects: which of them.
        force: replace an existing folder.
        seed: of the simulated glossy objects.
        shrink: pixels of a side of the squares over which real photographs are averaged.
        rig: real objects under a rig that is measured on the others.
    """
    with hg.progress_bar("relit objects") as progress:
        relit_objects(folder, out, objects, force, progress, seed, shrink, rig)
    print(f"wrote {out / 'index.html'}")


if __name__ == "__main__":
    command(main)
