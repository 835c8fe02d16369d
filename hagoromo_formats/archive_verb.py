"""The command `hagoromo archive`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo_formats.archive.profile import known_profile, profile_place


@verb(verbs)
def archive(
    results: Positional[tuple[Path, ...]],
    out: Out,
    inventory: Annotated[str, arg(help="inventory number of the object")] = "",
    title: Annotated[str, arg(help="what the object is called (default: its inventory number)")] = "",
    date: Annotated[str, arg(help="of the photographs, such as 2026-11-27 (default: not stated)")] = "",
    originals: tuple[Path, ...] = (),
    pack: bool = False,
    profile: Path | None = None,
    iiif: Annotated[str, arg(metavar="ADDRESS")] = "",
    notes: Path | None = None,
    force: Force = False,
) -> None:
    """Results → what a museum keeps: a bag (BagIt) with SHA-256 of every file, Dublin Core, RO-Crate, pictures.

    Who, where, licence and camera are asked once, on a terminal, and kept in a profile that you may edit.

    Args:
        results: folders and files to keep: a measurement, a page, a comparison of two dates.
        originals: captures and photographs that they were made from: each file is named with its size and SHA-256.
        pack: copy the originals into the bag, too.
        profile: TOML with creator, institution, licence, place, contact, camera, lens, lamps (default: in your folder
            of settings).
        iiif: address at which the folder data/iiif of the bag will be served, such as https://museum.org/iiif/1889.12:
            it gets tiles of the pictures and a manifest, for viewers of IIIF.
        notes: file of notes on the measured object, as its page saves them (W3C Web Annotation): it is kept, and the
            pictures of the measurement carry the notes in the manifest.
    """
    place = profile_place() if profile is None else profile
    known = known_profile(place, input if sys.stdin is not None and sys.stdin.isatty() else None)
    with progress_bar("archive") as progress:
        holdings = hg.archive(
            results, out, known, inventory=inventory, title=title, photographed=date, originals=originals, pack=pack,
            iiif=iiif, notes=notes, force=force, progress=progress,
        )  # fmt: skip
    kept = [one for one in holdings if one.kept]
    size = sum(one.size for one in kept) / 2**20
    say(f"{len(kept)} files kept ({size:.1f} MiB), {len(holdings) - len(kept)} originals named by their digests")
    wrote(out)
