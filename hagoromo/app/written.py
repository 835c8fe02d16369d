"""Written: the files and folders that a command writes for the name of --out, declared beside the command."""

from __future__ import annotations

import glob
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Written(NamedTuple):
    """What a command writes. files: files and folders, that of --out first.

    pictures: start of the names of further pictures beside it, START…_….png with a number, as many as its input has;
    "": none.
    """

    files: tuple[Path, ...]
    pictures: str = ""

    def there(self) -> tuple[Path, ...]:
        """Which of them exist."""
        out = self.files[0]
        beside = out.parent.glob(f"{glob.escape(self.pictures)}[0-9]*_*.png") if self.pictures else ()
        return (*(file for file in self.files if file.exists()), *sorted(beside))


Writes = Callable[[Path], Written]


def alone(out: Path) -> Written:
    """The file or folder itself."""
    return Written((out,))


def with_picture(out: Path) -> Written:
    """A file, and a picture of it beside it."""
    return Written((out, out.with_suffix(".png")))


def picture_or_film(out: Path) -> Written:
    """What `render` writes: a picture and its PNG, a film and the folder of its frames, or that folder alone."""
    from hagoromo.files.film_file import SUFFIXES, frames_of

    if out.suffix.lower() in SUFFIXES:
        return Written((out, frames_of(out)))
    return with_picture(out) if out.suffix else alone(out)


def response_files(out: Path) -> Written:
    """What `calibrate response` writes: the curves, their intervals, what was found, and a plot."""
    from hagoromo.calibration.response.response_calibration import ResponseCalibration

    return Written((*ResponseCalibration.paths(out), out.with_suffix(".png")))
