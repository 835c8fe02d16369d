"""Sheet labels: pictures in rows and columns with a text beneath each, and a line above all."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.names import plot_label

GAP = 8  # px between cells
LINE = 16  # px of a line of text
SIZE_PX = 12.0  # of letters
DPI = 72.0  # a point is a pixel
PAPER, INK = "#16181c", "#e6e6e6"
LETTER = 0.62  # width of a letter, of its size


def labelled(pictures: NDArray[np.uint8], labels: Sequence[Sequence[str]], title: str) -> NDArray[np.uint8]:
    """One picture (height, width, 3) of pictures (rows, columns, height, width, 3), whose pixels stay as they are."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, columns, tall, wide = pictures.shape[:4]
    width = columns * (wide + GAP) + GAP
    texts = [[_wrapped(label, wide) for label in row] for row in labels]
    lines = max(text.count("\n") + 1 for row in texts for text in row)
    head = _wrapped(title, width - 2 * GAP)
    top = GAP + LINE * (head.count("\n") + 1)
    pitch = tall + GAP + LINE * lines
    height = top + rows * pitch + GAP
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    style: dict[str, Any] = {"va": "top", "color": INK, "fontsize": SIZE_PX, "linespacing": 1.15}
    figure.text(GAP / width, 1.0 - GAP / height, _safe(head), ha="left", **style)
    corners = [(top + row * pitch, GAP + column * (wide + GAP)) for row in range(rows) for column in range(columns)]
    for (y, x), text in zip(corners, (text for row in texts for text in row), strict=True):
        figure.text((x + wide / 2) / width, 1.0 - (y + tall + 3) / height, _safe(text), ha="center", **style)
    canvas.draw()
    sheet = np.array(canvas.buffer_rgba())[..., :3]
    for (y, x), picture in zip(corners, pictures.reshape(-1, tall, wide, 3), strict=True):
        sheet[y : y + tall, x : x + wide] = picture
    return sheet


def _wrapped(text: str, width: int) -> str:
    """The text in lines of at most `width` px, about."""
    letters = max(int(width / (LETTER * SIZE_PX)), 8)
    return "\n".join(part for line in text.split("\n") for part in textwrap.wrap(line, letters) or [""])


def _safe(text: str) -> str:
    return "\n".join(map(plot_label, text.split("\n")))
