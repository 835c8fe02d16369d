"""The study of real photographs: lamps, normals, materials, and the prediction of every photograph from the others.

    python -m studies.real ../shared/data/uw_psm --out out/real

Enters: the folder of the uw_psm set (see `uw_psm`). Leaves: results.json, pictures and report.html.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from studies.command import command
from studies.encoding import encoding_study
from studies.leave_one_out import NORMAL_METHODS
from studies.object_study import study_object
from studies.real_report import write_pictures, write_real_report
from studies.rig import LampUnevenness, unevenness
from studies.table import print_table
from studies.uw_psm import LAMPS, OBJECTS, read_lamps, read_object

Array = NDArray[np.float64]


def real_study(
    folder: str | Path,
    out: str | Path,
    objects: Sequence[str] = OBJECTS,
    force: bool = False,
    progress: hg.Progress = hg.silent,
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    with hg.whole_folder(out, force) as home:
        progress(0.0, "lamps")
        _, lamps = read_lamps(folder)
        captures = {name: read_object(folder, name, lamps) for name in OBJECTS}
        progress(0.01, "response")
        response = encoding_study(captures)
        rigs: dict[str, LampUnevenness] = {}
        for i, (name, capture) in enumerate(captures.items()):
            progress(0.1 + 0.1 * i / len(captures), f"lamps over {name}")
            rigs[name] = unevenness(hg.solve_normals(capture))
        studies = []
        for i, name in enumerate(objects):
            others = [one for other, one in rigs.items() if other != name]
            of_object = hg.part_of(progress, 0.2 + 0.78 * i / len(objects), 0.78 / len(objects))
            studies.append(study_object(folder, captures[name], others, range(LAMPS), of_object))
        record = {
            "hagoromo": hg.__version__,
            "lamps": [{**lamp.record(), "off_their_reading_deg": off} for lamp, off in _agreement(folder, lamps)],
            "response": response,
            "methods": NORMAL_METHODS,
            "objects": {study.name: study.record() for study in studies},
        }
        hg.write_json(home / "results.json", record)
        for study in studies:
            write_pictures(study, home / study.name)
        write_real_report(home / "report.html", record, studies)
        progress(1.0, "")
    return record


def _agreement(folder: str | Path, lamps: Sequence[hg.LampReading]) -> list[tuple[hg.LampReading, dict[str, float]]]:
    """Each lamp with the angles [°] to the two readings that come with the set."""
    files = {
        "laboratory": "lights_from_chrome_ball_by_lab.txt",
        "author of the repository": "lights_by_repo_author.txt",
    }
    theirs = {who: read_directions(Path(folder) / file) for who, file in files.items()}
    off = {who: np.degrees(np.arccos(np.clip(_rows_dot(lamps, of), -1.0, 1.0))) for who, of in theirs.items()}
    return [(lamp, {who: float(angles[k]) for who, angles in off.items()}) for k, lamp in enumerate(lamps)]


def _rows_dot(lamps: Sequence[hg.LampReading], directions: Array) -> Array:
    return np.array([lamp.to_lamp @ row for lamp, row in zip(lamps, directions, strict=True)])


def read_directions(path: Path) -> Array:
    """(12, 3) unit directions of a file of the set."""
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    directions = np.array([[float(number) for number in row] for row in rows if len(row) == 3])
    if directions.shape != (LAMPS, 3):
        raise hg.InputError(f"{path} must hold {LAMPS} rows of three numbers: given {directions.shape}")
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def main(folder: Positional[Path], out: Path, force: bool = False) -> None:
    """Study the photographs of the set in FOLDER.

    Args:
        folder: uw_psm, with a folder per object.
        out: where to write results.json, the pictures and report.html.
        force: replace an existing result.
    """
    with hg.progress_bar("real photographs") as progress:
        record = real_study(folder, out, force=force, progress=progress)
    title, columns = "Kept-aside photographs: relative RMSE [%] · PSNR [dB]", ("method", *record["objects"])
    print_table(title, columns, [_cells(record, method) for method in NORMAL_METHODS])
    print(f"wrote {out / 'report.html'}")


def _cells(record: dict[str, Any], method: str) -> list[str]:
    means = [study["mean"][method] for study in record["objects"].values()]
    return [NORMAL_METHODS[method], *(f"{100 * m['relative_rmse']:.1f} · {m['psnr']:.1f}" for m in means)]


if __name__ == "__main__":
    command(main)
