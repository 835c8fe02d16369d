"""Stills as they would be hung: backlit linen and hair by each mode, with time, memory and the command that makes them.

    python -m studies.stills examples/recipes --out out/stills --pixels 2160

Each still is made by `hagoromo render` in a process of its own. Leaves in the folder `out`: boxes, scenes, stills,
previews of them, and stills.md, a page. What is there is not made again.
"""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.image.modes import Mode

PREVIEW, QUALITY = 540, 82  # px a side, and of JPEG
MODES: dict[Mode, tuple[str, ...]] = {
    "march": ("--samples", "4"), "full": (), "path": ("--samples", "4"),
}  # fmt: skip
AWAY = 25.0  # fields of view from the middle to the camera


class Still(NamedTuple):
    """A recipe, keys that differ from its file, the width of the field of view [mm], directions to camera and lamps."""

    title: str
    recipe: str
    changed: Mapping[str, Any]
    field_mm: float
    to_eye: tuple[float, float, float]
    lamps: tuple[tuple[tuple[float, float, float], float], ...]


STILLS = {
    "linen": Still(
        "White linen, lit from behind", "linen",
        {"lay": "patch", "width_mm": 13.0, "height_mm": 13.0, "material": {"body_colour": 0.9}},
        10.0, (0.1, -1.0, 0.1), (((0.5, 1.0, 0.9), 1.0), ((-0.75, -0.8, 1.0), 0.1)),
    ),
    "hair": Still(
        "A head of hair", "hair", {}, 270.0, (0.5, -1.0, 0.25),
        (((-0.75, -0.8, 1.0), 1.0), ((0.9, -1.0, 0.2), 0.15), ((0.5, 0.9, 1.3), 0.6)),
    ),
}  # fmt: skip


def stills(
    recipes: Positional[Path],
    out: Path,
    pixels: int = 1080,
    only: tuple[str, ...] = tuple(STILLS),
    modes: tuple[Mode, ...] = tuple(MODES),
) -> None:
    """All stills, their previews and the page. pixels: a side. only, modes: those that are made."""
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in only:
        scene = scene_file(recipes, out, name, pixels)
        for mode in modes:
            picture = out / f"{name}_{mode}_{pixels}.exr"
            record = picture.with_suffix(".json")
            if not record.exists():
                hg.write_json(record, made(scene, picture, mode, MODES[mode]))
            rows.append({"name": name, "mode": mode, **hg.read_json(record)})
            preview(picture, out / "stills" / f"{name}_{mode}.jpg")
    page(rows, out / "stills.md", pixels)


def scene_file(recipes: Path, out: Path, name: str, pixels: int) -> Path:
    """The scene of a still, and its box, built where it is not there."""
    still, box = STILLS[name], out / f"{name}.zarr"
    record = hg.read_toml(recipes / f"{still.recipe}.toml")
    changed = {k: record.get(k, {}) | v if isinstance(v, dict) else v for k, v in still.changed.items()}
    if not box.exists():
        hg.build(record | changed | {"extinction": "projected"}).save(box)
    loaded = hg.load_box(box)
    corners = loaded.matter_corners()
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    eye = middle + 1e-3 * AWAY * still.field_mm * np.array(still.to_eye) / np.linalg.norm(still.to_eye)
    focal, half = pixels * AWAY, 0.5 * pixels
    lamps = "".join(
        f'[[lamp]]\nto_lamp = {list(place)}\nintensity = {share}\nspectrum = "D65"\n' for place, share in still.lamps
    )
    path = out / f"{name}_{pixels}.toml"
    path.write_text(
        f"[camera]\nsize = [{pixels}, {pixels}]\nfocal = [{focal}, {focal}]\nprincipal = [{half}, {half}]\n"
        f'eye = {eye.tolist()}\ntarget = {middle.tolist()}\n{lamps}[[box]]\nfile = "{box.name}"\n',
        encoding="utf-8",
    )
    return path


def made(scene: Path, picture: Path, mode: Mode, more: tuple[str, ...]) -> dict[str, Any]:
    """Make a still in a process of its own: its command, wall and CPU time [s], largest resident memory [MiB]."""
    words = ("render", scene.as_posix(), "--out", picture.as_posix(), "--mode", mode, *more)
    start = time.monotonic()
    child = os.spawnv(os.P_NOWAIT, sys.executable, [sys.executable, "-m", "hagoromo", *words, "--force"])
    _, status, used = os.wait4(child, 0)
    if status:
        raise hg.InputError(f"hagoromo {shlex.join(words)} failed")
    image = hg.read_image(picture)
    found = image.full_error
    return {
        "command": f"hagoromo {shlex.join(words)}", "wall_s": time.monotonic() - start,
        "cpu_s": used.ru_utime + used.ru_stime, "mib": used.ru_maxrss / 1024,
        "noise": image.metadata.get("noise"), "off": None if found is None else found.mended.at_most,
    }  # fmt: skip


def preview(picture: Path, out: Path) -> None:
    """A small JPEG of a still."""
    from PIL import Image

    out.parent.mkdir(parents=True, exist_ok=True)
    shown = Image.open(picture.with_suffix(".png")).convert("RGB")
    shown.resize((PREVIEW, PREVIEW), Image.Resampling.LANCZOS).save(out, quality=QUALITY)


def page(rows: list[dict[str, Any]], out: Path, pixels: int) -> None:
    """The page of all stills that are there."""
    text = [
        "# Stills",
        "",
        f"Matter as it would be hung, {pixels} pixels a side, by each mode; shown smaller. Times and memory are those",
        "of the command on two cores that others use, too; the building of boxes is not in them.",
        "Made by `python -m studies stills`; larger ones by",
        "`python -m studies.stills examples/recipes --out out/stills --pixels 2160`.",
    ]
    for name in dict.fromkeys(row["name"] for row in rows):
        own = [row for row in rows if row["name"] == name]
        modes = [row["mode"] for row in own]
        text += ["", f"## {STILLS[name].title} {{ #{name} }}", ""]
        text += [f"| {' | '.join(modes)} |", f"|{' --- |' * len(own)}"]
        text += [f"| {' | '.join(f'![{mode}](figures/stills/{name}_{mode}.jpg)' for mode in modes)} |", ""]
        text += ["| mode | CPU time [s] | wall time [s] | peak of memory [MiB] | stated error |"]
        text += ["| --- | ---: | ---: | ---: | --- |"]
        text += [
            f"| {row['mode']} | {row['cpu_s']:.0f} | {row['wall_s']:.0f} | {row['mib']:.0f} | {stated(row)} |"
            for row in own
        ]
        text += ["", "```sh", *(row["command"] for row in own), "```"]
    out.write_text("\n".join(text) + "\n", encoding="utf-8")


def stated(row: Mapping[str, Any]) -> str:
    """What a picture says of its own error."""
    if row["noise"] is not None:
        return f"noise of a pixel {100 * row['noise']:.0f} %"
    if row["off"] is not None:
        return f"mean and blocks at most {100 * row['off']:.1f} % off"
    return "the first order alone"


if __name__ == "__main__":
    tyro.cli(stills)
