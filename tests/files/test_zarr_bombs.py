"""A chunk of a Zarr array unpacks to the bytes that the array states, and never takes the memory for more."""

import bz2
import gzip
import json
import lzma
import struct
import tracemalloc
import warnings
import zlib
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numcodecs import LZ4, Blosc, Zstd, get_codec

from hagoromo.errors import InputError
from hagoromo.files.zarr_arrays import open_array
from hagoromo.files.zarr_codecs import ZSTD_START, unpacked, zstd_size
from hagoromo.volume.store.zarr_blocks import ZarrBlocks

SHAPE = (16, 24, 40)
SIZE = 4 * 16 * 24 * 40  # bytes of the only chunk
VAST = 1 << 24  # bytes that a bomb unpacks to
LIMIT = 1 << 22  # bytes that reading may take, bomb or not
CODECS = {
    "zstd": {"level": 0, "checksum": False},
    "gzip": {"level": 5},
    "blosc": {"cname": "zstd", "clevel": 5, "shuffle": "noshuffle", "typesize": 4, "blocksize": 0},
    "numcodecs.zlib": {"level": 5},
    "numcodecs.bz2": {"level": 5},
    "numcodecs.lzma": {"preset": 0},  # a window of 256 KiB in each thread
    "numcodecs.lz4": {"acceleration": 1},
}
RAW = {"format": lzma.FORMAT_RAW, "filters": [{"id": lzma.FILTER_LZMA2, "dict_size": 1 << 20}]}
VERSION_2 = [{"id": "gzip", "level": 5}, {"id": "lzma", **RAW}, {"id": "zstd", "level": 1}, None]
BYTES = {"name": "bytes", "configuration": {"endian": "little"}}


@cache
def packed(name: str, size: int) -> bytes:
    """Zeros, packed."""
    zeros = np.zeros(size, np.uint8)
    plain = {
        "gzip": gzip.compress,
        "zlib": zlib.compress,
        "bz2": bz2.compress,
        "lzma": partial(lzma.compress, preset=0),
    }
    made = {"zstd": Zstd(19), "blosc": Blosc("zstd", 9, Blosc.NOSHUFFLE), "lz4": LZ4()}
    return bytes(made[name].encode(zeros)) if name in made else plain[name](zeros.tobytes())


def unstated_zstd(size: int) -> bytes:
    """A frame of Zstandard that does not state its size: blocks of one repeated byte."""
    blocks = [min(size - at, 1 << 16) for at in range(0, size, 1 << 16)]
    headers = [struct.pack("<I", n << 3 | 2 | (k == len(blocks) - 1))[:3] + b"\0" for k, n in enumerate(blocks)]
    return ZSTD_START + bytes([0, 7 << 3]) + b"".join(headers)


def array_of(folder: Path, codecs: list, files: dict[str, bytes], shape=SHAPE, chunk=SHAPE, fill=0) -> Path:
    record = {
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": "float32",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": fill, "codecs": codecs, "attributes": {},
    }  # fmt: skip
    (folder / "a.zarr").mkdir()
    (folder / "a.zarr" / "zarr.json").write_text(json.dumps(record))
    for name, data in files.items():
        (folder / "a.zarr" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "a.zarr" / name).write_bytes(data)
    return folder / "a.zarr"


def read(path: Path, low=(0, 0, 0), high=SHAPE) -> np.ndarray:
    """What the array holds; the memory that it took is bounded, also where it raises."""
    array = open_array(path)
    tracemalloc.start()
    try:
        return array.read(low, high)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < LIMIT


def shard(codecs: list) -> dict:
    inner = {"chunk_shape": SHAPE, "codecs": codecs, "index_codecs": [BYTES], "index_location": "end"}
    return {"name": "sharding_indexed", "configuration": inner}


@pytest.fixture(autouse=True)
def quiet():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of zarr-python about codecs outside the specification
        yield


@pytest.mark.parametrize("sharded", [False, True])
@pytest.mark.parametrize("name", CODECS)
def test_a_chunk_that_unpacks_to_more_is_refused_without_the_memory(tmp_path, name, sharded):
    data = packed(name.removeprefix("numcodecs."), VAST)
    codecs = [BYTES, {"name": name, "configuration": CODECS[name]}]
    index = struct.pack("<QQ", 0, len(data)) if sharded else b""
    path = array_of(tmp_path, [shard(codecs)] if sharded else codecs, {"c/0/0/0": data + index})
    for high in (SHAPE, (1, 2, 3)):
        with pytest.raises(InputError, match="cannot be decoded"):
            read(path, high=high)


@pytest.mark.parametrize("sharded", [False, True])
@pytest.mark.parametrize("name", CODECS)
def test_what_zarr_writes_is_read_as_it_is(tmp_path, name, sharded):
    values = np.random.default_rng(1).normal(size=SHAPE).astype(np.float32)
    inner = (8, 8, 8)
    zarr.create_array(
        tmp_path / "a.zarr", data=values, chunks=inner, shards=SHAPE if sharded else None,
        compressors=[{"name": name, "configuration": CODECS[name]}, {"name": "crc32c"}],
    )  # fmt: skip
    assert np.array_equal(read(tmp_path / "a.zarr"), values)
    assert np.array_equal(read(tmp_path / "a.zarr", (3, 5, 7), (9, 20, 31)), values[3:9, 5:20, 7:31])


@pytest.mark.parametrize("compressor", VERSION_2)
@pytest.mark.parametrize("filters", [None, [{"id": "delta", "dtype": "<f4"}, {"id": "zlib", "level": 1}]])
def test_version_2_is_bounded_too(tmp_path, compressor, filters):
    values = np.arange(np.prod(SHAPE), dtype=np.float32).reshape(SHAPE)
    codecs: Any = [get_codec(one) for one in filters or ()]
    packer: Any = compressor and get_codec(compressor)
    made: Any = zarr.create_array(
        tmp_path / "a.zarr", data=values, chunks=SHAPE, zarr_format=2, filters=codecs,
        compressors=packer,
    )  # fmt: skip
    assert np.array_equal(read(tmp_path / "a.zarr"), values)
    if compressor or filters:
        codec = made.metadata.compressor or made.metadata.filters[-1]
        (tmp_path / "a.zarr" / "0.0.0").write_bytes(bytes(codec.encode(np.zeros(VAST, np.uint8))))
        with pytest.raises(InputError, match="cannot be decoded"):
            read(tmp_path / "a.zarr")


@pytest.mark.parametrize("first", ["gzip", "zstd", "blosc"])
def test_a_bomb_within_a_packed_chunk_is_refused(tmp_path, first):
    codecs = [BYTES, *({"name": name, "configuration": CODECS[name]} for name in (first, "gzip"))]
    path = array_of(tmp_path, codecs, {"c/0/0/0": gzip.compress(packed(first, VAST))})
    with pytest.raises(InputError, match="cannot be decoded"):
        read(path)


def test_zstandard_without_a_stated_size_is_read_and_bounded(tmp_path):
    codecs = [BYTES, {"name": "zstd", "configuration": CODECS["zstd"]}]
    path = array_of(tmp_path, codecs, {"c/0/0/0": unstated_zstd(SIZE)})
    assert zstd_size(unstated_zstd(SIZE)) is None and zstd_size(packed("zstd", 300)) == 300
    assert not read(path).any()
    for size in (VAST, SIZE + 1, SIZE - 1):
        (path / "c/0/0/0").write_bytes(unstated_zstd(size))
        with pytest.raises(InputError, match="cannot be decoded"):
            read(path)


def test_frames_one_after_the_other_are_bounded_together():
    twice = 2 * packed("gzip", 1000)
    assert len(unpacked("gzip", twice, 2000, True, {})) == 2000
    with pytest.raises(ValueError, match="more than the 1999"):
        unpacked("gzip", twice, 1999, True, {})
    with pytest.raises((ValueError, RuntimeError)):
        unpacked("zstd", 2 * packed("zstd", 1000), 1999, True, {})


def test_a_file_larger_than_its_chunk_is_not_read(tmp_path):
    path = array_of(tmp_path, [BYTES], {"c/0/0/0": bytes(SIZE)})
    assert not read(path).any()
    with (path / "c/0/0/0").open("r+b") as file:
        file.truncate(1 << 34)  # sparse: no such file is written
    for high in (SHAPE, (1, 2, 3)):
        with pytest.raises(InputError, match="larger than"):
            read(path, high=high)


def test_shards_of_very_many_chunks_and_vast_descriptions_are_refused(tmp_path):
    inner = {"chunk_shape": [1, 1, 1], "codecs": [BYTES], "index_codecs": [BYTES], "index_location": "end"}
    side = [4096] * 3
    with pytest.raises(InputError, match="GiB of memory"):
        open_array(array_of(tmp_path, [{"name": "sharding_indexed", "configuration": inner}], {}, side, side))
    with (tmp_path / "a.zarr" / "zarr.json").open("r+b") as file:
        file.truncate(1 << 34)
    with pytest.raises(InputError, match="a description of arrays"):
        open_array(tmp_path / "a.zarr")


def test_a_lattice_of_which_no_table_fits_the_memory_is_refused_by_its_description(tmp_path):
    for vast in ([100_000] * 3, [9, 6, 10**395]):  # the second is beyond the largest float
        folder = tmp_path / str(vast[0])
        folder.mkdir()
        with pytest.raises(InputError, match=r"GiB of memory|must be a number below 1e308"):
            ZarrBlocks(open_array(array_of(folder, [BYTES], {}, vast, (64, 64, 64), fill=1)), {})
