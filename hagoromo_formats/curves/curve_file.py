"""Curve files: Yuksel's `.hair`, lines of OBJ and glTF, curves of Alembic and USD → polylines, in the file's units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.gltf import SUFFIXES as GLTF
from hagoromo.files.memory import require
from hagoromo.files.reading import reading
from hagoromo_formats.curves.curve_abc import abc_lines
from hagoromo_formats.curves.curve_gltf import gltf_lines
from hagoromo_formats.curves.curve_usd import usd_lines
from hagoromo_formats.curves.polylines import LARGEST_FILE, Polylines, chained, of_chains
from hagoromo_formats.scenes.usd_stage import USD

# suffix → memory of the curves while they are read, in sizes of the file
GROWTH = {".hair": 8.0, ".obj": 40.0, ".abc": 40.0}
SUFFIXES = (*GROWTH, *GLTF, *USD)
LARGEST_PLACE = 1e9  # [units]


def read_curves(path: str | Path) -> Polylines:
    """The curves in a file of at least two points each; `InputError` when it is missing, damaged, or has none."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path} is no file of curves of a known format: give one of {', '.join(SUFFIXES)}")
    sized_file(path, LARGEST_FILE, "a file of curves")
    if suffix == ".hair":
        lines = hair_lines(read_bytes(path, GROWTH[suffix]), str(path))
    elif suffix == ".obj":
        with reading(path, "OBJ"):
            lines = obj_lines(read_bytes(path, GROWTH[suffix]))
    elif suffix == ".abc":
        require(GROWTH[suffix] * Path(path).stat().st_size, str(path))
        lines = abc_lines(Path(path))
    elif suffix in GLTF:
        lines = gltf_lines(Path(path))
    else:
        lines = usd_lines(Path(path))
    return _checked(lines, path)


def hair_lines(data: bytes, where: str) -> Polylines:
    """Curves of a `.hair` (Yuksel, "HAIR model files": 128 bytes of head, then the arrays that its bits name)."""
    head = np.frombuffer(data[:128], "<u4") if len(data) >= 128 else np.zeros(32, "<u4")
    if data[:4] != b"HAIR" or len(data) < 128:
        raise InputError(f"{where} is no .hair file: it does not begin as one")
    hairs, points, bits, segments = (int(number) for number in head[1:5])
    thickness = float(np.frombuffer(data[20:24], "<f4")[0])
    counts = {0: (hairs, 2), 1: (3 * points, 4), 2: (points, 4), 3: (points, 4), 4: (3 * points, 4)}
    wanted = sum(count * size for bit, (count, size) in counts.items() if bits >> bit & 1)
    if not bits >> 1 & 1 or len(data) < 128 + wanted:
        raise InputError(f"{where} has {len(data)} bytes, its head names {128 + wanted} and points: it is cut off")
    place, arrays = 128, {}
    for bit, (count, size) in counts.items():
        if bits >> bit & 1:
            arrays[bit] = np.frombuffer(data, {2: "<u2", 4: "<f4"}[size], count, place)
            place += count * size
    if 0 not in arrays and hairs > points:
        raise InputError(f"{where} names {hairs} hairs of {points} points: it is damaged")
    each = arrays[0].astype(np.int64) if 0 in arrays else np.full(hairs, segments, np.int64)
    first = np.concatenate([[0], np.cumsum(each + 1)])
    if first[-1] > points:
        raise InputError(f"{where} names {first[-1]} points of its hairs and holds {points}: it is damaged")
    wide = arrays.get(2, np.full(points if thickness > 0 else 0, thickness, "<f4"))[: first[-1]]
    corners = arrays[1].reshape(-1, 3)[: first[-1]].astype(np.float64)
    return Polylines(corners, first, wide.astype(np.float64) if len(wide) else None)


def obj_lines(data: bytes) -> Polylines:
    """Curves of the lines `l` of an OBJ; a line that begins where the one before it ends goes on with it."""
    vertices: list[list[float]] = []
    pieces: list[list[int]] = []
    for row in data.decode("ascii", "replace").replace("\\\n", " ").splitlines():
        words = row.split()
        if words and words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words and words[0] == "l":
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            pieces.append([number - 1 if number > 0 else len(vertices) + number for number in numbers])
    return of_chains(np.array(vertices, np.float64).reshape(-1, 3), chained(pieces))


def _checked(lines: Polylines, path: str | Path) -> Polylines:
    """The lines of two points or more; `InputError` where there are none or numbers are not finite."""
    count = np.diff(lines.first)
    kept = np.repeat(count >= 2, count)
    if not kept.any():
        raise InputError(f"{path} holds no curves of two points or more: give hair or lines")
    points = lines.points[: lines.first[-1]][kept]
    if not np.isfinite(points).all() or np.abs(points).max() > LARGEST_PLACE:
        raise InputError(f"{path} has points that are not finite, or beyond {LARGEST_PLACE:g}: it is damaged")
    wide = None if lines.diameter is None else lines.diameter[: lines.first[-1]][kept]
    if wide is not None and not (np.isfinite(wide).all() and wide.min() >= 0):
        raise InputError(f"{path} has hairs whose thickness is no number of 0 or more: it is damaged")
    return Polylines(points, np.concatenate([[0], np.cumsum(count[count >= 2])]), wide)
