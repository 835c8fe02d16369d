"""Bag: a folder whose files are in data/, with a manifest of their SHA-256 (BagIt 1.0, RFC 8493)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hagoromo.files.sources import sha256_of_file
from hagoromo.files.whole import MARK, write_text

PAYLOAD = "data"
DECLARATION = "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"


def make_bag(home: Path, info: Mapping[str, str]) -> None:
    """Make a bag of the folder `home`, which holds data/ and nothing else. info: of bag-info.txt, a line each."""
    files = sorted(file for file in (home / PAYLOAD).rglob("*") if file.is_file())
    octets = sum(file.stat().st_size for file in files)
    described = {**info, "Payload-Oxum": f"{octets}.{len(files)}"}
    write_text(home / "bagit.txt", DECLARATION)
    write_text(
        home / "bag-info.txt", "".join(f"{key}: {' '.join(value.split())}\n" for key, value in described.items())
    )
    write_text(home / "manifest-sha256.txt", _manifest(home, files))
    (home / MARK).touch()  # it will lie there, and a manifest covers all that does
    tags = sorted(home / name for name in (MARK, "bagit.txt", "bag-info.txt", "manifest-sha256.txt"))
    write_text(home / "tagmanifest-sha256.txt", _manifest(home, tags))


def _manifest(home: Path, files: list[Path]) -> str:
    """A line for each file: its digest, and its path with /."""
    return "".join(f"{sha256_of_file(file)}  {file.relative_to(home).as_posix()}\n" for file in files)
