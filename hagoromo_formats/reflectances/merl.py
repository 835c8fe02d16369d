"""Tables of MERL: an isotropic BRDF in red, green and blue over the half and the difference angle.

Matusik, Pfister, Brand and McMillan, "A Data-Driven Reflectance Model" (2003); angles as in Rusinkiewicz, "A New Change
of Variables for Efficient BRDF Representation" (1998). A file has three whole numbers, the bins of θ_h, θ_d and φ_d,
then the values in doubles, all of red first; θ_h is finer near 0 (its bins are even in the square root), φ_d goes to π.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import sized_file
from hagoromo.files.memory import require
from hagoromo.measurement.reflectance_table import ReflectanceTable

BINS = (90, 90, 180)  # of θ_h, θ_d and φ_d, in every published file
SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0  # of red, green and blue, in the published reader
HEAD, WORD = 12, 8  # bytes
FARTHEST = np.cos(np.radians(85.0))  # of lamp and eye from the normal: the instrument does not reach beyond 80–85°
STEP_NEAR, STEP_FAR, NEAR = 1, 4, 15  # of the bins of θ_h up to bin NEAR (2.5°), and beyond
STEP_DIFFERENCE, STEP_TURN = 4, 12
Array = NDArray[np.float64]


def read_merl(path: str | Path) -> ReflectanceTable:
    """The table in a .binary; every bin near the mirror direction, one of several elsewhere. It states no variance.

    `InputError` for another number of bins, another length, or a file without one value above 0.
    """
    path = sized_file(path, HEAD + 3 * WORD * int(np.prod(BINS)), "a table of MERL")
    with path.open("rb") as file:
        head = file.read(HEAD)
    bins = tuple(np.frombuffer(head, "<i4").tolist()) if len(head) == HEAD else ()
    if bins != BINS or path.stat().st_size != HEAD + 3 * WORD * int(np.prod(BINS)):
        raise InputError(f"{path} is no table of MERL: it needs {BINS} bins of doubles in three colours, it has {bins}")
    require(8.0 * WORD * float(np.prod(BINS)), str(path))
    stored = np.memmap(path, "<f8", "r", HEAD, (3, *BINS))
    places = _places()
    values = np.asarray(stored[:, *places]).T * SCALE
    lamp, eye = sampled_directions()
    known = (values > 0.0).all(axis=1) & np.isfinite(values).all(axis=1)
    known &= (lamp[:, 2] > FARTHEST) & (eye[:, 2] > FARTHEST)  # bins below the horizon hold −1
    if not known.any():
        raise InputError(f"{path} has no value above 0: it is damaged, or no table of MERL")
    return ReflectanceTable(lamp[known], eye[known], values[known], channels=("R", "G", "B"))


def sampled_directions() -> tuple[Array, Array]:
    """Unit directions (N, 3) to lamp and eye of the bins that are read, also of those below the horizon."""
    half, difference, turn = _places()
    return directions(
        ((half + 0.5) / BINS[0]) ** 2 * np.pi / 2,
        (difference + 0.5) / BINS[1] * np.pi / 2,
        (turn + 0.5) / BINS[2] * np.pi,
    )


def _places() -> list[NDArray[np.intp]]:
    """Bins (N,) of θ_h, θ_d and φ_d that are read."""
    half = np.r_[0:NEAR:STEP_NEAR, NEAR : BINS[0] : STEP_FAR]
    difference, turn = np.arange(0, BINS[1], STEP_DIFFERENCE), np.arange(0, BINS[2], STEP_TURN)
    return [place.ravel() for place in np.meshgrid(half, difference, turn, indexing="ij")]


def directions(half: Array, difference: Array, turn: Array) -> tuple[Array, Array]:
    """Unit directions (N, 3) to lamp and eye, normal +z, of the angles θ_h, θ_d and φ_d (N,) [rad]; φ_h is 0."""
    x, y, z = np.sin(difference) * np.cos(turn), np.sin(difference) * np.sin(turn), np.cos(difference)
    cosine, sine = np.cos(half), np.sin(half)
    lamp = np.stack([cosine * x + sine * z, y, cosine * z - sine * x], 1)
    middle = np.stack([sine, np.zeros_like(half), cosine], 1)
    return lamp, 2.0 * np.einsum("ni,ni->n", lamp, middle)[:, None] * middle - lamp
