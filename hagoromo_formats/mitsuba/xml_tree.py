"""XML tree: a scene file of Mitsuba as plain tables, as `mitsuba.load_dict` takes them, without loading any plugin.

Nothing of the file is run: only its text is read, and files that it includes, from its own folder. Tables have "type"
(of the root "scene") and "tag"; places are (4, 4) arrays, colours tables of type rgb or spectrum. References are
resolved. Names of files of Mitsuba 0.x (toWorld) become those of today (to_world).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.format import start_of
from hagoromo.files.reading import reading

LARGEST = 1 << 26  # bytes of a scene file; its long parts are files of their own
GROWTH = 60.0  # memory of its tree, in sizes of the file
MOST_INCLUDES, MOST_DEPTH, MOST_NODES = 32, 64, 200_000
MOST_RESOLVED = 1_000_000  # tables, each counted once for every reference to it
FORBIDDEN = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)  # entities may grow, or name other files
PLUGINS = {"scene", "bsdf", "shape", "emitter", "sensor", "film", "rfilter", "sampler", "integrator", "texture",
           "medium", "phase", "volume"}  # fmt: skip
CAPITAL = re.compile(r"(?<=[a-z0-9])([A-Z])")
Table = dict[str, Any]


def read_xml(path: str | Path) -> Table:
    """The scene in a .xml file; `InputError` for a damaged one, one that defines entities, and files elsewhere."""
    return _Reader(Path(path)).scene()


def is_scene(path: Path) -> bool:
    """Whether an .xml is a scene of Mitsuba, by its first bytes."""
    return path.is_file() and path.suffix.lower() == ".xml" and bool(re.search(rb"<scene[\s>]", start_of(path)))


def scene_facts(path: Path) -> dict[str, Any]:
    """How many plugins of each type a scene of Mitsuba has, by their tags; nothing of it is loaded."""
    parts = [part for part in read_xml(path).values() if isinstance(part, dict)]
    tags = dict.fromkeys(str(part.get("tag")) for part in parts)
    counts = {tag: Counter(str(part["type"]) for part in parts if part.get("tag") == tag) for tag in tags}
    return {"kind": "Mitsuba scene", **{tag: dict(counts[tag]) for tag in tags}}


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path, self.folder = path, path.parent
        self.defaults: dict[str, str] = {}
        self.known: dict[str, Table] = {}
        self.old = False
        self.files = self.nodes = 0

    def scene(self) -> Table:
        root = self._root(self.path)
        with reading(self.path, "a scene of Mitsuba"):
            table = self._table(root, 0)
            _check_size(table)
        return table

    def _root(self, path: Path) -> ElementTree.Element:
        self.files += 1
        if self.files > MOST_INCLUDES:
            raise InputError(f"{self.path} includes more than {MOST_INCLUDES} files, or itself: put it into one")
        data = read_bytes(sized_file(path, LARGEST, "a scene of Mitsuba"), GROWTH)
        if FORBIDDEN.search(data) or b"\0" in data[:200]:
            raise InputError(f"{path} defines entities, or is no text in UTF-8: no scene needs that, it is refused")
        with reading(path, "a scene of Mitsuba"):
            root = ElementTree.fromstring(data)
        if root.tag != "scene":
            raise InputError(f"{path} begins with <{root.tag}>: a scene of Mitsuba begins with <scene>")
        version = re.match(r"\d+", root.get("version", "3"))
        self.old = version is not None and int(version[0]) < 2
        return root

    def _name(self, name: str) -> str:
        return CAPITAL.sub(r"_\1", name).lower() if self.old else name

    def _table(self, element: ElementTree.Element, depth: int) -> Table:
        """A plugin with its values and its plugins, by their names or numbers."""
        if depth > MOST_DEPTH:
            raise InputError(f"{self.path} nests more than {MOST_DEPTH} deep: it is refused")
        table: Table = {"type": self._text(element.get("type", element.tag)), "tag": element.tag}
        for child in element:
            self._add(table, child, depth)
        if name := element.get("id"):
            self.known[self._text(name)] = table
            table["id"] = self._text(name)
        return table

    def _add(self, table: Table, child: ElementTree.Element, depth: int) -> None:
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise InputError(f"{self.path} has more than {MOST_NODES} parts: it is refused")
        tag, name = child.tag, self._name(self._text(child.get("name", "")))
        if tag in PLUGINS:
            table[name or f"{tag} {len(table)}"] = self._table(child, depth + 1)
        elif tag == "default":
            self.defaults.setdefault(child.get("name", ""), self._text(child.get("value", "")))
        elif tag == "include":
            for each in self._root(inside(self.folder, self._text(child.get("filename", "")))):
                self._add(table, each, depth + 1)
        elif tag == "ref":
            place = self._text(child.get("id", ""))
            if place not in self.known:
                raise InputError(f"{self.path} refers to {place!r}, which it does not define before: define it")
            table[name or f"ref {len(table)}"] = self.known[place]
        elif tag == "alias":
            self.known[self._text(child.get("as", ""))] = self.known[self._text(child.get("id", ""))]
        else:
            table[name] = self._value(child, tag)

    def _value(self, child: ElementTree.Element, tag: str) -> Any:
        text = self._text(child.get("value", ""))
        if tag in ("float", "integer"):
            return float(text) if tag == "float" else int(float(text))
        if tag == "boolean":
            return text.strip().lower() == "true"
        if tag == "string":
            return text
        if tag in ("point", "vector"):
            return self._vector(child)
        if tag == "transform":
            return self._transform(child)
        if tag in ("rgb", "srgb", "color"):
            return {"type": "rgb", "tag": "texture", "value": _rgb(text)}
        if tag in ("spectrum", "blackbody"):
            return self._spectrum(child, text)
        raise InputError(f"{self.path} has <{tag}>, which is not known: remove it")

    def _spectrum(self, child: ElementTree.Element, text: str) -> Table:
        table: Table = {"type": "spectrum", "tag": "texture"}
        if "filename" in child.attrib:
            return table | {"filename": self._text(child.get("filename", ""))}
        if ":" not in text:
            values = _floats(text)
            return table | {"value": values[0]} if len(values) == 1 else table | {"type": "rgb", "value": values[:3]}
        return table | {"value": [tuple(float(x) for x in pair.split(":")) for pair in text.replace(",", " ").split()]}

    def _vector(self, child: ElementTree.Element, default: float = 0.0) -> NDArray[np.float64]:
        if "value" in child.attrib:
            values = _floats(self._text(child.get("value", "")))
            return np.array(values * 3 if len(values) == 1 else values[:3], float)
        return np.array([float(self._text(child.get(axis, str(default)))) for axis in "xyz"])

    def _transform(self, element: ElementTree.Element) -> NDArray[np.float64]:
        """Each step is done after those before it."""
        whole = np.eye(4)
        for step in element:
            whole = self._step(step) @ whole
        return whole

    def _step(self, step: ElementTree.Element) -> NDArray[np.float64]:
        place = np.eye(4)
        if step.tag == "translate":
            place[:3, 3] = self._vector(step)
        elif step.tag == "scale":
            place[:3, :3] = np.diag(self._vector(step, 1.0))
        elif step.tag == "rotate":
            place[:3, :3] = _turn(self._vector(step), float(self._text(step.get("angle", "0"))))
        elif step.tag == "matrix":
            values = _floats(self._text(step.get("value", "")))
            side = 3 if len(values) == 9 else 4
            place[:side, :side] = np.reshape(values, (side, side))
        elif step.tag in ("lookat", "lookAt"):
            given = (_floats(self._text(step.get(key, "0,0,1"))) for key in ("origin", "target", "up"))
            place = _look_at(*(np.array(each, float) for each in given))
        else:
            raise InputError(f"{self.path} has <{step.tag}> in a transform, which is not known: give a matrix")
        return place

    def _text(self, text: str) -> str:
        """The text with the defaults in place of $names; a default is not looked for in another."""
        if "$" not in text:
            return text
        for name in sorted(self.defaults, key=len, reverse=True):
            text = text.replace(f"${name}", self.defaults[name])
            if len(text) > LARGEST:
                raise InputError(f"{self.path} has a default that grows beyond {LARGEST} letters: it is refused")
        return text


def _check_size(table: Mapping[str, Any]) -> None:
    """`InputError` where references to references make more of a file than it holds."""
    sizes: dict[int, int] = {}

    def size(part: Mapping[str, Any]) -> int:
        if id(part) not in sizes:
            sizes[id(part)] = 1 + sum(size(each) for each in part.values() if isinstance(each, Mapping))
        return sizes[id(part)]

    if size(table) > MOST_RESOLVED:
        raise InputError(f"the scene has more than {MOST_RESOLVED} parts with its references resolved: it is refused")


def _floats(text: str) -> list[float]:
    return [float(x) for x in text.replace(",", " ").split()]


def _rgb(text: str) -> list[float]:
    """Linear sRGB of three numbers, of one, or of display values #rrggbb."""
    if text.strip().startswith("#"):
        from hagoromo.light.colour import srgb_decode

        return srgb_decode(np.array([int(text.strip()[k : k + 2], 16) for k in (1, 3, 5)])).tolist()
    values = _floats(text)
    return values * 3 if len(values) == 1 else values[:3]


def _turn(axis: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Rodrigues' rotation about an axis."""
    x, y, z = axis / np.linalg.norm(axis)
    across, angle = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), math.radians(degrees)
    return np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across


def _look_at(origin: NDArray[np.float64], target: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mitsuba's axes: +x left, +y up, +z forwards."""
    forward = (target - origin) / np.linalg.norm(target - origin)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    place = np.eye(4)
    place[:3] = np.column_stack([left, np.cross(forward, left), forward, origin])
    return place
