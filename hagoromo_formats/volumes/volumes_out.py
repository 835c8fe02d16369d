"""Volumes out: the density, the axes or the body colours of a box, as files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.files.volume_file import VolumeFile
from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import STORED
from hagoromo_formats.volumes.mitsuba_volume import write_mitsuba_volume
from hagoromo_formats.volumes.nrrd_file import write_nrrd
from hagoromo_formats.volumes.openvdb_out import write_openvdb
from hagoromo_formats.volumes.vtk_images import write_vti

Field = Literal["density", "axis", "colour"]
BYTES = 40.0  # memory of a voxel: three components as halves and as floats, and the density


def nrrd(box: VolumeBox, path: Path, field: Field) -> None:
    """One field as NRRD."""
    values = dense_field(box, field)
    write_nrrd(path, VolumeFile(values, lattice_matrix(box), str(path)), f"{field} of {box.name}".strip())


def vti(box: VolumeBox, path: Path, field: Field) -> None:
    """All fields as VTK image data; `field` is the one that VTK takes for its scalars if it is density or colour."""
    names: tuple[Field, ...] = ("density", "axis", "colour")
    order = sorted(names, key=lambda name: name != field)
    write_vti(path, {name: dense_field(box, name) for name in order}, lattice_matrix(box))


def vdb(box: VolumeBox, path: Path, field: Field) -> None:
    """All fields as grids of OpenVDB in the world [m], active where there is matter, whatever `field` is."""
    names: tuple[Field, ...] = ("density", "axis", "colour")
    write_openvdb(path, {name: dense_field(box, name) for name in names}, lattice_matrix(box))


def vol(box: VolumeBox, path: Path, field: Field) -> None:
    """One field as Mitsuba's grid volume, in the axes of the box [m]."""
    write_mitsuba_volume(path, dense_field(box, field), box.voxel_size)


def lattice_matrix(box: VolumeBox) -> NDArray[np.float64]:
    """Index (x, y, z) of the centre of a voxel → place in the world [m]: (4, 4)."""
    return np.linalg.inv(box.lattice_from_world)


def dense_field(box: VolumeBox, field: Field) -> NDArray[np.float32]:
    """(nz, ny, nx[, 3]): density; axis, in the axes of the box; or the body's linear sRGB under D65, 0 without matter.

    `InputError` for a box of texels, and one that does not fit the memory.
    """
    if box.texel:
        raise InputError(f"volume box {box.name!r} is a shell of texels: its voxels are no lattice of space")
    require(BYTES * float(np.prod(box.bricks.shape, dtype=float)), f"all voxels of volume box {box.name!r}")
    if field != "colour":
        return box.bricks.dense()[field == "axis"].astype(np.float32)
    full = np.zeros((*(8 * m + 1 for m in box.bricks.lattice), 3), np.float32)
    for number, (z, y, x) in enumerate(box.bricks.corners().tolist()):
        full[z : z + STORED, y : y + STORED, x : x + STORED] = _colours(box, number)
    return full[tuple(slice(n) for n in box.bricks.shape)]


def _colours(box: VolumeBox, number: int) -> NDArray[np.float32]:
    """Linear sRGB of the body of each voxel of a brick: (9, 9, 9, 3)."""
    held = {name: values[0] for name, values in box.bricks.read(number, number + 1).items()}
    which = held.get("material", np.zeros(held["density"].shape, np.uint8))
    alpha = np.array([material.alpha for material in box.materials])[which][..., None]
    if "colour" in held:
        basis = np.array(
            [linear_colour(each, Spectrum.named("D65")) for each in box.basis or (Spectrum.constant(1.0),)]
        )
        colour = held["colour"][..., : len(basis)].astype(float) @ basis
    else:
        colour = np.array([linear_colour(material.body_colour, Spectrum.named("D65")) for material in box.materials])[
            which
        ]
    return np.where(held["density"][..., None] > 0, np.pi * alpha * colour, 0.0).astype(np.float32)
