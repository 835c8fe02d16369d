"""Stills as they would be hung: backlit linen, hair and figures 6 to 8 by each mode, with time, memory and the command.

    python -m studies.stills examples/recipes --out out/stills
    python -m studies.stills examples/recipes --out out/stills --only figure_7_skin --modes path --pixels 3840

Each still is made by `hagoromo render` in a process of its own, after a smaller one that says how long it will take.
Leaves in the folder `out`: boxes, scenes, stills, previews of them, and stills.md, a page of all that are there. What
is there is not made again; after an interrupt, mode path goes on with the picture that it left.
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
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.image.scene.modes import Mode
from hagoromo_matter.demo.figure_scene import camera_of, cast_of, resized_scene, write_figure_scene
from hagoromo_matter.demo.figures import PAPER_FIGURES
from studies.command import command

PREVIEW, QUALITY = 540, 82  # px along the longer side, and of JPEG
SAMPLES = 4  # rays, or walks of mode path, a pixel
TRIAL = 10  # a still has so many times the pixels of its trial, squared
MODES: tuple[Mode, ...] = "march", "full", "path"
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
ORDER = (*STILLS, "figure_8_angel", *(name for name in PAPER_FIGURES if name != "figure_8_angel"))


class From(NamedTuple):
    """Folders of the recipes and of a demo, whose measured materials figures have; the resolution of figures' boxes."""

    recipes: Path
    demo: Path
    resolution: float


def stills(
    recipes: Positional[Path],
    out: Path,
    demo: Path = Path("out/demo"),
    resolution: float = 0.5,
    pixels: int = 1080,
    samples: int = SAMPLES,
    seconds: float | None = None,
    only: tuple[str, ...] = ORDER[:3],
    modes: tuple[Mode, ...] = MODES,
    denoise: bool = False,
    page_alone: bool = False,
) -> None:
    """Stills, their previews and the page.

    Args:
        recipes: folder of the recipes.
        out: folder to write.
        demo: folder of a demo, whose measured materials figures have.
        resolution: of the boxes of figures, 1 being that of `make figures`.
        pixels: along the longer side.
        samples: rays a pixel, walks of mode path.
        seconds: for how long mode path goes on, about; samples are then the least number of walks.
        only: names of those that are made: linen, hair, and figures such as figure_8_angel.
        modes: by which they are made.
        denoise: without the noise of mode path, as Open Image Denoise guesses.
        page_alone: make nothing but the page of what is there.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in only if not page_alone else ():
        for mode in modes:
            guessed = denoise and mode == "path"
            picture = out / f"{name}_{mode}_{pixels}{'_denoised' if guessed else ''}.exr"
            if not picture.with_suffix(".json").exists():
                scene = scene_file(From(recipes, demo, resolution), out, name, pixels)
                say_time(scene, picture, mode, samples)
                record = made(scene, picture, mode, samples, seconds, guessed)
                record |= {"name": name, "mode": mode, "samples": samples, "seconds": seconds, "denoised": guessed}
                hg.write_json(picture.with_suffix(".json"), record)
    records = {path: hg.read_json(path) for path in sorted(out.glob("*_*.json"))}
    rows = [row | {"file": path.stem} for path, row in records.items() if "command" in row]
    rows.sort(key=lambda row: (ORDER.index(row["name"]), row["size"], MODES.index(row["mode"])))
    for row in rows:
        preview(out / f"{row['file']}.png", out / "stills" / f"{row['file']}.jpg")
    page(rows, out / "stills.md")


def scene_file(sources: From, out: Path, name: str, pixels: int) -> Path:
    """The scene of a still, and its boxes, built where they are not there."""
    if name not in STILLS:
        return figure_file(sources, out, name, pixels)
    still, box = STILLS[name], out / f"{name}.zarr"
    record = hg.read_toml(sources.recipes / f"{still.recipe}.toml")
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


def figure_file(sources: From, out: Path, name: str, pixels: int) -> Path:
    """The scene of a figure; pictures of all sizes share its boxes."""
    home = out / f"{name}_{sources.resolution:g}"
    if not (home / "scene.toml").exists():
        print(f"boxes of {name}", flush=True)
        cast = cast_of(sources.demo, sources.resolution, "projected")
        write_figure_scene(cast, name, camera_of(pixels), home)
    return resized_scene(home / "scene.toml", pixels)


def say_time(scene: Path, picture: Path, mode: Mode, samples: int) -> None:
    """Say how long a still will take, by one of 1 / TRIAL of its width."""
    small = resized_scene(scene, max(max(hg.read_toml(scene)["camera"]["size"]) // TRIAL, 16))
    tried = picture.with_name(f"trial_{picture.name}")
    tried.unlink(missing_ok=True)  # of a run that was interrupted: there is nothing to resume
    trial = made(small, tried, mode, samples)
    longest = trial["wall_s"] if mode == "full" else trial["wall_s"] * TRIAL**2
    about = "more than" if mode == "full" else "at most about"
    print(f"{picture.stem}: {about} {longest / 60:.0f} min, by a trial of {trial['wall_s']:.0f} s", flush=True)


def made(
    scene: Path, picture: Path, mode: Mode, samples: int, seconds: float | None = None, denoise: bool = False
) -> dict[str, Any]:
    """Make a still in a process of its own: its command, wall and CPU time [s], largest resident memory [MiB]."""
    words = ("render", scene.as_posix(), "--out", picture.as_posix(), "--mode", mode)
    words += () if mode == "full" else ("--samples", str(samples))
    words += ("--time", f"{seconds:g}") if mode == "path" and seconds else ()
    words += ("--denoise",) if denoise else ()
    words += ("--resume",) if mode == "path" and picture.exists() else ()
    start = time.monotonic()
    alone = os.environ | {"HAGOROMO_CACHE": "off"}  # light that another picture solved would be missing in the time
    child = os.spawnve(os.P_NOWAIT, sys.executable, [sys.executable, "-m", "hagoromo", *words, "--force"], alone)
    _, status, used = os.wait4(child, 0)
    if status:
        raise hg.InputError(f"hagoromo {shlex.join(words)} failed")
    image = hg.read_image(picture)
    found = image.full_error
    return {
        "command": f"hagoromo {shlex.join(words)}", "wall_s": time.monotonic() - start,
        "cpu_s": used.ru_utime + used.ru_stime, "mib": used.ru_maxrss / 1024,
        "size": list(image.alpha.shape[::-1]),
        "noise": image.metadata.get("noise"), "off": None if found is None else found.mended.at_most,
    }  # fmt: skip


def preview(picture: Path, out: Path) -> None:
    """A small JPEG of a still."""
    from PIL import Image

    out.parent.mkdir(parents=True, exist_ok=True)
    shown = Image.open(picture).convert("RGB")
    shown.thumbnail((PREVIEW, PREVIEW), Image.Resampling.LANCZOS)
    shown.save(out, quality=QUALITY)


def page(rows: list[dict[str, Any]], out: Path) -> None:
    """The page of all stills that are there."""
    text = [
        "# Stills",
        "",
        "Matter as it would be hung, shown smaller. Times and memory are those of the command on two cores that others",
        "use, too: CPU time is of all cores. The building of boxes is not in them. Made by `python -m studies stills`;",
        "others by `python -m studies.stills examples/recipes --out out/stills`, with `--only`, `--modes`, `--pixels`,",
        "`--samples`, `--denoise` and, for figures, `--resolution` of their boxes.",
    ]
    for name in dict.fromkeys(row["name"] for row in rows):
        own = [row for row in rows if row["name"] == name]
        text += ["", f"## {title_of(name)} {{ #{name} }}", ""]
        text += [f"| {' | '.join(named(row) for row in own)} |", f"|{' --- |' * len(own)}"]
        shown = [f"![{named(row)}](figures/stills/{row['file']}.jpg)" for row in own]
        text += [f"| {' | '.join(shown)} |", ""]
        text += ["| mode | CPU time [s] | wall time [s] | peak of memory [MiB] | stated error |"]
        text += ["| --- | ---: | ---: | ---: | --- |"]
        text += [
            f"| {named(row)} | {row['cpu_s']:.0f} | {row['wall_s']:.0f} | {row['mib']:.0f} | {stated(row)} |"
            for row in own
        ]
        text += ["", "```sh", *(row["command"] for row in own), "```"]
    made_ones = {(row["name"], row["mode"]) for row in rows}
    missing = [f"{n} by {m}" for n in ORDER[:3] for m in MODES if (n, m) not in made_ones]
    text += ["", f"Not made yet: {', '.join(missing)}."] if missing else []
    out.write_text("\n".join(text) + "\n", encoding="utf-8")


def named(row: Mapping[str, Any]) -> str:
    """Mode and size of a still, and whether its noise was taken out."""
    return f"{row['mode']}, {row['size'][0]} × {row['size'][1]}{', denoised' if row.get('denoised') else ''}"


def title_of(name: str) -> str:
    """What a still shows."""
    return STILLS[name].title if name in STILLS else PAPER_FIGURES[name].caption.rstrip(".")


def stated(row: Mapping[str, Any]) -> str:
    """What a picture says of its own error."""
    if row["noise"] is not None:
        walks = f"{row['seconds']:g} s of walks" if row.get("seconds") else f"{row['samples']} walks"
        before = " before denoising, which has no stated error" if row.get("denoised") else ""
        return f"noise of a pixel {100 * row['noise']:.0f} %, {walks}{before}"
    if row["off"] is not None:
        return f"mean and blocks at most {100 * row['off']:.1f} % off"
    return "the first order alone"


if __name__ == "__main__":
    command(stills)
