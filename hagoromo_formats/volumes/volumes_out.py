"""Volumes out: the density, the axes or the body colours of a box, as files of other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.volume.box import VolumeBox
from hagoromo_formats.volumes.lattice_field import BoxField, Field
from hagoromo_formats.volumes.mitsuba_volume import write_mitsuba_volume
from hagoromo_formats.volumes.nrrd_file import write_nrrd
from hagoromo_formats.volumes.openvdb_out import write_openvdb
from hagoromo_formats.volumes.vtk_images import write_vti


def nrrd(box: VolumeBox, path: Path, field: Field) -> None:
    """One field as NRRD."""
    write_nrrd(path, BoxField(box, field), lattice_matrix(box), f"{field} of {box.name}".strip())


def vti(box: VolumeBox, path: Path, field: Field) -> None:
    """All fields as VTK image data; `field` is the one that VTK takes for its scalars if it is density or colour."""
    names: tuple[Field, ...] = ("density", "axis", "colour")
    order = sorted(names, key=lambda name: name != field)
    write_vti(path, {name: BoxField(box, name) for name in order}, lattice_matrix(box))


def vdb(box: VolumeBox, path: Path, field: Field) -> None:
    """All fields as grids of OpenVDB in the world [m], active where there is matter, whatever `field` is."""
    names: tuple[Field, ...] = ("density", "axis", "colour")
    write_openvdb(path, {name: BoxField(box, name) for name in names}, lattice_matrix(box))


def vol(box: VolumeBox, path: Path, field: Field) -> None:
    """One field as Mitsuba's grid volume, in the axes of the box [m]."""
    write_mitsuba_volume(path, BoxField(box, field), box.voxel_size)


def lattice_matrix(box: VolumeBox) -> NDArray[np.float64]:
    """Index (x, y, z) of the centre of a voxel → place in the world [m]: (4, 4)."""
    return np.linalg.inv(box.lattice_from_world)
