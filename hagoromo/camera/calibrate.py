"""Calibrate a camera: photographs of a chessboard → focal length, principal point, distortion, each with its
standard deviation.

OpenCV finds the corners and fits the lens (Zhang 2000, "A flexible new technique for camera calibration"); OpenCV
counts from the centre of the first pixel and we from the image's corner, so the principal point moves by ½ px.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.record import count, number, read_json, take

FEWEST_BOARDS = 3  # below it the focal length and principal point are not determined by planes (Zhang 2000)
NAMES = ("fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
CORNER_STEPS = (30, 1e-4)  # sub-pixel search ends after 30 steps or at 1e-4 px


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera and how well it is known.

    standard_deviation: of each of `NAMES` [px, or 1 for the distortion]. rms: of the corners' residuals [px], each
    corner's two coordinates taken together. boards: rms per photograph used [px]. skipped: photographs in which no
    board was found.
    """

    camera: Camera
    standard_deviation: dict[str, float]
    rms: float
    boards: dict[str, float]
    skipped: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """The JSON record: keys of nerfstudio's `transforms.json`, then what is known about them."""
        camera = self.camera
        values = (*camera.focal, *camera.principal, *camera.distortion)
        return {
            "w": camera.width,
            "h": camera.height,
            **dict(zip(NAMES, values, strict=True)),
            "standard_deviation": self.standard_deviation,
            "rms_px": self.rms,
            "boards_rms_px": self.boards,
            "skipped": list(self.skipped),
        }


def calibrate_camera(
    photographs: Mapping[str, NDArray],
    board: tuple[int, int],
    square: float,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Fit a camera to photographs of a chessboard.

    photographs: name → (height, width) or (height, width, 3), uint8. board: inner corners (columns, rows).
    square: side of a square [m]. progress: told the name of each photograph as it is searched.
    `InputError` for photographs of different sizes, a board or square that is none, or fewer than three boards found.
    """
    _check(photographs, board, square)
    corners = {}
    for name, photograph in photographs.items():
        if progress:
            progress(name)
        found = find_corners(photograph, board)
        if found is not None:
            corners[name] = found
    skipped = tuple(name for name in photographs if name not in corners)
    if len(corners) < FEWEST_BOARDS:
        raise InputError(
            f"a board of {board[0]}x{board[1]} inner corners was found in {len(corners)} of {len(photographs)} "
            f"photographs and {FEWEST_BOARDS} are needed: check --board, or take more photographs"
        )
    return _fit(corners, skipped, _points(board, square), next(iter(photographs.values())).shape[:2])


def read_camera(path: str | Path) -> Camera:
    """The camera in a JSON file that holds what `Calibration.record` gives, at the world's origin."""
    figures = take(read_json(path), {"w": count, "h": count, **dict.fromkeys(NAMES, number)}, str(path), strict=False)
    ax, ay, x0, y0, *distortion = (figures[name] for name in NAMES)
    return Camera(figures["w"], figures["h"], (ax, ay), (x0, y0), tuple(distortion), name=Path(path).stem)


def find_corners(photograph: NDArray, board: tuple[int, int]) -> NDArray | None:
    """Inner corners (corners, 2) (x, y) float32 [px, OpenCV's count] of `board` in a photograph; None when not seen."""
    import cv2

    grey = photograph if photograph.ndim == 2 else cv2.cvtColor(photograph[..., :3], cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCorners(grey, board)
    if not found:
        return None
    # the search window stays within the squares next to a corner
    sides = np.linalg.norm(np.diff(corners.reshape(board[1], board[0], 2), axis=1), axis=-1)
    half = int(np.clip(sides.min() / 3, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, *CORNER_STEPS)
    return cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria).reshape(-1, 2)


def _check(photographs: Mapping[str, NDArray], board: tuple[int, int], square: float) -> None:
    if min(board) < 3:
        raise InputError(f"a board has at least 3x3 inner corners: given {board[0]}x{board[1]}")
    if not (np.isfinite(square) and square > 0):
        raise InputError(f"the side of a square is {square} m: give a length above 0")
    sizes = {name: photograph.shape[:2] for name, photograph in photographs.items()}
    first = next(iter(sizes), "")
    for name, size in sizes.items():
        if size != sizes[first]:
            raise InputError(
                f"photographs of different sizes: {first} is {sizes[first][1]}x{sizes[first][0]} px and {name} "
                f"{size[1]}x{size[0]}: calibrate each size by itself"
            )
        if photographs[name].dtype != np.uint8:
            raise InputError(f"{name} is {photographs[name].dtype}: corners are searched in 8-bit photographs")


def _points(board: tuple[int, int], square: float) -> NDArray[np.float32]:
    """(corners, 3) corners of the board in its own plane [m], in OpenCV's order."""
    row, column = np.mgrid[: board[1], : board[0]]
    return (np.stack([column, row, 0 * row], axis=-1).reshape(-1, 3) * square).astype(np.float32)


def _fit(
    corners: Mapping[str, NDArray],
    skipped: tuple[str, ...],
    points: NDArray[np.float32],
    size: tuple[int, int],
) -> Calibration:
    import cv2

    height, width = size
    rms, matrix, distortion, _, _, deviations, _, errors = cv2.calibrateCameraExtended(
        [points] * len(corners), list(corners.values()), (width, height), np.eye(3), np.zeros(5)
    )
    deviation: dict[str, float] = dict(zip(NAMES, map(float, deviations.ravel()), strict=False))
    if not (np.isfinite(rms) and np.isfinite(list(deviation.values())).all()):
        raise InputError("the photographs of the board do not determine the camera: tilt the board more between them")
    camera = Camera(
        width,
        height,
        focal=(float(matrix[0, 0]), float(matrix[1, 1])),
        principal=(float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5),
        distortion=tuple(map(float, distortion.ravel()[:5])),
    )
    return Calibration(
        camera, deviation, float(rms), dict(zip(corners, map(float, errors.ravel()), strict=True)), skipped
    )
