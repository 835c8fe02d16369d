"""Profile: what stays the same from object to object in an archive: who, where, licence, camera. It is asked once.

It is a TOML file, by default in the user's folder of settings, that people may edit.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from msgspec.structs import asdict, fields

from hagoromo.errors import InputError
from hagoromo.files.record import Record, about, decode, read_toml
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import write_text

Ask = Callable[[str], str]
REQUIRED = ("creator", "institution", "licence")
QUESTIONS = {
    "creator": "Who made these records (name, or names)",
    "institution": "Institution that keeps the object",
    "licence": "Licence of the records (an SPDX name such as CC-BY-4.0, or an address)",
    "place": "Place where they were made (may stay empty)",
    "contact": "Contact, such as an address of mail (may stay empty)",
    "camera": "Camera (may stay empty)",
    "lens": "Lens (may stay empty)",
    "lamps": "Lamps, such as the name of the dome (may stay empty)",
}


class ArchiveProfile(Record, frozen=True, kw_only=True):
    """The profile of an archive."""

    creator: Annotated[str, about("who made the records")] = ""
    institution: Annotated[str, about("who keeps the object")] = ""
    licence: Annotated[str, about("SPDX name, or address, of the licence of the records")] = ""
    place: Annotated[str, about("where the records were made")] = ""
    contact: Annotated[str, about("how to reach who made them")] = ""
    camera: Annotated[str, about("camera")] = ""
    lens: Annotated[str, about("lens")] = ""
    lamps: Annotated[str, about("lamps")] = ""

    @property
    def missing(self) -> list[str]:
        """Keys without which nothing is archived."""
        return [key for key in REQUIRED if not getattr(self, key).strip()]


def profile_place() -> Path:
    """Where the profile lies by default."""
    from platformdirs import user_config_path

    return user_config_path("hagoromo", appauthor=False) / "archive.toml"


def known_profile(path: Path, ask: Ask | None) -> ArchiveProfile:
    """The profile at `path`. ask: gives the answer to a question; None: nobody is there to answer.

    Where there is no file, everything is asked and kept there. `InputError` for a file that lacks something, or where
    nobody answers.
    """
    if path.exists():
        found = decode(read_toml(path), ArchiveProfile, str(path))
        if found.missing:
            raise InputError(f"{path} lacks {', '.join(found.missing)}: write them there")
        return found
    if ask is None:
        raise InputError(
            f"there is no profile {path}, and no terminal to ask at: write one with {', '.join(REQUIRED)} "
            f"(and {', '.join(key for key in QUESTIONS if key not in REQUIRED)})"
        )
    answers = {field.name: ask(f"{QUESTIONS[field.name]}: ").strip() for field in fields(ArchiveProfile)}
    found = ArchiveProfile(**answers)
    if found.missing:
        raise InputError(f"no answer for {', '.join(found.missing)}: nothing was kept; call it again")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, toml_text(asdict(found)))
    return found
