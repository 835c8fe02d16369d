"""Recover strangers: what `hagoromo recover` makes of captures that nobody tuned it to, and what it says of them.

    python -m studies.recover_strangers --out out/recover_strangers [--only NAME …]

24 views of 144² pixels, a near lamp each, 5 to 60° off the eye, 12 bits, noise; 40 nodes, 100 steps of each level. Four
new views each are predicted, against exact light, unscaled, over all pixels. table.md has the rows as a table.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

import hagoromo as hg
from hagoromo.backend import vectors
from studies.path_scenes import path_simulated, shape_mesh
from studies.recover_scenes import Simulated, TrueObject, shots, simulated
from studies.recovery_scores import (
    covered,
    gloss_held,
    held_words,
    psnr,
    said_words,
    seen_angles,
    shape_errors,
    stated,
)
from studies.strange_captures import (
    Bowl,
    Cube,
    HollowCorner,
    MattBall,
    Mug,
    ThinPlate,
    TouchingBalls,
    WhiteMug,
    at_the_camera,
    behind,
    even,
    flash_beside,
    in_files,
    lamps_changed,
    masks_moved,
    resized,
    textured,
    together,
    unlit,
)

SIDE, STEPS, PIXELS, VIEWS, SEED = 40, 100, 144, 24, 1
NEAR, FAR = (5.0, 60.0), (80.0, 110.0)  # degrees of lamps off the eye
HOME = Path("out/recover_strangers")  # of files that a row needs


@dataclass(frozen=True)
class Stranger:
    """A capture. words: what is strange. made: it. truth: the object. size: of its unit of length, or of the object, by
    the usual one. grown: whether strengths of lamps grow with it. refine: what is estimated beside the object. path:
    whether light goes from one part of the object to another. orders: of light that it is recovered by.
    """

    words: str
    made: Callable[[], Simulated]
    truth: type[TrueObject] = TrueObject
    size: float = 1.0
    grown: bool = True
    refine: str = "auto"
    path: bool = False
    orders: Literal["first", "all"] = "first"


@dataclass(frozen=True)
class StrangerRow:
    """new, side: PSNR of new views under lamps like those, and from the side [dB]. normals: mean error at true points;
    seen: of those that cameras see [°], see `seen_angles`. surface: mean distance of true points from it, % of the
    lattice's edge. held: share [%] of true points of which 95 % intervals of position, normal and body colour hold the
    truth, of those that have intervals; stated: share that has them. beta: found; gloss_held: whether its interval and
    that of γ hold the truth. said: remarks and warnings, or the line with which the capture was refused.
    """

    name: str
    words: str
    new: float | None = None
    side: float | None = None
    normals: float | None = None
    seen: float | None = None
    surface: float | None = None
    held: tuple[float, float, float] | None = None
    stated: float = 0.0
    beta: float | None = None
    gloss_held: bool | None = None
    said: tuple[str, ...] = ()
    seconds: float = 0.0


@functools.cache
def usual(truth: type[TrueObject] = TrueObject, views: int = VIEWS, lamps: int = 1) -> Simulated:
    """Photographs as others are made of."""
    return simulated(truth(), shots(views, *NEAR, SEED, PIXELS, lamps), SEED)


@functools.cache
def aside(truth: type[TrueObject], path: bool = False) -> tuple[Simulated, Simulated]:
    """Exact photographs of new views, under lamps like those, and from the side."""
    given = [shots(4, *lamps, seed, PIXELS) for lamps, seed in ((NEAR, 2), (FAR, 3))]
    made = [simulated(truth(), each, noise=False) for each in given]
    if path:
        mesh = shape_mesh(truth())
        lit = [path_simulated(mesh, each, 100 * k, noise=False) for k, each in enumerate(given)]
        made = [
            Simulated(one.capture, one.exact, exact.normals, exact.points) for one, exact in zip(lit, made, strict=True)
        ]
    return made[0], made[1]


def beside(p: hg.Photograph) -> tuple[hg.Lamp, ...]:
    """A lamp in the middle of the object."""
    return (hg.Lamp(position=(0.0, 0.0, 0.0), intensity=1.0),)


def flash() -> Simulated:
    """A flash 5 cm beside the camera."""
    return simulated(TrueObject(), flash_beside(VIEWS, PIXELS), SEED)


@functools.cache
def by_path(truth: type[TrueObject]) -> Simulated:
    """A matt object by Mitsuba's path tracer."""
    return path_simulated(shape_mesh(truth()), shots(VIEWS, *NEAR, SEED, PIXELS), SEED)


def of_both_orders(name: str, words: str, truth: type[TrueObject]) -> dict[str, Stranger]:
    """An object that may light itself, recovered by light of the first order and of all orders."""
    path = f"{words}, by Mitsuba `path`"
    made = functools.partial(by_path, truth)
    return {
        name: Stranger(path, made, truth, path=True),
        f"{name}_all": Stranger(f"{path}, `--orders all`", made, truth, path=True, orders="all"),
    }


STRANGERS = {
    "usual": Stranger("nothing strange", usual),
    "small": Stranger("masks 3 px too small, dark background", lambda: masks_moved(usual(), -3.0)),
    "large": Stranger("masks 3 px too large, dark background", lambda: masks_moved(usual(), 3.0)),
    "wall": Stranger("a textured wall behind it", lambda: behind(usual(), textured)),
    "small_wall": Stranger("the same, masks 3 px too small", lambda: masks_moved(behind(usual(), textured), -3.0)),
    "large_wall": Stranger("the same, masks 3 px too large", lambda: masks_moved(behind(usual(), textured), 3.0)),
    "large_even": Stranger("a grey wall, masks 3 px too large", lambda: masks_moved(behind(usual(), even), 3.0)),
    "mug": Stranger("a mug: its inside shows in no silhouette", lambda: usual(Mug), Mug),
    "plate": Stranger("a plate 3 mm thick, 1.5 voxels", lambda: usual(ThinPlate), ThinPlate),
    "cube": Stranger("a cube with sharp edges", lambda: usual(Cube), Cube),
    **of_both_orders("bowl", "a white bowl that lights itself", Bowl),
    **of_both_orders("white_mug", "a white mug", WhiteMug),
    **of_both_orders("balls", "two white balls that touch", TouchingBalls),
    **of_both_orders("corner", "a white block with a hollow corner", HollowCorner),
    **of_both_orders("matt_ball", "a matt ball with patterns", MattBall),
    "millimetres": Stranger("all in millimetres", lambda: resized(usual(), 1e3, False), size=1e3, grown=False),
    "5 mm": Stranger("an object of 5 mm", lambda: resized(usual(), 0.05), size=0.05),
    "10 m": Stranger("an object of 10 m", lambda: resized(usual(), 100.0), size=100.0),
    "three_lamps": Stranger("three lamps in each photograph", lambda: together(usual(lamps=3), 3)),
    "flash": Stranger("a flash 5 cm beside the camera", flash),
    "flash_wrong": Stranger("the same, stated at the camera", lambda: lamps_changed(flash(), at_the_camera)),
    "flash_refined": Stranger(
        "the same, places refined", lambda: lamps_changed(flash(), at_the_camera), refine="places"
    ),
    "8 bits": Stranger("PNG of 8 bits, display-encoded", lambda: in_files(usual(), HOME / "8_bits", 8)),
    "16 bits": Stranger("PNG of 16 bits, linear", lambda: in_files(usual(), HOME / "16_bits", 16)),
    "8 views": Stranger("8 views", lambda: usual(views=8)),
    "3 views": Stranger("3 views", lambda: usual(views=3)),
    "dark_frames": Stranger("every fourth photograph without light", lambda: unlit(usual(), lambda k: k % 4 == 3)),
    "all_dark": Stranger("all photographs without light", lambda: unlit(usual(), lambda k: True)),
    "lamp_inside": Stranger("lamps inside the object", lambda: lamps_changed(usual(), beside)),
}


def measured(name: str, given: Stranger) -> StrangerRow:
    """Recover a capture, and compare it with what is kept aside."""
    capture, truth = given.made().capture, given.truth()
    settings = hg.RecoverySettings(side=SIDE, steps=STEPS, keep=0, refine=given.refine, orders=given.orders)
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            found = hg.recover(capture, settings)
        except hg.InputError as error:
            return StrangerRow(name, given.words, said=(f"refused: {error}",), seconds=time.process_time() - begin)
    seconds, record = time.process_time() - begin, found.record()
    kept = [resized(each, given.size, given.grown) for each in aside(given.truth, given.path)]
    shown = shape_errors(found, kept[0])
    points = shown.points / given.size
    factor = 1.0 if given.grown else given.size**2  # of body colours that are found
    colours = factor * np.stack([np.array(each) for each in truth.colours(vectors(points))], 1)
    held = gloss_held(found, factor * truth.beta, truth.gamma)
    return StrangerRow(
        name, given.words, psnr(found, kept[0]), psnr(found, kept[1]), float(shown.angles.mean()),
        float(seen_angles(found, kept[0]).mean()),
        100.0 * float(shown.distances.mean()) / (max(found.lattice.shape) * found.lattice.voxel),
        covered(found, shown, colours), stated(found, shown.points), found.beta, held,
        (*(str(each.message) for each in warned), *record["remarks"]), seconds,
    )  # fmt: skip


def table(rows: Sequence[StrangerRow]) -> str:
    """The rows as Markdown."""
    lines = [
        "| capture | new lamps like those, from the side | normals at true points, as seen | surface, of the edge "
        "| 95 % intervals hold position, normal, colour | β, γ held | CPU s | what is said |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        said = said_words(row.said)
        if row.new is None or row.side is None or row.normals is None or row.seen is None or row.surface is None:
            lines.append(f"| {row.words} | | | | | | | {said} |")
            continue
        held = held_words(row.held, row.stated)
        gloss = {True: "yes", False: "no", None: ""}[row.gloss_held]
        scores = f"{row.new:.1f}, {row.side:.1f} dB | {row.normals:.2f}, {row.seen:.2f}° | {row.surface:.2f} %"
        lines.append(f"| {row.words} | {scores} | {held} | {gloss} | {row.seconds:.0f} | {said} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=list(STRANGERS), choices=list(STRANGERS))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in given.only:
        rows.append(measured(name, STRANGERS[name]))
        print(json.dumps(asdict(rows[-1])), flush=True)
    hg.write_json(given.out / "rows.json", {"rows": [asdict(row) for row in rows], "version": hg.__version__})
    (given.out / "table.md").write_text(table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
