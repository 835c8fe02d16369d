"""Verbs: the commands themselves, run in this process, with spoilt arguments and spoilt inputs.

Each ends with status 0, or with 2 and one line on standard error and nothing left behind; never in a traceback. What
takes longer than `PATIENCE_S`, because a spoilt size asks for much work, is interrupted as by Ctrl-C: one line, too.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import json
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fuzz.crash_cases import CASES, CrashCase
from fuzz.mutators import spoil_one
from hagoromo.errors import InputError

Random = np.random.Generator
WORDS = "words.json"  # file of a sample: the arguments; a word that begins with @ is a path in the folder
OUT = "@"
PATIENCE_S = 20
DONE, SOME_FAILED = 0, 2  # the second without a line: of batch alone
INTERRUPTED = 130
VALUES = (
    "", "0", "-1", "1", "2", "0.5", "nan", "inf", "-inf", "1e308", "-1e-320", "1e400", "9" * 400, "2147483648", "1e9",
    "1e30", "text", "auto", "none", "True", "--", "-", "--help", "D65", "A", "srgb", "linear", "RGGB", "7x5", "0x0",
    "99999x99999", "key=0.5", "key=", "=", "key=nan", "x" * 5000, "a\nb\x1b[31m", "\u2028", "\udcff", "../a", ".", "@",
    "@absent", "@out/inside", "/dev/null", "/dev/zero", "http://host/a", "{path}", "$HOME", "~", "*",
)  # fmt: skip
NUMBERS = ("0", "-1", "1", "0.01", "0.5", "3", "100", "1e4", "nan", "inf", "-inf", "1e30", "1e308", "-1e-320", "1e400")
INTEGERS = ("0", "-1", "1", "2", "5", "64", "1000000", "2147483648", "9" * 30, "1.5")
OUTS = (
    "@.",
    "@",
    "@a/b/c",
    "@out",
    "@out.exr",
    "@out.json",
    "@out.txt",
    "@out.zarr",
    "@out.png",
    "@" + "n" * 300,
    "@a\nb",
)
NEVER = ("scheduler", "out")  # they start processes; OUTS are tried in their place


class Verb(NamedTuple):
    """case: command with its inputs; function: the name of what is called, whose options it has."""

    case: CrashCase
    function: str

    def write(self, folder: Path) -> None:
        """A good sample: the inputs and the arguments."""
        self.case.make(folder)
        words = [f"{OUT}{word}" if (folder / word).exists() else word for word in self.case.words]
        out = [] if self.function in ("info", "compare") else ["--out", f"{OUT}{self.case.out or self.case.targets[0]}"]
        (folder / WORDS).write_text(json.dumps([*words, *out]))

    def read(self, words: Path) -> None:
        """Run the command; raises `InputError` with its line where it was refused."""
        folder = words.parent
        given = [_word(word, folder) for word in json.loads(words.read_text())]
        before = _names(folder)
        with contextlib.chdir(folder):
            status, said = _run(given)
        lines = [line for line in said.splitlines() if not line.startswith("hagoromo: warning: ")]
        if status == DONE or (status == SOME_FAILED and self.function == "batch" and not lines):
            return
        if status not in (2, INTERRUPTED) or len(lines) != 1 or not lines[0].startswith("hagoromo: "):
            raise AssertionError(f"status {status}, {len(lines)} lines: {said[:2000]!r}")
        left = {name for name in _names(folder) - before if ".building" not in name}
        if left and self.function != "batch":
            raise AssertionError(f"status {status} left {sorted(left)[:5]}: {said[:2000]!r}")
        raise InputError(lines[0])

    def spoil(self, files: dict[str, bytes], random: Random) -> None:
        """Spoil the arguments, an input, or both."""
        words = files.pop(WORDS)
        chance = random.random()
        if files and chance < 0.7:
            spoil_one(files, random)
        if not files or chance > 0.5:
            words = json.dumps(spoilt_words(json.loads(words), self.function, sorted(files), random)).encode()
        files[WORDS] = words


def spoilt_words(words: list[str], function: str, files: list[str], random: Random) -> list[str]:
    """Arguments with one to three things wrong."""
    words = list(words)
    for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
        value = _one(VALUES, random) if not files or random.random() < 0.8 else f"{OUT}{_one(tuple(files), random)}"
        act, at = int(random.integers(10)), int(random.integers(len(words) + 1))
        if act < 4 and options(function):
            name, kind = _one(options(function), random)
            values = [_fitting(kind, value, files, random) for _ in range(int(random.choice((1, 1, 1, 2, 3))))]
            words += [f"--{name}", *([] if kind == "bool" else values)]
        elif act < 6 and "--out" in words:
            words[words.index("--out") + 1 :] = [_one(OUTS, random)]
        elif act == 6:
            words[at:at] = [value]
        elif act == 7:
            words[at : at + 1] = []
        elif act == 8:
            words[at : at + 1] = words[at : at + 1] * 2
        else:
            words[at : at + 1] = [value]
    return words


@cache
def options(function: str) -> tuple[tuple[str, str], ...]:
    """Names of the options of a verb, and their types."""
    from hagoromo.app import cli

    assert cli.main  # with it, all modules that have verbs are loaded
    modules = [module for name, module in sys.modules.items() if name.startswith(("hagoromo.app.", "hagoromo_"))]
    found = (vars(module)[function] for module in modules if function in vars(module))
    called = next(one for one in found if inspect.isfunction(one) and one.__module__.startswith("hagoromo"))
    parameters = [one for one in inspect.signature(called).parameters.values() if one.name not in NEVER]
    return tuple(
        (one.name.replace("_", "-"), "bool" if one.default is False else str(one.annotation))
        for one in parameters
        if "Positional" not in str(one.annotation)
    )


def _fitting(kind: str, value: str, files: list[str], random: Random) -> str:
    """A value of the type that an option has, most of the time: what is refused at once tries little."""
    if random.random() < 0.2:
        return value
    if kind.startswith("Literal"):
        return _one(tuple(word.strip(" '\"") for word in kind[8:].split("]")[0].split(",")), random)
    if "Path" in kind and files:
        return f"{OUT}{_one(tuple(files), random)}"
    return _one(INTEGERS if "int" in kind else NUMBERS, random) if "float" in kind or "int" in kind else value


def _one(choices: tuple, random: Random) -> Any:
    return choices[int(random.integers(len(choices)))]


def _word(word: str, folder: Path) -> str:
    if not word.startswith(OUT):
        return word
    return f"{folder}{os.sep}{word.removeprefix(OUT)}"


def _names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def _run(arguments: list[str]) -> tuple[int, str]:
    """Exit status, and what was said on standard error."""
    from hagoromo.app.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said), _patience():
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            try:
                status = main(arguments)
            except SystemExit as end:  # --help
                status = int(end.code or 0)
    return status, said.getvalue()


@contextlib.contextmanager
def _patience() -> Iterator[None]:
    """Ctrl-C after `PATIENCE_S`."""
    before = signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
    signal.alarm(PATIENCE_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def function_of(case: CrashCase) -> str:
    """The name of what a command calls."""
    return "_".join(case.words[: 2 if case.words[0] == "calibrate" else 1])


_MADE = {case.name: case for case in CASES}
LOOKING = (
    CrashCase("info", _MADE["expose"].make, ("info", "scene.exr"), ("out",)),
    CrashCase("compare", _MADE["expose"].make, ("compare", "scene.exr", "scene.exr"), ("out",)),
)
SLOW = (
    "calibrate camera", "calibrate response", "simulate", "health", "measure", "measure unknown shape", "build",
    "build a texel", "render", "relight", "recover", "change",
)  # fmt: skip
VERBS = {case.name: Verb(case, function_of(case)) for case in (*CASES, *LOOKING) if case.name != "demo"}
