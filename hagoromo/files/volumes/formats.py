"""Formats of volumes, and the one way to read a volume of any of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.format import Format
from hagoromo.files.volumes.arrays import file_and_dataset
from hagoromo.files.volumes.openvdb import look_at_openvdb
from hagoromo.files.volumes.tiff_stack import SUFFIXES, slices
from hagoromo.files.volumes.volume_file import VolumeFile

HERE = "hagoromo.files.volumes"
VOLUMES = (
    Format(
        "NRRD", "volume", (".nrrd", ".nhdr"), f"{HERE}.nrrd_file:read_nrrd", "hagoromo.app.formats.volumes_out:nrrd",
        "pynrrd (its header)", "SimpleITK", "key/value pairs, colours, tensors; out: one field a file",
    ),
    Format(
        "MetaImage", "volume", (".mha", ".mhd"), f"{HERE}.metaimage:read_metaimage", "", "our own", "SimpleITK",
        "anatomical names, tags, numbers as text, slices in several files",
    ),
    Format(
        "NIfTI", "volume", (".nii", ".nii.gz"), f"{HERE}.nifti:read_nifti", "", "nibabel", "SimpleITK",
        "time, extensions, the second matrix",
    ),
    Format(
        "VTK image data", "volume", (".vti",), f"{HERE}.vtk_images:read_vtk_image",
        "hagoromo.app.formats.volumes_out:vti", "VTK (out: our own)", "VTK, our own bytes",
        "all arrays but one; out: spectra",
    ),
    Format(
        "SLC of VolVis", "volume", (".slc",), f"{HERE}.vtk_images:read_vtk_image", "", "VTK", "our own bytes", "icons",
    ),
    Format(
        "Mitsuba grid volume", "volume", (".vol",), f"{HERE}.mitsuba_volume:read_mitsuba_volume",
        "hagoromo.app.formats.volumes_out:vol", "our own", "Mitsuba", "directions in bytes; out: all but one field",
    ),
    Format(
        "NumPy array", "volume", (".npy",), f"{HERE}.arrays:read_npy", "", "NumPy", "our own bytes",
        "nothing; lengths are not in it; pickles are refused",
    ),
    Format(
        "OpenVDB", "volume", (".vdb",), f"{HERE}.openvdb:read_openvdb", "hagoromo.app.formats.volumes_out:vdb",
        "our own (no wheel of OpenVDB exists)", "OpenVDB (Debian's pyopenvdb, skipped without), tinyvdb",
        "all grids but one; level sets, points, masks, maps of a camera are refused; out: spectra",
    ),
    Format(
        "NanoVDB", "volume", (".nvdb",), f"{HERE}.nanovdb:read_nanovdb", "", "our own", "OpenVDB's vdb_tool wrote it",
        "all grids but one; level sets, points and quantised numbers are refused",
    ),
    Format(
        "HDF5", "volume", (".h5", ".hdf5"), f"{HERE}.arrays:read_hdf5", "", "h5py", "NumPy",
        "attributes, other datasets",
    ),
    Format(
        "RAW, lattice in its name", "volume", (".raw",), f"{HERE}.arrays:read_raw_volume", "", "our own", "NumPy",
        "nothing; lengths are not in it",
    ),
    Format(
        "TIFF stack", "volume", (".tif", ".tiff"), f"{HERE}.tiff_stack:read_tiff_stack", "", "tifffile, OpenCV",
        "Pillow", "tags but ImageJ's lengths; colours",
    ),
)  # fmt: skip
LOOK: dict[str, Callable[[str | Path], VolumeFile]] = {"OpenVDB": look_at_openvdb}
SUFFIXES_READ = tuple(suffix for each in VOLUMES for suffix in each.suffixes)


def volume_format(path: str | Path) -> Format | None:
    """The format of a volume by its name; None for another one. A dataset may be named behind an HDF5 file."""
    name = file_and_dataset(path)[0].lower()
    return next((each for each in VOLUMES if name.endswith(each.suffixes)), None)


def look_at_volume(path: str | Path) -> VolumeFile:
    """As `read_volume`, but that no numbers are read where the file has a header that says what they are."""
    found = volume_format(path)
    look = LOOK.get(found.name) if found is not None else None
    return look(path) if look is not None else read_volume(path)


def read_volume(path: str | Path) -> VolumeFile:
    """The volume in a file of any of `VOLUMES`, or in a folder of TIFF layers.

    `InputError` for another format, a damaged file, or one that does not fit the memory.
    """
    if Path(path).is_dir() and slices(Path(path)):
        return next(each for each in VOLUMES if SUFFIXES[0] in each.suffixes).read(path)
    found = volume_format(path)
    if found is None:
        existing_file(path)
        raise InputError(f"{path} is no volume of a known format: Zarr arrays and {', '.join(SUFFIXES_READ)} are read")
    return found.read(path)
