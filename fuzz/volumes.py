"""Good samples of volumes of other programs."""

from __future__ import annotations

import struct
import zlib
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
    from hagoromo_formats.volumes.nrrd_file import write_nrrd

    write_nrrd(path, VALUES, MATRIX, "sample")


def metaimage(path: Path) -> None:
    """MetaImage in one file."""
    path.write_bytes(METAIMAGE.encode() + VALUES.tobytes())


def nifti(path: Path) -> None:
    """NIfTI."""
    import nibabel

    nibabel.Nifti1Image(VALUES.T, MATRIX * 1e3).to_filename(path)


def vti(path: Path) -> None:
    """VTK image data."""
    from hagoromo_formats.volumes.vtk_images import write_vti

    write_vti(path, {"density": VALUES.astype(np.float32)}, MATRIX)


def slc(path: Path) -> None:
    """SLC of VolVis."""
    data = b"11111\n5 4 3 8\n1 1 2\n1 6 0 1\n2 1 X" + bytes(6)
    for layer in VALUES.astype(np.uint8):
        packed = bytes([0x80 | layer.size, *layer.ravel().tolist(), 0])
        data += b"%d X" % len(packed) + packed
    path.write_bytes(data)


def vol(path: Path) -> None:
    """Mitsuba's grid volume."""
    from hagoromo_formats.volumes.mitsuba_volume import write_mitsuba_volume

    write_mitsuba_volume(path, VALUES.astype(np.float32), 1e-3)


def vdb(path: Path) -> None:
    """OpenVDB with two grids."""
    from hagoromo_formats.volumes.openvdb_out import write_openvdb

    density = VALUES.astype(np.float32)
    write_openvdb(path, {"density": density, "colour": np.stack([density] * 3, axis=-1)}, MATRIX)


def nvdb(path: Path) -> None:
    """NanoVDB with one leaf, packed by zlib: three heads, a tile of the root, two nodes, the leaf."""
    leaf = struct.pack("<3i3BB", 0, 0, 0, 4, 3, 2, 0) + b"\xff" * 64 + struct.pack("<4f", 0, 200, 50, 9)
    leaf += np.pad(VALUES.T, [(0, 3), (0, 4), (0, 5)]).astype("<f4").tobytes()
    lower, upper = _nano_node(16), _nano_node(32)
    root = struct.pack("<6iI5f", 0, 0, 0, 4, 3, 2, 1, 0, 0, 200, 50, 9).ljust(64, b"\0")
    root += struct.pack("<QqIf", 0, 96, 0, 0).ljust(32, b"\0")
    places = 64 + np.cumsum([0, len(root), len(upper), len(lower)])
    tree = struct.pack("<4q3I3IQ", *map(int, places[::-1]), 1, 1, 1, 0, 0, 0, 512)
    spacing = (*np.diag([1e-3] * 3).ravel(), *np.diag([1e3] * 3).ravel())
    head = struct.pack("<8sQIIIIQ256s", b"NanoVDB1", 0, 32 << 21, 0, 0, 1, 0, b"density")
    head += struct.pack("<22f", *spacing, 0, 0, 0, 1) + struct.pack("<22d", *spacing, 0, 0, 0, 1)
    head += struct.pack("<9d2IqIIQQ", *([0.0] * 6), 1e-3, 1e-3, 1e-3, 2, 1, 0, 0, 0, 0, 0)
    block = head + tree + root + upper + lower + leaf
    packed = zlib.compress(block)
    entry = struct.pack("<4Q2I6d6i3dI4I3IHHI", len(block), 8 + len(packed), 0, 512, 1, 2, *([0.0] * 6), *([0] * 6),
                        1e-3, 1e-3, 1e-3, 8, 1, 1, 1, 1, 0, 0, 0, 1, 0, 32 << 21)  # fmt: skip
    start = struct.pack("<8sIHH", b"NanoVDB0", 32 << 21, 1, 1)
    path.write_bytes(start + entry + b"density\0" + struct.pack("<Q", len(packed)) + packed)


def _nano_node(edge: int) -> bytes:
    """A node whose first child is its only one, and lies behind it."""
    masks = edge**3 // 8
    head = struct.pack("<6iQ", 0, 0, 0, 4, 3, 2, 0) + bytes(masks) + b"\1" + bytes(masks - 1) + bytes(16)
    head += bytes(-len(head) % 32)
    return head + struct.pack("<q", len(head) + 8 * edge**3) + bytes(8 * (edge**3 - 1))


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
    "volume.slc": (slc, 0.05),
    "volume.vol": (vol, 1.0),
    "volume.vdb": (vdb, 0.5),
    "volume.nvdb": (nvdb, 0.5),
    "volume.npy": (npy, 1.0),
    "volume.h5": (hdf5, 0.1),
    "volume.tif": (tiff, 1.0),
    "volume_5x4x3_uint16.raw": (raw, 0.3),
}
