"""Step: a command of the window, as a row of its table has it; its words, shown text and state derive from it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hagoromo_page.lab.folder import Folder, Made

PROGRAM = "hagoromo"
State = Literal["to do", "done", "out of date"]


@dataclass(frozen=True)
class Option:
    """A choice that becomes words of a command.

    flag: of the command; "": the step's own words say it. choices: value → what people read; none: free text.
    many: whether the value is words, each chosen by itself. default, choices: of a folder. aside: seldom needed.
    """

    name: str
    label: str
    flag: str
    choices: Callable[[Folder], dict[str, str]] | None = None
    default: Callable[[Folder], str] = lambda folder: ""
    many: bool = False
    hint: str = ""
    aside: bool = False

    def value(self, step: str, folder: Folder) -> str:
        """What was chosen in a folder; the default where that is not offered, or would be an option."""
        chosen, default = folder.option(step, self.name, self.default(folder)), self.default(folder)
        known = None if self.choices is None else self.choices(folder)
        offered = not chosen.startswith("-") if known is None else set(self._parts(chosen)) <= set(known)
        return chosen if offered else default

    def words(self, step: str, folder: Folder) -> list[str]:
        """Its words in a command."""
        parts = [part for part in self._parts(self.value(step, folder)) if part]
        return [self.flag, *parts] if self.flag and parts else []

    def _parts(self, value: str) -> list[str]:
        return value.split() if self.many else [value]


@dataclass(frozen=True)
class LabStep:
    """A command of the window.

    verb: its first words. given: the words that follow. reads: files it depends on, beside results of the steps
    `after`, which are run before it. makes: what it writes, in the folder. applies: whether there is anything to do.
    stands_for: what in the window says an option of the command that is in none of `options`. lacks: what must be
    filled in first.
    """

    name: str
    title: str
    does: str
    verb: tuple[str, ...]
    given: Callable[[Folder], list[str]]
    makes: str
    options: tuple[Option, ...] = ()
    reads: Callable[[Folder], Sequence[str]] = lambda folder: ()
    after: tuple[LabStep, ...] = ()
    applies: Callable[[Folder], bool] = lambda folder: True
    opens: tuple[str, ...] = field(default=())
    stands_for: Mapping[str, str] = field(default_factory=dict)
    lacks: Callable[[Folder], Sequence[str]] = lambda folder: ()

    def value(self, option: str, folder: Folder) -> str:
        """What was chosen for an option in a folder."""
        return next(one for one in self.options if one.name == option).value(self.name, folder)

    def plain_words(self, folder: Folder) -> list[str]:
        """The words of its command in a folder, without --force."""
        chosen = [word for option in self.options for word in option.words(self.name, folder)]
        return [*self.verb, *self.given(folder), *chosen, "--out", self.makes]

    def words(self, folder: Folder) -> list[str]:
        """The words of its command as it is to be run now: --force where its result is there already."""
        return [*self.plain_words(folder), *(["--force"] if (folder.home / self.makes).exists() else [])]

    def shown(self, folder: Folder) -> str:
        """The command as people copy it into a terminal: all photographs of a folder are *.jpg there, if it is safe."""
        text = f" {shlex.join([PROGRAM, *self.words(folder)])} "
        for names in {folder.photographs, folder.ball_photographs}:
            pattern, listed = _pattern(folder, names), f" {shlex.join(as_words(names))} "
            text = text.replace(listed, f" {pattern} ") if pattern else text
        return text.strip()

    def made(self, folder: Folder) -> Made:
        """What its result would be made of now."""
        needed = [one.makes for one in self.after if one.applies(folder)]
        return Made(self.plain_words(folder), folder.read_digest([*self.reads(folder), *needed]))

    def state(self, folder: Folder) -> State:
        """Whether its result is there, and still what the command would give.

        A result that was made outside of the window is taken as it is.
        """
        if not (folder.home / self.makes).exists():
            return "to do"
        before = [one for one in self.after if one.applies(folder)]
        kept = folder.record.made.get(self.name)
        stale = any(one.state(folder) != "done" for one in before) or kept not in (None, self.made(folder))
        return "out of date" if stale else "done"

    def chain(self, folder: Folder) -> list[LabStep]:
        """The steps to run for its result: those before it that are not done, and itself."""
        chained: list[LabStep] = []
        for one in self.after:
            if one.applies(folder) and one.state(folder) != "done":
                chained += [each for each in one.chain(folder) if each not in chained]
        return [*chained, self]


def as_words(names: Sequence[str]) -> list[str]:
    """Names as a command takes them: one that begins with - is no option."""
    return [f"./{name}" if name.startswith("-") else name for name in names]


def _pattern(folder: Folder, names: Sequence[str]) -> str:
    """What a shell expands to `names`, in their order; "" where another shell might have another order, or other files.

    Names are of one length, of letters, digits, _ and -, and in the order of their characters.
    """
    home, suffix = (Path(names[0]).parent, Path(names[0]).suffix) if len(names) > 1 else (Path(), "")
    plain = rf"[A-Za-z0-9_][\w-]*{re.escape(suffix)}"
    stems = [Path(name).name for name in names]
    alike = len({len(stem) for stem in stems}) == 1 and all(re.fullmatch(plain, stem, re.ASCII) for stem in stems)
    there = sorted(one.name for one in folder.file(str(home)).glob(f"*{suffix}") if not one.name.startswith("."))
    whole = (
        suffix
        and alike
        and stems == there
        and stems == sorted(stems, key=str.lower)
        and shlex.quote(str(home)) == str(home)
    )
    return str(home / f"*{suffix}") if whole else ""
