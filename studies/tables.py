"""The study of tables: measured materials laid out as files of MERL and RGL, read and fitted as `hagoromo fit` does.

    python -m studies.tables ../shared/data/merl_fits --out out/tables

Enters: a folder with merl_sgd.json and merl_abc.json, two published fits of each material. Leaves: results.json and
tables.md, which belongs to docs. One published fit of a material is the truth, with noise; our fit of its table is
compared with the other published fit, which its authors fitted to the measurement that both stand for.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo_formats.reflectances.merl import BINS, SCALE, directions, read_merl
from hagoromo_formats.reflectances.rgl import read_rgl
from hagoromo_formats.reflectances.rgl_out import write_rgl_table
from hagoromo_formats.relightable.measured_brdf import CHANNELS, FAINT, measured_brdf
from studies.command import command
from studies.merl_truth import Truth, read_truths

Array = NDArray[np.float64]
Brdf = Callable[[Array, Array], Array]  # unit directions (N, 3) to lamp and eye → (N, 3) [1/sr]
NOISE = 0.01  # relative, of each number in a file
EVERY = 5  # of the materials, in the order of the files, one in so many
WIDTHS = (0.02, 0.1)  # [rad] that the places of RGL's tables are laid out for: no width of the truth is used
HORIZON = 0.01  # least cosine of a bin of MERL that holds a value
READERS = {"MERL": read_merl, "RGL": read_rgl}
UP = (0.0, 0.0, 1.0)
FITTED = np.cos(np.radians(80.0))  # least cosine of lamp and eye that a fit uses, and that errors are stated for


@dataclass(frozen=True)
class TableRow:
    """One material in one layout: medians over directions and channels of |value − truth| / truth.

    layout: of the values read, noise included. ours: of the fit. other: of the other published fit of the material.
    """

    truth: str
    material: str
    file: str
    layout: float
    ours: float
    other: float


def tables_study(folder: Path, out: Path, force: bool, progress: hg.Progress = hg.silent) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    truths = read_truths(folder)
    first, second = truths
    names = list(truths[first])[::EVERY]
    rows = []
    with hg.whole_folder(out, force) as home, tempfile.TemporaryDirectory() as kept:
        cases = [(kind, other, name) for kind, other in ((first, second), (second, first)) for name in names]
        for number, (kind, other, name) in enumerate(cases):
            progress(number / len(cases), name)
            random = np.random.default_rng([0, number])
            rows += table_rows(kind, name, truths[kind][name], truths[other][name], Path(kept), random)
        record = {
            "hagoromo": hg.__version__,
            "noise": NOISE,
            "materials": len(names),
            "rows": [asdict(r) for r in rows],
        }
        hg.write_json(home / "results.json", record)
        parts = {"record": record, "summary": summary(rows), "rows": rows, "every": EVERY, "widths": WIDTHS}
        (home / "tables.md").write_text(
            hg.page_text("tables.md.j2", "studies", **parts), encoding="utf-8", newline="\n"
        )
    return record


def table_rows(
    kind: str, name: str, truth: Truth, other: Truth, kept: Path, random: np.random.Generator
) -> list[TableRow]:
    """One material in both layouts."""
    exact, rival = brdf_of(truth), brdf_of(other)

    def noisy(to_lamp: Array, to_eye: Array) -> Array:
        values = exact(to_lamp, to_eye)
        return values * (1.0 + NOISE * random.standard_normal(values.shape))

    files = {"MERL": kept / "a.binary", "RGL": kept / "a.bsdf"}
    write_merl(files["MERL"], noisy)
    write_rgl_table(files["RGL"], _sent(noisy), WIDTHS, CHANNELS, "rgb", name, force=True)
    rows = []
    for layout, file in files.items():
        table = READERS[layout](file)
        material = table.with_relative_error(NOISE).fit(name)
        used = np.minimum(table.to_lamp[:, 2], table.to_eye[:, 2]) > FITTED
        lamp, eye = table.to_lamp[used], table.to_eye[used]
        clean = exact(lamp, eye)
        found = measured_brdf(material, None, None).reflectance.evaluate(UP, lamp, eye, CHANNELS)
        errors = (table.values[used], found / (FAINT * lamp[:, 2:]), rival(lamp, eye))
        rows.append(TableRow(kind, name, layout, *(_median_error(values, clean) for values in errors)))
    return rows


def brdf_of(truth: Truth) -> Brdf:
    """The BRDF of a published fit, whose values are times the cosine of the incidence."""

    def brdf(to_lamp: Array, to_eye: Array) -> Array:
        cosines = hg.ReflectanceTable(to_lamp, to_eye, np.zeros((len(to_lamp), 1))).cosines
        return truth(cosines) / to_lamp[:, 2:]

    return brdf


def write_merl(path: Path, brdf: Brdf) -> None:
    """A file of MERL: the BRDF at the middle of each bin, −1 below the horizon."""
    places = np.meshgrid(*(np.arange(n) for n in BINS), indexing="ij")
    angles = ((places[0] + 0.5) / 90) ** 2 * np.pi / 2, (places[1] + 0.5) / 180 * np.pi, (places[2] + 0.5) / 180 * np.pi
    lamp, eye = directions(*(angle.ravel() for angle in angles))
    values = np.full((len(lamp), 3), -1.0)
    above = (lamp[:, 2] > HORIZON) & (eye[:, 2] > HORIZON)
    values[above] = brdf(lamp[above], eye[above]) / SCALE
    path.write_bytes(np.array(BINS, "<i4").tobytes() + values.T.astype("<f8").tobytes())


def summary(rows: list[TableRow]) -> list[list[str]]:
    """A line for each truth and layout: quartiles over the materials, and how often our fit is nearer."""
    lines = []
    for kind, layout in dict.fromkeys((row.truth, row.file) for row in rows):
        chosen = [row for row in rows if (row.truth, row.file) == (kind, layout)]
        ours, other = (np.array([getattr(row, key) for row in chosen]) for key in ("ours", "other"))
        cells = [f"{100 * np.median([row.layout for row in chosen]):.1f} %"]
        for errors in (ours, other):
            quartiles = np.percentile(errors, (25, 50, 75))
            cells.append(" / ".join(f"{100 * one:.1f}" for one in quartiles) + f" %, worst {100 * errors.max():.0f} %")
        lines.append([kind, layout, *cells, f"{100 * np.mean(ours < other):.0f} %"])
    return lines


def _sent(brdf: Brdf) -> Brdf:
    """f, times the cosine of the incidence, 0 below the horizon."""

    def sent(to_lamp: Array, to_eye: Array) -> Array:
        values = np.zeros((len(to_lamp), 3))
        above = (to_lamp[:, 2] > 1e-4) & (to_eye[:, 2] > 1e-4)
        values[above] = brdf(to_lamp[above], to_eye[above]) * to_lamp[above, 2:]
        return values

    return sent


def _median_error(values: Array, clean: Array) -> float:
    return float(np.median(np.abs(values - clean) / clean))


def main(folder: Positional[Path], out: Path, force: bool = False) -> None:
    """Study the published fits of MERL in FOLDER as tables.

    Args:
        folder: with merl_sgd.json and merl_abc.json.
        out: where to write results.json and tables.md.
        force: replace an existing result.
    """
    with hg.progress_bar("tables") as progress:
        record = tables_study(folder, out, force, progress)
    for line in summary([TableRow(**row) for row in record["rows"]]):
        print("; ".join(line))
    print(f"wrote {out / 'tables.md'}")


if __name__ == "__main__":
    command(main)
