"""Holdings: the files of an archive, each with its size and digest, copied or only referenced.

Links are refused: what they lead to is not what was meant to be kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.sources import sha256_of_file
from hagoromo.files.whole import MARK

UNSAFE = "%\r\n"  # RFC 8493 encodes them in manifests, and the tool of the Library of Congress only two of them
MOST_FILES = 100_000


@dataclass(frozen=True)
class Holding:
    """A file. path: within the archive, or of a file that is only referenced, within its folder, with /. size: [bytes].
    sha256: hexadecimal. kept: whether the archive holds it.
    """

    path: str
    size: int
    sha256: str
    kept: bool


def copied(sources: Sequence[Path], home: Path, within: str = "") -> list[Holding]:
    """Copy files and folders into `home`, under `within`; gives what is kept.

    `InputError` for names that occur twice, for links, and for sources that are not there.
    """
    found: list[Holding] = []
    for source in sources:
        name = f"{within}{source.resolve().name}"
        if (home / name).exists():
            raise InputError(f"two of the results are called {source.resolve().name}: rename one")
        for file, relative in _files(source):
            target = home / name / relative if relative else home / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)
            found.append(holding(target, f"{name}/{relative}" if relative else name, True))
    return found


def referenced(sources: Sequence[Path]) -> list[Holding]:
    """Files that stay where they are, known by name and digest."""
    return [
        holding(file, f"{source.resolve().name}/{relative}" if relative else source.resolve().name, False)
        for source in sources
        for file, relative in _files(source)
    ]


def _files(source: Path) -> list[tuple[Path, str]]:
    """The files of a folder, by name, with their paths in it; a file alone has the path ""."""
    if not source.exists():
        raise InputError(f"{source} does not exist: give results, and originals, that are there")
    found = (
        []
        if source.is_file()
        else sorted(
            file for file in source.rglob("*") if file.name != MARK and (file.is_symlink() or not file.is_dir())
        )
    )
    if len(found) > MOST_FILES:
        raise InputError(f"{source} has {len(found)} files, an archive at most {MOST_FILES}: divide it")
    for file in found:
        if file.is_symlink() or not file.is_file():
            raise InputError(f"{file} is a link, or no plain file: put the file itself there")
    for file in (source, *found):
        if set(UNSAFE) & set(file.name):
            raise InputError(
                f"{file} has % or an end of line in its name, which readers of bags take differently: rename it"
            )
    if source.is_file():
        return [(source, "")]
    return [(file, file.relative_to(source).as_posix()) for file in found]


def holding(file: Path, path: str, kept: bool) -> Holding:
    """A file with its size and digest."""
    return Holding(path, file.stat().st_size, sha256_of_file(file), kept)
