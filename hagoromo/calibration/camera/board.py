"""Calibration board (chessboard or ChArUco) and the detection of its corners in a photograph by OpenCV.

Image points in this module follow OpenCV's convention: (0, 0) is the centre of the first pixel.

Corner window: size of the window of the sub-pixel search around a chessboard corner.

The search assumes that every edge in its window passes through the corner. Other edges bias it: the sides of the next
squares and, if the outer squares are cut, the edge of the board. On simulated boards with blur and noise, the accuracy
grows with the window as long as it contains no other edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

OWN_WINDOWS = "windows without other edges"
OTHER_WINDOWS = (11, 5)  # [px] half sides: those of OpenCV's examples, and of its usual advice for small boards
CORNER_STEPS = (30, 1e-4)  # sub-pixel search ends after 30 steps or at 1e-4 px
WHITE_QUANTILE = 0.995  # quantile of a linear photograph that becomes white in 8 bits
FEWEST_CORNERS = 8  # least number of corners of a partly visible ChArUco board: a pose needs 4
INNER_SHARE, OUTER_SHARE = 1.0 / 2.0, 1.0 / 3.0  # of the distance to the next edge; outer squares may be cut in half
LEAST_HALF_SIDE_PX, LARGEST_HALF_SIDE_PX = 2, 15  # [px] larger windows gain nothing, as distorted edges are curved
SIDE_SAMPLES = 17  # points along the side of a square
# corners of the four squares around a corner, in order, as steps of rows and columns
SQUARE_CORNERS = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


class Corners(NamedTuple):
    """Detected corners: points (n, 3) on the board [m], image (n, 2) (x, y) [px, OpenCV's convention], float32."""

    points: NDArray[np.float32]
    image: NDArray[np.float32]


@dataclass(frozen=True)
class Board:
    """A flat board of squares; `InputError` if its dimensions are impossible.

    columns, rows: inner corners (one less than squares). square: side of a square [m]. marker: side of a ChArUco marker
    [m], 0 for a chessboard. dictionary: OpenCV's name of the marker dictionary, such as "5X5_100". window: half side
    [px] of the window of the sub-pixel search for chessboard corners; None: per corner, by `corner_windows`.

    >>> hg.Board(9, 6, square=0.025).columns
    9
    >>> hg.Board(1, 6, square=0.025)
    Traceback (most recent call last):
    ...
    hagoromo.errors.InputError: a board has at least 3x3 inner corners: given 1x6
    """

    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = "4X4_50"
    window: int | None = None

    def __post_init__(self) -> None:
        """Check every figure once."""
        if min(self.columns, self.rows) < 3:
            raise InputError(f"a board has at least 3x3 inner corners: given {self.columns}x{self.rows}")
        if not (np.isfinite(self.square) and self.square > 0):
            raise InputError(f"the side of a square is {self.square} m: give a length above 0")
        if not 0.0 <= self.marker < self.square:
            raise InputError(f"the side of a marker is {self.marker} m: it must be below the square's {self.square} m")
        if self.window is not None and self.window < 1:
            raise InputError(f"the search window has half a side of {self.window} px: give 1 or more")
        if self.marker:
            markers, needed = len(_dictionary(self.dictionary).bytesList), (self.columns + 1) * (self.rows + 1) // 2
            if markers < needed:
                raise InputError(f"{self.dictionary} has {markers} markers and the board {needed}: name its dictionary")

    def find(self, photograph: NDArray) -> Corners | None:
        """The board's corners in a photograph (height, width[, 3]), 8 or 16 bits or float; None if none is detected."""
        found = self.find_by_windows(photograph)
        return None if found is None else next(iter(found.values()))

    def find_by_windows(self, photograph: NDArray) -> dict[str, Corners] | None:
        """The corners by each of several windows of the sub-pixel search, `corner_windows` first; None as `find`.

        A ChArUco board and a board with a stated window have one set.
        """
        import cv2

        photograph = as_shown(photograph)
        grey = np.asarray(photograph if photograph.ndim == 2 else cv2.cvtColor(photograph[..., :3], cv2.COLOR_RGB2GRAY))
        if not self.marker:
            return self._find_squares(grey)
        found = self._find_markers(grey)
        return None if found is None else {OWN_WINDOWS: found}

    def __str__(self) -> str:
        """The board in words."""
        return f"{'ChArUco ' if self.marker else ''}board of {self.columns}x{self.rows} inner corners"

    def _find_squares(self, grey: NDArray) -> dict[str, Corners] | None:
        import cv2

        complete, corners = cv2.findChessboardCorners(grey, (self.columns, self.rows))
        if not complete:
            return None
        start = np.array(corners, np.float32).reshape(-1, 1, 2)
        own = corner_windows(start.reshape(self.rows, self.columns, 2)).ravel()
        if self.window:
            return {OWN_WINDOWS: self._sought(grey, start, np.full_like(own, self.window))}
        found = {OWN_WINDOWS: self._sought(grey, start, own)}
        for half in OTHER_WINDOWS:
            found[f"{half} px"] = self._sought(grey, start, np.full_like(own, half))
        return found

    def _sought(self, grey: NDArray, start: NDArray[np.float32], windows: NDArray[np.intp]) -> Corners:
        """The corners sought from `start` (n, 1, 2) in windows of these half sides [px]."""
        import cv2

        criteria, image = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, *CORNER_STEPS), start.copy()
        for half in map(int, np.unique(windows)):
            image[windows == half] = cv2.cornerSubPix(grey, image[windows == half], (half, half), (-1, -1), criteria)
        row, column = np.mgrid[: self.rows, : self.columns]
        points = np.stack([column, row, 0 * row], axis=-1).reshape(-1, 3) * self.square
        return Corners(points.astype(np.float32), image.reshape(-1, 2))

    def _find_markers(self, grey: NDArray) -> Corners | None:
        import cv2

        squares = (self.columns + 1, self.rows + 1)
        for legacy in (False, True):  # before OpenCV 4.6, boards with an even number of rows began with a white square
            board = cv2.aruco.CharucoBoard(squares, self.square, self.marker, _dictionary(self.dictionary))
            board.setLegacyPattern(legacy)
            image, index, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
            if index is not None and len(index) >= FEWEST_CORNERS and not board.checkCharucoCornersCollinear(index):
                points = np.asarray(board.getChessboardCorners(), np.float32)[np.asarray(index, np.intp).ravel()]
                points[:, :2] -= self.square  # origin at the first inner corner instead of the board's edge
                return Corners(points, np.asarray(image, np.float32).reshape(-1, 2))
        return None


def as_shown(photograph: NDArray) -> NDArray[np.uint8]:
    """8-bit version of a linear photograph (square root, scaled to WHITE_QUANTILE); 8 bits are returned unchanged."""
    if photograph.dtype == np.uint8:
        return photograph
    bright = max(float(np.quantile(photograph, WHITE_QUANTILE)), 1e-30)
    return np.rint(255.0 * np.sqrt(np.clip(photograph / bright, 0.0, 1.0))).astype(np.uint8)


def _dictionary(name: str) -> Any:
    import cv2

    number = getattr(cv2.aruco, f"DICT_{name}", None)
    if number is None:
        known = sorted(key.removeprefix("DICT_") for key in dir(cv2.aruco) if key.startswith("DICT_") and key.isupper())
        raise InputError(f"no dictionary of markers is called {name!r}: choose one of {', '.join(known)}")
    return cv2.aruco.getPredefinedDictionary(number)


def corner_windows(corners: NDArray[Any]) -> NDArray[np.intp]:
    """Half sides (rows, columns) [px] of the search windows of the corners at `corners` (rows, columns, 2) [px]."""
    share = np.full(corners.shape[:2], OUTER_SHARE)
    share[1:-1, 1:-1] = INNER_SHARE
    return np.clip(share * next_edge(corners), LEAST_HALF_SIDE_PX, LARGEST_HALF_SIDE_PX).astype(np.intp)


def next_edge(corners: NDArray[Any]) -> NDArray[np.float64]:
    """(rows, columns) distance [px] to the nearest side of a square that does not pass through the corner.

    The distance is the larger of those along rows and columns, because windows are square. Squares beyond the outer
    corners are assumed as large as their neighbours.
    """
    rows, columns = corners.shape[:2]
    whole = np.pad(corners.astype(np.float64), ((1, 1), (1, 1), (0, 0)))
    whole[0, 1:-1], whole[-1, 1:-1] = 2 * corners[0] - corners[1], 2 * corners[-1] - corners[-2]
    whole[:, 0], whole[:, -1] = 2 * whole[:, 1] - whole[:, 2], 2 * whole[:, -2] - whole[:, -3]
    ring = [whole[1 + down : 1 + down + rows, 1 + right : 1 + right + columns] for down, right in SQUARE_CORNERS]
    along = np.linspace(0.0, 1.0, SIDE_SAMPLES)[:, None, None, None]
    sides = [one * (1.0 - along) + other * along for one, other in zip(ring, ring[1:] + ring[:1], strict=True)]
    return np.min([np.abs(side - corners).max(axis=-1).min(axis=0) for side in sides], axis=0)
