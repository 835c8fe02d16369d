"""The study of spectra from colours: 28 cameras, a chart and people's skin, against what others do.

    python -m studies.spectra ../shared/data --out out/spectra

Enters: a folder with camera_sensitivities/camspec_28_cameras.csv and nist_skin/. Leaves: results.json, report.html.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tyro.conf import Positional

import hagoromo as hg
from studies.command import command
from studies.spectra_bench import CAMERAS, SOURCES, SPECTRA_NOISE, TARGETS, SpectraBench, read_bench
from studies.spectra_cases import SpectraCase, chart_case, skin_cases, study_case, surfaces_case
from studies.spectra_report import write_spectra_report
from studies.spectra_rivals import study_recoveries, study_rivals
from studies.spectra_row import SpectraRow, percentiles
from studies.table import print_table

SKIN_FILE = Path("nist_skin") / "nist_skin_70_subjects_250_1000nm.csv"
SLOW = 7  # of the cameras, every seventh where a method takes minutes over all


def spectra_study(
    folder: str | Path, out: str | Path, force: bool = False, progress: hg.Progress = hg.silent
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    with hg.whole_folder(out, force) as home:
        progress(0.0, "cameras")
        bench = read_bench(Path(folder) / CAMERAS)
        few = SpectraBench(dict(list(bench.cameras.items())[::SLOW]), bench.colours)
        skin = hg.read_spectra(Path(folder) / SKIN_FILE)
        chart, skins = chart_case(skin), skin_cases(skin)
        rows = []
        for i, sources in enumerate(SOURCES):
            progress(0.05 + 0.05 * i, f"chart, {sources}")
            rows.append(ours(chart, bench, sources))
        for i, case in enumerate(skins):
            progress(0.25 + 0.1 * i, case.name)
            rows.append(ours(case, bench, "D65"))
        progress(0.4, "surfaces kept out")
        kept_out = surfaces_case()
        rows.append(ours(kept_out, few, "D65"))
        for case, cameras in ((chart, bench), (skins[0], bench), (kept_out, few)):
            progress(0.5, f"{case.name}, other methods")
            rows += [SpectraRow(case.name, "D65", name, of, {}) for name, of in study_rivals(case, cameras).items()]
        progress(0.55, "recoveries")
        rows += [SpectraRow("chart", "D65", name, of, {}) for name, of in study_recoveries(chart, few).items()]
        record: dict[str, Any] = {
            "hagoromo": hg.__version__,
            "noise": SPECTRA_NOISE,
            "rows": [row.record() for row in rows],
        }
        record["cameras"] = list(bench.cameras)
        hg.write_json(home / "results.json", record)
        write_spectra_report(home / "report.html", record, rows, chart, bench)
        progress(1.0, "")
    return record


def ours(case: SpectraCase, bench: SpectraBench, sources: str) -> SpectraRow:
    """Our own estimate of a case: ΔE00, coverage of the 95 % regions, the reading of every other camera."""
    scores = study_case(case, bench, sources)
    other = {lamp: percentiles(100.0 * errors) for lamp, errors in scores["camera_b"].items()}
    more = {"camera_b_percent": other} | {key: scores[key] for key in ("coverage", "camera_b_coverage", "probability")}
    return SpectraRow(case.name, sources, "hagoromo", scores["delta_e"], more)


def main(folder: Positional[Path], out: Path, force: bool = False) -> None:
    """Study spectra from colours with the data in FOLDER.

    Args:
        folder: with camera_sensitivities and nist_skin.
        out: where to write results.json and report.html.
        force: replace an existing result.
    """
    with hg.progress_bar("spectra from colours") as progress:
        record = spectra_study(folder, out, force, progress)
    columns = ("case", "photographed under", "method", *TARGETS)
    print_table("ΔE00, median / 95th percentile, and coverage of 95 % regions", columns, map(_cells, record["rows"]))
    print(f"wrote {out / 'report.html'}")


def _cells(row: dict[str, Any]) -> list[str]:
    cells = [f"{of['median']:.2f} / {of['p95']:.2f}" for of in row["delta_e_2000"].values()]
    if "coverage" in row:
        shares = row["coverage"].values()
        cells = [f"{cell} · {100 * share:.0f} %" for cell, share in zip(cells, shares, strict=True)]
    return [row["case"], row["sources"], row["method"], *cells]


if __name__ == "__main__":
    command(main)
