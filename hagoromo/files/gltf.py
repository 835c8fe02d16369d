"""glTF 2.0 as it lies in its file: JSON, buffers, images, and the places of its nodes (Khronos glTF 2.0, 3 and 4.4).

Files that it names are those of its folder; addresses are not opened.
"""

from __future__ import annotations

import base64
import struct
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.gltf_record import MOST_NODES, WIDTHS, checked

SUFFIXES = (".glb", ".gltf")
START = struct.Struct("<4sIIII")  # of a binary one: magic, version, length, length and type of its JSON
CHUNK = 8  # bytes before the content of a part: its length and type
MAGIC = b"glTF"
LARGEST_FILE = 1 << 32  # [byte]
NUMBERS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
Matrix = NDArray[np.float64]


def gltf_record(data: bytes, suffix: str, where: str) -> dict[str, Any]:
    """The JSON of a glTF from its bytes, checked; `InputError` and others where they are damaged."""
    if suffix == ".glb":
        magic, _, _, length, _ = START.unpack_from(data)
        if magic != MAGIC:
            raise ValueError("it does not begin as a .glb")
        data = data[START.size : START.size + length]
    return checked(data, where)


def buffer_bytes(path: Path, record: Mapping[str, Any], number: int) -> bytes:
    """The bytes of a bufferView: of the file's second part, of the JSON itself, or of a file of its folder.

    `ValueError` and others where it is damaged, `InputError` for a file that is not there, or outside of the folder.
    """
    view = record["bufferViews"][number]
    buffer = record["buffers"][view["buffer"]]
    whole = named_bytes(path, str(buffer["uri"])) if "uri" in buffer else _binary(path)
    begin, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
    if not (begin >= 0 and 0 < length <= len(whole) - begin):
        raise ValueError(f"bufferView {number} lies outside of its buffer")
    return whole[begin : begin + length]


def image_bytes(path: Path, record: Mapping[str, Any], number: int) -> bytes:
    """The bytes of an image, as of `buffer_bytes`."""
    image = record["images"][number]
    return named_bytes(path, str(image["uri"])) if "uri" in image else buffer_bytes(path, record, image["bufferView"])


def array_of(path: Path, record: Mapping[str, Any], number: int) -> NDArray[Any]:
    """The numbers of an accessor, (count, width); `ValueError` and others where it is damaged, or sparse."""
    accessor = record["accessors"][number]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ValueError(f"accessor {number} is sparse: write it without")
    kind, width = np.dtype(NUMBERS[accessor["componentType"]]), WIDTHS[accessor["type"]]
    data = buffer_bytes(path, record, accessor["bufferView"])[int(accessor.get("byteOffset", 0)) :]
    stride = int(record["bufferViews"][accessor["bufferView"]].get("byteStride", 0)) or kind.itemsize * width
    count = int(accessor["count"])
    each = kind.itemsize * width
    if count < 0 or stride < each or (count and (count - 1) * stride + each > len(data)):
        raise ValueError(f"accessor {number} lies outside of its bufferView")
    strided = np.ndarray((count, width), kind.newbyteorder("<"), data, strides=(stride, kind.itemsize))
    return strided.astype(kind)


def named_bytes(path: Path, uri: str) -> bytes:
    """What a uri holds: data of the JSON, or of a file of the folder of `path`."""
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2], validate=True)
    return read_bytes(sized_file(inside(path.parent, unquote(uri)), LARGEST_FILE, "a file of a glTF"), 1.0)


def _binary(path: Path) -> bytes:
    """The second part of a .glb."""
    data = read_bytes(sized_file(path, LARGEST_FILE, "a glTF"), 1.0)
    return data[START.size + START.unpack_from(data)[3] + CHUNK :]


def placed_nodes(record: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], Matrix]]:
    """The nodes of the scene with their places in the world (4, 4), each once for every way to it."""
    nodes, scenes = record.get("nodes", []), record.get("scenes", [])
    roots = scenes[record.get("scene", 0)].get("nodes", []) if scenes else range(len(nodes))
    pending = deque((int(root), np.eye(4), 0) for root in roots)
    count = 0
    while pending:
        number, above, depth = pending.popleft()
        count += 1
        if count > MOST_NODES or depth > len(nodes):
            raise ValueError(f"its nodes are more than {MOST_NODES}, or lie within themselves")
        place = above @ _transform(nodes[number])
        yield nodes[number], place
        pending += [(int(child), place, depth + 1) for child in nodes[number].get("children", [])]


def _transform(node: Mapping[str, Any]) -> Matrix:
    """Node to parent (3.5.3): a matrix by columns, or translation, rotation (x, y, z, w) and scale."""
    if "matrix" in node:
        return np.reshape(np.array(node["matrix"], float), (4, 4)).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), float)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    place = np.eye(4)
    place[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), float)
    place[:3, 3] = np.array(node.get("translation", (0, 0, 0)), float)
    return place
