"""Springs: which points of the grids of a cloth are joined, and how. Lengths in mm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hagoromo.backend import arrays
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.resident import resident
from hagoromo_matter.drape.sheet import Sheet

ANYWHERE = 1e9  # [mm] reach of points that no belt draws in: larger than any distance
# rows, columns to the neighbours
NEIGHBOUR_STEPS = ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1))


def mesh_of(cuts: Sequence[Cut], sheets: Sequence[Sheet], spacing: float) -> dict[str, Any]:
    """The joined points: index and rest length of every spring (0: none), weights of the bends."""
    jit = arrays()
    parts = [_joined(cut, sheet, spacing) for cut, sheet in zip(cuts, sheets, strict=True)]
    starts = np.cumsum([0] + [sheet.u.size for sheet in sheets[:-1]])

    def index(key: str, k: int) -> Any:
        values = [part[key][k] + start for part, start in zip(parts, starts, strict=True)]
        return resident(jit.UInt, np.concatenate(values).astype(np.uint32))

    def weight(key: str, k: int) -> Any:
        return resident(jit.Float, np.concatenate([part[key][k] for part in parts]).astype(np.float32))

    springs = [(index("other", k), weight("rest", k)) for k in range(8)]
    bends = [
        (index("other", a), index("other", b), (index("second", a), weight("far", a)),
         (index("second", b), weight("far", b)), weight("near", a // 2))
        for a, b in ((0, 1), (2, 3))
    ]  # fmt: skip
    values = {
        name: np.concatenate([cut.over(getattr(cut, name), spacing).ravel() for cut in cuts])
        for name in ("held", "reach")
    }
    layer = np.repeat([cut.layer for cut in cuts], [sheet.u.size for sheet in sheets])
    return {
        "along": springs[:4], "across": springs[4:], "bends": bends,
        "layer": resident(jit.UInt, layer.astype(np.uint32)),
        "held": resident(jit.Float, values["held"].astype(np.float32)),
        "reach": resident(jit.Float, np.minimum(values["reach"], ANYWHERE).astype(np.float32)),
    }  # fmt: skip


def _joined(cut: Cut, sheet: Sheet, spacing: float) -> dict[str, np.ndarray]:
    """Neighbours and second neighbours of every point of a sheet, its own number where there is none."""
    rows, columns = sheet.u.shape
    wide = cut.width / (columns if cut.closed else columns - 1) * cut.narrowing(cut.shares(spacing)[1])
    tall = cut.height / (rows - 1)
    row, column = np.indices((rows, columns))

    def number(down: int, across: int) -> tuple[np.ndarray, np.ndarray]:
        i, j = row + down, column + across
        if cut.closed:
            j = j % columns
        there = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        return np.where(there, i * columns + j, row * columns + column).ravel(), there.ravel()

    other, rest = [], []
    for down, across in NEIGHBOUR_STEPS:
        index, there = number(down, across)
        mean = 0.5 * (wide[row] + wide[np.clip(row + down, 0, rows - 1)])
        other.append(index)
        rest.append(np.where(there, np.hypot(across * mean, down * tall).ravel(), 0.0))
    # where rows are narrow their points bend no more stiffly than half a spacing would: the step is not made for it
    step = [np.maximum(wide[row] if across else tall, 0.5 * spacing).ravel() for _, across in NEIGHBOUR_STEPS[:4]]
    step = [np.broadcast_to(size, row.size) for size in step]
    second = [number(2 * down, 2 * across) for down, across in NEIGHBOUR_STEPS[:4]]
    near = [number(*NEIGHBOUR_STEPS[a])[1] & number(*NEIGHBOUR_STEPS[a + 1])[1] for a in (0, 2)]
    return {
        "other": np.array(other), "rest": np.array(rest), "second": np.array([index for index, _ in second]),
        "far": np.array([there / size**4 for (_, there), size in zip(second, step, strict=True)]),
        "near": np.array([there / size**4 for there, size in zip(near, (step[0], step[2]), strict=True)]),
    }  # fmt: skip
