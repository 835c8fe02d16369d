"""The page of the coverage study: its tables and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scipy.stats import beta

import hagoromo as hg

NOMINAL_COVERAGE = 0.95
LABELS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "n": "n", "nu": "ν", "specular_albedo": "specular albedo",
    "body_colour": "body colour", "interface_colour": "interface colour",
}  # fmt: skip
LINE_COLOURS = ("#1f4e8c", "#b5651d", "#3b7d5a")


def write_coverage_page(home: Path, record: dict[str, Any]) -> None:
    """Write coverage.md and coverage.png to the folder `home`."""
    _plot(home / "coverage.png", record)
    (home / "coverage.md").write_text(_page(record), encoding="utf-8", newline="\n")


def chance(held: float, of: int) -> tuple[float, float]:
    """Clopper–Pearson's 95 % interval of a share of which `held` in `of` were seen."""
    low = float(beta.ppf(0.025, held, of - held + 1)) if held else 0.0
    high = float(beta.ppf(0.975, held + 1, of - held)) if held < of else 1.0
    return low, high


def _page(record: dict[str, Any]) -> str:
    count = record["simulations"]
    low, high = (100.0 * edge for edge in chance(round(NOMINAL_COVERAGE * count), count))
    benches = []
    for name in dict.fromkeys(row["bench"] for row in record["rows"]):
        chosen = [row for row in record["rows"] if row["bench"] == name]
        rows = [
            [label, *(_cell(row, count) for row in chosen if row["quantity"] == key)] for key, label in LABELS.items()
        ]
        levels = dict.fromkeys(row["level"] for row in chosen)
        head = ["95 % interval of", *(f"full well {level}: coverage (identifiable)" for level in levels)]
        benches.append({"name": f"{name[0].upper()}{name[1:]}", "head": head, "rows": rows})
    return hg.page_text("coverage.md.j2", "studies", simulations=count, low=low, high=high, benches=benches)


def _cell(row: dict[str, Any], count: int) -> str:
    share = (
        f" ({100 * row['identifiable'] / count:.0f} %)"
        if row["quantity"] in ("alpha", "beta", "gamma", "n", "nu", "interface_colour")
        else ""
    )
    return f"{100 * row['hold'] / row['intervals']:.1f} %{share}"


def _plot(path: Path, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    benches = list(dict.fromkeys(row["bench"] for row in record["rows"]))
    figure = Figure(figsize=(4.2 * len(benches), 3.6), layout="constrained")
    axes = figure.subplots(1, len(benches), sharey=True, squeeze=False)[0]
    for axis, bench in zip(axes, benches, strict=True):
        rows = [row for row in record["rows"] if row["bench"] == bench]
        levels = list(dict.fromkeys(row["level"] for row in rows))
        for k, level in enumerate(levels):
            shift, colour = 0.2 * (k - 0.5 * (len(levels) - 1)), LINE_COLOURS[k % len(LINE_COLOURS)]
            of = [row for row in rows if row["level"] == level]
            share = [100.0 * row["hold"] / row["intervals"] for row in of]
            # channels of one simulation share their noise: they count as one
            held = [row["hold"] * record["simulations"] / row["intervals"] for row in of]
            edges = [[100.0 * edge for edge in chance(hold, record["simulations"])] for hold in held]
            bars = [[s - low for s, (low, _) in zip(share, edges, strict=True)],
                    [high - s for s, (_, high) in zip(share, edges, strict=True)]]  # fmt: skip
            places = [place + shift for place in range(len(of))]
            axis.errorbar(places, share, bars, fmt="o", markersize=4, capsize=3, color=colour, label=level)
        axis.axhspan(92.0, 98.0, color="#eee", zorder=0)
        axis.axhline(95.0, color="#999", linewidth=0.8, zorder=0)
        axis.set_xticks(
            range(len(LABELS)), [*LABELS.values()], fontsize=8, rotation=25, ha="right", rotation_mode="anchor"
        )
        axis.set_title(bench, fontsize=10)
        axis.set_ylim(84.0, 101.0)
    axes[0].set_ylabel("intervals that contain the truth [%]", fontsize=9)
    axes[-1].legend(
        fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, title="full well", title_fontsize=8
    )
    figure.savefig(path, dpi=120)
