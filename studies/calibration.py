"""The study of calibrations under bad conditions: a board in blurred photographs, mirror balls with streaks of glare.

    python -m studies.calibration --out out/calibration.json

Everything is simulated. A board in ten photographs, two of them blurred: the residual of the fit, and how far the
camera is off. Lamps on mirror balls of several sizes, sharp and with streaks: the angle between what is read and the
truth. The light of streaks adds up, so that the lamp's clipped image has spurs.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.command import command
from studies.table import print_table

Array = NDArray[np.float64]
SEED = 5
BOARD, LENS = hg.Board(7, 5, 0.02), (-0.21, 0.09, 0.001, -0.0007, 0.0)
CAMERA = hg.Camera(602, 458, (644.0, 654.0), (306.0, 224.0), LENS)
VIEWS, SUBPIXELS, CELL, NOISE = 10, 3, 80, 2.0  # photographs; rays a side of a pixel; texels of a square; of 255
BLURRED, BLURS = (2, 7), (0.0, 2.0, 5.0)  # photographs; standard deviations [px]
KINDS = "sharp", "glare"
DIAMETERS, LAMPS = (24, 36, 48, 72, 100, 180), 40  # of balls [px]; read on each
STREAKS, STREAK_LEVEL, STREAK_WIDTH = 3, 0.6, 1.2  # of a lamp; of white; standard deviation [px]
LAMP_RADIUS, DARK = 0.02, 0.06  # of a lamp's image, over the ball's radius; of white, the ball without a lamp


def calibration_study() -> dict[str, Any]:
    """The record: `boards` by blur, `balls` by diameter."""
    return {
        "boards": {f"{blur:g}": board_row(blur) for blur in BLURS},
        "balls": {f"{size}": {kind: ball_row(size, kind == "glare") for kind in KINDS} for size in DIAMETERS},
    }


def board_row(blur: float) -> dict[str, Any]:
    """Residual [px], photographs used, and the errors of the focal length and the principal point [px]."""
    random, photographs = np.random.default_rng(SEED), {}
    middle = np.array([0.06, 0.04, 0.0])
    for k in range(VIEWS):
        eye = middle + np.array([*random.uniform(-0.14, 0.14, 2), -random.uniform(0.18, 0.24)])
        view = CAMERA.look_at(eye, middle + 0.003 * random.normal(size=3), (0.0, -1.0, 0.0))
        photographs[f"{k}"] = photograph_of_board(view, blur if k in BLURRED else 0.0, random)
    found = hg.calibrate_camera(photographs, BOARD)
    off = np.hypot(*np.subtract(found.camera.principal, CAMERA.principal))
    return {
        "rms_px": float(found.rms),
        "focal_off_px": float(np.abs(np.subtract(found.camera.focal, CAMERA.focal)).max()),
        "principal_off_px": float(off),
    }


def photograph_of_board(view: hg.Camera, blur: float, random: np.random.Generator) -> NDArray[np.uint8]:
    """8-bit photograph of the board, out of focus by `blur` [px]."""
    row, column = np.mgrid[: view.height * SUBPIXELS, : view.width * SUBPIXELS]
    way = view.unproject(np.stack([(column + 0.5) / SUBPIXELS, (row + 0.5) / SUBPIXELS], axis=-1))
    at = view.position[:2] - way[..., :2] * (view.position[2] / way[..., 2])[..., None]
    square = np.floor(np.nan_to_num(at, nan=-1.0) / BOARD.square + 1.0).astype(int)
    inside = ((square >= 0) & (square <= (BOARD.columns, BOARD.rows))).all(axis=-1)
    dark = inside & (square.sum(axis=-1) % 2 == 0)
    grey = np.where(dark, 30.0, 220.0).reshape(view.height, SUBPIXELS, view.width, SUBPIXELS).mean(axis=(1, 3))
    grey = blurred(grey, blur) if blur else grey
    return np.clip(grey + random.normal(0.0, NOISE, grey.shape), 0, 255).astype(np.uint8)


def blurred(grey: Array, deviation: float) -> Array:
    """`grey` (h, w) under a Gaussian blur."""
    reach = int(4 * deviation)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    for axis in (0, 1):
        padded = np.pad(grey, [(reach, reach) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        grey = np.apply_along_axis(np.convolve, axis, padded, kernel / kernel.sum(), mode="valid")
    return grey


def ball_row(diameter: int, glare: bool) -> dict[str, float]:
    """Mean and largest angle [°] between lamps and what is read of them on a ball, and how many were refused."""
    random, angles, refused = np.random.default_rng([SEED, diameter]), [], 0
    for _ in range(LAMPS):
        azimuth, tilt = random.uniform(0.0, 2.0 * np.pi), np.radians(random.uniform(5.0, 65.0))
        lamp = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
        photograph, mask = photograph_of_ball(diameter, lamp, random, glare)
        try:
            found = hg.calibrate_lamps({"lamp": photograph}, mask).lamps[0].to_lamp
        except hg.InputError:
            refused += 1
            continue
        assert found is not None
        angles.append(np.degrees(np.arccos(np.clip(found @ lamp, -1.0, 1.0))))
    return {"mean_deg": float(np.mean(angles)), "largest_deg": float(np.max(angles)), "refused": refused}


def photograph_of_ball(
    diameter: int, lamp: Array, random: np.random.Generator, glare: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """8-bit photograph of a mirror ball under a far lamp, and its mask; streaks of glare run from the lamp's image."""
    side, radius = diameter + 20, diameter / 2
    y, x = np.mgrid[:side, :side] + 0.5
    middle = side / 2 + random.uniform(-0.5, 0.5, 2)
    half = lamp + np.array([0.0, 0.0, 1.0])
    place = middle + radius * (half / np.linalg.norm(half))[:2] * (1.0, -1.0)
    off = np.stack([x - place[0], y - place[1]], axis=2)
    edge = np.clip(np.linalg.norm(off, axis=2) - max(LAMP_RADIUS * radius, 0.7), -20.0, 20.0)
    light = DARK + 2.5 / (1.0 + np.exp(3.0 * edge))
    for angle in random.uniform(0.0, 2.0 * np.pi, STREAKS if glare else 0):
        way = np.array([np.cos(angle), np.sin(angle)])
        along, aside = off @ way, off @ np.array([-way[1], way[0]])
        length = random.uniform(0.15, 0.4) * radius
        light += STREAK_LEVEL * np.exp(-0.5 * (aside / STREAK_WIDTH) ** 2) * ((along > 0.0) & (along < length))
    mask = np.where(np.hypot(x - middle[0], y - middle[1]) < radius, 255, 0).astype(np.uint8)
    noisy = 255.0 * light + random.normal(0.0, 1.0, light.shape)
    return np.where(mask > 0, np.clip(noisy, 0.0, 255.0), 0.0).astype(np.uint8), mask


def show(record: dict[str, Any]) -> None:
    """The tables of the study."""
    columns = "blur of two of ten [px]", "residual [px]", "focal length off [px]", "principal point off [px]"
    rows = [(blur, *(f"{value:.3f}" for value in row.values())) for blur, row in record["boards"].items()]
    print_table("a board, photographed ten times", columns, rows)
    columns = "ball [px]", "lamp", "mean angle [°]", "largest [°]", f"refused of {LAMPS}"
    balls = [
        (size, kind, f"{row['mean_deg']:.2f}", f"{row['largest_deg']:.2f}", f"{row['refused']:g}")
        for (size, rows), kind in product(record["balls"].items(), KINDS)
        for row in [rows[kind]]
    ]
    print_table(f"lamps on mirror balls; glare: streaks of {STREAK_LEVEL:g} of white", columns, balls)


def main(out: Path, force: bool = False) -> None:
    """Study calibrations under bad conditions.

    Args:
        out: the record, a JSON file.
        force: overwrite it.
    """
    with hg.whole_file(out, force) as partial:
        record = calibration_study()
        hg.write_json(partial, record)
    show(record)
    print(f"wrote {out}")


if __name__ == "__main__":
    command(main)
