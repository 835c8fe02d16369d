"""Strip and contact sheet: a film on one picture, some frames beside each other, or many in rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

STRIP_FRAMES, SHEET_FRAMES = 8, 24
SHEET_COLUMNS = 6
LONGEST_SIDE = 320  # px of a frame on them
GAP, PAPER = 4, 32  # px between frames, and their display value
Frame = NDArray[np.uint8]


def chosen(count: int, most: int) -> list[int]:
    """Numbers of at most `most` of `count` frames, evenly from the first on."""
    number = min(count, most)
    return [k * count // number for k in range(number)]


def strip(frames: Sequence[Frame]) -> Frame:
    """Frames of one size beside each other."""
    return sheet(frames, len(frames))


def sheet(frames: Sequence[Frame], columns: int = SHEET_COLUMNS) -> Frame:
    """Frames of one size in rows, reduced to LONGEST_SIDE."""
    import cv2

    height, width = frames[0].shape[:2]
    share = min(LONGEST_SIDE / max(height, width), 1.0)
    size = max(round(width * share), 1), max(round(height * share), 1)
    small = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in frames]
    columns = min(columns, len(small))
    rows = -(-len(small) // columns)
    paper = np.full((rows * (size[1] + GAP) + GAP, columns * (size[0] + GAP) + GAP, 3), PAPER, np.uint8)
    for k, frame in enumerate(small):
        top, left = (GAP + (k // columns) * (size[1] + GAP), GAP + (k % columns) * (size[0] + GAP))
        paper[top : top + size[1], left : left + size[0]] = frame
    return paper
