"""Photographs of a folder: which of its files they are, in which order, and which file lists their lamps."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.raw import RAW_SUFFIXES
from hagoromo.photograph.lamp_files import LP
from hagoromo.photograph.pixels import SUFFIXES

LAMPS = "lamps.json"
JPEGS = (".jpg", ".jpeg")


def photographs_in(folder: Path) -> list[Path]:
    """The photographs of a folder; `InputError` for one without any."""
    found = [folder / name for name in photographs_among(files_in(folder))]
    if not found:
        raise InputError(f"{folder} has no photographs: give a folder of RAW, TIFF, JPEG, PNG or EXR files")
    return found


def photographs_among(names: Sequence[str]) -> list[str]:
    """Of names of files those of the format that most pictures have; of as many RAW as JPEG files, the RAW."""
    counts = Counter(suffix_of(name) for name in names if suffix_of(name) in SUFFIXES)
    if not counts:
        return []
    most = max(counts, key=lambda suffix: (counts[suffix], suffix in RAW_SUFFIXES))
    return [name for name in names if suffix_of(name) == most]


def lamp_lists_among(names: Sequence[str]) -> list[str]:
    """Of names of files those that list lamps: an .lp of any name, and lamps.json."""
    return [name for name in names if suffix_of(name) == LP or Path(name).name == LAMPS]


def lamp_list_in(folder: Path) -> Path | None:
    """The file of a folder that lists lamps; None where there is none, `InputError` where there are several."""
    names = lamp_lists_among(files_in(folder))
    if len(names) > 1:
        raise InputError(f"{folder} has {' and '.join(names[:2])}: say which lists the lamps (--lamps)")
    return folder / names[0] if names else None


def files_in(folder: Path) -> list[str]:
    """Names of the files of a folder that are not hidden, as people count."""
    return sorted((one.name for one in visible(folder) if one.is_file()), key=as_counted)


def visible(folder: Path) -> list[Path]:
    """What is in a folder and not hidden; `InputError` for one that cannot be read."""
    try:
        return [one for one in folder.iterdir() if not one.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder} cannot be read: {error.strerror}: choose another folder") from error


def as_counted(name: str) -> list[tuple[int, str]]:
    """By this, names are in the order in which people count: 2.jpg before 10.jpg."""
    parts = re.split(r"(\d+)", name.lower())
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def suffix_of(name: str) -> str:
    """The suffix of a name of a file, in small letters."""
    return Path(name).suffix.lower()
