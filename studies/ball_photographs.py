"""The study of lamps read off balls: scratched, dusty, glossy balls, masks beside the ball, and real photographs.

    python -m studies.ball_photographs --out out/balls.json --real ../shared/data/uw_psm

The photographs are simulated by `studies.simulated_balls`, which shares nothing with the readings. The angles are those
between what is read and the truth. A set of photographs that is refused is read one photograph at a time, to count how
many are. The real balls have the lamps of a laboratory beside them, and each other: one is chrome, the other grey.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.ball_conditions import CHROME, GLOSSY
from studies.command import command
from studies.simulated_balls import BallSet, ball_set
from studies.table import print_table

SEED = 20
DIAMETERS, SETS, LAMPS = (60, 100, 160, 260, 400), 1, 6  # of balls [px]; sets of photographs each, and their lamps
MASKED, MASKED_DIAMETER = ("clean", "worn", "glazed"), 160  # balls whose mask is moved
MOVES, MASKED_SETS = (0.0, 0.03, 0.2, 0.4), 2  # of the radius; sets of photographs each
ROOM = 0.7  # of the radius: the picture around the ball, so that a mask that is moved is whole
REAL_MOVES = (0, 10, 40)  # [px]
ALL = "all"

Angles = list[tuple[float, float]]  # angle to the truth and stated error [°]


def ball_study(real: Path | None = None) -> dict[str, Any]:
    """The record: `worn` by condition and diameter, `masks` by condition and move, `real` where it is given."""
    record: dict[str, Any] = {
        "worn": {kind: wear_rows(kind) for kind in CHROME | GLOSSY},
        "masks": {kind: {f"{move:g}": mask_row(kind, move) for move in MOVES} for kind in MASKED},
    }
    if real is not None:
        record["real"] = real_rows(real)
    return record


def wear_rows(kind: str) -> dict[str, Any]:
    """By diameter and for all: readings, refused photographs, mean and largest angle [°], share within two errors."""
    rows, every, lost = {}, Angles(), 0
    for diameter in DIAMETERS:
        angles, refused = Angles(), 0
        for number in range(SETS):
            shown = simulated(kind, diameter, number)
            found = read_each(shown.photographs, shown.mask)
            truth = dict(zip(shown.photographs, shown.lamps, strict=True))
            angles += [_angle(one, truth[name]) for name, one in found.items()]
            refused += LAMPS - len(found)
        rows[f"{diameter}"] = _row(angles, refused)
        every, lost = every + angles, lost + refused
    return {**rows, ALL: _row(every, lost)}


def simulated(kind: str, diameter: int, number: int) -> BallSet:
    """The photographs of one ball in this condition."""
    random = np.random.default_rng([SEED + number, diameter, sum(map(ord, kind))])
    return ball_set((CHROME | GLOSSY)[kind], diameter, LAMPS, random)


def read_each(photographs: Mapping[str, NDArray], mask: NDArray) -> dict[str, hg.LampReading]:
    """The lamps by name; of photographs that are refused together, those that are read alone."""
    try:
        return {one.name: one for one in hg.lamps_from_ball(photographs, mask)[1]}
    except hg.InputError:
        found = {}
    for name, photograph in photographs.items():
        try:
            found[name] = hg.lamps_from_ball({name: photograph}, mask)[1][0]
        except hg.InputError:
            continue
    return found


def mask_row(kind: str, move: float) -> dict[str, int]:
    """How many sets of photographs are refused under a mask that is off by `move` radii; of the others, how many have
    all lamps within three stated errors, and how many have not.
    """
    row = {"refused": 0, "held": 0, "wrong": 0}
    for number in range(MASKED_SETS):
        shown = simulated(kind, MASKED_DIAMETER, number)
        pad = int(ROOM * shown.radius)
        photographs = {name: np.pad(one, pad, mode="edge") for name, one in shown.photographs.items()}
        turn = np.random.default_rng([SEED, number]).uniform(0.0, 2.0 * np.pi)
        off = np.rint(move * shown.radius * np.array([np.sin(turn), np.cos(turn)])).astype(int).tolist()
        mask = np.roll(np.pad(shown.mask, pad), off, axis=(0, 1))
        try:
            _, lamps = hg.lamps_from_ball(photographs, mask)
        except hg.InputError:
            row["refused"] += 1
            continue
        angles = [_angle(one, lamp) for one, lamp in zip(lamps, shown.lamps, strict=True)]
        row["held" if all(angle < 3.0 * error for angle, error in angles) else "wrong"] += 1
    return row


def real_rows(folder: Path) -> dict[str, Any]:
    """The chrome ball beside the laboratory's lamps, by how far its mask is moved; the grey ball beside the chrome."""
    theirs = _directions(folder / "lights_from_chrome_ball_by_lab.txt")
    chrome, mask = _photographs(folder / "chrome")
    rows: dict[str, Any] = {}
    for move in REAL_MOVES:
        try:
            _, lamps = hg.lamps_from_ball(chrome, np.roll(mask, move, axis=1))
            rows[f"chrome, mask {move} px off"] = _row([_angle(*pair) for pair in zip(lamps, theirs, strict=True)], 0)
        except hg.InputError as error:
            rows[f"chrome, mask {move} px off"] = {"said": str(error)}
    ours = {one.name: one.to_lamp for one in hg.lamps_from_ball(chrome, mask)[1]}
    grey = read_each(*_photographs(folder / "gray"))
    beside = [_angle(one, ours[name]) for name, one in grey.items()]
    return {**rows, "grey beside chrome": _row(beside, len(ours) - len(grey))}


def _photographs(folder: Path) -> tuple[dict[str, NDArray], NDArray]:
    files = sorted(folder.glob(f"{folder.name}.[0-9]*.png"), key=lambda file: int(file.suffixes[0][1:]))
    return {f"{k}": hg.read_png(file) for k, file in enumerate(files)}, hg.read_png(folder / f"{folder.name}.mask.png")


def _directions(file: Path) -> NDArray[np.float64]:
    rows = [line.split() for line in file.read_text(encoding="utf-8").splitlines()]
    found = np.array([[float(word) for word in row] for row in rows if len(row) == 3])
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def _angle(reading: hg.LampReading, lamp: NDArray) -> tuple[float, float]:
    return float(np.degrees(np.arccos(np.clip(reading.to_lamp @ lamp, -1.0, 1.0)))), reading.standard_error_deg


def _row(angles: Sequence[tuple[float, float]], refused: int) -> dict[str, Any]:
    if not angles:
        return {"readings": 0, "refused": refused}
    angle, error = np.array(angles).T
    return {
        "readings": len(angle), "refused": refused, "mean_deg": float(angle.mean()), "largest_deg": float(angle.max()),
        "stated_deg": float(np.median(error)), "within_two_errors": float(np.mean(angle < 2.0 * error)),
    }  # fmt: skip


def main(out: Path, real: Path | None = None, force: bool = False) -> None:
    """Study lamps that are read off balls.

    Args:
        out: the record, a JSON file.
        real: folder of the photographs of real balls, uw_psm; without it, or where it is absent, none are read.
        force: overwrite the record.
    """
    with hg.whole_file(out, force) as partial:
        record = ball_study(real if real is not None and real.is_dir() else None)
        hg.write_json(partial, record)
    show(record)
    print(f"wrote {out}")


def show(record: Mapping[str, Any]) -> None:
    """The tables of the study."""
    columns = "ball, diameter [px]", "readings", "refused", "mean [°]", "largest [°]", "stated [°]", "within 2 errors"
    worn = [(f"{kind}, {size}", row) for kind, rows in record["worn"].items() for size, row in rows.items()]
    print_table("lamps read off balls", columns, [_shown(*one) for one in worn])
    masks = [(kind, move, row) for kind, rows in record["masks"].items() for move, row in rows.items()]
    columns_of_masks = "ball", "move [radii]", "refused", "held", "wrong"
    print_table("masks that are moved", columns_of_masks, [(*one[:2], *map(str, one[2].values())) for one in masks])
    for name, row in record.get("real", {}).items():
        print(f"{name}: {row['said']}" if "said" in row else ", ".join(_shown(name, row)))


def _shown(name: str, row: Mapping[str, Any]) -> tuple[str, ...]:
    if not row["readings"]:
        return name, "0", f"{row['refused']}", *[""] * 4
    numbers = (f"{row[key]:.2f}" for key in ("mean_deg", "largest_deg", "stated_deg", "within_two_errors"))
    return name, f"{row['readings']}", f"{row['refused']}", *numbers


if __name__ == "__main__":
    command(main)
