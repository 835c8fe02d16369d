"""All orders of light at equal error: modes path and full against Mitsuba's volpath and volpathmis, and Cycles.

Scenes: `orders_scenes.py`; one is a piece that runs alone. Contenders take turns, A B C A B C …, each with its own seed
in every round; times are medians of the CPU time of all threads, kernels compiled before. Nothing is extrapolated:

* race: a first look chooses walks by which blocks of 32 × 32 pixels have the noise that was asked for, in MOST times
  the time of path at most: who needs more shows the noise that it reached. The noise of a row is that of its pictures:
  half the mean square difference of each two rounds. Where media are the same, the row has the mean light over path's,
  with its standard error.
* full: its error is the root of the mean of (F − A)(F − B), with A and B the means of path's even and odd rounds,
  whose noise falls out. Then Mitsuba gets CHASE times the CPU time of full: what noise has a pixel of it then?
* another camera: the field is kept, and the picture is timed beside the march of the same camera.

    python benchmarks/orders.py [--scene cloth] [--size 512] [--error 0.01] [--rounds 2] [--only Cycles]

Leaves: out/bench/orders_SCENE.json; `python benchmarks/page.py` makes the table of docs/performance.md of them.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from orders_rivals import Cycles, Mitsuba
from orders_scenes import CONTESTS, WAVELENGTH, OrdersContest
from tables import CHASE
from turns import RECORDS, options, record

import hagoromo as hg
from hagoromo.image.full.picture import full_picture
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.transport.film import pixel_points

BLOCK = 32  # px a side
SEEN = 0.02  # coverage of a pixel by matter from which it counts
MOST = 6.0  # times the time of path that the picture of a rival may take
CHASED = "Mitsuba volpath"
FULL_RAYS = 4  # a pixel
PARTS = 8  # pictures of a chase, about
SURE = 1.65  # standard errors that are added to the square of full's error: in 95 of 100 cases it is less
LOOK = 4  # walks a pixel of the first look at most
Array = NDArray[np.float64]
Picture = Callable[[int, int], Array]


class Timed:
    """A contender: pictures by walks a pixel and seed, with their CPU times."""

    def __init__(self, picture: Picture) -> None:
        self.picture = picture
        self.pictures: list[Array] = []
        self.times: list[float] = []
        self.walks = 0

    def run(self, walks: int, seed: int) -> tuple[float, Array]:
        """CPU time of all threads [s], and the picture."""
        begin = time.process_time()
        values = self.picture(walks, seed)
        dr.sync_thread()
        taken = time.process_time() - begin
        return (self.picture.cpu_s if isinstance(self.picture, Cycles) else taken), values

    def look(self, error: float, budget: float, seen: NDArray[np.bool_]) -> None:
        """Choose the walks: for an error of blocks, or what the budget of CPU time is enough for."""
        self.run(1, 90)  # compiles
        taken, one = self.run(1, 91)
        count = int(np.clip(0.25 * budget / max(taken, 1e-9), 1, LOOK))
        if taken > budget:
            self.walks = 1
            return
        if count > 1:
            taken, one = self.run(count, 91)
        noise = relative_noise([one, self.run(count, 92)[1]], seen, BLOCK)
        wanted, affordable = count * (noise / error) ** 2, count * budget / max(taken, 1e-9)
        self.walks = max(math.ceil(min(wanted, affordable)), 1)

    def turn(self, seed: int) -> None:
        """One picture of the race."""
        taken, values = self.run(self.walks, seed)
        self.times.append(taken)
        self.pictures.append(values)


def blocks(values: Array, side: int) -> Array:
    """Means of blocks of side × side pixels; what is left over is cut off."""
    rows, columns = (n // side for n in values.shape)
    return values[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))


def covered(contest: OrdersContest, pixels: int) -> NDArray[np.bool_]:
    """Pixels that count: those that show matter, told without noise by the march."""
    return hg.render(contest.scene(pixels), hg.Settings(FULL_RAYS)).alpha > SEEN


def relative_noise(pictures: Sequence[Array], seen: NDArray[np.bool_], side: int) -> float:
    """Root mean square noise of one picture over its mean, of blocks of the pixels that count, from pairs."""
    share = blocks(seen.astype(float), side)
    full, mean = share > 0.0, float(np.mean([picture[seen].mean() for picture in pictures]))
    squares = [
        float(np.mean(np.square(blocks((one - other) * seen, side)[full] / share[full])))
        for one, other in itertools.combinations(pictures, 2)
    ]
    return math.sqrt(0.5 * float(np.mean(squares))) / mean


def relative_error(values: Array, halves: tuple[Array, Array], seen: NDArray[np.bool_], side: int) -> float:
    """Root mean square error over the mean of a picture without noise, from two independent ones of the truth: what it
    is at most, in 95 of 100 cases.
    """
    share = blocks(seen.astype(float), side)
    off = [(blocks((values - half) * seen, side) / np.maximum(share, 1e-30))[share > 0.0] for half in halves]
    mean, squares = float(np.mean([half[seen].mean() for half in halves])), off[0] * off[1]
    doubt = float(squares.std()) / math.sqrt(squares.size)
    return math.sqrt(max(float(squares.mean()), 0.0) + SURE * doubt) / mean


def ratio_of_means(one: Sequence[Array], other: Sequence[Array], seen: NDArray[np.bool_]) -> tuple[float, float]:
    """Mean light of some pictures over that of others, and its standard error."""
    means = [np.array([picture[seen].mean() for picture in pictures]) for pictures in (one, other)]
    noise = math.sqrt(sum(each.var(ddof=1) / len(each) / each.mean() ** 2 for each in means))
    ratio = float(means[0].mean() / means[1].mean())
    return ratio, ratio * noise


def contenders(contest: OrdersContest, pixels: int, threads: int) -> dict[str, Picture]:
    """Pictures by walks a pixel and seed; those of Cycles where it is installed."""
    ours = contest.scene(pixels)

    def path(walks: int, seed: int) -> Array:
        return radiance(hg.render(ours, hg.Settings(samples=walks, seed=seed), mode="path"))

    found: dict[str, Picture] = {"path": path}
    found |= {f"Mitsuba {name}": Mitsuba(contest, pixels, name) for name in ("volpath", "volpathmis")}
    try:
        cycles = Cycles(contest, pixels, RECORDS / "cycles", threads)
        found[f"Cycles {cycles.version}"] = cycles
    except FileNotFoundError as absent:
        print(f"no Cycles: {absent}", flush=True)
    return found


def radiance(image: hg.Image) -> Array:
    """At WAVELENGTH, under all lamps."""
    palette = image.palette
    shares = [lamp.at(WAVELENGTH) * colour.at(WAVELENGTH) for lamp in palette.lamps for colour in palette.colours]
    return image.weights.astype(float) @ np.array(shares)


def raced(
    timed: Mapping[str, Timed], contest: OrdersContest, seen: NDArray[np.bool_], given: argparse.Namespace
) -> list[dict[str, Any]]:
    """The rows of the race."""
    budget = math.inf
    for name, each in timed.items():
        each.look(given.error, budget, seen)
        if name == "path":
            budget = MOST * each.run(each.walks, 0)[0]
        print(f"{contest.title}: {name} takes {each.walks} walks a pixel", flush=True)
    for seed in range(1, given.rounds + 1):
        for each in timed.values():
            each.turn(seed)
    path, rows = timed["path"], []
    for name, each in timed.items():
        row = {"by": name, "walks": each.walks, "cpu_s": float(np.median(each.times))}
        row |= {f"noise_{side}": relative_noise(each.pictures, seen, side) for side in (1, BLOCK)}
        if contest.same and "Mitsuba" in name:
            row["mean"], row["mean_error"] = ratio_of_means(each.pictures, path.pictures, seen)
        rows.append(row)
    return rows


def full_rows(
    contest: OrdersContest, pixels: int, path: Sequence[Array], seen: NDArray[np.bool_], rounds: int
) -> list[dict[str, Any]]:
    """Mode full: solved and marched, and marched from elsewhere, beside the march."""
    scene, settings, cache = contest.scene(pixels), hg.Settings(FULL_RAYS, walks=0), SceneCache()
    points = pixel_points(FULL_RAYS, 0)
    try:
        full_picture(scene, settings, points, SceneCache())  # compiles
    except hg.InputError as refused:
        return [{"by": "full", "refused": str(refused)}]
    taken, image = cpu(lambda: full_picture(scene, settings, points, cache))
    turned = contest.scene(pixels, contest.other_eye)
    again: list[float] = []
    march: list[float] = []
    for _ in range(rounds):
        again.append(cpu(lambda: full_picture(turned, settings, points, cache))[0])
        march.append(cpu(lambda: hg.render(turned, settings))[0])
    halves = np.mean(path[::2], axis=0), np.mean(path[1::2], axis=0)
    values = radiance(image)
    row = {"by": "full", "walks": FULL_RAYS, "cpu_s": taken}
    row |= {f"noise_{side}": relative_error(values, halves, seen, side) for side in (1, BLOCK)}
    truth = np.array([picture[seen].mean() for picture in path])
    row["mean"] = float(values[seen].mean() / truth.mean())
    row["mean_error"] = row["mean"] * float(truth.std(ddof=1) / math.sqrt(len(path)) / truth.mean())
    field = image.metadata.get("field")
    if field:
        row["memory"] = field["bytes"] / sum(box.bricks.bytes for box in contest.boxes)
    other = {"by": "full, another camera", "walks": FULL_RAYS, "cpu_s": float(np.median(again))}
    return [row, other | {"march_s": float(np.median(march))}]


def chased(timed: Mapping[str, Timed], full: Mapping[str, Any], seen: NDArray[np.bool_]) -> list[dict[str, Any]]:
    """What noise a pixel of a rival's picture has after CHASE times the CPU time of full."""
    rows = []
    for name, each in timed.items():
        if name != CHASED or "cpu_s" not in full:
            continue
        limit, taken, seed = CHASE * full["cpu_s"], 0.0, 100
        walks, sums, counts = each.walks, [np.zeros(seen.shape), np.zeros(seen.shape)], [0, 0]
        while taken < limit:
            begun = taken
            for half in (0, 1):  # of one picture: their difference tells its noise
                seconds, values = each.run(walks, seed)
                sums[half] += walks * values
                counts[half], taken, seed = counts[half] + walks, taken + seconds, seed + 1
            walks *= 2 if taken - begun < limit / PARTS else 1
        halves = [total / count for total, count in zip(sums, counts, strict=True)]
        noise = relative_noise(halves, seen, 1) / math.sqrt(2.0)
        rows.append(
            {"by": name, "chase": taken / full["cpu_s"], "walks": sum(counts), "cpu_s": taken, "noise_1": noise}
        )
        print(rows[-1], flush=True)
    return rows


def cpu(frame: Callable[[], Any]) -> tuple[float, Any]:
    """CPU time of all threads [s], and the result."""
    begin = time.process_time()
    result = frame()
    dr.sync_thread()
    return time.process_time() - begin, result


def measured(name: str, given: argparse.Namespace) -> dict[str, Any]:
    """The figures of a scene."""
    contest = CONTESTS[name]()
    pictures = contenders(contest, given.size, os.cpu_count() or 1)
    if given.only:
        pictures = {who: each for who, each in pictures.items() if who.startswith(("path", *given.only))}
    timed, seen = {who: Timed(picture) for who, picture in pictures.items()}, covered(contest, given.size)
    try:
        rows = raced(timed, contest, seen, given)
        if given.only:
            return {"rows": rows}
        rows += full_rows(contest, given.size, timed["path"].pictures, seen, given.rounds)
        full = next(row for row in rows if row["by"] == "full")
        chase = [] if given.no_chase else chased(timed, full, seen)
    finally:
        for picture in pictures.values():
            if isinstance(picture, Cycles):
                picture.close()
    figures = {"title": contest.title, "same": contest.same, "pixels": given.size, "error": given.error}
    figures |= {"most": MOST, "rounds": given.rounds, "rows": rows, "chase": chase}
    return figures | {"seeds": f"1 to {given.rounds}", "load_before": os.getloadavg()[0]}


def main() -> None:
    """Measure the scenes that are asked for, one record each."""
    parser = options(__doc__, 2)
    parser.add_argument("--scene", choices=tuple(CONTESTS), action="append", help="all where none is given")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--error", type=float, default=0.01, help="of blocks of 32 × 32 pixels")
    parser.add_argument(
        "--no-chase", action="store_true", help="leave out what Mitsuba reaches in 20 times full's time"
    )
    parser.add_argument(
        "--only", nargs="+", metavar="NAME", help="race path against these alone, by how their names begin; no record"
    )
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("noise is told from two rounds or more")
    for name in given.scene or CONTESTS:
        begin, spent = time.perf_counter(), time.process_time()
        figures = measured(name, given)
        for row in figures["rows"]:
            print(row, flush=True)
        if given.only:
            continue
        figures["wall_s"], figures["cpu_s"] = time.perf_counter() - begin, time.process_time() - spent
        record(f"orders_{name}", figures)


if __name__ == "__main__":
    main()
