"""Extremes: what is nested deeply, repeated very often, very long, or states a size that is far from the file's.

A reader must refuse these at once, or read them in steps of the file's size: the judge counts its time and memory.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Random = np.random.Generator
DEEP, MANY, LONG = 50_000, 20_000, 100_000
LARGEST = 4_000_000  # bytes of what is there many times
SIZES = (1_000, 30_000, 2**16 - 1, 2**20, 2**31 - 1)
SMALLEST_SIZE, LARGEST_SIZE = 2, 5_000  # of whole numbers that are taken for a size
NAME = rb"[A-Za-z_][\w.-]*"
LEAF = re.compile(rb"<(%s)[^<>]*>([^<>]*)</\1>|<%s[^<>]*/>" % (NAME, NAME))
ATTRIBUTE = re.compile(rb'(%s)="([^"]*)"' % NAME)
WORD = re.compile(rb"[A-Za-z][A-Za-z0-9]{2,}")
TOKENS = (b"A" * 125, b"A" * LONG, b"1" * LONG, b"a." * LONG, b"-" * LONG, b"1 " * LONG, b"\xc3\xa9" * LONG, b"&" * 300)


def stated_size(data: bytes, random: Random) -> bytes:
    """A binary whole number that may be a size replaced by one that is far from it."""
    width, order = int(random.choice((2, 4, 8))), ("little", "big")[int(random.integers(2))]
    numbers = np.frombuffer(data[: len(data) // width * width], f"{'<' if order == 'little' else '>'}u{width}")
    shift = int(random.integers(width)) if random.random() < 0.5 else 0
    if shift and len(data) > 2 * width:
        body = data[shift : shift + (len(data) - shift) // width * width]
        numbers = np.frombuffer(body, numbers.dtype)
    places = np.flatnonzero((numbers >= SMALLEST_SIZE) & (numbers <= LARGEST_SIZE))
    if not len(places):
        return data
    at = shift + width * int(places[int(random.integers(len(places)))])
    size = SIZES[int(random.integers(len(SIZES)))] % 2 ** (8 * width)
    return data[:at] + size.to_bytes(width, order) + data[at + width :]


def part_many_times(data: bytes, random: Random) -> bytes:
    """A part of a binary file very often."""
    at, size = int(random.integers(max(len(data), 1))), int(random.integers(1, 65))
    return data[:at] + data[at : at + size] * MANY + data[at + size :]


def line_many_times(data: bytes, random: Random) -> bytes:
    """A line very often."""
    lines = data.split(b"\n")
    at = int(random.integers(len(lines)))
    return b"\n".join([*lines[:at], *[lines[at]] * _times(lines[at]), *lines[at + 1 :]])


def long_word(data: bytes, random: Random) -> bytes:
    """A word replaced by a very long one, or one of 125 letters."""
    found = list(WORD.finditer(data))
    if not found:
        return data
    one = found[int(random.integers(len(found)))]
    return data[: one.start()] + TOKENS[int(random.integers(len(TOKENS)))] + data[one.end() :]


def leaf_lost(data: bytes, random: Random) -> bytes:
    """An element of XML without others in it, or an attribute, is lost."""
    found = [*LEAF.finditer(data), *ATTRIBUTE.finditer(data)]
    return _replaced(data, found, lambda _: b"", random)


def leaf_changed(data: bytes, random: Random) -> bytes:
    """The text of an element, or the value of an attribute, is another or a very long one."""
    texts = (b"", b"-1", b"nan", b"1e400", b"true", b"1, 2", b"text", b"../a", *TOKENS)
    text = texts[int(random.integers(len(texts)))]

    def other(found: re.Match[bytes]) -> bytes:
        if found.re is ATTRIBUTE:
            return b'%s="%s"' % (found[1], text)
        return found[0] if found[1] is None else b"<%s>%s</%s>" % (found[1], text, found[1])

    return _replaced(data, [*LEAF.finditer(data), *ATTRIBUTE.finditer(data)], other, random)


def leaf_nested(data: bytes, random: Random) -> bytes:
    """An element within itself, very deeply."""

    def nested(found: re.Match[bytes]) -> bytes:
        name = found[1] or b"a"
        deep = min(DEEP, LARGEST // len(name))
        return b"<%s>" % name * deep + found[0] + b"</%s>" % name * deep

    return _replaced(data, list(LEAF.finditer(data)), nested, random)


def leaf_many_times(data: bytes, random: Random) -> bytes:
    """An element very often."""
    return _replaced(data, list(LEAF.finditer(data)), lambda found: found[0] * _times(found[0]), random)


def _times(part: bytes) -> int:
    return max(min(MANY, LARGEST // (len(part) + 1)), 2)


def _replaced(
    data: bytes, found: list[re.Match[bytes]], make: Callable[[re.Match[bytes]], bytes], random: Random
) -> bytes:
    if not found:
        return data
    one = found[int(random.integers(len(found)))]
    return data[: one.start()] + make(one) + data[one.end() :]


BINARY = (stated_size, stated_size, stated_size, part_many_times)
TEXT = (line_many_times, long_word, long_word)
XML = (leaf_lost, leaf_lost, leaf_changed, leaf_changed, leaf_nested, leaf_many_times)
