"""Mutants: a number of a law is changed, one at a time, and the nearest tests must notice.

    python -m tests.mutants [--count 200] [--seed 0] [--only facets] [--quick] [--out out/mutants.json]

Which tests are near a file is what docs/equations.md says. Numbers are drawn by the seed from the functions and module
constants of these files. A number is changed by a fiftieth, a whole one by 1: a law that is off by so much is wrong.
Each mutant runs in a copy of the repository. Exit status: 0 where all were noticed, 1 where some survive; these are
listed with their lines. A survivor may be a number that no result depends on (a bound for rounding): look at each.
"""

from __future__ import annotations

import argparse
import ast
import json
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

HOME = Path(__file__).resolve().parents[1]
PAGE = HOME / "docs" / "equations.md"
SHARE = 0.02  # by which a number is changed
LIMIT_S = 900  # of one run of the tests
COPIED = ("hagoromo*", "tests", "docs", "studies", "fuzz", "examples", "benchmarks", "pyproject.toml", "mkdocs.yml")


@dataclass(frozen=True)
class Mutant:
    """A number of a file in the place of another one."""

    file: str
    line: int
    column: int
    end: int
    was: str
    becomes: str

    def text(self, source: str) -> str:
        """The source with it."""
        lines = source.splitlines(keepends=True)
        row = lines[self.line - 1].encode()  # columns of `ast` count bytes
        lines[self.line - 1] = (row[: self.column] + self.becomes.encode() + row[self.end :]).decode()
        return "".join(lines)


def nearest_tests(page: str) -> dict[str, list[str]]:
    """File of a law → the tests that its rows of the page name."""
    near: dict[str, list[str]] = {}
    for row in page.splitlines():
        names = re.findall(r"`((?:hagoromo|tests)/[^`]*)`", row)
        tests = [name for name in names if name.startswith("tests/")]
        for file in (name for name in names if name.startswith("hagoromo/") and name.endswith(".py")):
            near[file] = sorted({*near.get(file, []), *tests})
    return near


def mutants_of(file: str, source: str) -> Iterator[Mutant]:
    """One for each number of its code; those of types, choices of axes and shapes of arrays are none of a law."""
    tree = ast.parse(source)
    left_out = {id(inner) for node in ast.walk(tree) for part in _no_law(node) for inner in ast.walk(part)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or id(node) in left_out or node.lineno != node.end_lineno:
            continue
        value, end = node.value, node.end_col_offset or 0
        if type(value) is int:
            becomes = repr(value + 1)
        elif type(value) is float:
            becomes = repr(value * (1.0 + SHARE) if value else SHARE)
        else:
            continue
        was = source.splitlines()[node.lineno - 1].encode()[node.col_offset : end].decode()
        yield Mutant(file, node.lineno, node.col_offset, end, was, becomes)


def _no_law(node: ast.AST) -> list[ast.AST]:
    if isinstance(node, ast.Subscript):
        return [node.slice]
    if isinstance(node, ast.arg | ast.AnnAssign):
        return [node.annotation] if node.annotation else []
    if isinstance(node, ast.keyword) and node.arg in ("axis", "maxsize", "ndmin", "dtype"):
        return [node.value]
    if isinstance(node, ast.FormattedValue | ast.Assert | ast.Raise):
        return [node]
    return []


def survives(mutant: Mutant, tests: list[str], copy: Path, chosen: str = "not slow") -> bool:
    """Whether the tests pass with the mutant, in a copy of the repository, which is as before afterwards."""
    path = copy / mutant.file
    source = path.read_text(encoding="utf-8")
    path.write_text(mutant.text(source), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", chosen, *tests]
    try:
        return subprocess.run(command, cwd=copy, capture_output=True, timeout=LIMIT_S).returncode == 0
    except subprocess.TimeoutExpired:
        return False  # a law that does not end is noticed
    finally:
        path.write_text(source, encoding="utf-8")


def drawn(near: dict[str, list[str]], count: int, seed: int) -> list[Mutant]:
    """Some mutants of all files, evenly over their numbers."""
    every = [one for file in sorted(near) for one in mutants_of(file, (HOME / file).read_text(encoding="utf-8"))]
    return sorted(random.Random(seed).sample(every, min(count, len(every))), key=lambda one: (one.file, one.line))


def main() -> int:
    """Try them, print each, and write those that survive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="files with this in their name alone")
    parser.add_argument("--quick", action="store_true", help="by the tests of `make test` alone")
    parser.add_argument("--out", type=Path, default=Path("out/mutants.json"))
    given = parser.parse_args()
    near = {
        file: tests for file, tests in nearest_tests(PAGE.read_text(encoding="utf-8")).items() if given.only in file
    }
    chosen = "not slow and not nightly" if given.quick else "not slow"
    mutants, survivors = drawn(near, given.count, given.seed), []
    with tempfile.TemporaryDirectory() as home:
        copy = Path(home) / "copy"
        copy.mkdir()
        for place in (place for pattern in COPIED for place in HOME.glob(pattern)):
            (shutil.copytree if place.is_dir() else shutil.copy)(place, copy / place.name)
        for number, one in enumerate(mutants, 1):
            alive = survives(one, near[one.file], copy, chosen)
            survivors += [one] if alive else []
            print(f"{number}/{len(mutants)} {'SURVIVES' if alive else 'noticed '} {one.file}:{one.line} "
                  f"{one.was} → {one.becomes}", flush=True)  # fmt: skip
    given.out.parent.mkdir(parents=True, exist_ok=True)
    record = {"seed": given.seed, "tried": len(mutants), "survivors": [asdict(one) for one in survivors]}
    given.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    print(f"{len(survivors)} of {len(mutants)} survive; wrote {given.out}")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
