"""Alembic (.abc): polygons and cages of subdivision surfaces at their first time, read in a process of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.apart import read_apart
from hagoromo.files.memory import require
from hagoromo.files.mesh import fans
from hagoromo.files.reading import library, reading

BYTES_PER_NUMBER = 300.0  # of memory, of a vertex or corner while it is a number of Python's
DEEPEST, MOST_OBJECTS = 100, 100_000  # of the tree of objects


def read_abc(path: Path) -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices (n, 3) and triangles (m, 3) of all meshes at their places; `InputError` where there are none."""
    library("alembic3d")
    arrays = read_apart(triangles_by_alembic, path, "Alembic")
    return arrays["vertices"], arrays["faces"]


def triangles_by_alembic(path: Path) -> Mapping[str, NDArray[Any]]:
    """vertices and faces; run by `read_apart`."""
    alembic = library("alembic3d")
    vertices, faces, before, held = [], [], 0, 0
    with reading(path, "Alembic"):
        schemas = alembic.AbcGeom.IPolyMesh, alembic.AbcGeom.ISubD
        top = alembic.Abc.IArchive(str(path)).getTop()
        for count, (mesh, matrix) in enumerate(placed_objects(alembic, top, schemas)):
            if count > MOST_OBJECTS:
                raise InputError(f"{path} has more than {MOST_OBJECTS} meshes: join them")
            sample = mesh.getSchema().getValue()
            held += len(sample.getPositions()) + len(sample.getFaceIndices())
            require(BYTES_PER_NUMBER * held, str(path))  # many meshes may share the numbers of the file
            points = np.array([tuple(p) for p in sample.getPositions()], np.float64).reshape(-1, 3)
            corners = np.array(list(sample.getFaceIndices()), np.int64)
            triangles, _ = fans(np.array(list(sample.getFaceCounts()), np.int64), corners)
            triangles = triangles[:, [0, 2, 1]]  # Alembic's polygons run clockwise
            if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(points):
                raise InputError(f"{path} names vertices that it does not have: it is damaged")
            vertices.append(points @ matrix[:3, :3] + matrix[3, :3])
            faces.append(triangles + before)
            before += len(points)
        if not sum(map(len, faces)):
            raise InputError(f"{path} holds no polygons: give a mesh")
        return {"vertices": np.concatenate(vertices), "faces": np.concatenate(faces)}


def placed_objects(
    alembic: Any, above: Any, schemas: tuple[Any, ...], matrix: NDArray[np.float64] | None = None, depth: int = 0
) -> Iterator[tuple[Any, NDArray[np.float64]]]:
    """Each object below `above` of one of the `schemas`, and the matrix, for rows of points, that places it."""
    geometry, existing = alembic.AbcGeom, alembic.Abc.WrapExistingFlag.kWrapExisting
    if depth > DEEPEST:
        raise ValueError("its objects are nested too deeply")
    for k in range(above.getNumChildren()):
        child, own = above.getChild(k), np.eye(4) if matrix is None else matrix
        kind = child.getMetaData()
        if geometry.IXform.matches(kind):
            sample = geometry.IXform(child, existing).getSchema().getValue()
            moved = np.array([[sample.getMatrix()[i][j] for j in range(4)] for i in range(4)], np.float64)
            own = moved @ own if sample.getInheritsXforms() else moved
        for schema in schemas:
            if schema.matches(kind):
                yield schema(child, existing), own
        yield from placed_objects(alembic, child, schemas, own, depth + 1)
