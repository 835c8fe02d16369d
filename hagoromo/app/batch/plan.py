"""The plan of a batch: steps in their order, with what each reads, writes and needs.

Every file that a step names lies in the folder of the recipe or in that of the results, links followed, or where the
user allowed it. No two steps write one file, and none writes into the result of another.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hagoromo.app.batch.call import Call, call_of
from hagoromo.app.verb import Written, written_by_verb
from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.content import named_by
from hagoromo.files.format import file_and_part
from hagoromo.files.stores import address

PLACEHOLDER = re.compile(r"\{(\w*)\}")


class Input(NamedTuple):
    """A file or folder that a step reads: what its key calls it, and where it is."""

    label: str
    path: Path


@dataclass(frozen=True)
class Step:
    """A command of a batch. folder: of the recipe, in which it runs. says: its words without the places of folders, for
    its key. needs: numbers of the steps whose results it reads.
    """

    name: str
    call: Call
    folder: Path
    says: tuple[str, ...]
    written: Written
    inputs: tuple[Input, ...]
    needs: tuple[int, ...]

    @property
    def out(self) -> Path:
        """Where its result goes."""
        return self.written.files[0]


class Words(NamedTuple):
    """The words of a step of a recipe, with their placeholders. name: of the step; out: of its result."""

    name: str
    words: tuple[str, ...]
    out: str


class Match(NamedTuple):
    """What `each` found: {path}, relative to the recipe, and {name}."""

    path: str
    name: str


class Plan:
    """Steps in the making. folder: of the recipe; home: of the results."""

    def __init__(self, folder: Path, home: Path) -> None:
        self.folder, self.home, self.steps = folder.absolute(), home.absolute(), list[Step]()
        self.made: dict[Path, int] = {}  # file or folder that is written → number of its step
        self.numbers: dict[tuple[str, Match | None], int] = {}
        self.templates: dict[str, Call | None] = {}
        self.claims = Claims(home)

    def add(self, step: Words, match: Match | None) -> None:
        """A step for a match of `each`; None: one that is done once."""
        title, known = f"{step.name} {match.name}" if match else step.name, _values(match)
        numbers = {name: self.result(name, match) for word in step.words for name in PLACEHOLDER.findall(word)
                   if name not in known}  # fmt: skip
        places = known | {name: str(self.steps[number].out) for name, number in numbers.items()}
        with described(f"step {step.name!r}"):
            reads = _Reads(self, set(numbers.values()))
            call = self._call(step, places).changed(reads.placed)
            written = written_by_verb(call.function, self._out(_filled(step.out, known)))
        self.claims.add(title, written)
        for file in written.files:
            self.made[file] = len(self.steps)
        self.numbers[step.name, match] = len(self.steps)
        says = tuple(_filled(word, known) for word in step.words)
        needs, inputs = tuple(sorted(reads.needs)), tuple(reads.inputs)
        self.steps.append(Step(title, call, self.folder, says, written, inputs, needs))

    def result(self, name: str, match: Match | None) -> int:
        """Number of the step of that name, for the match or for all."""
        return self.numbers[name, match] if (name, match) in self.numbers else self.numbers[name, None]

    def within(self, text: str) -> Path:
        """The place that a path names; `InputError` where it is neither in the recipe's folder nor in the results."""
        if os.path.isabs(text) and Path(os.path.normpath(text)).is_relative_to(self.home):
            return inside(self.home, os.path.relpath(text, self.home))
        return inside(self.folder, text)

    def _call(self, step: Words, places: Mapping[str, str]) -> Call:
        """The call of a step. Its words are parsed once for all matches, unless a placeholder stands for a number."""
        if step.name not in self.templates:
            self.templates[step.name] = _template(step.words)
        template = self.templates[step.name]
        if template is None:
            return call_of([_filled(word, places) for word in step.words])
        return template.changed(lambda value: type(value)(_filled(str(value), places)))

    def _out(self, text: str) -> Path:
        out = inside(self.home, text).absolute()
        parts = out.relative_to(self.home).parts
        if not parts or any(part.startswith(".") for part in parts):
            raise InputError(f"its out is {text!r}: name a file or folder, no part of which begins with a dot")
        return out


def _values(match: Match | None) -> dict[str, str]:
    return {} if match is None else match._asdict()


def _filled(text: str, values: Mapping[str, str]) -> str:
    """The text with its placeholders replaced by `values`."""
    return PLACEHOLDER.sub(lambda found: values.get(found[1], found[0]), text)


def _template(words: Sequence[str]) -> Call | None:
    """The call that the words of a step make; None where that depends on what replaces a placeholder."""
    try:
        return call_of(words)
    except InputError:
        if any(PLACEHOLDER.search(word) for word in words):
            return None
        raise


class _Reads:
    """Inputs that the values of a call name, and steps whose results they use."""

    def __init__(self, plan: Plan, needs: set[int]) -> None:
        self.plan, self.needs, self.inputs = plan, needs, list[Input]()

    def placed(self, value: Any) -> Any:
        """A text or path of the call as the step takes it: the path of an input whole."""
        if isinstance(value, Path):
            return self._found(str(value), folders=True) or value
        for piece in _pieces(value):
            self._found(piece, folders=False)
        return value

    def _found(self, text: str, folders: bool) -> Path | None:
        """The place of a text that names an input or a result; `InputError` where it leads outside."""
        if address(text):
            self.inputs.append(Input(text, Path(text)))
            return None
        made, path = self.plan.made, self.plan.within(text).absolute()
        named, dataset = file_and_part(text)
        file = self.plan.within(named).absolute() if dataset else path
        try:
            there = file.exists() if folders else file.is_file()
        except (OSError, ValueError):
            return None  # no path
        if not text or not (there or any(place in made for place in (file, *file.parents))):
            return None
        for label, named in named_by(file, made):
            maker = next((made[place] for place in (named, *named.parents) if place in made), None)
            if maker is None:
                self.inputs.append(Input(f"{text}{label}", named))
            else:
                self.needs.add(maker)
        return path


def _pieces(text: str) -> Iterator[str]:
    """The parts of a text that may name a file: all of it, and what follows an equals sign, as in key=lamp.csv."""
    yield from dict.fromkeys((text, text.partition("=")[2] or text, text.rpartition("=")[2] or text))


class _Claim(NamedTuple):
    number: int  # of the step
    title: str


class Claims:
    """Paths that the steps write. home: the folder of all results."""

    def __init__(self, home: Path) -> None:
        self.home, self.count = Path(os.path.realpath(home)), 0
        self.files: dict[Path, _Claim] = {}
        self.above: dict[Path, _Claim] = {}  # folders that hold results
        self.pictures: dict[Path, _Claim] = {}  # starts of the names of pictures that a step may write
        self.starts: dict[Path, _Claim] = {}  # starts, up to an underscore, of the names of pictures that one writes

    def add(self, title: str, written: Written) -> None:
        """Note what the next step writes; `InputError` where another one writes it, too."""
        claim = _Claim(self.count, title)
        self.count += 1
        for file in written.files:
            self._file(claim, Path(os.path.realpath(file)))
        if written.pictures:
            start = Path(os.path.realpath(written.files[0])).with_name(written.pictures)
            self._refuse(claim, start, self.pictures, self.starts)
            self.pictures[start] = claim

    def _file(self, claim: _Claim, file: Path) -> None:
        above = [folder for folder in file.parents if folder != self.home and folder.is_relative_to(self.home)]
        name = file.name if file.suffix.lower() == ".png" else ""
        starts = [file.with_name(name[: place.end()]) for place in re.finditer("_", name)]
        self._refuse(claim, file, self.files, self.above)
        for folder in above:
            self._refuse(claim, folder, self.files)
        for start in starts:
            self._refuse(claim, start, self.pictures)
        self.files[file] = claim
        self.above |= dict.fromkeys(above, claim)
        self.starts |= dict.fromkeys(starts, claim)

    def _refuse(self, claim: _Claim, place: Path, *taken: Mapping[Path, _Claim]) -> None:
        """`InputError` where another step has the place."""
        other = next((each[place] for each in taken if place in each), claim)
        if other.number != claim.number:
            what = place.relative_to(self.home) if place.is_relative_to(self.home) else place
            raise InputError(f"{claim.title} and {other.title} would both write {what}: give one of them another out")
