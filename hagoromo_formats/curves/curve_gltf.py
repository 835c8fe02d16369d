"""Lines of glTF 2.0 (LINES, LINE_LOOP, LINE_STRIP) → polylines in the file's units, placed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.gltf import array_of, gltf_record, placed_nodes
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo_formats.curves.polylines import LARGEST_FILE, Polylines, chained, of_chains

LINES, LINE_LOOP, LINE_STRIP = 1, 2, 3
BYTES_PER_POINT = 200.0  # of lines while they are joined, at every place where they stand


def gltf_lines(path: Path) -> Polylines:
    """Lines of a .glb or .gltf; no diameter: the format has none. `InputError` where it is damaged."""
    data = read_bytes(sized_file(path, LARGEST_FILE, "a file of curves"), 2.0)
    vertices, chains, count = list[NDArray[np.float64]](), list[list[int]](), 0
    with reading(path, "glTF"):
        record = gltf_record(data, path.suffix.lower(), str(path))
        for node, place in placed_nodes(record):
            for part in record["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
                if part.get("mode", 4) in (LINES, LINE_LOOP, LINE_STRIP):
                    points = array_of(path, record, part["attributes"]["POSITION"]).astype(np.float64)
                    require(BYTES_PER_POINT * (count + len(points)), str(path))  # many nodes may share a mesh
                    for chain in _chains(path, record, part, len(points)):
                        chains.append([number + count for number in chain])
                    vertices.append(points @ place[:3, :3].T + place[:3, 3])
                    count += len(points)
    if not vertices:
        raise InputError(f"{path} has no lines: give a glTF with LINES or LINE_STRIP, USD, Alembic or .hair")
    return of_chains(np.concatenate(vertices), chains)


def _chains(path: Path, record: Mapping[str, Any], part: Mapping[str, Any], count: int) -> list[list[int]]:
    """Numbers of the points of each polyline of a primitive."""
    stated = array_of(path, record, part["indices"])[:, 0] if "indices" in part else np.arange(count)
    require(BYTES_PER_POINT * len(stated), str(path))
    numbers = stated.tolist()
    if any(number >= count for number in numbers):
        raise ValueError(f"its lines name point {max(numbers)} of {count}")
    if part["mode"] == LINES:
        return chained([first, last] for first, last in zip(numbers[::2], numbers[1::2], strict=False))
    return [numbers + numbers[:1] if part["mode"] == LINE_LOOP else numbers]
