"""Metadata of an archive: Dublin Core (oai_dc), and RO-Crate 1.1, of which the payload is the crate.

Soiland-Reyes et al., https://w3id.org/ro/crate/1.1; Dublin Core Metadata Element Set 1.1, ISO 15836.
"""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.etree import ElementTree

from hagoromo.errors import InputError
from hagoromo.files.record import read_json
from hagoromo.version import __version__
from hagoromo_formats.archive.holdings import Holding
from hagoromo_formats.archive.profile import ArchiveProfile

CRATE, DUBLIN_CORE, SOURCES = "ro-crate-metadata.json", "dublin_core.xml", "sources.json"
OAI = "http://www.openarchives.org/OAI/2.0/oai_dc/"
DC = "http://purl.org/dc/elements/1.1/"
ORIGINALS = "originals/"  # folder of the payload that holds what results were made from
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
    originals = [{"@id": _source(one)["@id"]} for one in sources]
    originals += [{"@id": quote(one.path)} for one in kept if one.path.startswith(ORIGINALS)]
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
        "mentions": [{"@id": one["@id"]} for one in (*_made(kept, home), *(_source(one) for one in sources))],
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
        *(
            action
            | {
                "agent": {"@id": "#creator"},
                "instrument": [{"@id": "#hagoromo"}, *({"@id": one["@id"]} for one in owned)],
                "object": originals,
            }
            for action in _made(kept, home)
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
        "@id": f"urn:sha256:{one.sha256}",
        "@type": "CreativeWork",
        "name": one.path,
        "contentSize": str(one.size),
        "encodingFormat": media_type(one.path),
        "sha256": one.sha256,
    }


def _made(kept: Sequence[Holding], home: Path) -> list[dict[str, Any]]:
    """What was done, by the tables `hagoromo` of the JSON files that results have: versions and settings."""
    found = []
    for one in kept:
        if Path(one.path).name not in ("materials.json", "change.json", "relit.json", "export.json"):
            continue
        try:
            data = read_json(home / one.path)
        except InputError:
            continue  # a file of that name that is not ours is kept as it is
        data = data[0] if isinstance(data, list) and data else data
        by = data.get("hagoromo") if isinstance(data, dict) else None
        if isinstance(by, dict):
            said = json.dumps(by.get("settings", {}), ensure_ascii=False, sort_keys=True)
            found.append(
                {
                    "@id": f"#made-{quote(one.path, safe='')}",
                    "@type": "CreateAction",
                    "name": f"hagoromo {by.get('version', '')}: {one.path}",
                    "description": f"settings: {said}",
                    "result": {"@id": quote(one.path)},
                }
            )
    return found


def _if(**values: str) -> dict[str, str]:
    return {key: value for key, value in values.items() if value}
