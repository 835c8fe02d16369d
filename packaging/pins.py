"""Pins: the lines of constraints.txt that an installation needs, each with the hashes of its wheels.

    python packaging/pins.py 'hagoromo[view]' > pins.txt
    python -m pip install --only-binary=:all: --require-hashes -r pins.txt

Arguments are `hagoromo`, with extras in brackets, and names of dependency groups of pyproject.toml. Needs nothing but
Python: it runs before anything is installed. constraints.txt says after each pin what asks for it; that is followed.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENT = re.compile(r"([A-Za-z0-9][\w.-]*+)\s*+(?:\[([\w\s,.-]*)\])?+(?!\[)")  # name, extras
PIN = re.compile(r"^([\w.-]+)==(\S+)(?: ; ([^\\\n]+?))?(?= \\$|$)", re.MULTILINE)  # name, version, marker


class Pin(NamedTuple):
    """A package at one version: where its marker (PEP 508) holds, the SHA-256 of its wheels, and who asks for it."""

    name: str
    version: str
    marker: str
    hashes: tuple[str, ...]
    via: tuple[str, ...]

    @property
    def line(self) -> str:
        """The requirement as pip reads it in a file."""
        head = f"{self.name}=={self.version}" + (f" ; {self.marker}" if self.marker else "")
        return " \\\n    ".join([head, *(f"--hash=sha256:{digest}" for digest in self.hashes)])


def pins_of(text: str) -> dict[str, Pin]:
    """The pins of a constraints.txt by name."""
    found, heads = {}, [*PIN.finditer(text)]
    for head, following in zip(heads, [*heads[1:], None], strict=True):
        block = text[head.end() : following.start() if following else len(text)]
        hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})", block)
        via = re.findall(r"^ +#(?: via)? +(?!via$)(\S+)", block, re.MULTILINE)
        found[normal(head[1])] = Pin(head[1], head[2], head[3] or "", tuple(hashes), tuple(map(normal, via)))
    return found


def requirements(pyproject: Mapping[str, Any], asked: Iterable[str]) -> list[str]:
    """The requirements of the package with extras, `hagoromo[view]`, and of dependency groups.

    Raises `KeyError` for an extra or a group that pyproject.toml does not have.
    """
    project, lines = pyproject["project"], []
    for wanted in asked:
        name, extras = parsed(wanted)
        if name != project["name"]:
            lines += pyproject["dependency-groups"][name]
            continue
        lines += project["dependencies"]
        for extra in extras:
            for line in project["optional-dependencies"][extra]:
                own = parsed(line)[0] == project["name"]  # an extra that names other extras
                lines += requirements(pyproject, [line]) if own else [line]
    return list(dict.fromkeys(lines))


def needed(pins: Mapping[str, Pin], lines: Iterable[str]) -> dict[str, Pin]:
    """The pins that requirements need, directly or through others, in the order of their names."""
    names, new = set(), {parsed(line)[0] for line in lines}
    while new:
        names |= new
        new = {name for name, pin in pins.items() if name not in names and names & set(pin.via)}
    return {name: pins[name] for name in sorted(names)}


def parsed(requirement: str) -> tuple[str, list[str]]:
    """Normal name and extras of a requirement; `ValueError` where it is none."""
    match = REQUIREMENT.match(requirement)
    if match is None:
        raise ValueError(f"{requirement!r} is no requirement: give hagoromo, hagoromo[view] or a dependency group")
    return normal(match[1]), [extra.strip() for extra in (match[2] or "").split(",") if extra.strip()]


def normal(name: str) -> str:
    """A package's name as the package index compares names."""
    return re.sub(r"[-_.]+", "-", name).lower()


def main(asked: list[str]) -> int:
    """Print the lines for `asked`; 2 where it names what pyproject.toml does not have."""
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    pins = pins_of((ROOT / "constraints.txt").read_text(encoding="utf-8"))
    try:
        chosen = needed(pins, requirements(pyproject, asked or ["hagoromo"]))
    except ValueError as error:
        print(f"pins.py: {error}", file=sys.stderr)
        return 2
    except KeyError as error:
        print(f"pins.py: no extra, dependency group or pin is called {error}: see pyproject.toml", file=sys.stderr)
        return 2
    print("\n".join(pin.line for pin in chosen.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
