"""Archive: results, and what they were made from, as a bag (BagIt 1.0, RFC 8493) with SHA-256 of every file.

Enters: folders and files of results, the originals, and who, where and under which licence. Leaves: a folder in which
data/ holds the results, `ro-crate-metadata.json`, `dublin_core.xml` and `sources.json`.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.record import write_json, written_by
from hagoromo.files.whole import whole_folder, write_text
from hagoromo.progress import Progress, silent
from hagoromo_formats.archive.bag import PAYLOAD, make_bag
from hagoromo_formats.archive.holdings import Holding, copied, referenced
from hagoromo_formats.archive.metadata import CRATE, DUBLIN_CORE, ORIGINALS, SOURCES, ArchivedObject, crate, dublin_core
from hagoromo_formats.archive.profile import ArchiveProfile


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
    force: bool = False,
    progress: Progress = silent,
) -> tuple[Holding, ...]:
    """Write `results` (files and folders) as the bag `out`; gives its files, and those that it refers to.

    inventory: number of the object. title: what it is called (default: its number). photographed: date of the
    photographs, ISO 8601. originals: captures and photographs that the results were made from: each is named with its
    digest, and with `pack` copied, too.
    `InputError` for what is missing, links, names that occur twice, and a date that is none.
    """
    if profile.missing:
        raise InputError(f"the profile lacks {', '.join(profile.missing)}: an archive needs them")
    if not inventory.strip():
        raise InputError("no inventory number: an archive needs the number of the object; give --inventory")
    thing = ArchivedObject(inventory, title or inventory, _date(photographed), _today())
    if not results:
        raise InputError("nothing to archive: give folders or files of results")
    with whole_folder(out, force) as home:
        payload = home / PAYLOAD
        payload.mkdir()
        progress(0.0, "files")
        holdings = copied([Path(one) for one in results], payload)
        if pack and originals:
            holdings += copied([Path(one) for one in originals], payload, ORIGINALS)
        elif originals:
            holdings += referenced([Path(one) for one in originals])
        progress(0.6, "metadata")
        names = {one.path.split("/")[0] for one in holdings if one.kept}
        if taken := names & {CRATE, DUBLIN_CORE, SOURCES}:
            raise InputError(f"a result is called {min(taken)}, as a file of the archive is: rename it")
        write_json(payload / SOURCES, {"hagoromo": written_by(), "files": [asdict(one) for one in holdings]})
        write_text(payload / DUBLIN_CORE, dublin_core(thing, profile, holdings))
        write_text(payload / CRATE, crate(thing, profile, holdings, payload))
        progress(0.8, "bag")
        make_bag(home, _bag_info(thing, profile))
    return tuple(holdings)


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
