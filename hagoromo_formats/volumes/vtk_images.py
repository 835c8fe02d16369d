"""Volumes that VTK reads: its image data in XML (.vti) and the .slc of VolVis; in a process of its own.

Also how image data are written, without VTK. Lengths of VTI have no unit: they are taken as millimetres.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.checks import PACKED, check_density, existing_file
from hagoromo.files.reading import library, reading
from hagoromo.files.volume_file import MM, VolumeFile, check_size
from hagoromo.files.whole import whole_file
from hagoromo_formats.volumes.lattice_field import LatticeField, lattice_field, slabs

READERS = {".vti": ("vtkIOXML", "vtkXMLImageDataReader"), ".slc": ("vtkIOImage", "vtkSLCReader")}


def read_vtk_image(path: str | Path) -> VolumeFile:
    """The scalars (or the only array) of the points of image data, or of its cells where points have none."""
    library("vtkmodules")
    arrays = read_apart(image_by_vtk, existing_file(path), "VTK image data")
    return VolumeFile(arrays["values"], arrays["matrix"], str(path))


def image_by_vtk(path: Path) -> Mapping[str, NDArray[Any]]:
    """values and matrix of a `VolumeFile`; run by `read_apart`."""
    vtk_to_numpy = library("vtkmodules.util.numpy_support").vtk_to_numpy
    module, name = READERS[path.suffix.lower()]
    with reading(path, "VTK image data"):
        reader = getattr(library(f"vtkmodules.{module}"), name)()
        reader.SetFileName(str(path))
        reader.UpdateInformation()
        extent = reader.GetOutputInformation(0).Get(reader.GetExecutive().WHOLE_EXTENT())
        if extent is None:
            raise InputError(f"{path} has no lattice: it is damaged, or no image data")
        low, high = np.array(extent).reshape(3, 2).T
        stated = (high - low + 1).tolist()
        check_size(stated, 8, str(path), 3.0)
        check_density(math.prod(map(float, stated)), path, PACKED, f"a lattice of {stated}")
        reader.Update()
        image = reader.GetOutput()
        array, cells = _scalars(image, path)
        shape = tuple(n - cells for n in reversed(image.GetDimensions()))
        if reader.GetErrorCode() or array.GetNumberOfTuples() != int(np.prod(shape)):
            raise InputError(f"{path} is damaged or cut off: copy it again")
        values = vtk_to_numpy(array).reshape(*shape, *([-1] if array.GetNumberOfComponents() > 1 else []))
        matrix = np.eye(4)
        matrix[:3, :3] = np.reshape([image.GetDirectionMatrix().GetElement(i, j) for i in range(3) for j in range(3)],
                                    (3, 3)) * image.GetSpacing()  # fmt: skip
        matrix[:3, 3] = image.GetOrigin() + matrix[:3, :3] @ (low + 0.5 * cells)
    matrix[:3] *= MM
    return {"values": values, "matrix": matrix}


def _scalars(image: Any, path: Path) -> tuple[Any, bool]:
    """The array of densities, and whether its numbers are those of cells."""
    for data, cells in ((image.GetPointData(), False), (image.GetCellData(), True)):
        if data.GetNumberOfArrays():
            named = data.GetScalars() or data.GetArray("density")
            if named is None and data.GetNumberOfArrays() > 1:
                names = ", ".join(str(data.GetArrayName(k)) for k in range(data.GetNumberOfArrays()))
                raise InputError(f"{path} has the arrays {names:.200} and calls none its scalars: name one density")
            return named or data.GetArray(0), cells
    raise InputError(f"{path} has no array of numbers: give image data with one")


def write_vti(path: str | Path, fields: Mapping[str, NDArray[Any] | LatticeField], matrix: NDArray[np.float64]) -> None:
    """Write fields (nz, ny, nx[, 3]) of one lattice as VTK image data [mm], raw; the first is its scalars.

    matrix: of a `VolumeFile`. (VTK file formats, "XML File Formats", appended raw data.)
    """
    lattices = {name: lattice_field(values) for name, values in fields.items()}
    first = next(iter(lattices.values()))
    edges = np.linalg.norm(matrix[:3, :3], axis=0) / MM
    extent = " ".join(f"0 {n - 1}" for n in reversed(first.shape[:3]))
    origin, spacing, direction = (
        " ".join(f"{x:.17g}" for x in np.ravel(numbers))
        for numbers in (matrix[:3, 3] / MM, edges, matrix[:3, :3] / MM / edges)
    )
    arrays, sizes = [], []
    for name, field in lattices.items():
        components, offset = field.shape[3] if len(field.shape) == 4 else 1, sum(sizes) + 8 * len(sizes)
        arrays.append(f'<DataArray type="Float32" Name={quoteattr(name)} NumberOfComponents="{components}" '
                      f'format="appended" offset="{offset}"/>')  # fmt: skip
        sizes.append(4 * math.prod(field.shape))
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" '
        f'header_type="UInt64">\n<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}" '
        f'Direction="{direction}">\n<Piece Extent="{extent}">\n<PointData Scalars={quoteattr(next(iter(fields)))}>\n'
        + "\n".join(arrays)
        + '\n</PointData>\n<CellData/>\n</Piece>\n</ImageData>\n<AppendedData encoding="raw">\n_'
    )
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(head.encode())
        for field, size in zip(lattices.values(), sizes, strict=True):
            file.write(struct.pack("<Q", size))
            file.writelines(np.ascontiguousarray(slab, "<f4").tobytes() for slab in slabs(field))
        file.write(b"\n</AppendedData>\n</VTKFile>\n")
