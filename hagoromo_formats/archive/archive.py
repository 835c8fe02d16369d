"""Archive: results, and what they were made from, as a bag (BagIt 1.0, RFC 8493) with SHA-256 of every file.

Enters: folders and files of results, the originals, and who, where and under which licence. Leaves: a folder in which
data/ holds the results, pictures of them, `ro-crate-metadata.json`, `dublin_core.xml` and `sources.json`.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from hagoromo.errors import InputError
from hagoromo.files.exr import exr_header
from hagoromo.files.record import write_json, written_by
from hagoromo.files.whole import whole_folder, write_text
from hagoromo.progress import Progress, silent
from hagoromo_formats.archive.bag import PAYLOAD, make_bag
from hagoromo_formats.archive.holdings import Holding, copied, holding, referenced
from hagoromo_formats.archive.iiif import FOLDER, MANIFEST, TiledPicture, check_address, manifest, write_tiles
from hagoromo_formats.archive.metadata import CRATE, DUBLIN_CORE, ORIGINALS, SOURCES, ArchivedObject, crate, dublin_core
from hagoromo_formats.archive.pictures import NORMALS, PICTURES, pictures_of, write_picture, xmp_packet
from hagoromo_formats.archive.profile import ArchiveProfile
from hagoromo_page.publication.notes import Note, read_notes


def archive(
    results: Sequence[str | Path],
    out: str | Path,
    profile: ArchiveProfile,
    *,
    inventory: str,
    title: str = "",
    photographed: str = "",
    originals: Sequence[str | Path] = (),
    pack: bool = False,
    iiif: str = "",
    notes: str | Path | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> tuple[Holding, ...]:
    """Write `results` (files and folders) as the bag `out`; gives its files, and those that it refers to.

    inventory: number of the object. title: what it is called (default: its number). photographed: date of the
    photographs, ISO 8601. originals: captures and photographs that the results were made from: each is named with its
    digest, and with `pack` copied, too. iiif: address at which the folder data/iiif will be served: it gets a manifest
    and tiles of the pictures; "": none. notes: file of notes on the object of the one measurement among the results
    (W3C Web Annotation), which is kept; the manifest has them as annotations of that measurement's pictures.
    `InputError` for what is missing, links, names that occur twice, a date that is none, and notes of another object.
    """
    if profile.missing:
        raise InputError(f"the profile lacks {', '.join(profile.missing)}: an archive needs them")
    if not inventory.strip():
        raise InputError("no inventory number: an archive needs the number of the object; give --inventory")
    thing = ArchivedObject(inventory, title or inventory, _date(photographed), _today())
    address = check_address(iiif) if iiif else ""
    if not results:
        raise InputError("nothing to archive: give folders or files of results")
    with whole_folder(out, force) as home:
        payload = home / PAYLOAD
        payload.mkdir()
        progress(0.0, "files")
        holdings = copied([Path(one) for one in (*results, *([] if notes is None else [notes]))], payload)
        if pack and originals:
            holdings += copied([Path(one) for one in originals], payload, ORIGINALS)
        elif originals:
            holdings += referenced([Path(one) for one in originals])
        names = {one.path.split("/")[0] for one in holdings if one.kept}
        if taken := names & {CRATE, DUBLIN_CORE, SOURCES, PICTURES[:-1], FOLDER[:-1]}:
            raise InputError(f"a result is called {min(taken)}, as a file or folder of the archive is: rename it")
        progress(0.3, "pictures")
        kept = [one.path for one in holdings if one.kept]
        on_object = None if notes is None else _notes(kept, payload, notes)
        holdings += _pictures(kept, payload, (thing, profile), address, on_object)
        progress(0.6, "metadata")
        write_json(payload / SOURCES, {"hagoromo": written_by(), "files": [asdict(one) for one in holdings]})
        write_text(payload / DUBLIN_CORE, dublin_core(thing, profile, holdings))
        write_text(payload / CRATE, crate(thing, profile, holdings, payload))
        progress(0.8, "bag")
        make_bag(home, _bag_info(thing, profile))
    return tuple(holdings)


class _ObjectNotes(NamedTuple):
    """folder: of the measurement in the payload, ending in /."""

    folder: str
    notes: tuple[Note, ...]


def _notes(kept: Sequence[str], payload: Path, path: str | Path) -> _ObjectNotes:
    """The notes, on the one measurement among what is kept."""
    folders = [
        one.removesuffix(NORMALS) for one in kept if one.split("/")[-1] == NORMALS and not one.startswith(ORIGINALS)
    ]
    if len(folders) != 1:
        raise InputError(
            f"{path} holds notes on a measured object, and the results hold {len(folders)} measurements: give one"
        )
    header = exr_header(payload / folders[0] / NORMALS)
    return _ObjectNotes(folders[0], read_notes(path, (header.width, header.height)))


def _pictures(
    kept: Sequence[str],
    payload: Path,
    said: tuple[ArchivedObject, ArchiveProfile],
    address: str,
    on_object: _ObjectNotes | None,
) -> list[Holding]:
    """Write pictures of results with ICC and XMP, with an address also tiles and a manifest; what was written."""
    tiled = []
    for name, pixels in pictures_of([one for one in kept if not one.startswith(ORIGINALS)], payload):
        write_picture(payload / PICTURES / f"{name}.png", pixels, xmp_packet(name, *said))
        if address:
            tiled.append(write_tiles(name, pixels, payload / FOLDER, address))
    if tiled:
        write_text(payload / FOLDER / MANIFEST, manifest(tiled, *said, address, _of_pictures(tiled, on_object)))
    made = [file for folder in (PICTURES, FOLDER) for file in sorted((payload / folder).rglob("*")) if file.is_file()]
    return [holding(file, file.relative_to(payload).as_posix(), True) for file in made]


def _of_pictures(pictures: Sequence[TiledPicture], on_object: _ObjectNotes | None) -> dict[str, tuple[Note, ...]]:
    """Notes by the names of the pictures that carry them: those in the folder of the measurement itself."""
    if on_object is None:
        return {}
    folder, notes = on_object
    inside = (one.name for one in pictures if one.name.startswith(folder))
    return {name: notes for name in inside if "/" not in name.removeprefix(folder)}


def _bag_info(thing: ArchivedObject, profile: ArchiveProfile) -> dict[str, str]:
    """bag-info.txt: one line a value."""
    values = {
        "Source-Organization": profile.institution,
        "Contact-Name": profile.creator,
        "Contact-Email": profile.contact,
        "External-Identifier": thing.inventory,
        "External-Description": thing.description,
        "Bagging-Date": thing.archived,
    }
    return {key: value for key, value in values.items() if value}


def _date(text: str) -> str:
    try:
        return datetime.date.fromisoformat(text).isoformat() if text else ""
    except ValueError:
        raise InputError(f"the date is {text!r}: give it as 2026-11-27") from None


def _today() -> str:
    return datetime.date.today().isoformat()
