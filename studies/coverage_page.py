"""The page of the coverage study: its tables and plot, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scipy.stats import beta

NOMINAL = 0.95
LABELS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "n": "n", "specular_albedo": "specular albedo",
    "body_colour": "body colour",
}  # fmt: skip
COLOURS = ("#1f4e8c", "#b5651d", "#3b7d5a")


def write_coverage_page(home: Path, record: dict[str, Any]) -> None:
    """Write coverage.md and coverage.png to the folder `home`."""
    _plot(home / "coverage.png", record)
    (home / "coverage.md").write_text("\n".join(_lines(record)) + "\n", encoding="utf-8")


def chance(held: int, of: int) -> tuple[float, float]:
    """Clopper–Pearson's 95 % interval of a share of which `held` in `of` were seen."""
    low = float(beta.ppf(0.025, held, of - held + 1)) if held else 0.0
    high = float(beta.ppf(0.975, held + 1, of - held)) if held < of else 1.0
    return low, high


def _lines(record: dict[str, Any]) -> list[str]:
    count = record["simulations"]
    low, high = (100.0 * edge for edge in chance(round(NOMINAL * count), count))
    lines = [
        "# How often the intervals hold the truth",
        "",
        "*Made by `make coverage`; every figure on this page is its output.*",
        "",
        f"{count} materials are drawn for each bench and noise level (body albedo 0.1–0.8 per channel, γ 0.06–0.4 rad, "
        "n 1.3–1.7, β 0.05–1 /sr, or 0.0005–0.05 /sr where the gloss is faint), observed on a ball with shot and read "
        f"noise, and measured. Exact 95 % intervals would be seen to hold in {low:.1f}–{high:.1f} % of as many "
        "simulations. A parameter that is not told has a wide or one-sided interval, which must hold the truth at "
        "least as often; one lamp beside the camera cannot tell n, nor β without it.",
        "",
        "![Coverage](figures/coverage.png)",
    ]
    for bench in dict.fromkeys(row["bench"] for row in record["rows"]):
        chosen = [row for row in record["rows"] if row["bench"] == bench]
        levels = list(dict.fromkeys(row["level"] for row in chosen))
        lines += ["", f"## {bench[0].upper()}{bench[1:]}", ""]
        lines.append("| 95 % interval of | " + " | ".join(f"full well {level}: hold (told)" for level in levels) + " |")
        lines.append("|---|" + "---|" * len(levels))
        for key, label in LABELS.items():
            cells = [_cell(row, count) for row in chosen if row["quantity"] == key]
            lines.append(f"| {label} | {' | '.join(cells)} |")
    return lines


def _cell(row: dict[str, Any], count: int) -> str:
    told = f" ({100 * row['told'] / count:.0f} %)" if row["quantity"] in ("alpha", "beta", "gamma", "n") else ""
    return f"{100 * row['hold'] / row['intervals']:.1f} %{told}"


def _plot(path: Path, record: dict[str, Any]) -> None:
    from matplotlib.figure import Figure

    benches = list(dict.fromkeys(row["bench"] for row in record["rows"]))
    figure = Figure(figsize=(4.2 * len(benches), 3.6), layout="constrained")
    axes = figure.subplots(1, len(benches), sharey=True, squeeze=False)[0]
    for axis, bench in zip(axes, benches, strict=True):
        rows = [row for row in record["rows"] if row["bench"] == bench]
        levels = list(dict.fromkeys(row["level"] for row in rows))
        for k, level in enumerate(levels):
            shift, colour = 0.2 * (k - 0.5 * (len(levels) - 1)), COLOURS[k % len(COLOURS)]
            of = [row for row in rows if row["level"] == level]
            share = [100.0 * row["hold"] / row["intervals"] for row in of]
            edges = [[100.0 * edge for edge in chance(row["hold"], row["intervals"])] for row in of]
            bars = [[s - low for s, (low, _) in zip(share, edges, strict=True)],
                    [high - s for s, (_, high) in zip(share, edges, strict=True)]]  # fmt: skip
            places = [place + shift for place in range(len(of))]
            axis.errorbar(places, share, bars, fmt="o", markersize=4, capsize=3, color=colour, label=level)
        axis.axhspan(92.0, 98.0, color="#eee", zorder=0)
        axis.axhline(95.0, color="#999", linewidth=0.8, zorder=0)
        axis.set_xticks(range(len(LABELS)), [*LABELS.values()], fontsize=8, rotation=25)
        axis.set_title(bench, fontsize=10)
        axis.set_ylim(84.0, 101.0)
    axes[0].set_ylabel("intervals that hold the truth [%]", fontsize=9)
    axes[-1].legend(fontsize=8, frameon=False, loc="lower right", title="full well", title_fontsize=8)
    figure.savefig(path, dpi=120)
