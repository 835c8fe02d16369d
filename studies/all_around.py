"""Simulated photographs of an object on a table, all around it, as anybody takes them with a flash: JPEG and masks.

    python -m studies.all_around --out around --views 30 --width 480

Output: photographs/ (sRGB), masks/ (white on the object) and truth.json: β, γ and n, a length, and where cameras stood.
The object is that of the study of recovery. The table has a pattern, from which cameras are found, and a calibration
board of 7 × 5 inner corners. The flash is 5 cm to the right of the lens.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.light.colour import srgb_encode
from hagoromo.matter import shape as sd
from hagoromo_matter.noise import value_noise
from studies.command import command
from studies.recover_scenes import DISTANCE, Shots, TrueObject, simulated

Array = NDArray[np.float64]
TABLE, EDGE = -0.0375, 0.16  # [m] height of its top, half its edge
COLUMNS, ROWS, SQUARE = 7, 5, 0.009  # inner corners of the board, and the side of its squares [m]
CORNER = (-0.034, -0.105)  # [m] of the board's first square
FLASH = 0.05  # [m] to the right of the lens
FOCAL = 2.6  # in widths of a photograph
RINGS = ((0.62, 0.42), (0.38, 0.85))  # share of the views, and height of their ring [rad]
CELLS = (0.0035, 0.009)  # [m] of the pattern
WHITE, QUALITY = 0.9, 95  # where the brightest light is in a file; of JPEG


class OnTable(TrueObject):
    """The object of the study of recovery, with a fine pattern, on a table."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        top = sd.rounded_box(p, (0.0, 0.0, TABLE - 0.01), (EDGE, EDGE, 0.01), 0.001)
        return dr.minimum(super().distance(p), top)

    def colours(self, p: Any) -> list[Any]:
        """Body colour at points."""
        noise = 0.2 + 0.4 * sum(value_noise(p / cell, number) for number, cell in enumerate(CELLS))
        table = p.z < TABLE + 1e-4
        column, row = (p.x - CORNER[0]) / SQUARE, (p.y - CORNER[1]) / SQUARE
        rim = table & (column > -1.0) & (row > -1.0) & (column < COLUMNS + 2.0) & (row < ROWS + 2.0)
        inside = (column > 0.0) & (row > 0.0) & (column < COLUMNS + 1.0) & (row < ROWS + 1.0)
        jit = arrays()
        dark = inside & ((jit.Int(dr.floor(column)) + jit.Int(dr.floor(row))) % 2 == 0)
        board = dr.select(dark, 0.04, jit.Float(0.85))
        own = [1.25 * noise * c for c in super().colours(p)]
        return [dr.select(rim, board, dr.select(table, 0.7 * noise, c)) for c in own]


def all_around(out: str | Path, views: int = 30, width: int = 480, seed: int = 0, force: bool = False) -> Path:
    """Photograph the object from `views` sides with a camera of `width` × `width` pixels."""
    truth, shots = OnTable(), _shots(views, width)
    taken = simulated(truth, shots, seed)
    brightest = np.percentile(np.stack([p.values for p in taken.capture.photographs]), 99.9)
    with hg.whole_folder(out, force) as home:
        for folder in ("photographs", "masks"):
            (home / folder).mkdir()
        for number, (photograph, points) in enumerate(zip(taken.capture.photographs, taken.points, strict=True)):
            name = f"view{number:02d}"
            Image.fromarray(srgb_encode(WHITE * photograph.values / brightest)).save(
                home / "photographs" / f"{name}.jpg", quality=QUALITY, subsampling=0
            )
            on_object = np.asarray(ndimage.binary_fill_holes(points[..., 2] > TABLE + 2e-4), np.bool_)
            hg.write_png(home / "masks" / f"{name}.png", np.where(on_object, 255, 0).astype(np.uint8))
        places = [p.camera.position.tolist() for p in taken.capture.photographs]
        known = {"beta": truth.beta, "gamma": truth.gamma, "n": truth.n, "places": places, "seed": seed}
        hg.write_json(home / "truth.json", {**known, "version": hg.__version__})
    return Path(out)


def _shots(count: int, width: int) -> Shots:
    """Two rings of cameras, with a flash beside each lens."""
    views = []
    for share, height in RINGS:
        turn = 2.0 * np.pi * np.arange(round(share * count)) / round(share * count)
        level = np.full_like(turn, np.sin(height))
        views.append(np.stack([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), level], axis=1))
    towards = np.concatenate(views)
    right = np.cross(-towards, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    flashes = DISTANCE * towards + FLASH * right
    return Shots(towards, list(flashes[:, None]), width, FOCAL)


if __name__ == "__main__":
    command(all_around)
