"""Metadata of an archive: Dublin Core (oai_dc), and RO-Crate 1.1, of which the payload is the crate.

Soiland-Reyes et al., https://w3id.org/ro/crate/1.1; Dublin Core Metadata Element Set 1.1, ISO 15836.
"""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote
from xml.etree import ElementTree

from hagoromo.errors import InputError
from hagoromo.files.record import WrittenBy, decode, read_json
from hagoromo.version import __version__
from hagoromo_formats.archive.holdings import Holding
from hagoromo_formats.archive.profile import ArchiveProfile

CRATE, DUBLIN_CORE, SOURCES = "ro-crate-metadata.json", "dublin_core.xml", "sources.json"
OAI = "http://www.openarchives.org/OAI/2.0/oai_dc/"
DC = "http://purl.org/dc/elements/1.1/"
ORIGINALS = "originals/"  # folder of the payload that holds what results were made from
RECORDS = "materials.json", "change.json", "relit.json", "export.json", "transforms.json"  # that say how they were made
CONFORMS = "https://w3id.org/ro/crate/1.1"
TYPES = {".exr": "image/x-exr", ".zarr": "application/x-zarr", ".toml": "application/toml"}


@dataclass(frozen=True)
class ArchivedObject:
    """What is archived. inventory: number of the object. title: what it is called. photographed: date, ISO 8601, ""
    where unknown. archived: date of the archive.
    """

    inventory: str
    title: str
    photographed: str
    archived: str

    @property
    def description(self) -> str:
        """A sentence."""
        when = f", photographed {self.photographed}" if self.photographed else ""
        return f"Measurements of {self.title} (inventory number {self.inventory}){when}, by Hagoromo {__version__}"


def dublin_core(thing: ArchivedObject, profile: ArchiveProfile, holdings: Sequence[Holding]) -> str:
    """The record as XML."""
    ElementTree.register_namespace("oai_dc", OAI)
    ElementTree.register_namespace("dc", DC)
    root = ElementTree.Element(f"{{{OAI}}}dc")
    values = [
        ("title", thing.title),
        ("identifier", thing.inventory),
        ("creator", profile.creator),
        ("publisher", profile.institution),
        ("rights", licence_address(profile.licence)),
        ("date", thing.photographed or thing.archived),
        ("coverage", profile.place),
        ("type", "Dataset"),
        ("description", thing.description),
        *(("source", f"{one.path} (SHA-256 {one.sha256})") for one in holdings if not one.kept),
        *(("format", kind) for kind in sorted({media_type(one.path) for one in holdings if one.kept})),
    ]
    for name, value in values:
        if value:
            ElementTree.SubElement(root, f"{{{DC}}}{name}").text = value
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def crate(thing: ArchivedObject, profile: ArchiveProfile, holdings: Sequence[Holding], home: Path) -> str:
    """ro-crate-metadata.json. home: where the files are that are kept."""
    kept, sources = ([one for one in holdings if one.kept is side] for side in (True, False))
    licence = licence_address(profile.licence)
    equipment = [("camera", profile.camera), ("lens", profile.lens), ("lamps", profile.lamps)]
    owned = [{"@id": f"#{key}", "@type": "IndividualProduct", "name": name} for key, name in equipment if name]
    originals = [{"@id": _id(one)} for one in sources]
    originals += [{"@id": quote(one.path)} for one in kept if one.path.startswith(ORIGINALS)]
    made = _made(kept, home)
    unheld = _unheld([one for action in made for one in action.stated], holdings)
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": thing.title,
        "identifier": thing.inventory,
        "description": thing.description,
        "datePublished": thing.archived,
        "license": {"@id": licence},
        "author": {"@id": "#creator"},
        "publisher": {"@id": "#institution"},
        "hasPart": [{"@id": quote(one.path)} for one in kept],
        "mentions": [{"@id": name} for name in (*(one.entity["@id"] for one in made), *map(_id, sources), *unheld)],
    }
    if profile.place:
        root["contentLocation"] = {"@id": "#place"}
    graph = [
        {"@id": CRATE, "@type": "CreativeWork", "about": {"@id": "./"}, "conformsTo": {"@id": CONFORMS}},
        root,
        {"@id": licence, "@type": "CreativeWork", "name": profile.licence},
        {"@id": "#creator", "@type": "Person", "name": profile.creator} | _if(email=profile.contact),
        {"@id": "#institution", "@type": "Organization", "name": profile.institution},
        {"@id": "#hagoromo", "@type": "SoftwareApplication", "name": "Hagoromo", "version": __version__},
        *([{"@id": "#place", "@type": "Place", "name": profile.place}] if profile.place else []),
        *owned,
        *(_file(one) for one in kept),
        *(_source(one) for one in sources),
        *unheld.values(),
        *(
            action.entity
            | {
                "agent": {"@id": "#creator"},
                "instrument": [{"@id": "#hagoromo"}, *({"@id": one["@id"]} for one in owned)],
                "object": _objects(action.stated, holdings) or originals,
            }
            for action in made
        ),
    ]
    return json.dumps({"@context": f"{CONFORMS}/context", "@graph": graph}, indent=1, ensure_ascii=False) + "\n"


def licence_address(licence: str) -> str:
    """The address of a licence that is known by its SPDX name."""
    return licence if "://" in licence else f"https://spdx.org/licenses/{quote(licence)}"


def media_type(path: str) -> str:
    """Of a file, by its name."""
    suffix = Path(path).suffix.lower()
    return TYPES.get(suffix) or mimetypes.types_map.get(suffix, "application/octet-stream")


def _file(one: Holding) -> dict[str, Any]:
    return {
        "@id": quote(one.path),
        "@type": "File",
        "name": Path(one.path).name,
        "contentSize": str(one.size),
        "encodingFormat": media_type(one.path),
        "sha256": one.sha256,
    }


def _source(one: Holding) -> dict[str, Any]:
    """A file that is not in the archive, by its digest."""
    return {
        "@id": _id(one),
        "@type": "CreativeWork",
        "name": one.path,
        "contentSize": str(one.size),
        "encodingFormat": media_type(one.path),
        "sha256": one.sha256,
    }


class MadeResult(NamedTuple):
    """What was done: its entity in the crate, and the sources that the result states, (name, SHA-256)."""

    entity: dict[str, Any]
    stated: list[tuple[str, str]]


def _made(kept: Sequence[Holding], home: Path) -> list[MadeResult]:
    """What was done, by the tables `hagoromo` of the JSON files that results have: versions, settings and sources."""
    found = []
    for one in kept:
        if Path(one.path).name not in RECORDS:
            continue
        try:
            data = read_json(home / one.path)
            data = data[0] if isinstance(data, list) and data else data
            table = data.get("hagoromo") if isinstance(data, dict) else None
            by = None if table is None else decode(table, WrittenBy, one.path)
        except InputError:
            continue  # a file of that name that is not ours is kept as it is
        if by is not None:
            entity = {
                "@id": f"#made-{quote(one.path, safe='')}",
                "@type": "CreateAction",
                "name": f"hagoromo {by.version}: {one.path}",
                "description": f"settings: {json.dumps(by.settings, ensure_ascii=False, sort_keys=True)}",
                "result": {"@id": quote(one.path)},
            }
            found.append(MadeResult(entity, [(each.name, each.sha256) for each in by.sources]))
    return found


def _id(one: Holding) -> str:
    """How the crate calls a file: by its path, or by its digest if it is not in the archive."""
    return quote(one.path) if one.kept else f"urn:sha256:{one.sha256}"


def _objects(stated: Sequence[tuple[str, str]], holdings: Sequence[Holding]) -> list[dict[str, str]]:
    """The sources of a result: files of the archive with the same digest, or digests."""
    held = {one.sha256: _id(one) for one in holdings}
    return [{"@id": name} for name in dict.fromkeys(held.get(digest, f"urn:sha256:{digest}") for _, digest in stated)]


def _unheld(stated: Sequence[tuple[str, str]], holdings: Sequence[Holding]) -> dict[str, dict[str, Any]]:
    """Entities of sources that are neither in the archive nor named as originals, by their names in the crate."""
    held = {one.sha256 for one in holdings}
    return {
        f"urn:sha256:{digest}": {
            "@id": f"urn:sha256:{digest}", "@type": "CreativeWork", "name": name, "sha256": digest,
            "encodingFormat": media_type(name),
        }
        for name, digest in stated
        if digest not in held
    }  # fmt: skip


def _if(**values: str) -> dict[str, str]:
    return {key: value for key, value in values.items() if value}
