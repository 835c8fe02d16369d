"""Voxels of boxes: density, axis and colour of a medium on the lattices of the user's boxes, to read and to replace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.transport.medium import Medium
from hagoromo.volume.bricks import Grid
from hagoromo.volume.lattice import from_bricks, into_bricks
from hagoromo.volume.voxels import PlainVoxels

COLUMNS = {"density": slice(0, 1), "axis": slice(1, 4), "colour": slice(0, 4)}  # of the packets of four numbers


def read_boxes(medium: Medium, name: str) -> tuple[NDArray[np.float32] | None, ...]:
    """Of each box (nz, ny, nx) density, (…, 3) axis or (…, 4) colour, 0 in bricks that it does not store; None of a box
    without colours.
    """
    packets = _packets(medium, name)[:, COLUMNS[name]]
    values = packets[:, 0] if name == "density" else packets
    grids = zip(medium.boxes, _grids(medium, name), strict=True)
    return tuple(None if grid is None else from_bricks(box.bricks, grid, values) for box, grid in grids)


def write_boxes(medium: Medium, name: str, boxes: Sequence[ArrayLike | None]) -> None:
    """Replace what `read_boxes` reads; None: a box stays as it is. `InputError` for another shape, or numbers above 0
    in bricks that a box does not store.
    """
    packets, old = _packets(medium, name), read_boxes(medium, name)
    if len(boxes) != len(old):
        raise InputError(f"{name}: {len(boxes)} arrays for {len(old)} boxes: give one for each")
    for number, (box, grid, given, like) in enumerate(zip(medium.boxes, _grids(medium, name), boxes, old, strict=True)):
        if grid is None or given is None or like is None:
            continue
        new, target = _numbers(name, number, given, like.shape), packets[:, COLUMNS[name]]
        into_bricks(box.bricks, grid, new.reshape(*box.bricks.shape, -1), target)
        if name == "density" and (new[from_bricks(box.bricks, grid, np.ones(len(packets))) == 0.0] > 0.0).any():
            raise InputError(
                f"density of box {number} is above 0 in bricks of 8³ voxels that the box does not store: build it with "
                "some density in each brick that matter may come to"
            )
    if name == "colour":
        medium.colours = lookup(arrays().Float, packets)
    else:
        medium.voxels = PlainVoxels(lookup(arrays().Float, packets))


def _numbers(name: str, number: int, given: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """What was given, as finite numbers of the shape of a box."""
    new = np.asarray(given, np.float32)
    if new.shape != shape or not np.isfinite(new).all() or (name == "density" and (new < 0.0).any()):
        raise InputError(f"{name} of box {number}, of shape {new.shape}: give finite numbers (0 or more), {shape}")
    return new


def _packets(medium: Medium, name: str) -> NDArray[np.float32]:
    """The packets of four numbers of each stored voxel."""
    if name == "colour":
        if medium.colours is None:
            raise InputError("no box has a colour per voxel")
        return np.array(medium.colours, np.float32).reshape(-1, 4)
    if not isinstance(medium.voxels, PlainVoxels):
        raise InputError("the voxels are packed: prepare the scene with RayMarch(scene, differentiable=True)")
    return np.array(medium.voxels.values, np.float32).reshape(-1, 4)


def _grids(medium: Medium, name: str) -> list[Grid | None]:
    return [getattr(box.bricks, "colour" if name == "colour" else "density") for box in medium.boxes]
