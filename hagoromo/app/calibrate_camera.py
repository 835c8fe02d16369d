"""`hagoromo calibrate camera`: photographs of a board → camera.json and a plot of the residuals beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from numpy.typing import NDArray

from hagoromo.app.calibration_plot import residual_plot
from hagoromo.calibration.camera.board import Board
from hagoromo.calibration.camera.calibrate_camera import Calibration, Model, calibrate_camera
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file
from hagoromo.progress import Progress, silent


def parse_board(corners: str, square: float, marker: float, dictionary: str, window: int | None) -> Board:
    """The board of a command line: corners such as "9x6"."""
    found = re.fullmatch(r"(\d+)x(\d+)", corners)
    if found is None:
        raise InputError(f"--board is {corners!r}: give inner corners as columns x rows, such as 9x6")
    return Board(int(found[1]), int(found[2]), square, marker, dictionary, window)


def calibrate_to(
    photographs: Mapping[str, NDArray],
    board: Board,
    out: Path,
    coefficients: Model,
    square_pixels: bool,
    force: bool,
    progress: Progress = silent,
) -> tuple[Calibration, tuple[Path, Path]]:
    """The calibration, and the paths of its record and its plot."""
    plot = out.with_suffix(".png")
    if plot == out:
        raise InputError(f"{out} is to be a record: give a name that ends in .json")
    with whole_file(out, force) as record, whole_file(plot, force) as picture:
        found = calibrate_camera(photographs, board, coefficients, square_pixels, progress)
        write_json(record, found.record())
        picture.write_bytes(residual_plot(found))
    return found, (out, plot)
