"""The study of captures drawn at random: how far predictions and stated errors hold where nobody chose the objects.

    python -m studies.random_captures --out out/random_captures --seeds 12

A seed draws one to four things of simple shapes (sphere, ellipsoid, cube, cylinder), each of one reflectance, perhaps a
wall behind them, 5 to 20 lamps and a sensor. The capture is simulated, and all but its last photograph are measured,
with its shape given and without; the last is predicted. Then the same photographs are stated with one mistake each,
which `check_photographs` should name, while it should doubt nothing of the right ones.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

import hagoromo as hg
from studies import mistakes
from studies.command import command
from studies.table import print_table

Array = NDArray[Any]
EYE = 0.8  # m from the middle
BODY_AT = (380.0, 500.0, 600.0, 730.0)  # nm: where body colours are drawn
SHAPES = ("sphere", "ellipsoid", "cube", "cylinder")
WALL = """name = "wall"
shape = "rectangle"
position = [0.0, 0.06, 0.0]
rotation_deg = [90.0, 0.0, 0.0]
scale = 0.3
"""
SEEDS = 12
ERROR_COLUMNS = (
    "seed", "lamps", "boxes, shape given", "boxes", "boxes, learnt", "normals, learnt", "Lambert", "expected",
    "95 % regions of normals hold",
)  # fmt: skip
HELD = float(chi2.ppf(0.95, 2))  # of a direction: squared error over its variance a component


def random_scene(seed: int) -> str:
    """The scene file (TOML) of a seed."""
    random = np.random.default_rng(seed)
    parts = [_camera(random)]
    for k in range(int(random.integers(1, 5))):
        place = (0.0, 0.0, 0.0) if k == 0 else tuple(random.uniform((-0.04, -0.06, -0.04), (0.04, -0.03, 0.04)))
        size = random.uniform(0.03, 0.045) if k == 0 else random.uniform(0.008, 0.018)
        parts.append(_thing(random, f"thing {k}", str(random.choice(SHAPES)), place, float(size)))
    if random.random() < 0.4:
        parts.append(f"[[surface]]\n{WALL}{_reflectance(random)}")
    widest, count = random.choice([35.0, 60.0]), int(random.integers(5, 21))
    parts += [_lamp(random, k, widest) for k in range(count)]
    return "\n".join(parts)


def _camera(random: np.random.Generator) -> str:
    bits = int(random.choice([8, 12]))
    well = float(random.choice([10_000.0, 40_000.0]))
    sensor = f"{{exposure = {well / 2}, full_well = {well}, read_noise = 5, gain = {well / 2**bits}, bits = {bits}}}"
    return f"""[camera]
size = [97, 89]
focal = [560.0, 560.0]
response = "canon_eos_300d"
sensor = {sensor}
eye = [0.0, {-EYE}, 0.0]
target = [0.0, 0.0, 0.0]
"""


def _thing(random: np.random.Generator, name: str, kind: str, place: tuple[float, ...], size: float) -> str:
    scale = [size] * 3 if kind == "sphere" else (size * random.uniform(0.6, 1.0, 3)).tolist()
    shape = "sphere" if kind == "ellipsoid" else kind
    turned = random.uniform(0.0, 360.0, 3).tolist()
    head = f'name = "{name}"\nshape = "{shape}"\nposition = {list(map(float, place))}\nrotation_deg = {turned}\n'
    return f"[[surface]]\n{head}scale = {scale}\n{_reflectance(random)}"


def _reflectance(random: np.random.Generator) -> str:
    """One that keeps energy: its body is darkened until it does."""
    body, gloss = random.uniform(0.05, 1.0, 4), {"beta": (0.0, 0.2, 0.5), "gamma": (0.05, 0.12, 0.25, 0.45)}
    values: dict[str, Any] = {
        "alpha": float(random.choice([0.02, 0.1, 0.25])),
        "n": float(random.choice([1.35, 1.5, 1.8])),
    }
    values |= {name: float(random.choice(of)) for name, of in gloss.items()}
    while True:
        try:
            hg.Reflectance(**values, body_colour=hg.Spectrum(BODY_AT, body))
            break
        except hg.InputError:
            body = 0.8 * body
    lines = "".join(f"{name} = {value}\n" for name, value in values.items())
    return f"[surface.reflectance]\n{lines}body_colour = {{wavelengths = {list(BODY_AT)}, values = {body.tolist()}}}\n"


def _lamp(random: np.random.Generator, number: int, widest: float) -> str:
    """Near the object or far from it, within `widest` [°] of the axis of the camera."""
    height, around = random.uniform(np.cos(np.radians(widest)), 1.0), random.uniform(0.0, 2.0 * np.pi)
    across = np.sqrt(1.0 - height**2)
    towards = np.array([across * np.cos(around), -height, across * np.sin(around)])
    away = float(random.uniform(0.7, 1.2))
    strength = away**2 * float(random.uniform(0.8, 1.2))
    place = (away * towards).tolist()
    return f'[[lamp]]\nname = "{number:02d}"\nposition = {place}\nintensity = {strength}\nspectrum = "D65"\n'


def predicted(capture: hg.Capture) -> tuple[dict[str, Any], hg.Relighting]:
    """Of the last photograph: relative errors of each prediction, and the expected one; and what `relight` gave."""
    begun = time.process_time()
    relit = hg.relight(capture)
    (one,) = relit.predictions
    return {
        "errors": {name: figures.relative_rmse for name, figures in one.compared.items()},
        "expected": one.record()["expected_error"],
        "materials": len(relit.measurement.materials),
        "seconds": time.process_time() - begun,
    }, relit


def without_shape(capture: hg.Capture) -> hg.Capture:
    """The same photographs; the shape is to be found."""
    return replace(capture, points=None, normals=None)


def normals_held(capture: hg.Capture, measurement: hg.Measurement) -> dict[str, float]:
    """Median and 95 % of the errors of solved normals [°], and the share of 95 % regions that hold the true one."""
    assert capture.normals is not None and measurement.normal_variance is not None
    seen = (np.linalg.norm(measurement.normals, axis=2) > 0.5) & (np.linalg.norm(capture.normals, axis=2) > 0.5)
    seen &= np.isfinite(measurement.normal_variance)
    cosine = np.sum(measurement.normals * capture.normals, axis=2)[seen]
    error = np.arccos(np.clip(cosine, -1.0, 1.0))
    # the variance is of the direction: both components together
    held = error**2 < HELD * measurement.normal_variance[seen] / 2.0
    return {
        "median": float(np.degrees(np.median(error))),
        "95": float(np.degrees(np.percentile(error, 95))),
        "held": float(np.mean(held)),
    }


def drawn_two(capture: hg.Capture, random: np.random.Generator) -> tuple[int, int]:
    """Numbers of two photographs."""
    first, second = random.choice(len(capture.photographs), 2, replace=False).tolist()
    return first, second


def swapped(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """Two photographs with one another's lamps."""
    return mistakes.exchanged(capture, *drawn_two(capture, random))


def direction(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """A lamp 8° beside where it is stated."""
    number, seed = drawn_two(capture, random)
    return mistakes.turned(capture, number, 8.0, seed)[0]


def strength(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """A lamp that is 1.4 times as strong as stated."""
    number, _ = drawn_two(capture, random)
    return mistakes.with_shot(capture, number, lambda shot: mistakes.brighter(shot, 1.4))


def encoded(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """Values as a screen takes them, stated to be linear."""
    return mistakes.displayed(capture)


def moved(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """The object moved by 1.5 px before one photograph."""
    number, _ = drawn_two(capture, random)
    angle = random.uniform(0.0, 2.0 * np.pi)
    return mistakes.moved(capture, number, 1.5 * float(np.cos(angle)), 1.5 * float(np.sin(angle)))


def blurred(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """One photograph out of focus, by σ = 2.5 px."""
    return mistakes.blurred(capture, drawn_two(capture, random)[0], 2.5)


def twice(capture: hg.Capture, random: np.random.Generator) -> hg.Capture:
    """One photograph in the place of another."""
    return mistakes.twice(capture, *drawn_two(capture, random))


MISTAKES: Mapping[Callable[[hg.Capture, np.random.Generator], hg.Capture], tuple[str, ...]] = {
    swapped: ("order",),
    direction: ("lamps",),
    strength: ("strengths",),
    encoded: ("transfer",),
    moved: ("motion",),
    blurred: ("blur",),
    twice: ("order", "motion", "strengths"),
}  # and the checks of which one should be doubtful


def row_of(seed: int, capture: hg.Capture) -> dict[str, Any]:
    """What predictions of the capture of a seed are off, with its shape and without."""
    row: dict[str, Any] = {"seed": seed, "lamps": len(capture.photographs)}
    for kind, given in (("shape", capture), ("none", without_shape(capture))):
        try:
            row[kind], relit = predicted(given)
        except hg.InputError as error:
            row[kind] = {"refused": str(error)}
            continue
        if kind == "none":
            row[kind]["normals"] = normals_held(capture, relit.measurement)
    return row


def states(capture: hg.Capture, seed: int) -> dict[str, dict[str, str]]:
    """What came out of each check, of the capture as it is ("right") and with each mistake."""
    said = {"right": _states_of(capture)}
    for number, mistake in enumerate(MISTAKES):
        said[mistake.__name__] = _states_of(mistake(capture, np.random.default_rng([seed, number])))
    return said


def _states_of(capture: hg.Capture) -> dict[str, str]:
    return {one.name: one.state for one in hg.check_photographs(capture).checks}


def studied(seeds: range, out: Path, with_errors: bool = True) -> list[dict[str, Any]]:
    """A row a seed: `row_of` where with_errors, and `states`; scenes are kept in `out`."""
    rows = []
    for seed in seeds:
        scene = out / f"scene_{seed}.toml"
        scene.write_text(random_scene(seed), encoding="utf-8")
        capture = hg.simulate(scene)
        row = row_of(seed, capture) if with_errors else {"seed": seed}
        row["checks"] = states(without_shape(capture), seed)
        rows.append(row)
        print(json.dumps(row), flush=True)
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Cells of the errors of each row."""
    cells = []
    for row in rows:
        given, found = row["shape"], row["none"]
        line = [str(row["seed"]), str(row["lamps"])]
        line += [percent(one.get("errors", {}).get("boxes")) for one in (given, found)]
        line += [percent(found.get("errors", {}).get(key)) for key in ("boxes_learnt", "learnt", "lambert")]
        line += [percent(found.get("expected")), percent(found.get("normals", {}).get("held"))]
        cells.append(tuple(line))
    return cells


def percent(share: float | None) -> str:
    """A share in per cent, or a dash."""
    return "–" if share is None else f"{100.0 * share:.1f}"


def named(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Of each mistake: in how many captures it is named, in how many its checks are good, how many are doubted at all,
    of how many.
    """
    right = [list(row["checks"]["right"].values()) for row in rows]
    lines: list[tuple[str, ...]] = [("none", "–", "–", str(sum("doubtful" in one for one in right)), str(len(rows)))]
    for mistake, where in MISTAKES.items():
        said = [row["checks"][mistake.__name__] for row in rows]
        found = sum("doubtful" in [one[name] for name in where] for one in said)
        good = sum({one[name] for name in where} == {"good"} for one in said)
        doubted = sum("doubtful" in one.values() for one in said)
        lines.append((mistake.__name__, *map(str, (found, good, doubted, len(said)))))
    return lines


def main(out: Path, first: int = 0, seeds: int = SEEDS, errors: bool = True, force: bool = False) -> None:
    """Study captures drawn at random.

    out: folder of the scenes and of random_captures.json. first, seeds: the first seed and how many. errors: predict
    photographs, too, besides the checks.
    """
    with hg.whole_folder(out, force) as home:
        rows = studied(range(first, first + seeds), home, errors)
        record = {"hagoromo": hg.__version__, "first": first, "rows": rows}
        (home / "random_captures.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    if errors:
        print_table("Photographs kept aside: relative errors [%]", ERROR_COLUMNS, table(rows))
    print_table(
        "Mistakes that the checks name", ("mistake", "named", "called good", "doubted", "captures"), named(rows)
    )


if __name__ == "__main__":
    command(main)
