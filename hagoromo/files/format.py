"""Format: a row of the table of file formats: what it holds, how it is known, what reads and writes it, what is lost.

The rows are found by entry points of the group `hagoromo.formats`, each the place of a tuple of `Format`:

    [project.entry-points."hagoromo.formats"]
    my_program = "my_package.formats:FORMATS"

Readers, messages, `info`, `convert` and the page of formats go by this table; the core names no format of another
program.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, reduce
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Literal

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.stores import address

Holds = Literal[
    "volume", "box", "surface", "scene", "cameras", "picture", "lamps", "lens", "spectrum", "table", "matter",
    "result", "reflectance",
]  # fmt: skip
GROUP = "hagoromo.formats"
START = 4096  # bytes of a file that are looked at


@dataclass(frozen=True)
class Format:
    """One format. What is done with a file is named as "module:function", imported when it is needed, "" for nothing.

    suffixes: in small letters; the first is what is written. reader, writer: of the file or folder. library: what reads
    it. judge: the independent reader of the tests. lost: what a file holds and we do not keep, or the other way round.
    folder: whether it is a folder. sniff: path → whether that file or folder is one; needed where others have its
    suffix, and of folders. magic: first bytes, of a file without a suffix. facts: path → what `info` says. look: as
    reader, without the numbers of a volume. key: what
    `convert --to` calls it, where a suffix does not say it. parts: whether a colon and the name of a part may follow.
    as_scene: path, folder, force → scene.toml there, and what was lost. triangles: path → vertices and faces of a mesh
    that trimesh does not read. mesh_writer: of its vertices and faces, to a path, by force. growth: memory of a mesh
    while it is read, in sizes of its file; 0: it holds none. moves: whether the writer of scenes takes their motion.
    """

    name: str
    holds: Holds
    suffixes: tuple[str, ...]
    reader: str = ""
    writer: str = ""
    library: str = "our own"
    judge: str = ""
    lost: str = ""
    folder: bool = False
    sniff: str = ""
    magic: tuple[bytes, ...] = ()
    facts: str = ""
    look: str = ""
    key: str = ""
    parts: bool = False
    as_scene: str = ""
    triangles: str = ""
    mesh_writer: str = ""
    growth: float = 0.0
    moves: bool = False

    @property
    def read(self) -> Callable[..., Any]:
        """The function that reads a file."""
        return function_at(self.reader)

    @property
    def write(self) -> Callable[..., Any]:
        """The function that writes one."""
        return function_at(self.writer)

    def is_sniffed(self, path: Path) -> bool:
        """Whether the format is known by what is at `path`, and that is one."""
        return bool(self.sniff) and bool(function_at(self.sniff)(path))


def function_at(place: str) -> Callable[..., Any]:
    """The function at "module:name"."""
    module, _, name = place.partition(":")
    found: Any = reduce(getattr, name.split("."), import_module(module))
    return found


def installed(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group; `InputError` where there are none: a folder of sources that is not installed."""
    points = tuple(entry_points(group=group))
    if not points:
        raise InputError(f"hagoromo is not installed here: nothing is registered as {group}: pip install -e .")
    return points


@cache
def formats() -> tuple[Format, ...]:
    """All formats, those of the core first."""
    points = sorted(installed(GROUP), key=lambda point: (point.name != "core", point.name))
    return tuple(form for point in points for form in point.load())


def formats_of(*holds: str) -> tuple[Format, ...]:
    """The formats that hold one of `holds`."""
    return tuple(form for form in formats() if form.holds in holds)


def suffixes_read(*holds: str) -> str:
    """Suffixes of the formats that are read and hold one of `holds` (none: all formats), for messages."""
    chosen = formats_of(*holds) if holds else formats()
    return ", ".join(dict.fromkeys(suffix for form in chosen if form.reader for suffix in form.suffixes if suffix))


def format_named(name: str) -> Format:
    """The format of that name."""
    return next(form for form in formats() if form.name == name)


def file_and_part(path: str | Path) -> tuple[str, str]:
    """The file, and the name of the part of it behind a colon; "" for the whole."""
    suffixes = "|".join(re.escape(suffix) for form in formats() if form.parts for suffix in form.suffixes)
    named = re.fullmatch(rf"(.*(?:{suffixes})):(.+)", str(path), re.IGNORECASE) if suffixes else None
    return (named[1], named[2].strip("/")) if named else (str(path), "")


def format_of(path: str | Path) -> Format:
    """The format of the file or folder at `path`; `InputError`, which lists all that are read, where it has none."""
    path = Path(path)
    if address(path):
        return format_named("volume box")
    if path.is_dir():
        return _of_folder(path)
    file, part = file_and_part(path)
    name = (Path(file) if part else existing_file(path)).name.lower()
    named = sorted((-len(suffix), k) for k, form in enumerate(formats()) for suffix in form.suffixes if suffix
                   and name.endswith(suffix) and (not form.folder or form.sniff))  # fmt: skip
    fitting = [formats()[k] for _, k in named]
    if not part:
        bare = [] if Path(name).suffix else [form for form in formats() if form.holds == "cameras"]
        found = next((form for form in (*fitting, *bare) if form.is_sniffed(path)), None)
        if found is not None:
            return found
    found = next((form for form in fitting if form.reader and not form.sniff and not form.folder), None)
    if found is None and not Path(name).suffix:
        start = start_of(path)
        found = next((form for form in formats() if form.magic and start.startswith(form.magic)), None)
    if found is None:
        raise InputError(f"{path} is of unknown type: give a folder or one of {suffixes_read()}")
    return found


def start_of(path: Path) -> bytes:
    """The first bytes of a file."""
    with path.open("rb") as file:
        return file.read(START)


def _of_folder(path: Path) -> Format:
    found = next((form for form in formats() if form.is_sniffed(path)), None)
    if found is not None:
        return found
    folders = (form for form in formats() if form.sniff and (form.folder or form.name == "TIFF stack"))
    others = dict.fromkeys(form.name.split(",")[0] for form in folders if form.name not in ("capture", "volume box"))
    names = " and ".join(f"no {name}{' model' if name == 'COLMAP' else ''}" for name in others)
    raise InputError(
        f"{path} is neither a capture (transforms.json) nor a volume box, and holds {names}: give one of these"
    )


def short(value: Any) -> Any:
    """A value for printing: of long lists and texts only the size."""
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} entries"
    if isinstance(value, dict):
        return {key: short(entry) for key, entry in value.items()}
    return f"{len(value)} characters" if isinstance(value, str) and len(value) > 200 else value
