"""Shared arrays: how arrays go from one process to another: a layout in JSON, and the bytes of all of them.

Large ones lie in memory that both processes see (Linux); they are not copied by the one that receives them. What the
other process says is not trusted: a layout names numbers and texts alone, and within the memory.
"""

from __future__ import annotations

import math
import mmap
import os
import socket
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER = struct.Struct("<Q")  # length of a message in front of it
ALIGNED = 64  # bytes, at which arrays begin
KINDS = "biufU"  # of NumPy's types: numbers and texts
SHARED_FROM = 1 << 20  # bytes: what is smaller goes through the pipe, as each shared memory takes a file descriptor


def layout_of(arrays: Mapping[str, NDArray[Any]]) -> tuple[list[list[Any]], int]:
    """[name, type, shape, where it begins] of each array, and the bytes of all."""
    layout, end = [], 0
    for name, array in arrays.items():
        layout.append([name, array.dtype.str, list(array.shape), end])
        end += -(-array.nbytes // ALIGNED) * ALIGNED
    return layout, end


def arrays_of_layout(layout: list[list[Any]], held: Any) -> dict[str, NDArray[Any]]:
    """The arrays in `held`; ValueError for a layout that does not fit it."""
    arrays: dict[str, NDArray[Any]] = {}
    for name, kind, shape, begin in layout:
        dtype = np.dtype(str(kind))
        count = math.prod(int(n) for n in shape)
        fits = min(begin, *shape, 0) == 0 and begin + count * dtype.itemsize <= len(held)
        if dtype.kind not in KINDS or not fits:
            raise ValueError("the layout of its arrays is wrong")
        if not count or not dtype.itemsize:
            arrays[str(name)] = np.empty(shape, dtype)
        else:
            arrays[str(name)] = np.frombuffer(held, dtype, count, begin).reshape(shape)
    return arrays


def bytes_of(layout: list[list[Any]], size: int, arrays: Mapping[str, NDArray[Any]]) -> bytearray:
    """The arrays where the layout says."""
    held = bytearray(size)
    for name, _, _, begin in layout:
        held[begin : begin + arrays[name].nbytes] = arrays[name].tobytes()
    return held


def shared(layout: list[list[Any]], size: int, arrays: Mapping[str, NDArray[Any]]) -> int:
    """The file descriptor of new memory with the arrays, for `give`."""
    number = os.memfd_create("arrays", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        os.ftruncate(number, size)
        for name, _, _, begin in layout:
            left = np.ascontiguousarray(arrays[name]).reshape(-1).view(np.uint8).data
            while len(left):  # writing takes half the time of copying into a map
                os.lseek(number, begin, os.SEEK_SET)
                done = os.write(number, left)
                left, begin = left[done:], begin + done
    except BaseException:
        os.close(number)
        raise
    return number


def give(channel: socket.socket, number: int) -> None:
    """Give the other process the memory."""
    try:
        socket.send_fds(channel, [b"m"], [number])
    finally:
        os.close(number)


def memory_of(channel: socket.socket, size: int) -> mmap.mmap:
    """Memory of `size` bytes that the other process gives; what is written to it stays here."""
    try:
        import fcntl
    except ImportError as error:
        raise EOFError from error
    _, numbers, _, _ = socket.recv_fds(channel, 1, 1)
    if not numbers:
        raise EOFError
    try:
        fcntl.fcntl(numbers[0], fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)  # reading what is gone would end this process
        if os.fstat(numbers[0]).st_size != size:
            raise ValueError("its memory has another size than it says")
        return mmap.mmap(numbers[0], size, access=mmap.ACCESS_COPY)
    finally:
        os.close(numbers[0])
