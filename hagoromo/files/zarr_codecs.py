"""Codecs of Zarr that unpack no more bytes than an array says that a chunk of it has.

A compressed file may state, or silently unpack to, any size: a hundred kilobytes of it to gigabytes. Sizes that a
format states are compared before it is unpacked; the others are unpacked with a limit.
"""

from __future__ import annotations

import asyncio
import bz2
import lzma
import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from zarr.abc.codec import BytesBytesCodec

ZSTD_START = b"\x28\xb5\x2f\xfd"
LARGEST_LZMA_WINDOW = 1 << 28  # bytes, of the window that the strongest LZMA looks back into
EXPANSION, OVERHEAD = 1.125, 1 << 12  # of packed bytes over unpacked ones, where packing does not help
CONTAINERS = {"gzip": 31, "zlib": 15}  # wbits of zlib


class TooLargeError(ValueError):
    """A chunk that unpacks to more than its array says."""

    def __init__(self, most: int) -> None:
        super().__init__(f"it unpacks to more than the {most} bytes that its array states")


def packed_limit(size: float, parts: float = 1.0) -> float:
    """Most bytes [byte] that a file of `parts` packed chunks may have which hold `size` bytes together."""
    return EXPANSION * size + OVERHEAD * (1.0 + parts)


def unpacked(name: str, data: bytes, most: int, exact: bool, settings: Mapping[str, Any]) -> Any:
    """`data` unpacked by the codec `name`; ValueError where that gives more than `most` bytes.

    exact: whether it must give `most` bytes, which a Zstandard frame need not state.
    """
    if name == "zstd":
        return _zstd(data, most, exact)
    if name == "blosc":
        return _stated(name, data, most, struct.unpack_from("<I", data, 4)[0])
    if name == "lz4":
        return _stated(name, data, most, struct.unpack_from("<I", data)[0])
    try:
        return _streamed(_decompressor(name, settings), data, most)
    except (zlib.error, lzma.LZMAError, EOFError) as error:
        raise ValueError(str(error)) from error


def bounded(pipeline: Any, most: int) -> Any:
    """A codec pipeline of zarr-python whose unpacking is bounded, that within shards too. most: bytes of a chunk."""
    inner = pipeline.array_bytes_codec
    if hasattr(inner, "compressor"):  # all codecs of version 2
        filters, exact = inner.filters, not inner.filters
        filters = None if exact else tuple(_bounded_numcodec(codec, most, False) for codec in filters)
        inner = replace(inner, filters=filters, compressor=_bounded_numcodec(inner.compressor, most, exact))
    elif hasattr(inner, "index_codecs"):
        inner = replace(inner, codecs=_bounded_codecs(inner.codecs))
    return replace(pipeline, array_bytes_codec=inner, bytes_bytes_codecs=_bounded_codecs(pipeline.bytes_bytes_codecs))


@dataclass(frozen=True)
class _BoundedCodec(BytesBytesCodec):
    """A codec of version 3 that unpacks no more than a chunk has. exact: whether it yields the chunk itself."""

    codec: Any
    name: str
    exact: bool
    is_fixed_size = False

    def evolve_from_array_spec(self, array_spec: Any) -> _BoundedCodec:
        return replace(self, codec=self.codec.evolve_from_array_spec(array_spec))

    def compute_encoded_size(self, input_byte_length: int, chunk_spec: Any) -> int:
        return self.codec.compute_encoded_size(input_byte_length, chunk_spec)

    def to_dict(self) -> Any:
        return self.codec.to_dict()

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:  # pyrefly: ignore[bad-override-param-name]
        size = math.prod(chunk_spec.shape) * chunk_spec.dtype.to_native_dtype().itemsize
        most = size if self.exact else int(packed_limit(size))
        settings = self.codec.to_dict().get("configuration", {})
        data = await asyncio.to_thread(unpacked, self.name, chunk_bytes.to_bytes(), most, self.exact, settings)
        return chunk_spec.prototype.buffer.from_bytes(bytes(data))


class _BoundedNumcodec:
    """A codec of version 2 that unpacks no more than `most` bytes."""

    def __init__(self, codec: Any, most: int, exact: bool) -> None:
        self.codec, self.codec_id, self.exact = codec, codec.codec_id, exact
        self.most = most if exact else int(packed_limit(most))

    def decode(self, data: Any, out: Any = None) -> Any:
        return unpacked(self.codec_id, bytes(data), self.most, self.exact, self.codec.get_config())

    def encode(self, data: Any) -> Any:
        return self.codec.encode(data)

    def get_config(self) -> Any:
        return self.codec.get_config()


def _bounded_codecs(codecs: tuple[Any, ...]) -> tuple[Any, ...]:
    """`codecs` of version 3, in the order in which they pack; the first that packs bytes is next to the chunk."""
    made = []
    for codec in codecs:
        if hasattr(codec, "index_codecs"):
            codec = replace(codec, codecs=_bounded_codecs(codec.codecs))
        name = codec.to_dict()["name"].removeprefix("numcodecs.")
        packs = isinstance(codec, BytesBytesCodec)
        first = packs and not any(isinstance(before, BytesBytesCodec) for before in made)
        made.append(_BoundedCodec(codec, name, first) if packs and name in UNPACKERS else codec)
    return tuple(made)


def _bounded_numcodec(codec: Any, most: int, exact: bool) -> Any:
    return _BoundedNumcodec(codec, most, exact) if getattr(codec, "codec_id", "") in UNPACKERS else codec


def _zstd(data: bytes, most: int, exact: bool) -> Any:
    """Zstandard: numcodecs fills exactly the memory that it is given, or raises."""
    from numcodecs import Zstd

    stated = zstd_size(data)
    size = most if stated is None and exact else stated
    if size is None:
        raise ValueError("its Zstandard frame does not state its size")
    if size > most:
        raise TooLargeError(most)
    return Zstd().decode(data, out=np.empty(size, np.uint8)) if size else b""


def zstd_size(data: bytes) -> int | None:
    """Size [byte] that the first frame of Zstandard states (RFC 8878, 3.1.1.1); None where it does not."""
    if len(data) < 6 or not data.startswith(ZSTD_START):
        raise ValueError("it is no Zstandard frame")
    kind, single = data[4] >> 6, bool(data[4] & 0x20)
    start = 5 + (not single) + (0, 1, 2, 4)[data[4] & 3]
    length = (1 if single else 0, 2, 4, 8)[kind]
    if not length or start + length > len(data):
        return None
    return int.from_bytes(data[start : start + length], "little") + (256 if length == 2 else 0)


def _stated(name: str, data: bytes, most: int, size: int) -> Any:
    """Formats of numcodecs that state the unpacked size first, and never unpack more."""
    from numcodecs import registry

    if size > most:
        raise TooLargeError(most)
    return registry.get_codec({"id": name}).decode(data)


def _streamed(start: Callable[[], Any], data: bytes, most: int) -> bytes:
    """Formats of Python's own, member after member, up to the limit."""
    parts, size = [], 0
    while data:
        stream = start()
        part = stream.decompress(data, most + 1 - size)
        while not stream.eof and part and size + len(part) <= most:  # more output may wait in the stream
            parts.append(part)
            size += len(part)
            part = stream.decompress(getattr(stream, "unconsumed_tail", b""), most + 1 - size)
        parts.append(part)
        size += len(part)
        if size > most:
            raise TooLargeError(most)
        if not stream.eof:
            raise ValueError("its packed bytes are cut off")
        data = stream.unused_data.lstrip(b"\0")  # padding
    return b"".join(parts)


def _decompressor(name: str, settings: Mapping[str, Any]) -> Callable[[], Any]:
    if name in CONTAINERS:
        return partial(zlib.decompressobj, CONTAINERS[name])
    if name == "bz2":
        return bz2.BZ2Decompressor
    filters = settings.get("filters")
    if settings.get("format") == lzma.FORMAT_RAW:
        if any(int(one.get("dict_size") or 0) > LARGEST_LZMA_WINDOW for one in filters or ()):
            raise ValueError(f"its LZMA window is larger than {LARGEST_LZMA_WINDOW} bytes")
        return partial(lzma.LZMADecompressor, lzma.FORMAT_RAW, filters=filters)
    return partial(lzma.LZMADecompressor, memlimit=LARGEST_LZMA_WINDOW)


UNPACKERS = ("zstd", "blosc", "lz4", "lzma", "bz2", *CONTAINERS)
