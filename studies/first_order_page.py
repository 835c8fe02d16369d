"""The page of the study of the first order: its tables and pictures, as docs has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg

SHADOWS = {"march": "marched shadows", "map": "shadow maps"}
BEFORE, AFTER = "#b5651d", "#1f4e8c"
LARGEST_SHOWN = 0.2  # error over the mean at the ends of the colours
Record = dict[str, Any]


def write_first_order_page(home: Path, record: Record, before: Record) -> None:
    """Write first_order.md, first_order.png and first_order_maps.png to the folder `home`."""
    _plot(home / "first_order.png", record, before)
    _pictures(home / "first_order_maps.png", record, before)
    usual = max(row["tolerance"] for row in record["rows"])
    page = hg.page_text(
        "first_order.md.j2", "studies", record=record, before=before, usual=usual,
        scenes=_scene_rows(record, before), blocks=_block_rows(record, before), gain=_gain(record, before),
    )  # fmt: skip
    (home / "first_order.md").write_text(page, encoding="utf-8", newline="\n")


def _errors(record: Record, key: str) -> dict[tuple, Record]:
    keys = {"rows": ("scene", "shadows", "tolerance"), "blocks": ("depth", "face", "shadows", "height")}[key]
    return {tuple(row[k] for k in keys): row for row in record[key]}


def _scene_rows(record: Record, before: Record) -> list[list[str]]:
    now, then = _errors(record, "rows"), _errors(before, "rows")
    usual, quarter = sorted({tolerance for _, _, tolerance in now}, reverse=True)[:2]
    rows = []
    for scene in dict.fromkeys(row["scene"] for row in record["rows"]):
        cells = [scene]
        for shadows in SHADOWS:
            for tolerance in (usual, quarter):
                key = scene, shadows, tolerance
                was = f"{100 * then[key]['error']:.2f} → " if key in then else ""
                cells.append(f"{was}{100 * now[key]['error']:.2f} %")
            key = scene, shadows, usual
            cells.append((f"{then[key]['ratio']:.3f} → " if key in then else "") + f"{now[key]['ratio']:.3f}")
        rows.append(cells)
    return rows


def _block_rows(record: Record, before: Record) -> list[list[str]]:
    """Per density and face: ratio to the closed form with marched shadows, lamp by lamp, before → now."""
    now, then = _errors(record, "blocks"), _errors(before, "blocks")
    heights = list(dict.fromkeys(row["height"] for row in record["blocks"]))
    rows = []
    for face in dict.fromkeys(row["face"] for row in record["blocks"]):
        for depth in dict.fromkeys(row["depth"] for row in record["blocks"]):
            keys = [(depth, face, "march", height) for height in heights]
            cells = [f"{then[key]['ratio']:.3f} → {now[key]['ratio']:.3f}" for key in keys]
            rows.append([face, f"{depth:g}", *cells])
    return rows


def _gain(record: Record, before: Record) -> list[Record]:
    """Geometric means of the errors over all scenes, before and now, per kind of shadows and tolerance."""
    now, then = _errors(record, "rows"), _errors(before, "rows")
    rows = []
    for shadows, label in SHADOWS.items():
        for tolerance in sorted({t for _, _, t in now}, reverse=True):
            keys = [key for key in now if key[1:] == (shadows, tolerance) and key in then]
            means = [float(np.exp(np.mean([np.log(of[key]["error"]) for key in keys]))) for of in (then, now)]
            rows.append({"shadows": label, "tolerance": tolerance, "before": means[0], "now": means[1]})
    return rows


def _plot(path: Path, record: Record, before: Record) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 5.2), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.1))
    scenes = list(dict.fromkeys(row["scene"] for row in record["rows"]))
    usual = max(row["tolerance"] for row in record["rows"])
    for axis, (shadows, label) in zip(axes, SHADOWS.items(), strict=False):
        for of, colour, name in ((before, BEFORE, f"before ({before['hagoromo']})"), (record, AFTER, "now")):
            errors = _errors(of, "rows")
            places = [k for k, scene in enumerate(scenes) if (scene, shadows, usual) in errors]
            values = [100.0 * errors[scenes[k], shadows, usual]["error"] for k in places]
            axis.plot(values, places, "o", color=colour, markersize=5, label=name)
        axis.axvline(100.0 * usual, color="#999", linewidth=0.8)
        axis.set_xscale("log")
        axis.set_yticks(range(len(scenes)), scenes if shadows == "march" else [], fontsize=8)
        axis.invert_yaxis()
        axis.grid(axis="y", color="#eee")
        axis.set_title(f"{label}, tolerance {usual:g}", fontsize=10)
        axis.set_xlabel("root mean square error over the mean [%]", fontsize=9)
    axes[0].legend(fontsize=8, frameon=False, loc="upper right")
    _plot_blocks(axes[2], record, before, usual)
    figure.savefig(path, dpi=120)


def _plot_blocks(axis: Any, record: Record, before: Record, tolerance: float) -> None:
    """Error of homogeneous blocks against their density."""
    for of, colour in ((before, BEFORE), (record, AFTER)):
        for face, style in (("hard face", "-"), ("soft face", "--")):
            for height, marker in ((60.0, "o"), (5.0, "v")):
                rows = [r for r in of["blocks"] if (r["face"], r["shadows"], r["height"]) == (face, "march", height)]
                label = f"{face}, lamp at {height:g}°" if of is record else None
                values = [max(100.0 * row["error"], 1e-3) for row in rows]
                axis.plot(
                    [r["depth"] for r in rows], values, style, marker=marker, markersize=4, color=colour, label=label
                )
    axis.axhline(100.0 * tolerance, color="#999", linewidth=0.8)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_title(f"homogeneous blocks, marched shadows, tolerance {tolerance:g}", fontsize=9)
    axis.set_xlabel("mean free paths a voxel", fontsize=9)
    axis.set_ylabel("error against the closed form [%]", fontsize=9)
    axis.legend(fontsize=8, frameon=False)


def _pictures(path: Path, record: Record, before: Record) -> None:
    """The oracle's picture of some scenes, and the errors of the march before and now."""
    from matplotlib.figure import Figure

    names = [name for name in record["pictures"] if name in before["pictures"]]
    figure = Figure(figsize=(2.5 * len(names) + 1.0, 7.6), layout="constrained")
    axes, shown = figure.subplots(3, len(names), squeeze=False), None
    for column, name in enumerate(names):
        true = _square(record["pictures"][name]["true"])
        axes[0, column].imshow(true, cmap="gray", vmin=0.0)
        axes[0, column].set_title(name, fontsize=9)
        for row, of in ((1, before), (2, record)):
            error = _square(of["pictures"][name]["seen"]) - true
            ends = {"vmin": -LARGEST_SHOWN, "vmax": LARGEST_SHOWN}
            shown = axes[row, column].imshow(error, cmap="RdBu_r", **ends)
        for axis in axes[:, column]:
            axis.set_xticks([])
            axis.set_yticks([])
    labels = ("oracle, 550 nm", f"error before ({before['hagoromo']})", "error now")
    for axis, label in zip(axes[:, 0], labels, strict=True):
        axis.set_ylabel(label, fontsize=9)
    if shown is not None:
        figure.colorbar(shown, ax=axes[1:].ravel().tolist(), label="error over the mean radiance [1]", shrink=0.7)
    figure.savefig(path, dpi=120)


def _square(values: list[float]) -> np.ndarray:
    side = round(len(values) ** 0.5)
    return np.array(values).reshape(side, side)
