"""Tables of the records, as Markdown, and what they come to in a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Rows = Sequence[Mapping[str, Any]]
CHASE = 20.0  # times the time of full that others get, see orders.py
STUDIES = {"resolution": "voxels", "pixels": "pixels", "lamps": "lamps", "boxes": "boxes"}  # and what is varied
GROWTH = {
    "voxels": "voxels along an edge", "lattice": "voxels of the lattice", "kept_bricks": "kept bricks",
    "samples": "samples of matter", "pixels": "pixels", "lamps": "lamps", "boxes": "boxes", "arranged": "arranged",
    "unshaded_s": "no shadows [s]", "each_ns": "that, per sample [ns]", "mapped_s": "maps made anew [s]",
}  # fmt: skip
SCALE = {
    "shell": "shell", "voxels": "voxels along an edge", "kept": "kept bricks", "share": "of the lattice [%]",
    "dense_gib": "dense [GiB]", "held_gib": "held [GiB]", "build_s": "build [s]", "build_gib": "peak then [GiB]",
    "first_s": "first frame [s]", "mapped_s": "warm, maps anew [s]", "unshaded_s": "warm, no shadows [s]",
    "peak_gib": "peak [GiB]",
}  # fmt: skip
OPENING = {
    "voxels": "voxels along an edge", "bricks": "kept bricks", "way": "read from", "files_mib": "files [MiB]",
    "read_s": "reading and decoding alone [s]", "fill_s": "filling memory [s]", "load_s": "load [s]",
    "picture_s": "first picture [s]", "cold_picture_s": "not cached [s]",
}  # fmt: skip


def march_table(found: Mapping[str, Any]) -> str:
    """Frames of KERNEL's scene, and the errors of their shadows."""
    head = {"frame": "frame of 512² pixels", "median_s": "median [s]", "least_s": "least [s]", "ratio": "ratio"}
    errors = "; ".join(f"{100 * error:.2f} % with maps of {name}" for name, error in found["shadow_error"].items())
    return (
        f"{table(head, found['frames'])}\n\nRatio: to the march without shadows, median of {found['rounds']} rounds. "
        f"Shadows against brute march, root mean square over the mean: {errors}."
    )


def equal_error_table(found: Mapping[str, Any]) -> str:
    """Time at equal error against version 0.2.0."""
    head = {
        "shadows": "shadows", "tolerance": "tolerance of 0.2.0", "percent": "its error [%]", "before": "its time",
        "now": "time now at that error", "ratio": "times as quick",
    }  # fmt: skip
    names = {"map": "shadow maps", "march": "marched shadows"}
    rows = [row | {"shadows": names[row["shadows"]], "percent": 100 * row["error"]} for row in found["rows"]]
    text = f"{table(head, rows)}\n\nTimes are in units of the yardstick's; medians of {found['rounds']} rounds."
    rough = [{**row, "percent": 100 * row["error"]} for row in found.get("rough", ())]
    if not rough:
        return text
    head = {"scene": "rough matter", **{key: word for key, word in head.items() if key != "shadows"}}
    return f"{text}\n\n{table(head, rough)}"


ORDERS = {
    "by": "by", "walks": "walks or rays a pixel", "cpu_s": "CPU [s]", "ratio": "CPU over path's",
    "pixel": "noise or error of a pixel [%]", "block": "of blocks of 32² px [%]", "mean": "mean light over path's",
    "memory": "light over bricks [%]",
}  # fmt: skip
CHASED = {"by": "by", "cpu_s": "CPU [s]", "chase": "CPU over full's", "walks": "walks a pixel", "pixel": "noise [%]"}


def orders_table(found: Mapping[str, Any]) -> str:
    """All orders of light of one scene at equal error, ours and others'."""
    media = "all have the same medium" if found["same"] else "Mitsuba and Cycles have the nearest of their media"
    if found["same"] and any("Cycles" in row["by"] for row in found["rows"]):
        media = "Mitsuba has the same medium, Cycles the nearest of its own"
    rows, path = found["rows"], next(row["cpu_s"] for row in found["rows"] if row["by"] == "path")
    text = (
        f"**{found['title'].capitalize()}**, {found['pixels']}² pixels; {media}. Asked for: {100 * found['error']:g} % "
        f"of blocks, in {found['most']:g} times the time of path at most. {found['rounds']} rounds, seeds "
        f"{found['seeds']}; load {found['load_before']:.1f} before the end.\n\n"
    ) + table(ORDERS, [orders_row(row, path) for row in rows])
    full = next((row for row in rows if row["by"] == "full"), {})
    if "refused" in full:
        return f"{text}\n\nMode full: {full['refused']}."
    again = next(row for row in rows if row["by"] == "full, another camera")
    ratio = again["cpu_s"] / again["march_s"]
    text += f"\n\nFirst picture of the known scene over the march of the same camera: {ratio:.2f}."
    if not found["chase"]:
        return text
    chase = [dict.fromkeys(CHASED, "") | row | {"pixel": 100 * row["noise_1"]} for row in found["chase"]]
    return f"{text} What the others have after {CHASE:g} times the time of full, where a pixel of full is off by " + (
        f"{100 * full['noise_1']:.3g} %:\n\n{table(CHASED, chase)}"
    )


def orders_row(row: Mapping[str, Any], path: float) -> dict[str, Any]:
    """A row as it is printed; path: CPU time of mode path [s]."""
    shown = dict.fromkeys(ORDERS, "") | {key: row[key] for key in ("by", "walks", "cpu_s") if key in row}
    if "cpu_s" in row:
        shown["ratio"] = row["cpu_s"] / path
    percent = {"noise_1": "pixel", "noise_32": "block", "memory": "memory"}
    shown |= {name: 100 * row[key] for key, name in percent.items() if key in row}
    if "mean" in row:
        shown["mean"] = f"{row['mean']:.4f} ± {row['mean_error']:.4f}"
    return shown


def scaling_table(found: Mapping[str, Rows]) -> str:
    """Growth with resolution, pixels, lamps and boxes."""
    parts = ["![Time of a frame against resolution, pixels, lamps and boxes](figures/scaling.png)"]
    for study, across in STUDIES.items():
        rows = [
            {**row, **({"each_ns": 1e9 * row["unshaded_s"] / row["samples"]} if "samples" in row else {})}
            for row in found[study]
        ]
        parts.append(table({key: name for key, name in GROWTH.items() if key in rows[0]}, rows))
        for arranged in dict.fromkeys(row.get("arranged") for row in rows):
            some = [row for row in rows if row.get("arranged") == arranged]
            slopes = f"{slope(some, across, 'unshaded_s'):.2f}, with maps {slope(some, across, 'mapped_s'):.2f}"
            parts.append(f"Slope against {across}{f' {arranged}' if arranged else ''}: without shadows {slopes}.")
    return "\n\n".join(parts)


def scale_table(found: Mapping[str, Any]) -> str:
    """Large boxes, and the one that does not fit."""
    boxes, no = [row | {"share": 100 * row["kept"] / row["bricks"]} for row in found["boxes"]], found["refused"]
    said = f"{no['voxels']}³ of the {no['shell']} shell, after {no['seconds']:.0f} s at {no['peak_gib']:.2f} GiB"
    return f"{table(SCALE, boxes)}\n\nRefused: {said}:\n\n    {no['said']}"


def matter_memory_table(found: Rows) -> str:
    """What builds and exports take, and took before they were made part by part."""
    head = {
        "what": "build, export, look", "mib": "peak [MiB]", "cpu_s": "CPU [s]", "before_mib": "peak before [MiB]",
        "before_cpu_s": "CPU before [s]", "disk_mib": "on disk [MiB]",
    }  # fmt: skip
    return table(head, found)


def open_table(found: Rows) -> str:
    """Boxes opened from disk."""
    ways = ("packed", "arrays")
    return table(OPENING, [{"voxels": box["voxels"], "way": way, **box[way]} for box in found for way in ways])


def page_frames_table(found: Rows) -> str:
    """Frames a second of published pages, drawn in software."""
    head = {
        "page": "page of a", "side": "side [px]", "drawn": "drawn", "frames_per_second": "frames a second",
        "mb": "size [MB]",
    }  # fmt: skip
    return table(head, [{**row, "mb": row["bytes"] / 1e6} for row in found])


def formats_table(found: Rows) -> str:
    """Seconds to read and to write a file of every format."""
    head = {"format": "format", "sample": "sample", "mb": "size [MB]", "read_s": "read [s]", "write_s": "write [s]"}
    seconds = [
        {**row, **{f"{key}_s": f"{row[key]:.2g}" if key in row else "–" for key in ("read", "write")}} for row in found
    ]
    return table(head, seconds)


def spectra_image_table(found: Rows) -> str:
    """Reflectance spectra of whole images."""
    head = {
        "lamps": "lamps", "pixels": "pixels", "cpu_s": "CPU time [s]", "pixels_per_s": "pixels a CPU second",
        "percent": "explained by a likely reflectance [%]",
    }  # fmt: skip
    return table(
        head,
        [
            {**row, "pixels_per_s": int(round(row["pixels_per_s"], -2)), "percent": 100 * row["explained"]}
            for row in found
        ],
    )


def bound_table(found: Mapping[str, Any]) -> str:
    """What the march is made of, and what the machine can do."""
    parts, steps, rates = found["parts_s"], found["steps"], found["gather_rates"]
    rows = [
        {
            "kernel": name, "seconds": parts[key], "share": parts[key] / parts["whole"],
            "steps": steps[key] / 1e6, "each": 1e9 * parts[key] / steps[key],
        }
        for name, key in {"march": "whole", "its walk alone": "walk"}.items()
    ]  # fmt: skip
    head = {
        "kernel": "kernel", "seconds": "time [s]", "share": "of the march",
        "steps": "turns of its loop [10⁶]", "each": "a turn [ns]",
    }  # fmt: skip
    return "\n\n".join([
        "![The march and its walk alone; rates of gathers](figures/bound.png)",
        table(head, rows),
        f"{found['samples'] / 1e6:.1f} million samples of matter are lit. Of {found['lanes']} neighbouring rays that "
        f"step together, {100 * found['busy']:.0f} % are still on their way, on average.",
        f"The machine gathers {rates[0]['per_s'] / 1e9:.1f} · 10⁹ words a second at random from "
        f"{rates[0]['bytes'] >> 10} KiB and {rates[-1]['per_s'] / 1e9:.2f} · 10⁹ from {rates[-1]['bytes'] >> 20} MiB, "
        f"streams {found['stream_bytes_per_s'] / 1e9:.0f} GB/s, and does {found['flops_per_s'] / 1e9:.0f} · 10⁹ "
        f"operations a second in multiply-adds.",
    ])  # fmt: skip


def slope(rows: Rows, across: str, along: str) -> float:
    """Of log `along` against log `across`, by least squares; NaN for fewer than two rows."""
    if len(rows) < 2:
        return float("nan")
    x, y = (np.log([row[key] for row in rows]) for key in (across, along))
    return float(np.polyfit(x, y, 1)[0])


def table(head: Mapping[str, str], rows: Rows) -> str:
    """Columns of `head`: key of a row → heading with its unit; the first is text."""
    lines = [list(head.values()), ["---", *["---:"] * (len(head) - 1)]]
    lines += [[shown(row[key]) for key in head] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def shown(value: Any) -> str:
    """Three figures of a number; whole ones in groups of three digits."""
    if isinstance(value, int):
        return f"{value:,}".replace(",", " ")
    return f"{value:.3g}" if isinstance(value, float) else str(value)
