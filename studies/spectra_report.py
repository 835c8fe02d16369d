"""Report of the spectra study: the table, how errors are distributed, the chart's spectra and the colour regions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.files.plot import panels, svg_text
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from studies.spectra_bench import TARGETS, SpectraBench
from studies.spectra_cases import SpectraCase, estimate
from studies.spectra_row import SpectraRow

SHOWN_METHODS = ("hagoromo", "3×3 matrix", "root polynomial", "Wiener")
BAR_COLOURS = ("#1f4e8c", "#b5651d", "#3b7d5a", "#8a8a8a")
CAMERA = "Canon 5DMarkII"  # of the drawn spectra; the first camera where it is not in the set


def write_spectra_report(
    path: Path, record: dict[str, Any], rows: Sequence[SpectraRow], chart: SpectraCase, bench: SpectraBench
) -> None:
    """Write the page to `path`: one self-contained HTML file."""
    camera = CAMERA if CAMERA in bench.cameras else next(iter(bench.cameras))
    charts = []
    for sources in ("D65", "filters"):
        estimates = estimate(chart, bench.readings(camera, sources), np.random.default_rng(0))
        charts.append(
            {
                "sources": sources,
                "spectra": hg.page_drawing(_spectra(chart, estimates), f"Spectra of the chart under {sources}"),
                "regions": hg.page_drawing(
                    _regions(chart, estimates, bench.colours["A"]), f"Chromaticities, {sources}"
                ),
            }
        )
    head = ("case", "photographed under", "method", *(f"ΔE00 {lamp}" for lamp in TARGETS))
    hg.write_page(
        path,
        "spectra.html.j2",
        "studies",
        record=record,
        head=(*head, "coverage of the 95 % regions"),
        rows=[_cells(row) for row in record["rows"]],
        camera_rows=[_camera_cells(row) for row in record["rows"] if "camera_b_percent" in row],
        shares=hg.page_drawing(_shares(rows), "Cumulative distribution of the colour errors of four methods"),
        camera=camera,
        charts=charts,
    )


def _cells(row: dict[str, Any]) -> list[str]:
    scores = [f"{of['median']:.2f} / {of['p95']:.2f}" for of in row["delta_e_2000"].values()]
    held = ", ".join(f"{100 * share:.1f} %" for share in row.get("coverage", {}).values())
    return [row["case"], row["sources"], row["method"], *scores, held]


def _camera_cells(row: dict[str, Any]) -> list[str]:
    scores = [f"{of['median']:.2f} / {of['p95']:.2f}" for of in row["camera_b_percent"].values()]
    probabilities = ", ".join(f"{name} {share:.3f}" for name, share in row["probability"].items())
    return [row["case"], row["sources"], *scores, f"{100 * row['camera_b_coverage']:.1f} %", probabilities]


def _shares(rows: Sequence[SpectraRow]) -> str:
    figure, axes = panels(len(TARGETS), 10.0, 3.2)
    chosen = {
        row.method: row for row in rows if (row.case, row.sources) == ("chart", "D65") and row.method in SHOWN_METHODS
    }
    for axis, lamp in zip(axes, TARGETS, strict=True):
        for method, colour in zip(SHOWN_METHODS, BAR_COLOURS, strict=True):
            errors = np.sort(chosen[method].delta_e[lamp].ravel())
            axis.plot(errors, np.linspace(0.0, 1.0, len(errors)), color=colour, label=method)
        axis.set_xlim(0.0, 6.0)
        axis.set_ylim(0.0, 1.0)
        axis.set_title(f"D65 → {lamp}", fontsize=10)
        axis.set_xlabel("ΔE00", fontsize=9)
    axes[0].set_ylabel("share below", fontsize=9)
    axes[-1].legend(fontsize=8, frameon=False, loc="lower right")
    return svg_text(figure)


def _spectra(case: SpectraCase, estimates: Sequence[hg.SpectrumEstimate]) -> str:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    axes = figure.subplots(4, 6, sharex=True, sharey=True)
    for axis, truth, estimate_of in zip(axes.flat, case.tested, estimates, strict=True):
        half = 1.96 * estimate_of.standard_error
        axis.fill_between(
            WAVELENGTHS, estimate_of.values - half, estimate_of.values + half, color="#9db7d5", linewidth=0
        )
        axis.plot(WAVELENGTHS, estimate_of.values, color="#1f4e8c", linewidth=1.2)
        axis.plot(WAVELENGTHS, truth, color="black", linewidth=0.9)
        axis.set_xlim(400.0, 700.0)
        axis.set_ylim(0.0, 1.0)
        axis.tick_params(labelsize=7)
    figure.supxlabel("wavelength [nm]", fontsize=9)
    figure.supylabel("reflectance", fontsize=9)
    return svg_text(figure)


def _regions(case: SpectraCase, estimates: Sequence[hg.SpectrumEstimate], colours: np.ndarray) -> str:
    """95 % ellipses of the chromaticities x, y, to first order in the errors."""
    figure, (axis,) = panels(1, 6.4, 4.6)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = np.sqrt(5.991) * np.stack([np.cos(turn), np.sin(turn)])  # χ² of two degrees of freedom at 95 %
    for truth, estimate_of in zip(case.tested, estimates, strict=True):
        xyz, total = colours @ estimate_of.values, float(np.sum(colours @ estimate_of.values))
        slope = (np.eye(3) - np.outer(xyz, np.ones(3)) / total)[:2] / total @ colours
        root = np.linalg.cholesky(slope @ estimate_of.covariance @ slope.T)
        x, y = xyz[:2, None] / total + root @ circle
        axis.plot(x, y, color="#1f4e8c", linewidth=0.8)
        true = colours @ truth
        axis.plot(*(true[:2] / true.sum()), "k.", markersize=3)
    axis.set_xlabel("x", fontsize=9)
    axis.set_ylabel("y", fontsize=9)
    return svg_text(figure)
