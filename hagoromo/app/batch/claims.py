"""Claims: what the steps of a batch write. Two that would write one file, or one within the result of another, are
refused before any of them runs.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from hagoromo.app.written import Written
from hagoromo.errors import InputError


class _Claim(NamedTuple):
    number: int  # of the step
    title: str


class Claims:
    """Paths that the steps write. home: the folder of all results."""

    def __init__(self, home: Path) -> None:
        self.home, self.count = Path(os.path.realpath(home)), 0
        self.files: dict[Path, _Claim] = {}
        self.above: dict[Path, _Claim] = {}  # folders that hold results
        self.pictures: dict[Path, _Claim] = {}  # starts of the names of pictures that a step may write
        self.starts: dict[Path, _Claim] = {}  # starts, up to an underscore, of the names of pictures that one writes

    def add(self, title: str, written: Written) -> None:
        """Note what the next step writes; `InputError` where another one writes it, too."""
        claim = _Claim(self.count, title)
        self.count += 1
        for file in written.files:
            self._file(claim, Path(os.path.realpath(file)))
        if written.pictures:
            start = Path(os.path.realpath(written.files[0])).with_name(written.pictures)
            self._refuse(claim, start, self.pictures, self.starts)
            self.pictures[start] = claim

    def _file(self, claim: _Claim, file: Path) -> None:
        above = [folder for folder in file.parents if folder != self.home and folder.is_relative_to(self.home)]
        name = file.name if file.suffix.lower() == ".png" else ""
        starts = [file.with_name(name[: place.end()]) for place in re.finditer("_", name)]
        self._refuse(claim, file, self.files, self.above)
        for folder in above:
            self._refuse(claim, folder, self.files)
        for start in starts:
            self._refuse(claim, start, self.pictures)
        self.files[file] = claim
        self.above |= dict.fromkeys(above, claim)
        self.starts |= dict.fromkeys(starts, claim)

    def _refuse(self, claim: _Claim, place: Path, *taken: Mapping[Path, _Claim]) -> None:
        """`InputError` where another step has the place."""
        other = next((each[place] for each in taken if place in each), claim)
        if other.number != claim.number:
            what = place.relative_to(self.home) if place.is_relative_to(self.home) else place
            raise InputError(f"{claim.title} and {other.title} would both write {what}: give one of them another out")
