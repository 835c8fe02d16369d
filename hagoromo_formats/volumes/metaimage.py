"""MetaImage (.mha, .mhd): a header of `Key = value` lines, its numbers behind it or in a file beside it, raw or zlib.

The header is read here, as what it names must lie beside it and its sizes are checked before memory is taken; tests
compare with VTK's reader. Lengths are millimetres. Of scans in slices of several files none is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, sized_file
from hagoromo.files.reading import reading
from hagoromo.files.volume_file import MM, VolumeFile, grid_matrix
from hagoromo_formats.volumes.payload import PLAIN, ZLIB, read_payload

LARGEST_HEADER = 1 << 16  # bytes
LAST_KEY = "elementdatafile"
TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip


def read_metaimage(path: str | Path) -> VolumeFile:
    """The volume in a .mha or .mhd file; `InputError` for what is damaged or no volume."""
    path = Path(path)
    with sized_file(path, 1 << 46, "a MetaImage").open("rb") as opened:
        header, behind = _header(opened, path)
    named = header[LAST_KEY]
    if named.split()[:1] == ["LIST"] or "%" in named:
        raise InputError(f"{path} has its numbers in several files: join them to one first")
    local = named.upper() == "LOCAL"
    with reading(path, "MetaImage"):
        kind = TYPES.get(header.get("elementtype", ""))
        if kind is None:
            raise InputError(
                f"{path} holds {header.get('elementtype', 'no ElementType')[:40]}: {', '.join(TYPES)} are read"
            )
        sizes = [int(word) for word in header["dimsize"].split()]
        if len(sizes) != 3:
            raise InputError(f"{path} has {len(sizes)} axes: a volume has three")
        channels = int(header.get("elementnumberofchannels", "1"))
        order = ">" if _is(header, "elementbyteordermsb") or _is(header, "binarydatabyteordermsb") else "<"
        skip = int(header.get("headersize", "0"))
        packing = ZLIB if _is(header, "compresseddata") else PLAIN
        if not _is(header, "binarydata", "true"):
            raise InputError(f"{path} holds its numbers as text: write it anew in binary")
    data, start = (path, behind) if local else (inside(path.parent, named), 0)
    shape = [*sizes[::-1], *([channels] if channels != 1 else [])]
    values = read_payload(data, -1 if skip == -1 else start + max(skip, 0), shape, order + kind, packing, str(path))
    with reading(path, "MetaImage"):
        return VolumeFile(values, _matrix(header), str(path))


def _header(opened: Any, path: Path) -> tuple[dict[str, str], int]:
    """Keys in small letters → values, and where the header ends: behind ElementDataFile, which is its last line."""
    header, seen = {}, 0
    while line := opened.readline(LARGEST_HEADER):
        seen += len(line)
        key, equals, value = line.decode("latin-1").partition("=")
        if not equals or seen > LARGEST_HEADER:
            break
        header[key.strip().lower()] = value.strip()
        if key.strip().lower() == LAST_KEY:
            if missing := {"dimsize", LAST_KEY} - set(header):
                raise InputError(f"{path} states no {', '.join(missing)}: it is no MetaImage")
            return header, seen
    raise InputError(f"{path} has no line ElementDataFile: it is no MetaImage, or it is cut off")


def _is(header: Mapping[str, str], key: str, default: str = "false") -> bool:
    return header.get(key, default).lower() == "true"


def _matrix(header: Mapping[str, str]) -> Any:
    """Spacing, first centre and axes; the rows of TransformMatrix are the axes in the world."""

    def numbers(*keys: str) -> list[float]:
        text = next((header[key] for key in keys if key in header), "")
        return [float(word) for word in text.split()]

    edges = numbers("elementspacing", "elementsize")
    if not edges:
        return None
    turned = numbers("transformmatrix", "rotation", "orientation")
    first = numbers("offset", "position", "origin") or [0.0, 0.0, 0.0]
    axes = np.reshape(turned, (3, 3)).T if turned else None
    return grid_matrix(edges, first, axes, MM)
