"""The study of modes: the gallery and figures 6, 7 and 8 by march, full and path, and how far march and full are off.

    python -m studies.modes out/demo examples/recipes --out out/modes

Each scene leaves NAME.json and NAME.npz, and is left as it is where both are there: the command goes on where it was
interrupted, `--only` makes some. The pictures are of the scenes that are there; the page modes.md has their rows and,
from modes_rows.json beside this file, those of the others. The rows of both are written to `out`/modes_rows.json.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.image.scene.modes import Mode
from studies.command import command
from studies.modes_scenes import ORDER, SceneFolders, scene_of, title_of
from studies.orders import BLOCK, MODES, beside_path, images_of, in_blocks, row

WALKS = 100  # a pixel of mode path
CLOSE = 0.05  # root mean square over blocks, over the mean, within which a mode is right on the page
PANELS = "march", "full", "path", "march − path", "full − path"
ROWS = Path(__file__).with_name("modes_rows.json")  # of the page as it stands, by the names of scenes
OF_ROW = (  # of a scene's figures, what the page has
    "title", "size", "walks", "all_over_first", "march_off_path", "full_over_path", "full_off_path", "noise_of_blocks",
    "noise_of_path", "seconds",
)  # fmt: skip
LARGEST_SHOWN = 0.2  # of white, at the ends of the colours
WHITE_AT = 99.5  # per cent of path's values that are darker than white
Linear = Mapping[str, NDArray[np.floating]]


def rendered(name: str, sources: SceneFolders, out: Path, walks: int, modes: tuple[Mode, ...] = MODES) -> None:
    """Render a scene by its modes, and keep its figures and pictures."""
    scene = scene_of(name, sources)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        images, seconds = images_of(scene, walks, modes)
    record = row(title_of(name), images, seconds) | {"size": [scene.camera.width, scene.camera.height], "walks": walks}
    record["warnings"] = sorted({str(one.message) for one in said})
    record |= stated(images)
    xyz = {mode: image.xyz().astype(np.float32) for mode, image in images.items()}
    with hg.whole_file(out / f"{name}.npz", force=True) as path, path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **xyz)
    hg.write_json(out / f"{name}.json", record)


def stated(images: Mapping[str, hg.Image]) -> dict[str, Any]:
    """What mode full says that it is off, where it is there and says it."""
    error = images["full"].full_error if "full" in images else None
    return {"stated": error.record()} if error else {}


def with_full_anew(name: str, sources: SceneFolders, out: Path) -> None:
    """Render a scene that is there by mode full alone; march and path stay."""
    record = hg.read_json(out / f"{name}.json")
    with np.load(out / f"{name}.npz") as kept:
        xyz = {mode: kept[mode] for mode in kept}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        images, seconds = images_of(scene_of(name, sources), 4, ("full",))
    xyz["full"] = images["full"].xyz().astype(np.float32)
    record |= beside_path("full", {mode: values[..., 1].astype(float) for mode, values in xyz.items()})
    record |= {"seconds": record["seconds"] | seconds, "field": images["full"].metadata.get("field")}
    record |= stated(images)
    record["warnings"] = sorted({str(one.message) for one in said})
    with hg.whole_file(out / f"{name}.npz", force=True) as path, path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **xyz)
    hg.write_json(out / f"{name}.json", record)


def plot(path: Path, xyz: Linear) -> None:
    """A scene by the modes, exposed alike, and how far march and full are from path, in per cent of white."""
    from matplotlib.figure import Figure

    high, wide = xyz["path"].shape[:2]
    figure = Figure(figsize=(2.0 * len(PANELS) + 0.9, 2.0 * high / wide + 0.3), layout="constrained")
    axes: Any = figure.subplots(1, len(PANELS))
    white = float(np.percentile(xyz["path"][..., 1], WHITE_AT))
    for axis, mode in zip(axes, MODES, strict=False):
        if mode not in xyz:
            axis.text(0.5, 0.5, "not rendered", ha="center", va="center", fontsize=8)
            continue
        axis.imshow(hg.srgb_encode(np.clip(0.9 / white * hg.srgb_from_xyz(xyz[mode]), 0.0, 1.0)))
    light = {mode: in_blocks(values[..., 1].astype(float)) for mode, values in xyz.items()}
    ends = {"vmin": -100.0 * LARGEST_SHOWN, "vmax": 100.0 * LARGEST_SHOWN, "cmap": "RdBu_r"}
    last: Any = None
    for axis, mode in zip(axes[-2:], MODES, strict=False):
        if mode not in light:
            continue
        shown = axis.imshow(100.0 / white * (light[mode] - light["path"]), **ends)
        last = last or shown
    for axis, title in zip(axes, PANELS, strict=True):
        axis.set(xticks=[], yticks=[])
        axis.set_title(title, fontsize=8)
    bar = figure.colorbar(last, ax=axes[-1], shrink=0.9)
    bar.set_label("[% of white]", fontsize=7)
    bar.ax.tick_params(labelsize=6)
    figure.savefig(path, format="jpg", dpi=90, pil_kwargs={"quality": 85})


def right_mode(record: Mapping[str, Any]) -> str:
    """The mode of least cost whose blocks are within CLOSE of those of path."""
    return next((mode for mode in ("march", "full") if record.get(f"{mode}_off_path", 1.0) < CLOSE), "path")


def row_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """What the page has of a scene's figures."""
    row = {key: record[key] for key in OF_ROW if key in record}
    if "stated" in record:
        row["stated"] = {"mended": {key: record["stated"]["mended"][key] for key in ("mean", "blocks")}}
    return row


def write_page(out: Path) -> dict[str, dict[str, Any]]:
    """Pictures modes/NAME.jpg of the scenes that are there; the page modes.md, with ROWS of the others; its rows."""
    (out / "modes").mkdir(exist_ok=True)
    records = {name: hg.read_json(out / f"{name}.json") for name in ORDER if (out / f"{name}.json").exists()}
    for name in records:
        with np.load(out / f"{name}.npz") as kept, hg.whole_file(out / "modes" / f"{name}.jpg", force=True) as path:
            plot(path, {mode: kept[mode] for mode in MODES if mode in kept})
    before = hg.read_json(ROWS) if ROWS.exists() else {}
    table = before | {name: row_of(record) for name, record in records.items()}
    table = {name: table[name] for name in ORDER if name in table}
    hg.write_json(out / "modes_rows.json", table)
    rows = [row | {"name": name, "right": right_mode(row)} for name, row in table.items()]
    page = hg.page_text("modes.md.j2", "studies", rows=rows, scenes=len(ORDER), close=CLOSE, block=BLOCK)
    with hg.whole_file(out / "modes.md", force=True) as path:
        path.write_text(page, encoding="utf-8", newline="\n")
    return table


def main(
    demo: tyro.conf.Positional[Path], recipes: tyro.conf.Positional[Path], out: Path,
    data: Path = Path("../shared/data"), only: tuple[str, ...] = (), walks: int = WALKS,
    without_full: bool = False, force: bool = False, full_anew: bool = False,
) -> None:  # fmt: skip
    """Render every scene by every mode.

    Args:
        demo: folder of a demo, whose measured materials the figures have.
        recipes: folder of the recipes.
        out: folder to write.
        data: folder that has the gallery's scan.
        only: names of scenes; the others stay as they are.
        walks: a pixel of mode path.
        without_full: leave mode full out, which needs much memory in large scenes.
        force: make scenes anew that are there.
        full_anew: of scenes that are there, make the pictures of mode full anew.
    """
    out.mkdir(parents=True, exist_ok=True)
    modes: tuple[Mode, ...] = tuple(mode for mode in MODES if mode != "full" or not without_full)
    for name in only or ORDER:
        if full_anew and (out / f"{name}.json").exists():
            print(name, flush=True)
            with_full_anew(name, SceneFolders(demo, recipes, data), out)
        elif force or not (out / f"{name}.json").exists():
            print(name, flush=True)
            rendered(name, SceneFolders(demo, recipes, data), out, walks, modes)
    write_page(out)
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
