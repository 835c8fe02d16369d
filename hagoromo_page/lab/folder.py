"""Folder: the photographs of one object, with what lies beside them and what the window keeps of them.

All that the window shows is read from files here, so that a reload, another window and a terminal see the same. What
the window writes lies in the folder `lab` below: choices and corrections by hand, and the results of commands.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta, structs

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_folder, inside
from hagoromo.files.content import digest
from hagoromo.files.png import png_header
from hagoromo.files.record import Record, about, decode, read_json, read_toml, up_to, write_json
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.lamp_files import LP, faces_up, lamp_of_each, load_lamps
from hagoromo.photograph.photograph_folder import (
    as_counted,
    files_in,
    lamp_lists_among,
    photographs_among,
    suffix_of,
    visible,
)
from hagoromo.photograph.pixels import SUFFIXES

LAB, RECORD, MASK, CIRCLES_FROM = "lab", "lab/lab.json", "lab/mask.png", "lab/lamps.json"
PROFILE = "lab/archive.toml"  # who archives, as `archive` takes it by --profile
ORDERED = ("lab/ordered.lp", "lab/ordered.json")  # lamps as reordered by hand: of an .lp, and of a lamps.json
MOST_PHOTOGRAPHS, MOST_FOLDERS, MOST_BALLS, LARGEST_LIST = 2000, 200, 8, 1 << 22
ON_BALL = "ball"  # lamps are read off a chrome ball in the photographs themselves
Name = Annotated[str, Meta(max_length=255)]
Text = Annotated[str, Meta(max_length=500)]
Coordinate = Annotated[float, Meta(ge=-1e5, le=1e5)]
Radius = Annotated[float, Meta(gt=0.0, le=1e5)]
Circle = tuple[Coordinate, Coordinate, Radius]
Corner = tuple[Coordinate, Coordinate]


class Made(Record, frozen=True):
    """What a result was made of."""

    words: Annotated[list[str], about("the command's words, without --force"), up_to(2 * MOST_PHOTOGRAPHS + 100)]
    read: Annotated[Name, about("digest of names, sizes and times of what it read")]


class LabRecord(Record, frozen=True, kw_only=True):
    """What the window keeps of a folder."""

    order: Annotated[
        list[Name], about("names of photographs in the order of their lamps"), up_to(MOST_PHOTOGRAPHS)
    ] = []
    circles: Annotated[list[Circle], about("x, y, radius [px] of chrome balls, by hand"), up_to(MOST_BALLS)] = []
    corners: Annotated[list[Corner], about("x, y [px] of the chart's corners, by hand"), up_to(4)] = []
    options: Annotated[dict[Name, Text], about("step.option → its value")] = {}
    made: Annotated[dict[Name, Made], about("step → what its result was made of")] = {}


class Direction(NamedTuple):
    """To a lamp, unit vector: x right, y up, z to the camera."""

    x: float
    y: float
    z: float


class Folder:
    """A folder below `root`, read anew by each instance. `InputError` where it lies elsewhere, also by a link."""

    def __init__(self, root: Path, relative: str = ".") -> None:
        self.root = root.resolve()
        self.home = existing_folder(inside(self.root, relative)).resolve()
        if not self.home.is_relative_to(self.root):
            raise InputError(f"{relative!r} lies outside {self.root}: choose a folder in it")
        self._facts: dict[str, list[str | int]] = {}  # of files, as they were when they were first asked for

    @property
    def relative(self) -> str:
        """The way to it from the root."""
        return self.home.relative_to(self.root).as_posix()

    def file(self, name: str) -> Path:
        """The path `name` in this folder, or in the one above it; `InputError` where that lies outside of the root."""
        return inside(self.root, os.path.relpath(self.home / name, self.root))

    @cached_property
    def record(self) -> LabRecord:
        """What the window keeps; `InputError` for a file that it did not write."""
        path = self.home / RECORD
        if not path.exists():
            return LabRecord()
        if path.stat().st_size > LARGEST_LIST:
            raise InputError(f"{path} is larger than this window writes it: remove it")
        return decode(read_json(path), LabRecord, str(path))

    def keep(self, **changes: Any) -> None:
        """Change what is kept, in its file."""
        record = structs.replace(self.record, **changes)
        (self.home / LAB).mkdir(exist_ok=True)
        write_json(
            self.home / RECORD,
            structs.asdict(record) | {"made": {k: structs.asdict(v) for k, v in record.made.items()}},
        )
        self.__dict__["record"] = record

    @cached_property
    def profile(self) -> dict[str, str]:
        """Who archives, by key; empty where nobody has said so. `InputError` for a file that is no TOML."""
        path = self.home / PROFILE
        return {key: str(value) for key, value in read_toml(path).items()} if path.is_file() else {}

    @cached_property
    def files(self) -> tuple[str, ...]:
        """Names of the files here, as people count: 2.jpg before 10.jpg."""
        return tuple(files_in(self.home))

    @cached_property
    def folders(self) -> tuple[str, ...]:
        """Names of the folders here."""
        names = sorted((one.name for one in visible(self.home) if one.is_dir()), key=as_counted)
        return tuple(name for name in names if name != LAB)[:MOST_FOLDERS]

    @cached_property
    def photographs(self) -> tuple[str, ...]:
        """Names of the photographs: the files of the format that most of them have; of RAW and JPEG alike, the RAW."""
        return _photographs(self.files)

    @cached_property
    def eight_bits(self) -> bool:
        """Whether the first photograph is a PNG of 8 bits, as its header has it."""
        path = self.home / self.photographs[0]
        try:
            return path.suffix.lower() == ".png" and png_header(path).depth == 8
        except (InputError, OSError):
            return False

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Pictures here that are not among the photographs."""
        return tuple(name for name in self.files if suffix_of(name) in SUFFIXES and name not in self.photographs)

    @cached_property
    def charts(self) -> tuple[str, ...]:
        """Pictures here and in the folder above that are not among the photographs: one may show a chart of colours."""
        pictures = (name for name in self.beside if suffix_of(name) in SUFFIXES and not name.startswith("-"))
        return tuple(name for name in pictures if name not in self.photographs)[:MOST_FOLDERS]

    @property
    def chart(self) -> str:
        """The photograph of a chart that was chosen; "" where there is none."""
        chosen = self.option("response", "chart", "")
        return chosen if chosen in self.charts else ""

    @property
    def ordered(self) -> tuple[str, ...]:
        """The photographs in the order of their lamps."""
        kept = self.record.order
        return tuple(kept) if sorted(kept) == sorted(self.photographs) else self.photographs

    def option(self, step: str, name: str, default: str) -> str:
        """What was chosen for an option of a step."""
        return self.record.options.get(f"{step}.{name}", default)

    @cached_property
    def lamp_sources(self) -> tuple[str, ...]:
        """Where lamps may come from, the likeliest first: an .lp or lamps.json here or above, folders with photographs
        of a ball, a ball in the photographs.
        """
        lists = lamp_lists_among(self.beside)
        balls = [name for name in self._near_folders if _photographs(files_in(self.file(name)))]
        likely = [name for name in balls if "ball" in Path(name).name.lower()]
        return (*lists, *likely, ON_BALL, *(name for name in balls if name not in likely))

    @cached_property
    def beside(self) -> tuple[str, ...]:
        """Names of the files here and, with ../, in the folder above, unless that is outside of the root."""
        above = () if self.home == self.root else files_in(self.home.parent)
        return (*self.files, *(f"../{name}" for name in above))

    @cached_property
    def _near_folders(self) -> tuple[str, ...]:
        above = [] if self.home == self.root else [one for one in visible(self.home.parent) if one.is_dir()]
        return (*self.folders, *sorted(f"../{one.name}" for one in above if one != self.home))[:MOST_FOLDERS]

    @property
    def lamps_from(self) -> str:
        """Of `lamp_sources` the one that is used."""
        chosen = self.option("lamps", "from", "")
        return chosen if chosen in self.lamp_sources else self.lamp_sources[0]

    @property
    def has_lamp_file(self) -> bool:
        """Whether the lamps come from a file, which may list them in a wrong order."""
        return suffix_of(self.lamps_from) in (LP, ".json")

    @property
    def ball_photographs(self) -> tuple[str, ...]:
        """The photographs that a chrome ball is in: these, or those of another folder."""
        if self.lamps_from == ON_BALL or self.has_lamp_file:
            return self.photographs
        names = _photographs(files_in(self.file(self.lamps_from)))
        return tuple(f"{self.lamps_from}/{name}" for name in names)

    @property
    def lamp_file(self) -> str:
        """The file that the capture has its lamps from: as it is, or as it was reordered by hand."""
        source = self.lamps_from if self.has_lamp_file else CIRCLES_FROM
        reordered = ORDERED[0 if suffix_of(source) == LP else 1]
        return reordered if self.has_lamp_file and self.ordered != self.photographs else source

    def lamps(self) -> list[Lamp]:
        """The lamp of each photograph, in their order; `InputError` where they do not match."""
        source = self.lamps_from if self.has_lamp_file else CIRCLES_FROM
        names = self.photographs if self.has_lamp_file else self.ball_photographs
        return lamp_of_each(load_lamps(self.file(source)), [Path(name) for name in names])[0]

    def directions(self) -> list[Direction]:
        """The directions to the lamps, in the order of the photographs, as a dome seen from the camera has them."""
        lamps = self.lamps()
        to = np.array([one.position if one.to_lamp is None else one.to_lamp for one in lamps], np.float64)
        to /= np.maximum(np.linalg.norm(to, axis=1, keepdims=True), 1e-12)
        if not (self.has_lamp_file and faces_up(self.file(self.lamps_from))) and to[:, 2].mean() < 0.0:
            to = to * (1.0, -1.0, -1.0)  # of a calibrated camera: x right, y down, z forward
        return [Direction(*map(float, one)) for one in to]

    def circles(self) -> list[Circle]:
        """The circles of the balls: by hand, or as they were found; none where nobody has looked for them."""
        if self.record.circles:
            return list(self.record.circles)
        path = self.home / CIRCLES_FROM
        if self.has_lamp_file or not path.is_file():
            return []
        balls = read_json(path).get("balls", [])
        return [decode_circle(ball) for ball in balls][:MOST_BALLS]

    def read_digest(self, names: Iterable[str]) -> str:
        """Digest of names, sizes and times of files and folders; those of what is not there are none."""
        return digest([self._fact(name) for name in names])

    def _fact(self, name: str) -> list[str | int]:
        if name not in self._facts:
            path = self.file(name)
            status = path.stat() if path.exists() else None
            size = [] if status is None else [0 if path.is_dir() else status.st_size, status.st_mtime_ns]
            self._facts[name] = [name, *size]
        return self._facts[name]


def decode_circle(ball: Any) -> Circle:
    """The circle of a ball as lamps.json lists it."""
    if not isinstance(ball, Mapping):
        raise InputError(f"{CIRCLES_FROM} lists a ball that is no table: make it anew")
    try:
        (x, y), radius = ball["centre_px"], ball["radius_px"]
        return float(x), float(y), float(radius)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{CIRCLES_FROM} lists a ball without centre and radius: make it anew") from None


def _photographs(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(photographs_among(names)[:MOST_PHOTOGRAPHS])
