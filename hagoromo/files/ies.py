"""IES files (IESNA LM-63 of 1986, 1991, 1995, 2002 and 2019): tables of candela over two angles, type C.

An outer shell of keywords, a line TILT=…, then numbers only. Sizes are checked before anything is allocated.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.table import is_number

LARGEST_FILE = 1 << 24  # bytes; a table in steps of half a degree has 2 MiB
GROWTH = 30.0  # memory of the numbers of a file as texts, in its sizes
MOST_VALUES = 1 << 20  # candela values of a table
MOST_NUMBERS = 2 * MOST_VALUES  # numbers that are read; the rest of a file is never split
HEADER = 13  # numbers before the angles: lamps, lumens, multiplier, counts, types, size, ballast, watts
TYPE_C, PHOTOMETRY = 1, {2: "B", 3: "A"}
# up to 1995 the number after the ballast factor multiplies the candela; from 2002 on it is 1, or says who measured
NOT_MULTIPLYING = re.compile(r"\s*IES(NA)?:LM-63-20\d\d", re.IGNORECASE)


class IesTable(NamedTuple):
    """lateral (C,), vertical (γ,): angles [°], increasing. candela (C, γ) [cd], all factors of the file applied.

    keywords: name without brackets → text, such as MANUFAC and LUMCAT; lines of [MORE] are added to the last one.
    """

    lateral: NDArray[np.float64]
    vertical: NDArray[np.float64]
    candela: NDArray[np.float64]
    keywords: dict[str, str]


def read_ies(path: str | Path) -> IesTable:
    """The table of an IES file; the symmetry that its lateral angles state is not unfolded.

    `InputError` for a missing or oversized file, photometry of type A or B, a tilt that changes the light, counts that
    do not fit the file, and numbers that are not finite or, for candela, negative.
    """
    source = sized_file(path, LARGEST_FILE, "an IES file")
    text = read_bytes(source, GROWTH).decode("latin-1")
    tilt = re.search(r"^[ \t]*TILT[ \t]*=[ \t]*([^\r\n]*)[\r\n]", text, re.MULTILINE | re.IGNORECASE)
    if tilt is None:
        raise InputError(f"{source} has no line TILT=: it is no IES file, or it is cut off")
    shell = text[: tilt.start()].splitlines()
    values = _numbers(text[tilt.end() :], source)
    values = values[_tilt_numbers(tilt.group(1).strip().upper(), values, source) :]
    multiplying = not shell or NOT_MULTIPLYING.match(shell[0]) is None
    return IesTable(*_table(values, multiplying, source), _keywords(shell))


def _numbers(text: str, source: Path) -> NDArray[np.float64]:
    """All numbers after the line TILT=, which blanks, commas and line ends part."""
    words = text.replace(",", " ").replace("\x1a", " ").split(maxsplit=MOST_NUMBERS)[:MOST_NUMBERS]
    try:
        values = np.array(words, np.float64)
    except ValueError:
        wrong = next(word for word in words if not is_number(word))
        raise InputError(f"{source}: {wrong!r:.40} stands among the numbers after TILT=: it is damaged") from None
    if not np.isfinite(values).all():
        raise InputError(f"{source}: a number after TILT= is not finite: it is damaged")
    return values


def _tilt_numbers(tilt: str, values: NDArray[np.float64], source: Path) -> int:
    """How many numbers describe the tilt: lamp's geometry, their count, angles and factors."""
    if tilt == "NONE":
        return 0
    if tilt != "INCLUDE":
        raise InputError(f"{source}: TILT={tilt:.40} names another file: give one with TILT=NONE")
    count = _count(values, 1, "tilt angles", source)
    if 2 + 2 * count > len(values):
        raise InputError(f"{source} announces {count} tilt angles and ends before them: it is cut off")
    if not np.allclose(values[2 + count : 2 + 2 * count], 1.0):
        raise InputError(f"{source}: TILT=INCLUDE changes the light with the tilt, which is not known here: TILT=NONE")
    return 2 + 2 * count


def _table(
    values: NDArray[np.float64], multiplying: bool, source: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Lateral angles, vertical angles and candela."""
    if len(values) < HEADER:
        raise InputError(
            f"{source} has {len(values)} numbers after TILT=, an IES file {HEADER} and more: it is cut off"
        )
    vertical, lateral = _count(values, 3, "vertical angles", source), _count(values, 4, "lateral angles", source)
    if values[5] != TYPE_C:
        kind = PHOTOMETRY.get(int(values[5]), f"{values[5]:g}") if abs(values[5]) < 10 else f"{values[5]:g}"
        raise InputError(f"{source} has photometry of type {kind}: only type C is read, convert it")
    announced = HEADER + vertical + lateral + vertical * lateral
    if vertical * lateral > MOST_VALUES or announced > len(values):
        raise InputError(
            f"{source} announces {lateral} × {vertical} values, {announced} numbers in all, and has {len(values)}: "
            f"it is cut off or larger than {MOST_VALUES} values"
        )
    if not (0.0 < values[2] and 0.0 < values[10] and math.isfinite(values[2] * values[10])):
        raise InputError(f"{source}: multiplier {values[2]:g} and ballast factor {values[10]:g} must be above 0")
    factor = values[2] * values[10] * (values[11] if multiplying and values[11] > 0.0 else 1.0)
    angles, candela = (
        values[HEADER : announced - vertical * lateral],
        values[announced - vertical * lateral : announced],
    )
    with np.errstate(over="ignore"):
        candela = factor * candela.reshape(lateral, vertical)
    if not np.isfinite(candela).all() or (candela < 0.0).any():
        raise InputError(f"{source} has candela that are negative or not finite: correct it")
    return angles[vertical:], angles[:vertical], candela


def _count(values: NDArray[np.float64], place: int, what: str, source: Path) -> int:
    count = values[place] if place < len(values) else 0.0
    if not (1.0 <= count <= MOST_VALUES and count == int(count)):
        raise InputError(f"{source} has {count:g} {what}: an IES file has a whole number of them, 1 or more")
    return int(count)


def _keywords(shell: list[str]) -> dict[str, str]:
    """Keywords of the lines before TILT=."""
    found: dict[str, list[str]] = {}
    name = ""
    for line in shell:
        match = re.match(r"\s*\[([^\]]+)\]\s*(.*)", line)
        if match is None:
            continue
        key, text = match.group(1).strip().upper(), match.group(2).strip()
        if key == "MORE" and name:
            found[name].append(text)
        else:
            name, found[key] = key, [text]
    return {key: " ".join(parts).strip() for key, parts in found.items()}
