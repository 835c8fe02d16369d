"""Polylines: curves as points one after the other, whatever file they come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

LARGEST_FILE = 1 << 32  # bytes


class Polylines(NamedTuple):
    """Polylines. points: (n, 3) of all, one after the other; first: (k + 1), where each begins, and n. diameter: (n)
    of the fibres there, in the same unit; None: the file states none.
    """

    points: NDArray[np.float64]
    first: NDArray[np.int64]
    diameter: NDArray[np.float64] | None = None


def chained(pieces: Iterable[list[int]]) -> list[list[int]]:
    """Numbers of vertices of polylines: a piece that begins where the one before it ends goes on with it."""
    chains: list[list[int]] = []
    for piece in pieces:
        if chains and piece and chains[-1][-1] == piece[0]:
            chains[-1] += piece[1:]
        elif piece:
            chains.append(piece)
    return chains


def of_arrays(arrays: Mapping[str, NDArray[Any]]) -> Polylines:
    """Lines of the arrays of another process; no diameter: the file states none."""
    wide = arrays["diameter"]
    return Polylines(arrays["points"], arrays["first"], wide if len(wide) else None)


def of_chains(vertices: NDArray[np.float64], chains: list[list[int]]) -> Polylines:
    """Lines of the numbers of vertices."""
    index = np.array([number for chain in chains for number in chain], np.int64)
    if len(index) and not (0 <= index.min() and index.max() < len(vertices)):
        raise InputError(f"a line names vertex {index.max() + 1}, there are {len(vertices)}: the file is damaged")
    return Polylines(vertices[index].reshape(-1, 3), np.cumsum([0, *(len(chain) for chain in chains)]))
