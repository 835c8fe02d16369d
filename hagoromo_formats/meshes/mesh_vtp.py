"""VTK's polygons in XML (.vtp), read by VTK in a process of its own: polygons and strips as triangles, no data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.reading import library, reading


def read_vtp(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices (n, 3) and triangles (m, 3) of a .vtp file; `InputError` where it is damaged or VTK is not installed."""
    library("vtkmodules")
    arrays = read_apart(triangles_by_vtk, path, "VTK polygons")
    return arrays["vertices"], arrays["faces"]


def triangles_by_vtk(path: Path) -> Mapping[str, NDArray[Any]]:
    """vertices and faces; run by `read_apart`."""
    vtk_to_numpy = library("vtkmodules.util.numpy_support").vtk_to_numpy
    with reading(path, "VTK polygons"):
        reader = library("vtkmodules.vtkIOXML").vtkXMLPolyDataReader()
        triangles = library("vtkmodules.vtkFiltersCore").vtkTriangleFilter()
        reader.SetFileName(str(path))
        triangles.SetInputConnection(reader.GetOutputPort())
        triangles.PassVertsOff()
        triangles.PassLinesOff()
        triangles.Update()
        mesh = triangles.GetOutput()
        if reader.GetErrorCode() or not mesh.GetNumberOfPolys():
            raise InputError(f"{path} holds no triangles, or is damaged: give a mesh")
        vertices = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
        faces = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError(f"{path} names vertices that it does not have: it is damaged")
    return {"vertices": vertices, "faces": faces}
