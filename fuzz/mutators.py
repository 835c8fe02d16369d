"""Mutators: the same bytes and the same seed give the same spoilt bytes."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable

import numpy as np

from fuzz import extremes
from fuzz.trees import spoilt_json, spoilt_toml

Random = np.random.Generator
NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e400", b"2147483648", b"4294967296", b"9223372036854775808",
    b"18446744073709551616", b"9" * 400, b"9" * 5000, b"nan", b"inf", b"-inf", b".Inf", b".NaN", b"NaN", b"-Infinity",
    b"0x10", b"1_0", b"1.2.3", "１２".encode(), b"0.5", b"3", b"1e30",
)  # fmt: skip
WORDS = (
    b"", b"[]", b"{}", b"null", b"~", b'""', b"text", b'"\\ud800"', b"\x00", b"\x1b[31m", b"\xff\xfe", b"-",
    b"[" * 20000, b"{" * 20000,
    b'{"a":' * 3000, "\u2028".encode(), b"\r\n", b" ", b"=", b":", b",", b"true", b"'", b"#", b";",
)  # fmt: skip
INTEGERS = (0, -1, 1, 2, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63)
FLOATS = (0.0, -1.0, 1e308, 1e-310, float("nan"), float("inf"), 1e30)
JSON, XML = (".json", ".gltf", ".zarray", ".zattrs", ".zgroup"), (".xml", ".spdx", ".vtp", ".vti")
TEXT_SUFFIXES = (
    ".yml", ".yaml", ".txt", ".csv", ".ies", ".wif", ".obj", ".mtl", ".ply", ".off", ".toml", ".spd", ".usda", ".mha",
    ".nrrd", *JSON, *XML,
)  # fmt: skip
FAR = 0.15  # share of extremes
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
LEADING = (".json", ".toml", ".zarray", ".yml", ".txt", ".wif", ".csv")  # files of a folder that are spoilt most
PNG_START = b"\x89PNG\r\n\x1a\n"


def spoilt(name: str, data: bytes, random: Random) -> bytes:
    """`data` of a file called `name`, with one to three things wrong."""
    for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
        data = _mutator(name, data, random)(data, random)
    return with_check_sums(data) if data.startswith(PNG_START) and random.random() < 0.7 else data


def spoil_one(files: dict[str, bytes], random: Random) -> None:
    """One file of the sample spoilt, or, where there are several, lost or in the place of another."""
    names = sorted(files)
    leading = [name for name in names if name.endswith(LEADING)]
    chosen = leading if leading and random.random() < 0.6 else names
    name = chosen[int(random.integers(len(chosen)))]
    act = random.random()
    if len(names) > 1 and act < 0.03:
        del files[name]
    elif len(names) > 1 and act < 0.06:
        files[name] = files[names[int(random.integers(len(names)))]]
    else:
        files[name] = spoilt(name, files[name], random)


def _mutator(name: str, data: bytes, random: Random) -> Callable[[bytes, Random], bytes]:
    suffix = name[name.rfind(".") :]
    chance = random.random()
    if suffix in JSON and chance < 0.7:
        return spoilt_json
    if suffix == ".toml" and chance < 0.7:
        return spoilt_toml
    if suffix in XML and chance < 0.5:
        return _one_of(extremes.XML, random)
    if suffix in TEXT_SUFFIXES and chance < 0.9:
        return _one_of(extremes.TEXT if random.random() < FAR else TEXT, random)
    return _one_of((inserted,) if not data else extremes.BINARY if random.random() < FAR else BYTES, random)


def _one_of(choices: tuple, random: Random) -> Callable[[bytes, Random], bytes]:
    return choices[int(random.integers(len(choices)))]


def _place(data: bytes, random: Random) -> int:
    """A byte; headers, where files have their sizes, are hit as often as the rest."""
    length = max(len(data), 1)
    return int(random.integers(min(length, 512) if random.random() < 0.5 else length))


def flipped(data: bytes, random: Random) -> bytes:
    """One to eight bytes changed."""
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 9)) if data else 0):
        changed[_place(data, random)] = int(random.integers(256))
    return bytes(changed)


def cut(data: bytes, random: Random) -> bytes:
    """Ended early, or without a part of the middle."""
    at = _place(data, random)
    return data[:at] + (b"" if random.random() < 0.6 else data[at + int(random.integers(1, 65)) :])


def inserted(data: bytes, random: Random) -> bytes:
    """Bytes that were not there."""
    at = _place(data, random)
    return data[:at] + random.bytes(int(random.integers(1, 65))) + data[at:]


def repeated(data: bytes, random: Random) -> bytes:
    """A part again, or many times."""
    at, size = _place(data, random), int(random.integers(1, 129))
    return data[:at] + data[at : at + size] * int(random.choice((2, 3, 200))) + data[at + size :]


def swapped(data: bytes, random: Random) -> bytes:
    """Two parts in each other's place."""
    a, b, size = *sorted((_place(data, random), _place(data, random))), int(random.integers(1, 129))
    size = min(size, b - a)
    return data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]


def zeroed(data: bytes, random: Random) -> bytes:
    """A part that is all 0 or all 255."""
    at, size = _place(data, random), int(random.integers(1, 129))
    return data[:at] + (b"\0", b"\xff")[int(random.integers(2))] * len(data[at : at + size]) + data[at + size :]


def with_number(data: bytes, random: Random) -> bytes:
    """A binary number at the edge of its range in place of some bytes."""
    at, order = _place(data, random), "<>"[int(random.integers(2))]
    if random.random() < 0.8:
        size = int(random.choice((1, 2, 4, 8)))
        number = (INTEGERS[int(random.integers(len(INTEGERS)))] % 2 ** (8 * size)).to_bytes(
            size, "little" if order == "<" else "big"
        )
    else:
        kind = "fd"[int(random.integers(2))]
        value = FLOATS[int(random.integers(len(FLOATS)))]
        number = struct.pack(order + kind, value if kind == "d" or abs(value) < 1e38 else float("inf"))
    return data[:at] + number + data[at + len(number) :]


def number_replaced(data: bytes, random: Random) -> bytes:
    """A number of a text replaced by one at the edge, or by a word."""
    found = list(NUMBER.finditer(data))
    if not found:
        return inserted(data, random)
    one = found[int(random.integers(len(found)))]
    choices = NUMBERS if random.random() < 0.8 else WORDS
    return data[: one.start()] + choices[int(random.integers(len(choices)))] + data[one.end() :]


def word_inserted(data: bytes, random: Random) -> bytes:
    """A word that formats take in a way of their own."""
    at = _place(data, random)
    return data[:at] + WORDS[int(random.integers(len(WORDS)))] + data[at:]


def line_changed(data: bytes, random: Random) -> bytes:
    """A line lost, doubled, indented, emptied, cut, or moved."""
    lines = data.split(b"\n")
    at, to = int(random.integers(len(lines))), int(random.integers(len(lines)))
    line = lines[at]
    changed = (
        [],
        [line, line],
        [b" " + line],
        [b"\t" + line],
        [b""],
        [line[: len(line) // 2]],
        [line.replace(b"=", b""), b"   " + line],
        [lines[to]],
        [line + b"\r"],
        [line.upper()],
    )
    return b"\n".join([*lines[:at], *changed[int(random.integers(len(changed)))], *lines[at + 1 :]])


def with_check_sums(data: bytes) -> bytes:
    """A PNG whose check sums are right, so that what is wrong inside its chunks reaches the decoder."""
    parts, offset = [PNG_START], len(PNG_START)
    while offset + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, offset)
        body = data[offset + 4 : offset + 8 + length]
        if len(body) != 4 + length:
            break
        parts.append(data[offset : offset + 4] + body + struct.pack(">I", zlib.crc32(body)))
        offset += 12 + length
    return b"".join(parts) + data[offset:]


BYTES = (flipped, flipped, cut, inserted, repeated, swapped, zeroed, with_number, with_number, with_number)
TEXT = (number_replaced, number_replaced, number_replaced, word_inserted, line_changed, flipped, cut)
