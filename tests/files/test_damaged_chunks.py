"""Chunks whose packed bytes are damaged are refused by the name of their file, whatever codec packed them."""

from functools import partial

import pytest

from fuzz import boxes
from hagoromo.errors import InputError
from hagoromo.files.zarr_arrays import open_array

PACKED = {
    "gzip": partial(boxes.array_v3, codec="gzip"),
    "blosc": partial(boxes.array_v3, codec="blosc"),
    "shards": partial(boxes.array_v3, shards=True),
    "v2 zlib": partial(boxes.array_v2, codec="zlib"),
    "v2 gzip": partial(boxes.array_v2, codec="gzip"),
    "v2 blosc": partial(boxes.array_v2, codec="blosc"),
}


@pytest.mark.parametrize("name", PACKED)
@pytest.mark.parametrize("damage", [lambda data: data[:9], lambda data: data[:20] + b"\xff" * 20, lambda data: b""])
def test_a_damaged_chunk_is_refused(tmp_path, name, damage):
    PACKED[name](tmp_path / "a.zarr")
    files = (path for path in (tmp_path / "a.zarr").rglob("*") if path.is_file())
    chunk = next(path for path in sorted(files) if path.name[0].isdigit())
    chunk.write_bytes(damage(chunk.read_bytes()))
    array = open_array(tmp_path / "a.zarr")
    with pytest.raises(InputError, match="cannot be decoded") as refused:
        array.read((0, 0, 0), array.shape)
    assert str(refused.value).isprintable()
