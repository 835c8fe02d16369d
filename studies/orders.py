"""The study of all orders of light: recipes by mode march (the first order), full and path, side by side.

    python -m studies.orders examples/recipes --out out/orders

Leaves: results.json, orders.md, orders.png and orders_colour.png, which belong to docs.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.image.scene.modes import Mode
from studies.command import command
from studies.orders_colour import colour_row
from studies.orders_colour import plot as plot_colour
from studies.table import print_table

MODES: tuple[Mode, ...] = "march", "full", "path"
TITLES = "march: the first order", "full", "path", "march − path", "full − path"
BLOCK = 8  # px a side of the blocks by which full and path are compared: the noise of path is small in their means
LARGEST_SHOWN = 0.2  # difference over the mean at the ends of the colours
AWAY = 25.0  # fields of view from the middle to the camera
Array = NDArray[np.float64]


class Subject(NamedTuple):
    """A recipe, keys that differ from its file, the field of view, and where the lamp stands."""

    title: str
    recipe: str
    changed: Mapping[str, Any]
    field_mm: float
    to_lamp: tuple[float, float, float]


FRONT, BEHIND = (-0.75, -0.8, 1.0), (0.5, 1.0, 0.9)
WHITE_LINEN = {
    "lay": "patch", "width_mm": 5.0, "height_mm": 5.0, "voxel_mm": 0.03, "variants": 1,
    "material": {"body_colour": 0.9},
}  # fmt: skip
SUBJECTS = {
    "linen": Subject("white linen", "linen", WHITE_LINEN, 4.0, FRONT),
    "backlit": Subject("white linen, lamp behind", "linen", WHITE_LINEN, 4.0, BEHIND),
    "skin": Subject("skin", "skin", {"size_mm": 5.0, "voxel_mm": 0.03}, 4.0, FRONT),
    "down": Subject("white down, lamp behind", "down", {"voxel_mm": 0.08}, 20.0, BEHIND),
}  # fmt: skip


def orders_study(
    recipes: str | Path, out: str | Path, pixels: int = 128, samples: int = 256, only: tuple[str, ...] = (),
    force: bool = False, progress: hg.Progress = hg.silent,
) -> dict[str, Any]:  # fmt: skip
    """The whole study, written to the folder `out`; gives the record of results.json.

    pixels: a side of the pictures. samples: walks a pixel of mode path, and rays a pixel of march and full to 4.
    """
    rows: list[dict[str, Any]] = []
    scenes: dict[str, hg.Scene] = {}
    shown: dict[str, dict[str, hg.Image]] = {}
    with hg.whole_folder(out, force) as home:
        chosen = only or tuple(SUBJECTS)
        for number, name in enumerate(chosen):
            subject = SUBJECTS[name]
            progress(0.9 * number / len(chosen), subject.title)
            scenes[name] = scene_of(box_of(Path(recipes), subject), subject, pixels)
            images, seconds = images_of(scenes[name], samples, mend=False)
            rows.append(row(subject.title, images, seconds))
            shown[name] = images
        record: dict[str, Any] = {
            "hagoromo": hg.__version__,
            "pixels": pixels,
            "samples": samples,
            "seed": 0,
            "rows": rows,
        }
        if {"linen", "backlit"} <= set(shown):
            progress(0.9, "colour of white linen")
            photographs = {"front": shown["linen"]["path"], "behind": shown["backlit"]["path"]}
            truth = WHITE_LINEN["material"]["body_colour"]
            record["colour"], pictures = colour_row(scenes["linen"], scenes["backlit"], photographs, truth)
            plot_colour(home / "orders_colour.png", pictures)
        hg.write_json(home / "results.json", record)
        plot(home / "orders.png", {SUBJECTS[name].title: images for name, images in shown.items()})
        page = hg.page_text("orders.md.j2", "studies", **record)
        (home / "orders.md").write_text(page, encoding="utf-8", newline="\n")
    return record


def box_of(recipes: Path, subject: Subject) -> hg.VolumeBox:
    """The box of a subject."""
    record: dict[str, Any] = hg.read_toml(recipes / f"{subject.recipe}.toml") | {"extinction": "projected"}
    for key, value in subject.changed.items():
        old = record.get(key)
        record[key] = old | value if isinstance(value, dict) and isinstance(old, dict) else value
    return hg.build(record)


def images_of(
    scene: hg.Scene, samples: int, modes: tuple[Mode, ...] = MODES, mend: bool = True
) -> tuple[dict[str, hg.Image], dict[str, float]]:
    """The image of a scene by each mode, and the processor seconds that it took; mend: whether full's walks mend it."""
    images, seconds = {}, {}
    for mode in modes:
        rays = samples if mode == "path" else min(samples, 4)
        settings = hg.Settings(rays, walks=None if mend else 0)
        begin = time.process_time()
        images[mode] = hg.render(scene, settings, mode=mode)
        seconds[mode] = time.process_time() - begin
    return images, seconds


def scene_of(box: hg.VolumeBox, subject: Subject, pixels: int) -> hg.Scene:
    """The middle of a box seen from its front, under one far lamp of D65."""
    low, high = box.bricks.places.min(axis=0), box.bricks.places.max(axis=0) + 1
    middle = box.pose[:3, 3] + 4.0 * box.voxel_size * (low + high)[::-1]
    camera = hg.Camera(pixels, pixels, (pixels * AWAY, pixels * AWAY), (0.5 * pixels, 0.5 * pixels))
    towards = np.array([0.1, -1.0, 0.1])
    eye = middle + AWAY * 1e-3 * subject.field_mm * towards / np.linalg.norm(towards)
    lamp = hg.Lamp(to_lamp=subject.to_lamp, spectrum=hg.Spectrum.named("D65"))
    return hg.Scene(camera.look_at(eye, middle), (lamp,), (box,))


def row(title: str, images: Mapping[str, hg.Image], seconds: Mapping[str, float]) -> dict[str, Any]:
    """Figures of one subject, of those modes that it has; all are of Y."""
    light = {mode: image.xyz()[..., 1].astype(float) for mode, image in images.items()}
    mean, variance, full = light["path"].mean(), images["path"].variance, images.get("full")
    assert variance is not None
    return {
        "title": title,
        "all_over_first": float(mean / light["march"].mean()),
        **beside_path("march", light),
        **(beside_path("full", light) if full else {}),
        "noise_of_path": float(np.sqrt(variance.mean()) / mean),
        "noise_of_blocks": float(np.sqrt(variance.mean()) / mean / BLOCK),
        "seconds": dict(seconds),
        **({"field": full.metadata.get("field")} if full else {}),
    }


def beside_path(mode: str, light: Mapping[str, Array]) -> dict[str, float]:
    """Light of a mode over that of path, and how far its blocks are off: root mean square over path's mean."""
    mean, off = light["path"].mean(), in_blocks(light[mode]) - in_blocks(light["path"])
    return {
        f"{mode}_over_path": float(light[mode].mean() / mean),
        f"{mode}_off_path": float(np.sqrt(np.mean(off**2)) / mean),
    }


def in_blocks(values: Array) -> Array:
    """Means of blocks of BLOCK × BLOCK pixels; what is left over at the ends is cut off."""
    rows, columns = (n // BLOCK for n in values.shape)
    return values[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))


def plot(path: Path, shown: Mapping[str, Mapping[str, hg.Image]]) -> None:
    """A row for each subject: the modes, exposed alike, and how much march and full differ from path."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16.0, 3.2 * len(shown)), layout="constrained")
    axes: Any = figure.subplots(len(shown), len(MODES) + 2, squeeze=False)
    last: Any = None
    for line, (title, images) in zip(axes, shown.items(), strict=True):
        linear = {mode: hg.srgb_from_xyz(images[mode].xyz()) for mode in MODES}
        white = 0.9 / max(float(np.percentile(linear["path"], 99.5)), 1e-30)
        for axis, mode in zip(line, MODES, strict=False):
            axis.imshow(hg.srgb_encode(np.clip(white * linear[mode], 0.0, 1.0)))
        light = {mode: in_blocks(images[mode].xyz()[..., 1].astype(float)) for mode in MODES}
        ends = {"vmin": -100.0 * LARGEST_SHOWN, "vmax": 100.0 * LARGEST_SHOWN}
        rivals: tuple[Mode, ...] = "march", "full"
        for axis, mode in zip(line[-2:], rivals, strict=True):
            difference = 100.0 * (light[mode] - light["path"]) / light["path"].mean()
            last = axis.imshow(difference, cmap="RdBu_r", **ends)
        line[0].set_ylabel(title, fontsize=10)
        for axis in line:
            axis.set_xticks([])
            axis.set_yticks([])
    for axis, title in zip(axes[0], TITLES, strict=True):
        axis.set_title(title, fontsize=10)
    bar = figure.colorbar(last, ax=axes[:, -1], shrink=0.6)
    bar.set_label("difference of Y over the mean [%]", fontsize=9)
    figure.savefig(path, dpi=110)


def main(
    recipes: tyro.conf.Positional[Path], out: Path, pixels: int = 128, samples: int = 256, force: bool = False
) -> None:
    """Render every subject by every mode.

    Args:
        recipes: folder of the recipes.
        out: folder to write.
        pixels: a side of the pictures.
        samples: walks a pixel of mode path.
        force: replace an existing folder.
    """
    with hg.progress_bar("all orders of light") as progress:
        record = orders_study(recipes, out, pixels, samples, force=force, progress=progress)
    heads = "subject", "all / first", "full / path", "full off path", "noise of path", "march, full, path [CPU s]"
    lines = [
        [
            r["title"], f"{r['all_over_first']:.3f}", f"{r['full_over_path']:.3f}", f"{r['full_off_path']:.1%}",
            f"{r['noise_of_path']:.1%}", ", ".join(f"{r['seconds'][mode]:.1f}" for mode in MODES),
        ]
        for r in record["rows"]
    ]  # fmt: skip
    print_table("all orders of light", heads, lines)
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
