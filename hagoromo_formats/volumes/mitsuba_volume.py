"""Mitsuba's grid volume (.vol): "VOL", version 3, type, sizes, channels, corners of its bounding box [m], numbers."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import sized_file
from hagoromo.files.volume_file import VolumeFile, grid_matrix
from hagoromo.files.whole import whole_file
from hagoromo_formats.volumes.lattice_field import LatticeField, lattice_field, slabs
from hagoromo_formats.volumes.payload import read_payload

MAGIC, VERSION = b"VOL", 3
HEAD = struct.Struct("<3sB5i6f")
TYPES = {1: "<f4", 2: "<f2", 3: "u1"}  # 4 is directions in two bytes, which Mitsuba itself does not read any more


def read_mitsuba_volume(path: str | Path) -> VolumeFile:
    """The volume in a .vol file; voxels are cells of its bounding box. Bytes stand for whole numbers 0…255."""
    path = Path(path)
    with sized_file(path, 1 << 46, "a grid volume").open("rb") as opened:
        start = opened.read(HEAD.size)
    if len(start) < HEAD.size or not start.startswith(MAGIC):
        raise InputError(f"{path} is no grid volume of Mitsuba: give a .vol")
    _, version, kind, nx, ny, nz, channels, *corners = HEAD.unpack(start)
    if version != VERSION or kind not in TYPES:
        raise InputError(f"{path} is of version {version} and type {kind}: version 3, types 1, 2 and 3 are read")
    shape = [nz, ny, nx, *([channels] if channels != 1 else [])]
    values = read_payload(path, HEAD.size, shape, TYPES[kind], where=str(path))
    low, high = np.reshape(corners, (2, 3)).astype(float)
    edges = (high - low) / [nx, ny, nz]
    if not (np.isfinite(edges).all() and (edges > 0).all()):
        raise InputError(f"{path} has a bounding box from {low.tolist()} to {high.tolist()}: it is damaged")
    return VolumeFile(values, grid_matrix(edges.tolist(), (low + 0.5 * edges).tolist()), str(path))


def write_mitsuba_volume(path: str | Path, values: NDArray[Any] | LatticeField, edge: float) -> None:
    """Write values (nz, ny, nx[, channels]) as floats in voxels of one edge [m]; the box begins at 0."""
    field = lattice_field(values)
    nz, ny, nx = field.shape[:3]
    channels = field.shape[3] if len(field.shape) == 4 else 1
    head = HEAD.pack(MAGIC, VERSION, 1, nx, ny, nz, channels, 0, 0, 0, nx * edge, ny * edge, nz * edge)
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(head)
        file.writelines(np.ascontiguousarray(slab, "<f4").tobytes() for slab in slabs(field))
