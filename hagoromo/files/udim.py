"""UDIM: images of several tiles of the UV plane, one file each: wall.<UDIM>.png is wall.1001.png, wall.1002.png, …

Tile 1001 + u + 10 v covers u…u+1, v…v+1; u is 0 to 9, v up from 0.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from hagoromo.errors import InputError
from hagoromo.files.checks import inside

MARK = "<UDIM>"
FIRST, ACROSS, LAST = 1001, 10, 9999
Tile = tuple[int, int]  # u, v


def udim_files(folder: Path, text: str) -> dict[Tile, str]:
    """The files, as paths in `folder`, of the tiles of a text such as maps/wall.<UDIM>.png; none: {}.

    `InputError` for a text that points outside, or has no mark or several of them in the name of its file.
    """
    place = PurePosixPath(text.replace("\\", "/"))
    if place.name.count(MARK) != 1 or MARK in str(place.parent):
        raise InputError(f"{text!r:.80} must have {MARK} once, in the name of the file, as wall.{MARK}.png")
    before, after = place.name.split(MARK)
    pattern = re.compile(re.escape(before) + r"(\d{4})" + re.escape(after))
    home = inside(folder, str(place.parent))
    names = sorted(one.name for one in home.iterdir()) if home.is_dir() else []
    found = {int(match[1]): name for name in names if (match := pattern.fullmatch(name))}
    return {
        ((number - FIRST) % ACROSS, (number - FIRST) // ACROSS): str(place.parent / name)
        for number, name in found.items()
        if FIRST <= number <= LAST
    }


def udim_number(tile: Tile) -> int:
    """The number of a tile.

    >>> udim_number((0, 0)), udim_number((2, 1))
    (1001, 1013)
    """
    return FIRST + tile[0] + ACROSS * tile[1]
