"""Directions and numbers as NumPy arrays, for the laws that are written for Dr.Jit; in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import Array3f, Float, arrays, column
from hagoromo.errors import InputError


def broadcast_directions(
    *, like: ArrayLike | None = None, **directions: ArrayLike
) -> tuple[tuple[int, ...], list[Array3f]]:
    """Their common shape without the last 3, and unit vectors of its size each; like: has that shape, too."""
    given = {name: np.asarray(values, np.float64) for name, values in directions.items()}
    for name, values in given.items():
        if values.shape[-1:] != (3,):
            raise InputError(f"{name} has shape {values.shape}: give (..., 3)")
        if not (np.isfinite(values).all() and (np.linalg.norm(values, axis=-1) > 0.0).all()):
            raise InputError(f"{name} has a direction that is 0 or not finite: give directions of some length")
    every = [*given.values(), *([] if like is None else [np.asarray(like)])]
    try:
        shape = np.broadcast_shapes(*(values.shape for values in every))[:-1]
    except ValueError as error:
        shapes = ", ".join(f"{name} {values.shape}" for name, values in given.items())
        raise InputError(f"shapes do not go together: {shapes}") from error
    unit = (values / np.linalg.norm(values, axis=-1, keepdims=True) for values in given.values())
    return shape, [arrays().Array3f64(*vectors_of(np.broadcast_to(each, (*shape, 3)).reshape(-1, 3))) for each in unit]


def vectors_of(values: NDArray[np.float64]) -> list[Float]:
    """Columns (N, 3) on the device."""
    return [column(arrays().Float64, each) for each in values.T]


def numbers_of(values: Any) -> NDArray[np.float64]:
    """Numbers of the device, or a plain one, as (N,) or (1,)."""
    return np.array(values, np.float64).reshape(-1)
