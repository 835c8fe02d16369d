"""The API reference: a page per room with every public name of `hagoromo`; one without a docstring stops the build.

Names and docstrings are read from the source (griffe), nothing is imported. The navigation gets a page per room, in
the order in which data flow, as pyproject.toml lists the rooms.
"""

from __future__ import annotations

import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

from griffe import GriffeLoader
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
LINTED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
PACKAGES = tuple(name for name in LINTED["root_packages"] if name != "hagoromo_start")  # which has no public name
SECTION = "API"  # entry of the navigation that the pages stand under
OPTIONS = "    options:\n      heading_level: 2\n"


def on_config(config: Any, **_: Any) -> Any:
    """Fill the navigation's section of the API with its pages."""
    pages = ["reference/api.md", *(f"reference/api/{room}.md" for room in names_by_room())]
    for entry in _entries(config.nav):
        if SECTION in entry:
            entry[SECTION] = pages
            return config
    raise PluginError(f"mkdocs.yml: the navigation has no entry {SECTION!r} for the public names")


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of each room, and the list of all names."""
    rooms = names_by_room()
    rows = [f"| [{room}](api/{room}.md) | {' '.join(map(_link(room), names))} |" for room, names in rooms.items()]
    text = (ROOT / "docs" / "hooks" / "api.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "reference/api.md", content=text + "\n".join(rows) + "\n"))
    for room, names in rooms.items():
        blocks = [f"::: hagoromo.{name}\n{OPTIONS}" for name in names]
        head = f"# {room.capitalize()}\n\n{_summary(room)}\n\n"
        files.append(File.generated(config, f"reference/api/{room}.md", content=head + "\n".join(blocks)))
    return files


@cache
def names_by_room() -> dict[str, list[str]]:
    """Room → its public names in the order of the stub; rooms in the order of the flow of data."""
    package = _modules()["hagoromo"]
    found: dict[str, list[str]] = defaultdict(list)
    order = list(package.members)
    for name in sorted(public_names(), key=lambda name: order.index(name) if name in order else -1):
        if name.startswith("__"):
            continue
        if name not in package.members:
            raise PluginError(f"hagoromo.{name} is public, and its stub does not say where it lives")
        member = package[name]
        target = member.final_target if member.is_alias else member
        if not target.has_docstring:
            raise PluginError(f"hagoromo.{name} is public and has no docstring ({target.path})")
        home, room = target.path.split(".")[:2]
        found[room if home == "hagoromo" else home].append(name)
    return {room: found[room] for room in [*_rooms(), *sorted(found)] if room in found}


def public_names() -> list[str]:
    """`hagoromo.__all__`; importing the package loads nothing heavy."""
    import hagoromo

    return list(vars(hagoromo)["__all__"])


@cache
def _modules() -> Any:
    """The packages, read from their source."""
    loader = GriffeLoader(search_paths=[str(ROOT)], allow_inspection=False)
    for package in PACKAGES:
        loader.load(package)
    return loader.modules_collection


def _rooms() -> list[str]:
    """The layers of pyproject.toml, from the light to the commands; what is below the light at the end."""
    layers = next(c for c in LINTED["contracts"] if c.get("containers") == ["hagoromo"])["layers"]
    rooms = [room.strip() for layer in reversed(layers) for room in layer.split("|")]
    light = rooms.index("light")
    return rooms[light:] + rooms[:light]


def _summary(room: str) -> str:
    """First sentence of a room's own docstring."""
    module = _modules()[room] if room in PACKAGES else _modules()["hagoromo"][room]
    return module.docstring.value.splitlines()[0] if module.docstring else ""


def _link(room: str) -> Any:
    return lambda name: f"[`{name}`](api/{room}.md#hagoromo.{name})"


def _entries(nav: list[Any]) -> list[dict[str, Any]]:
    """Every titled entry of a navigation, of all depths."""
    titled = [entry for entry in nav if isinstance(entry, dict)]
    groups = [value for entry in titled for value in entry.values() if isinstance(value, list)]
    return titled + [entry for group in groups for entry in _entries(group)]
