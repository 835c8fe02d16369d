"""Trees: JSON and TOML with a value of another kind, a key lost, doubled or renamed, otherwise valid."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np

Random = np.random.Generator
Path = tuple[Any, ...]
DEEP = 20_000
MANY = 20_000
# texts that stand for what json.dumps cannot write
RAW = {
    "@deep list@": "[" * DEEP + "]" * DEEP,
    "@deep table@": '{"a":' * DEEP + "1" + "}" * DEEP,
    "@400 digits@": "9" * 400,
    "@5000 digits@": "9" * 5000,
    "@surrogate@": '"\\ud800"',
    "@huge exponent@": "1e400",
    "@NaN@": "NaN",
}
TOML_RAW = RAW | {"@deep table@": "{a=" * DEEP + "1" + "}" * DEEP, "@NaN@": "nan", "@date@": "1979-05-27T07:32:00Z"}
VALUES: tuple[Any, ...] = (
    [], {}, None, "", "text", True, False, [True], [False] * 3,
    0, -1, 1, 2, 0.5, -0.0, 1e308, -1e308, 1e-310, 1e30, 2**31, 2**32, 2**53, 2**63,
    2**64, -(2**63) - 1, math.inf, -math.inf, math.nan, [[]], [{}], [1], [1, 2, 3], {"a": 1}, "../a", "1", "1e5", "nan",
    "a\nb\x1b[31m\u2028", "\x00", "x" * 3000, [0.0] * 16, [1, "a"], [None], [[1, 2], [3]], [1e308] * 3, 7, 65, 10**6,
    *TOML_RAW,
)  # fmt: skip


# one of each type that plain data have, numbers that are none, and what is empty
SWAPS: tuple[Any, ...] = (
    None, True, False, 0, -1, 1.5, 2**70, "text", "", "x" * 100_000, [], {}, [[]], [{}], [True], [None], {"a": 1},
)  # fmt: skip


def swaps(name: str, data: bytes, depth: int) -> Iterator[bytes]:
    """A JSON or TOML file with each node in turn, the root first, replaced by each of SWAPS; nothing of other files.

    depth: of the deepest nodes; 0 is the root alone.
    """
    try:
        tree = tomllib.loads(data.decode()) if name.endswith(".toml") else json.loads(data)
    except (ValueError, RecursionError):
        return
    for path, value in nodes_of(tree):
        for other in SWAPS if len(path) <= depth else ():
            if other is not value and (path or isinstance(other, dict) or not name.endswith(".toml")):
                swapped = with_node(tree, path, other)
                yield toml_text(swapped) if name.endswith(".toml") else json.dumps(swapped).encode()


def spoilt_json(data: bytes, random: Random) -> bytes:
    """A JSON text with one thing wrong in its tree."""
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return data[: len(data) // 2]
    try:
        text = json.dumps(changed(tree, random), indent=1)
    except (ValueError, RecursionError):
        return data[: len(data) // 3]
    for word, raw in RAW.items():
        text = text.replace(f'"{word}"', raw)
    return text.encode()


def spoilt_toml(data: bytes, random: Random) -> bytes:
    """A TOML text with one thing wrong in its tree."""
    try:
        tree = tomllib.loads(data.decode())
    except (ValueError, RecursionError):
        return data[: len(data) // 2]
    tree = changed(tree, random)
    if not isinstance(tree, dict):
        return repr(tree).encode()
    return toml_text(tree)


def toml_text(tree: dict[str, Any]) -> bytes:
    """The tree as TOML, a line for each of its keys."""
    text = "".join(f"{json.dumps(str(key))} = {_toml(value)}\n" for key, value in tree.items() if value is not None)
    for word, raw in TOML_RAW.items():
        text = text.replace(f'"{word}"', raw)
    return text.encode("utf-8", "surrogatepass")


def changed(tree: Any, random: Random) -> Any:
    """The tree with one node replaced, removed, renamed or doubled."""
    paths = [path for path, _ in nodes_of(tree)]
    path = paths[int(random.integers(len(paths)))]
    return _with(tree, path, int(random.integers(10)), random)


def nodes_of(tree: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """The path and the value of every node, the root first."""
    yield path, tree
    children = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in children:
        yield from nodes_of(value, (*path, key))


def with_node(tree: Any, path: Path, value: Any) -> Any:
    """The tree with `value` at a path."""
    if not path:
        return value
    copy = tree.copy()
    copy[path[0]] = with_node(tree[path[0]], path[1:], value)
    return copy


def _with(tree: Any, path: Path, act: int, random: Random) -> Any:
    if not path:
        return VALUES[int(random.integers(len(VALUES)))]
    key, rest = path[0], path[1:]
    copy = tree.copy()
    if rest or act < 7:
        copy[key] = _with(tree[key], rest, act, random)
    elif act == 7:
        copy.pop(key)
    elif isinstance(copy, dict):
        other = list(copy)[int(random.integers(len(copy)))]
        copy[key if act == 8 else "\x1b[31mnew\nkey"] = copy[other]
    else:
        copy[key:key] = [copy[key]] * (1 if act == 8 else MANY if random.random() < 0.1 else 300)
    return copy


def _toml(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {_toml(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(one) for one in value if one is not None) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return {math.inf: "inf", -math.inf: "-inf"}.get(value, "nan")
    if isinstance(value, (int, float)):
        return repr(value)
    return json.dumps(value) if isinstance(value, str) else f'"{value}"'
