"""The study of full's error: scenes on which mode full is off, as it is solved and as its walks mend it, beside path.

    python -m studies.full_error examples/recipes --out out/full_error

Leaves: results.json and full_error.md, which belongs to docs; studies.few_walks adds to both what few walks mend,
studies.random_scenes scenes drawn from wide ranges. Where a scene is in results.json, it is kept.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

import hagoromo as hg
from studies.command import command
from studies.orders import BEHIND, BLOCK, SUBJECTS, Subject, box_of, in_blocks
from studies.orders import scene_of as scene_of_recipe

PIXELS = 96  # a side
WALKS = 1000  # a pixel of path, which is the truth
RAYS = 4
WIDE = "wide_scenes.json"  # of studies.random_scenes: mode full on scenes drawn from wide ranges
FAR = hg.Lamp(to_lamp=(0.48, -0.6, 0.64))
WHITE = hg.Spectrum.constant(1.0)
RED = hg.Spectrum([400, 500, 560, 620, 700], [0.15, 0.2, 0.5, 1.0, 1.0])
BLUE = hg.Spectrum([400, 480, 540, 600, 700], [1.0, 0.9, 0.4, 0.15, 0.1])
FEATHER = Subject("feather, small lamp behind", "primary", {"voxel_mm": 0.12}, 20.0, BEHIND)
LAMP_AT = (0.018, 0.06, 0.03)  # of the feather's lamp, from the middle of its matter [m]
Array = NDArray[np.float64]


def camera(pixels: int) -> hg.Camera:
    """The camera that sees a cube of 1 m."""
    focal = 1.6 * pixels
    return hg.Camera(pixels, pixels, (focal, focal), (pixels / 2, pixels / 2)).look_at(
        (1.7, -2.2, 1.6), (0.5, 0.5, 0.5)
    )


def cube(depth: float, albedo: float, *colours: hg.Spectrum) -> hg.VolumeBox:
    """A cube of spheres, so many mean free paths across; of two colours in two halves."""
    side = 24
    axes = np.broadcast_to((0.36, -0.48, 0.8), (side, side, side, 3))
    materials = [hg.Reflectance(albedo / math.pi, 0.0, 0.3, 1.5, colour, element="sphere") for colour in colours]
    kind = np.zeros((side,) * 3, np.uint8)
    kind[..., side // 2 :] = len(colours) - 1
    full = np.ones((side,) * 3)
    return hg.VolumeBox.from_arrays(full, axes, 1 / side, 2.0 * depth, materials, material=kind, extinction="projected")


def fibres() -> hg.VolumeBox:
    """A cube of fibres along one axis, three of ten voxels full."""
    side = 32
    density = (np.random.default_rng(0).random((side,) * 3) < 0.3) * 1.0
    axes = np.broadcast_to((0.0, 0.6, 0.8), (side, side, side, 3))
    bright = hg.Reflectance(0.9 / math.pi, 0.0, 0.3, 1.5, WHITE, element="cylinder")
    return hg.VolumeBox.from_arrays(density, axes, 1 / side, 60.0, [bright], extinction="projected")


def feather(recipes: Path, pixels: int) -> hg.Scene:
    """A feather with a near lamp behind it."""
    scene = scene_of_recipe(box_of(recipes, FEATHER), FEATHER, pixels)
    corners = scene.matter_corners()
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    x, y, z = (float(value) for value in middle + LAMP_AT)
    return scene.with_lamps(hg.Lamp(position=(x, y, z), intensity=1e-3))


def recipe(name: str) -> Callable[[Path, int], hg.Scene]:
    """A subject of the study of orders."""
    return lambda recipes, pixels: scene_of_recipe(box_of(recipes, SUBJECTS[name]), SUBJECTS[name], pixels)


def of_box(box: Callable[[], hg.VolumeBox], lamp: hg.Lamp = FAR) -> Callable[[Path, int], hg.Scene]:
    """A box of 1 m under one lamp."""
    return lambda _, pixels: hg.Scene(camera(pixels), (lamp,), (box(),))


SCENES: dict[str, Callable[[Path, int], hg.Scene]] = {
    "cube, depth 100, albedo 0.99, one far lamp": of_box(lambda: cube(100.0, 0.99, WHITE)),
    "the same, two colours, 7 bands": of_box(lambda: cube(100.0, 0.99, RED, BLUE)),
    "cube, depth 30, albedo 0.99": of_box(lambda: cube(30.0, 0.99, WHITE)),
    "fibres, lamp behind": of_box(fibres, hg.Lamp(to_lamp=(-0.5, 0.8, 0.3))),
    "feather, small lamp behind": feather,
    "white linen": recipe("linen"),
    "white linen, lamp behind": recipe("backlit"),
}


def row(title: str, scene: hg.Scene, walks: int) -> dict[str, Any]:
    """Figures of one scene: what is off, and what it takes [CPU s]."""
    images: dict[str, hg.Image] = {}
    seconds: dict[str, float] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        hg.render(scene, hg.Settings(RAYS), mode="full")  # compiles
        for name, more in (("full", 0), ("mended", None)):
            begin = time.process_time()
            images[name] = hg.render(scene, hg.Settings(RAYS, walks=more), mode="full")
            seconds[name] = time.process_time() - begin
        images["path"] = hg.render(scene, hg.Settings(walks, seed=1), mode="path")
    error = images["mended"].full_error
    assert error is not None
    figures = {name: off(images[name], images["path"]) for name in ("full", "mended")}
    return {"title": title, "seconds": seconds, "stated": error.record(), "line": error.line(), **figures,
            "noise_of_blocks": noise_of_blocks(images["path"])}  # fmt: skip


def off(image: hg.Image, truth: hg.Image) -> dict[str, float]:
    """What a picture is off where there is matter, over the mean of the truth there: mean, blocks, the worst block."""
    there = shows_matter(image)
    own, real = (in_blocks(values.xyz()[..., 1].astype(float))[there] for values in (image, truth))
    left = (own - real) / real.mean()
    square = float(np.mean(left**2)) - noise_of_blocks(truth) ** 2
    return {
        "mean": float(left.mean()),
        "blocks": math.sqrt(max(square, 0.0)),
        "worst": float(left[np.abs(left).argmax()]),
    }


def noise_of_blocks(truth: hg.Image) -> float:
    """Of path, root mean square over the mean where there is matter."""
    assert truth.variance is not None
    there = shows_matter(truth)
    light = (truth.variance, truth.xyz()[..., 1])
    variance, mean = (float(in_blocks(values.astype(float))[there].mean()) for values in light)
    return math.sqrt(variance) / BLOCK / mean


def shows_matter(image: hg.Image) -> NDArray[np.bool_]:
    """Which blocks show any."""
    return in_blocks(image.alpha.astype(float)) > 0.0


def main(
    recipes: tyro.conf.Positional[Path], out: Path, pixels: int = PIXELS, walks: int = WALKS, only: str = ""
) -> None:
    """Render every scene by full, with and without walks, and by path.

    Args:
        recipes: folder of the recipes.
        out: folder to write.
        pixels: a side of the pictures.
        walks: a pixel of path.
        only: a word in the titles of the scenes to render; the others stay as they are.
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = hg.read_json(out / "results.json")["rows"] if (out / "results.json").exists() else []
    rows = {one["title"]: one for one in kept}
    for title, make in SCENES.items():
        if only in title and title not in rows:
            print(title, flush=True)
            rows[title] = row(title, make(recipes, pixels), walks)
            record: dict[str, Any] = {"hagoromo": hg.__version__, "pixels": pixels, "walks": walks}
            record["rows"] = [rows[name] for name in SCENES if name in rows]
            hg.write_json(out / "results.json", record)
    write_page(out)


def write_page(out: Path) -> None:
    """The page full_error.md in the folder `out`, of results.json, and of few_walks.json and WIDE, if there are any."""
    few, wide = (
        hg.read_json(out / name) if (out / name).exists() else {"rows": []} for name in ("few_walks.json", WIDE)
    )
    record = hg.read_json(out / "results.json")
    page = hg.page_text("full_error.md.j2", "studies", block=BLOCK, few=few, wide=wide, **record)
    with hg.whole_file(out / "full_error.md", force=True) as path:
        path.write_text(page, encoding="utf-8", newline="\n")
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
