"""Good samples of volumes of other programs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

VALUES = np.random.default_rng(5).integers(0, 200, (3, 4, 5)).astype(np.uint16)
MATRIX = np.diag([1e-3, 1e-3, 2e-3, 1.0])
METAIMAGE = (
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
    "Offset = 1 2 3\nElementSpacing = 1 1 2\nDimSize = 5 4 3\nElementType = MET_USHORT\nElementDataFile = LOCAL\n"
)


def nrrd(path: Path) -> None:
    """NRRD, gzip."""
    from hagoromo.files.volumes.nrrd_file import write_nrrd
    from hagoromo.files.volumes.volume_file import VolumeFile

    write_nrrd(path, VolumeFile(VALUES, MATRIX, ""), "sample")


def metaimage(path: Path) -> None:
    """MetaImage in one file."""
    path.write_bytes(METAIMAGE.encode() + VALUES.tobytes())


def nifti(path: Path) -> None:
    """NIfTI."""
    import nibabel

    nibabel.Nifti1Image(VALUES.T, MATRIX * 1e3).to_filename(path)


def vti(path: Path) -> None:
    """VTK image data."""
    from hagoromo.files.volumes.vtk_images import write_vti

    write_vti(path, {"density": VALUES.astype(np.float32)}, MATRIX)


def vol(path: Path) -> None:
    """Mitsuba's grid volume."""
    from hagoromo.files.volumes.mitsuba_volume import write_mitsuba_volume

    write_mitsuba_volume(path, VALUES.astype(np.float32), 1e-3)


def npy(path: Path) -> None:
    """NumPy's array."""
    np.save(path, VALUES)


def hdf5(path: Path) -> None:
    """HDF5, packed in chunks."""
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("density", data=VALUES, chunks=(2, 2, 2), compression="gzip")


def tiff(path: Path) -> None:
    """TIFF of several pages."""
    import tifffile

    tifffile.imwrite(path, VALUES, imagej=True, metadata={"spacing": 2.0, "unit": "um"}, resolution=(1.0, 1.0))


def raw(path: Path) -> None:
    """Numbers alone."""
    path.write_bytes(VALUES.tobytes())


def recipe(folder: Path) -> None:
    """A recipe of kind volume."""
    metaimage(folder / "a.mha")
    material = "material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }"
    (folder / "a.toml").write_text(f'kind = "volume"\ndensity = "a.mha"\nwindow = [10, 100]\n{material}\n')


SAMPLES: dict[str, tuple[Callable[[Path], None], float]] = {  # share of the mutations: less in a process of its own
    "volume.nrrd": (nrrd, 1.0),
    "volume.mha": (metaimage, 1.0),
    "volume.nii": (nifti, 1.0),
    "volume.nii.gz": (nifti, 0.5),
    "volume.vti": (vti, 0.05),
    "volume.vol": (vol, 1.0),
    "volume.npy": (npy, 1.0),
    "volume.h5": (hdf5, 0.1),
    "volume.tif": (tiff, 1.0),
    "volume_5x4x3_uint16.raw": (raw, 0.3),
}
