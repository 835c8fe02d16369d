"""The study of random scenes: scenes that nobody chose, by march and full, beside path.

    python -m studies.random_scenes --out out/random_scenes

A scene is one number, see studies.drawn_scenes. March is held to path's first order; full to its light of higher
orders, and to what it states of itself. Truth is two pictures of path, whose difference is their noise. Leaves:
results.json and random_scenes.md, which belongs to docs. A number that is in results.json is kept, and so is a truth
that is there. With `--mode full` march is left out, and what is left is wide_scenes.json beside the pages of
studies.full_error.
"""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.image.scene.modes import Mode
from studies import full_error
from studies.command import command
from studies.drawn_scenes import drawn_scene
from studies.orders import in_blocks

PIXELS = 48  # a side
FIRST, SCENES = 100, 26
RAYS = 4  # a pixel, of full
MANY_RAYS = 16  # of march
LEAST_WALKS = 32  # a pixel, of each picture of the truth
NOISE = 0.06  # of Y of a pixel of each
LONGEST = 60.0  # of each [s]
MOST_LIGHTS = 8  # of scenes that full is judged on alone: it is compiled for each mixture of lamps
DARK = 1e-4  # mean Y below which a scene shows nothing: matter is lit by 0.3 and more
ROUNDING = 1e-6  # of the largest weight, below 0
TOLERANCE = hg.Settings().tolerance  # of march
SURE = 1.96  # standard errors on each side of an interval of 95 %
Array = NDArray[np.float64]


def y_of(image: hg.Image, part: str = "") -> Array:
    """Y of the pixels, of all light or a part of it."""
    return (image.part(part) if part else image).xyz()[..., 1].astype(float)


class TimedPictures:
    """Pictures of one scene, the processor seconds that each took, and what was warned of."""

    def __init__(self, scene: hg.Scene) -> None:
        self.scene = scene
        self.seconds: dict[str, float] = {}
        self.warned: list[str] = []

    def picture(self, name: str, mode: Mode, settings: hg.Settings) -> hg.Image:
        """A picture of the scene."""
        begin = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            image = hg.render(self.scene, settings, mode=mode)
        self.warned += [f"{name}: {one.message}" for one in caught]
        self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - begin
        return image


def off(picture: Array, truths: Array, there: NDArray[np.bool_], mean: float) -> dict[str, float]:
    """What Y of a picture is off, over `mean`, in blocks that show matter: in the mean; root mean square, without the
    noise of the truths; in the worst block. Noise is that of the truths: in the mean, in a block, in the mean square.
    """
    one, other = ((picture - truth) / mean for truth in truths)
    first, second = (in_blocks(each)[there] for each in (one, other))
    noise, both = 0.5 * (first - second), 0.5 * (first + second)
    worst = int(np.abs(both).argmax())
    return {
        "mean": float(both.mean()),
        "mean_noise": float(np.sqrt((noise**2).sum()) / noise.size),
        "blocks": rooted(float((first * second).mean())),
        "worst": float(both[worst]),
        "noise": float(np.sqrt((noise**2).mean())),
        "square_noise": 2.0 * float(np.sqrt((both**2 * noise**2).sum())) / noise.size,
    }


def rooted(square: float) -> float:
    """Root of what is a square and noise, of its sign."""
    return math.copysign(math.sqrt(abs(square)), square)


class Truth(NamedTuple):
    """Y of two pictures of path, (2, height, width): of the first order, of all light, and of higher orders in it."""

    first: Array
    all_orders: Array
    higher: Array

    @classmethod
    def of(cls, timed: TimedPictures, seconds: float, marched: bool) -> Truth:
        """Of a scene, in so many seconds each at most; of the first order alone where march is held to it."""

        def pictures(name: str, orders: int | None) -> list[hg.Image]:
            settings = hg.Settings(LEAST_WALKS, orders=orders, error=NOISE, seconds=seconds)
            return [timed.picture(name, "path", replace(settings, seed=1 + k)) for k in range(2)]

        every = pictures("path", None)
        first = pictures("first", 1) if marched else []
        return cls(*(np.array([y_of(one, part) for one in some])
                     for some, part in ((first, ""), (every, ""), (every, "higher"))))  # fmt: skip


def row(number: int, pixels: int, home: Path, seconds: float, marched: bool) -> dict[str, Any]:
    """Figures of a scene. home: folder where the truth is kept, and taken from if it is there. marched: whether march
    is judged, too.
    """
    drawn = drawn_scene(number, pixels)
    timed = TimedPictures(drawn.scene)
    found: dict[str, Any] = {"number": number, "words": drawn.words, "seconds": timed.seconds, "warned": timed.warned}
    if len(drawn.scene.lights) > MOST_LIGHTS and not marched:
        return found | {"left_out": True}
    try:
        pictures = {"march": timed.picture("march", "march", hg.Settings(MANY_RAYS))} if marched else {}
        full = pictures["full"] = timed.picture("full", "full", hg.Settings(RAYS))
    except hg.InputError as error:
        return found | {"refused": str(error)}
    found["wrong"] = wrong_values(pictures)
    if max(y_of(image).mean() for image in pictures.values()) < DARK:
        return found | {"dark": True}
    kept = home / f"truth_{number}.npz"
    if not kept.exists():
        np.savez(kept, **Truth.of(timed, seconds, marched)._asdict())
    truth = Truth(**np.load(kept))
    there = in_blocks(full.alpha.astype(float)) > 0.0
    mean, higher = (float(np.mean([in_blocks(each)[there].mean() for each in some])) for some in truth[1:])
    error = full.full_error
    found |= {
        "share": higher / mean,
        "bands_error": full.metadata["bands_error"],
        "higher": off(y_of(full, "higher"), truth.higher, there, mean),
        "stated": error.record() if error else None,
    }
    if error:
        found["held"] = holds(found["higher"], found["stated"]["mended"])
    if marched:
        mean_first = float(np.mean([in_blocks(each)[there].mean() for each in truth.first]))
        found["march"] = off(y_of(pictures["march"]), truth.first, there, mean_first)
    return found


def wrong_values(images: dict[str, hg.Image]) -> list[str]:
    """Names of pictures with values that no picture has."""
    return [
        name
        for name, image in images.items()
        if not (
            np.isfinite(image.weights).all()
            and image.weights.min() >= -ROUNDING * image.weights.max()
            and 0.0 <= image.alpha.min() <= image.alpha.max() <= 1.0 + ROUNDING
        )
    ]


def holds(off: dict[str, float], stated: dict[str, Any]) -> dict[str, bool]:
    """Whether intervals of 95 % of mean and blocks that a picture states hold what it is off; the noise of the truth
    widens them.
    """
    middle, half = stated["mean"], 0.5 * (stated["mean_interval"][1] - stated["mean_interval"][0])
    low, high = (value**2 for value in stated["blocks_interval"])
    square, wider = math.copysign(off["blocks"] ** 2, off["blocks"]), SURE * off["square_noise"]
    return {
        "mean": abs(off["mean"] - middle) <= math.hypot(half, SURE * off["mean_noise"]),
        "blocks": low - wider <= square <= high + wider,
    }


def write_page(out: Path) -> None:
    """The page random_scenes.md in the folder `out`, of results.json."""
    record = hg.read_json(out / "results.json")
    rows = [row for row in record["rows"] if "march" in row]
    held = [row["held"] for row in rows if row["stated"]]
    figures = {
        "drawn": len(record["rows"]),
        "dark": sum("dark" in row for row in record["rows"]),
        "refused": [row for row in record["rows"] if "refused" in row],
        "wrong": sum(bool(row.get("wrong")) for row in record["rows"]),
        "stated": len(held),
        "held": {key: sum(each[key] for each in held) for key in ("mean", "blocks")},
        "summary": {name: summary([row[name] for row in rows]) for name in ("march", "higher")},
    }
    page = hg.page_text("random_scenes.md.j2", "studies", **record | {"rows": rows} | figures, walks=LEAST_WALKS,
                        rays=RAYS, many=MANY_RAYS, noise=NOISE)  # fmt: skip
    with hg.whole_file(out / "random_scenes.md", force=True) as path:
        path.write_text(page, encoding="utf-8", newline="\n")
    print(f"wrote {out}")


def summary(offs: list[dict[str, float]]) -> dict[str, float]:
    """Of scenes: the median and the largest of what means and blocks are off, without sign."""
    means, blocks = ([abs(off[key]) for off in offs] for key in ("mean", "blocks"))
    return {
        "mean": float(np.median(means)),
        "worst_mean": max(means),
        "blocks": float(np.median(blocks)),
        "worst_blocks": max(blocks),
        "within": sum(block <= TOLERANCE for block in blocks),
    }


def main(
    out: Path,
    first: int = FIRST,
    scenes: int = SCENES,
    pixels: int = PIXELS,
    seconds: float = LONGEST,
    mode: Literal["both", "full"] = "both",
) -> None:
    """Render scenes of numbers in a row by march, full and path.

    Args:
        out: folder to write.
        first: number of the first scene.
        scenes: how many.
        pixels: a side of the pictures.
        seconds: of each picture of path, at most [s].
        mode: full leaves march out; `out` is then that of studies.full_error.
    """
    out.mkdir(parents=True, exist_ok=True)
    path, marched = out / ("results.json" if mode == "both" else full_error.WIDE), mode == "both"
    rows = {one["number"]: one for one in (hg.read_json(path)["rows"] if path.exists() else [])}
    for number in range(first, first + scenes):
        if number not in rows:
            rows[number] = row(number, pixels, out, seconds, marched)
            print(number, rows[number], flush=True)
            hg.write_json(path, {"pixels": pixels, "rows": [rows[key] for key in sorted(rows)]})
    if marched:
        write_page(out)
    elif (out / "results.json").exists():
        full_error.write_page(out)


if __name__ == "__main__":
    command(main)
