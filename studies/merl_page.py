"""The page of the MERL study: its table and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

COLOURS = ("#1f4e8c", "#b5651d", "#3b7d5a")


def write_merl_page(home: Path, record: dict[str, Any]) -> None:
    """Write merl.md and merl.png to the folder `home`."""
    _plot(home / "merl.png", record)
    (home / "merl.md").write_text("\n".join(_lines(record)) + "\n", encoding="utf-8")


def _lines(record: dict[str, Any]) -> list[str]:
    lines = [
        "# Measured materials: Torrance–Sparrow against GGX",
        "",
        "*Made by `make merl`; every figure on this page is its output.*",
        "",
        f"The 80 materials of the MERL set, as two published fits of each, read in {record['directions']} pairs of "
        f"directions with {100 * record['noise']:g} % of noise a reading: lamp at 0–70° from the normal, eye at 0–90° "
        "from the mirror direction, in the plane of incidence and across it. Error of a material: the median over "
        "directions and channels of |fit − truth| / truth. Dichromatic Torrance–Sparrow (body colour, β, γ, n) and "
        "GGX + Lambert (SciPy, body colour, k_s, roughness, n) have six numbers each; *coloured* gives GGX a "
        "specular colour, eight numbers.",
        "",
        "| truth | model | first quartile | median | third quartile | worst |",
        "|---|---|---|---|---|---|",
    ]
    for kind, of in record["summary"].items():
        for method, figures in of["error"].items():
            cells = [f"{100 * figures[key]:.1f} %" for key in ("quartile_1", "median", "quartile_3")]
            worst = f"{100 * figures['worst']:.0f} % ({figures['worst_material']})"
            lines.append(f"| {kind} | {method} | {' | '.join(cells)} | {worst} |")
    lines += ["", "![Errors over the materials](figures/merl.png)", "", "## What the result says of it", ""]
    for kind, of in record["summary"].items():
        lines.append(
            f"* {kind}: of {of['materials']} materials {of['rejected']} are told as ill fitted (`lack_of_fit` in "
            f"materials.json, level {record['level']:g}); of the {of['off']} whose error is above three times the "
            f"noise, {of['off_and_told']}. Torrance–Sparrow is nearer than GGX + Lambert for {of['ours_better']}."
        )
    return lines


def _plot(path: Path, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    kinds = list(record["summary"])
    figure = Figure(figsize=(5.0 * len(kinds), 3.6), layout="constrained")
    axes = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    for axis, kind in zip(axes, kinds, strict=True):
        rows = [row for row in record["rows"] if row["truth"] == kind]
        for method, colour in zip(rows[0]["error"], COLOURS, strict=True):
            errors = np.sort([100.0 * row["error"][method] for row in rows])
            axis.step(errors, (np.arange(len(errors)) + 1.0) / len(errors), where="post", color=colour, label=method)
        axis.axvline(100.0 * record["noise"], color="#999", linewidth=0.8, linestyle=":")
        axis.set_xscale("log")
        axis.set_ylim(0.0, 1.0)
        axis.set_title(f"truth: {kind}", fontsize=10)
        axis.set_xlabel("median relative error of a material [%]", fontsize=9)
    axes[0].set_ylabel("share of the materials below", fontsize=9)
    axes[-1].legend(fontsize=8, frameon=False, loc="lower right")
    figure.savefig(path, dpi=120)
