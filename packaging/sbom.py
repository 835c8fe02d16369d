"""SBOM: the list of parts in the wheel (CycloneDX 1.6, PEP 770), made by the build from constraints.txt.

The wheel holds no code of other packages. The list names those that it requires (scope "required") and those that its
extras bring ("optional"; the property `hagoromo:extra` names the extras), at the versions with which it is tested, and
which of them needs which. The hashes of their wheels are in constraints.txt. The same sources give the same list.
"""

from __future__ import annotations

import json
import runpy
import shutil
import tempfile
import tomllib
import uuid
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PINS = runpy.run_path(
    str(Path(__file__).with_name("pins.py"))
)  # this folder is not among those that Python imports from
FILE = "hagoromo.cdx.json"


def parts_list(pyproject: Mapping[str, Any], constraints: str, own_version: str) -> dict[str, Any]:
    """The document, as JSON has it."""
    project, pins = pyproject["project"], PINS["pins_of"](constraints)

    def brought(asked: str) -> set[str]:
        return set(PINS["needed"](pins, PINS["requirements"](pyproject, [asked])))

    required = brought(project["name"])
    by_extra = {extra: brought(f"{project['name']}[{extra}]") for extra in project["optional-dependencies"]}
    names = sorted(required.union(*by_extra.values()))
    direct = {PINS["parsed"](line)[0] for extra in ["", *by_extra] for line in _lines(pyproject, extra)}
    own = _part(project["name"], own_version) | {
        "description": project["description"],
        "licenses": [{"license": {"id": project["license"]}}],
    }
    parts = []
    for name in names:
        part = _part(name, pins[name].version) | {"scope": "required" if name in required else "optional"}
        extras = [] if name in required else [extra for extra, bring in by_extra.items() if name in bring]
        properties = [{"name": "hagoromo:extra", "value": extra} for extra in extras]
        parts.append(part | ({"properties": properties} if properties else {}))
    refs = {name: part["bom-ref"] for name, part in zip(names, parts, strict=True)}
    edges = [{"ref": own["bom-ref"], "dependsOn": [refs[name] for name in names if name in direct]}]
    edges += [{"ref": refs[name], "dependsOn": [refs[n] for n in names if name in pins[n].via]} for name in names]
    document = {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "lifecycles": [{"phase": "build"}],
            "tools": {"components": [_part("hatchling", version("hatchling"))]},
            "component": own,
        },
        "components": parts,
        "dependencies": edges,
    }
    return document | {"serialNumber": uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(document)).urn}


def _lines(pyproject: Mapping[str, Any], extra: str) -> list[str]:
    name = pyproject["project"]["name"]
    return PINS["requirements"](pyproject, [f"{name}[{extra}]"])


def _part(name: str, at: str) -> dict[str, Any]:
    purl = f"pkg:pypi/{name}@{at}"
    return {"type": "library", "bom-ref": purl, "name": name, "version": at, "purl": purl}


class ListOfParts(BuildHookInterface):
    """The hook by which hatchling puts the list into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the list where hatchling takes it from; `version` is the kind of the build, not of the package."""
        root = Path(self.root)
        pyproject = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
        constraints = (root / "constraints.txt").read_text(encoding="utf-8")
        text = json.dumps(parts_list(pyproject, constraints, self.metadata.version), indent=1)
        self._folder = tempfile.mkdtemp()
        (Path(self._folder) / FILE).write_text(text + "\n", encoding="utf-8")
        build_data["sbom_files"].append(str(Path(self._folder) / FILE))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what `initialize` wrote."""
        shutil.rmtree(self._folder)
