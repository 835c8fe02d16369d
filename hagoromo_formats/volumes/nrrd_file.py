"""NRRD (Nearly Raw Raster Data, teem): its header by pynrrd, its numbers raw, gzip or bzip2, in the file or beside it.

Lengths without a unit are millimetres. The header's space (left-posterior-superior …) is taken as the world it is.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, sized_file
from hagoromo.files.reading import library, reading
from hagoromo.files.volume_file import MM, Later, VolumeFile
from hagoromo.files.whole import whole_file
from hagoromo_formats.volumes.lattice_field import LatticeField, lattice_field, slabs
from hagoromo_formats.volumes.payload import BZIP2, GZIP, PLAIN, WINDOW_BITS, read_payload

LARGEST_HEADER = 1 << 20  # bytes
LEVEL = 9  # of packing
PACKINGS = {"raw": PLAIN, "gzip": GZIP, "gz": GZIP, "bzip2": BZIP2, "bz2": BZIP2}
UNITS = {"": MM, "mm": MM, "millimeter": MM, "um": 1e-6, "µm": 1e-6, "micron": 1e-6, "cm": 1e-2, "m": 1.0}
SPATIAL = ("domain", "space", "none", "???")  # kinds of an axis of places


def read_nrrd(path: str | Path) -> VolumeFile:
    """The volume in a .nrrd or .nhdr file; `InputError` for what is damaged or no volume."""
    nrrd = library("nrrd")
    path = Path(path)
    file = sized_file(path, 1 << 46, "an NRRD")
    with reading(path, "NRRD"), file.open("rb") as opened:
        header = dict(nrrd.read_header(_lines(opened, path)))
        start = opened.tell()
        kind = _type(header, path)
        sizes = [int(n) for n in np.asarray(header.get("sizes", ()))]
    packing = PACKINGS.get(str(header.get("encoding", "")).lower())
    if packing is None:
        raise InputError(f"{path} is packed by {str(header.get('encoding'))[:20]!r}: {', '.join(PACKINGS)} are read")
    named = header.get("data file", header.get("datafile"))
    data, start = (path, start) if named is None else (_beside(path, str(named)), 0)
    if _skip(header, "line skip") or (skip := _skip(header, "byte skip")) < -1:
        raise InputError(f"{path} skips lines before its numbers: write it anew without")
    start = -1 if skip == -1 else start + skip
    values = read_payload(data, start, sizes[::-1], kind, packing, str(path))
    with reading(path, "NRRD"):
        return _volume(values, header, str(path))


def write_nrrd(path: str | Path, values: NDArray[Any] | LatticeField, matrix: NDArray[np.float64], name: str) -> None:
    """Write values (nz, ny, nx[, 3]) as NRRD 5, gzip; three components are an axis of kind 3-vector.

    matrix: of a `VolumeFile`. name: of the content.
    """
    nrrd, field, matrix = library("nrrd"), lattice_field(values), matrix / MM
    components = len(field.shape) == 4
    directions = [matrix[:3, k].tolist() for k in range(3)]
    header: dict[str, Any] = {
        "space dimension": 3,
        "space directions": np.array([[np.nan] * 3, *directions] if components else directions),
        "space origin": matrix[:3, 3],
        "space units": ["mm"] * 3,
        "kinds": ["3-vector", *["domain"] * 3] if components else ["domain"] * 3,
        "encoding": "gzip",
        "content": name,
    }
    written = io.BytesIO()
    nrrd.write(written, field.part((0, 0, 0), (1, 1, 1)), header, index_order="C")  # for its header
    lines = written.getvalue().partition(b"\n\n")[0].split(b"\n")
    sizes = b"sizes: " + b" ".join(b"%d" % n for n in reversed(field.shape))
    lines = [sizes if line.startswith(b"sizes: ") else line for line in lines]
    lines = [line for line in lines if not line.startswith(b"#")]  # comments state the time
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, WINDOW_BITS[GZIP])
    with whole_file(path, force=True) as partial, partial.open("wb") as file:
        file.write(b"\n".join(lines) + b"\n\n")
        file.writelines(packer.compress(slab.tobytes()) for slab in slabs(field))
        file.write(packer.flush())


def _lines(opened: Any, path: Path) -> Any:
    """The lines of a header, which is no longer than LARGEST_HEADER."""
    seen = 0
    while line := opened.readline(LARGEST_HEADER):
        seen += len(line)
        if seen > LARGEST_HEADER:
            raise InputError(f"{path} has a header of more than {LARGEST_HEADER} bytes: it is no NRRD")
        yield line


def _type(header: Mapping[str, Any], path: Path) -> np.dtype[Any]:
    from nrrd.reader import _determine_datatype

    kind = _determine_datatype(dict(header))
    if kind.kind not in "iuf":
        raise InputError(f"{path} holds {header.get('type')!s:.40}: give numbers")
    return kind


def _beside(path: Path, named: str) -> Path:
    if named.split()[:1] == ["LIST"] or "%" in named:
        raise InputError(f"{path} has its numbers in several files: join them to one first")
    return inside(path.parent, named)


def _skip(header: Mapping[str, Any], key: str) -> int:
    return int(header.get(key, header.get(key.replace(" ", ""), 0)))


def _volume(values: Later, header: Mapping[str, Any], where: str) -> VolumeFile:
    """values: axes slowest first; an axis that is none of space goes last, as components."""
    axes = len(values.shape)
    directions = header.get("space directions")
    rows: Any = None if directions is None else [None if row is None else np.asarray(row, float) for row in directions]
    kinds = [str(kind) for kind in header.get("kinds", ())] or ["domain"] * axes
    if rows is None:
        spatial = [k for k in range(axes) if kinds[k] in SPATIAL]
    else:
        spatial = [k for k in range(axes) if rows[k] is not None and np.isfinite(rows[k]).all()]
    if len(spatial) != 3 or axes > 4:
        raise InputError(f"{where} has {len(spatial)} axes of space among {axes}: a volume has three")
    rest = [k for k in range(axes) if k not in spatial]
    values = values.transpose([axes - 1 - k for k in (*reversed(spatial), *rest)])
    return VolumeFile(values, _matrix(header, rows, spatial), where)


def _matrix(header: Mapping[str, Any], rows: Any, spatial: list[int]) -> NDArray[np.float64] | None:
    """The matrix, from directions and origin, or from spacings (and the least coordinates of the axes)."""
    matrix = np.eye(4)
    if rows is not None:
        units = [str(unit) for unit in header.get("space units", ["mm"] * 3)]
        scale = np.array([_unit(unit) for unit in units])
        matrix[:3, :3] = np.stack([rows[k] for k in spatial], axis=1) * scale[:, None]
        matrix[:3, 3] = np.asarray(header.get("space origin", np.zeros(3)), float) * scale
        return matrix
    spacings = header.get("spacings")
    if spacings is None:
        return None
    units = [str(unit) for unit in header.get("units", ["mm"] * len(spacings))]
    edges = np.array([float(spacings[k]) * _unit(units[k]) for k in spatial])
    first = header.get("axis mins", header.get("axismins"))
    matrix[:3, :3] = np.diag(edges)
    if first is not None and np.isfinite(np.asarray(first, float)[spatial]).all():
        matrix[:3, 3] = [float(first[k]) * _unit(units[k]) for k in spatial]
    return matrix if np.isfinite(matrix).all() else None


def _unit(name: str) -> float:
    name = name.strip().strip('"').lower()
    if name not in UNITS:
        raise InputError(f"the unit {name[:20]!r} of an NRRD is not known: {', '.join(filter(None, UNITS))} are")
    return UNITS[name]
