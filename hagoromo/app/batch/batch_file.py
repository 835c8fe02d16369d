"""The recipe of a batch, a TOML file, and the steps that it stands for: one command each, with what it reads and needs.

    each = "captures/*"

    [[step]]
    name = "measured"
    verb = "measure"
    arguments = ["{path}"]
    options = { n = 1.5 }
    out = "measured/{name}"

{path} and {name} are a file or folder that `each` matches and its name without the suffix; {measured} is the result of
the step of that name, for the same match. A step that names none of them is done once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from hagoromo.errors import InputError, described
from hagoromo.files.checks import inside
from hagoromo.files.content import named_by
from hagoromo.files.record import Count, Record, about, decode, one_of, read_toml

VERBS = (
    "simulate", "develop", "capture", "convert", "calibrate", "measure", "build", "render", "expose", "relight",
)  # fmt: skip
MOST_STEPS = 200_000
PLACEHOLDER = re.compile(r"\{(\w*)\}")
OF_MATCH = ("path", "name")  # placeholders that differ between matches
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,63}$")]


class StepRecord(Record, frozen=True, kw_only=True):
    """A step: a command with its arguments, and where its result goes."""

    name: Annotated[Name, about("name of the step; later steps write {name of the step} for its result")]
    verb: Annotated[str, one_of(*VERBS), about("command of hagoromo")]
    arguments: Annotated[
        list[str],
        about("its arguments in their order; files and folders are relative to the recipe, inside its folder"),
    ] = []
    options: Annotated[
        dict[str, Any], about("its options without --: text, number, true, or a list of them; files as in arguments")
    ] = {}
    out: Annotated[str, about("where the result goes, inside the folder of the batch; {name} tells matches apart")]


class BatchRecord(Record, frozen=True, kw_only=True):
    """A batch: commands over many captures, scenes or recipes."""

    version_key = "format_version"

    each: Annotated[
        str | None, about("pattern of the files or folders that steps with {path} or {name} are repeated for")
    ] = None
    step: Annotated[list[StepRecord], about("the steps; one that uses the result of another stands after it")]
    format_version: Annotated[Count, about("version of the format of batch files")] = 1


class Input(NamedTuple):
    """A file or folder that a step reads: what its key calls it, and where it is."""

    label: str
    path: Path


@dataclass(frozen=True)
class Step:
    """A command of a batch. words: its arguments as they are run, the result's path not among them.

    says: the same words without the places of folders, for its key. needs: numbers of the steps whose results it reads.
    """

    name: str
    words: tuple[str, ...]
    says: tuple[str, ...]
    out: Path
    inputs: tuple[Input, ...]
    needs: tuple[int, ...]


class Match(NamedTuple):
    """What `each` found: {path}, relative to the recipe, and {name}."""

    path: str
    name: str


def read_batch(recipe: str | Path, out: Path) -> list[Step]:
    """The steps of the recipe in a TOML file, with results in the folder `out`; each stands after those it needs.

    `InputError` for a recipe that is none, a pattern that matches nothing, and results that would fall together.
    """
    recipe = Path(recipe)
    record = decode(read_toml(recipe), BatchRecord, str(recipe))
    with described(str(recipe)):
        repeated = _repeated(record)
        matches = list(_matches(record, recipe.parent, out)) if any(repeated.values()) else []
        if len(matches) * len(repeated) > MOST_STEPS:
            raise InputError(f"{len(matches)} matches of each give more than {MOST_STEPS} steps: divide the batch")
        plan = _Plan(recipe.parent, out)
        for step in record.step:
            if not repeated[step.name]:
                plan.add(step, None)
        for match in matches:
            for step in record.step:
                if repeated[step.name]:
                    plan.add(step, match)
    return plan.steps


def _repeated(record: BatchRecord) -> dict[str, bool]:
    """Step → whether it is repeated for every match."""
    repeated: dict[str, bool] = {}
    for step in record.step:
        if step.name in repeated or step.name in OF_MATCH:
            raise InputError(f"step {step.name!r}: the name is taken, give each step its own")
        used = {name for text in _texts(step) for name in PLACEHOLDER.findall(text)}
        unknown = used - set(repeated) - set(OF_MATCH)
        if unknown:
            known = ", ".join((*OF_MATCH, *repeated))
            raise InputError(f"step {step.name!r} uses {{{min(unknown)}}}: known are {known}; a step uses earlier ones")
        repeated[step.name] = any(name in OF_MATCH or repeated[name] for name in used)
        if repeated[step.name] and not {"name"} & set(PLACEHOLDER.findall(step.out)):
            raise InputError(f"step {step.name!r} is repeated and its out is {step.out!r}: write {{name}} in it")
    if not repeated:
        raise InputError("there is no [[step]]: give at least one")
    return repeated


def _texts(step: StepRecord) -> Iterator[str]:
    yield from step.arguments
    yield step.out
    for value in step.options.values():
        yield from (entry for entry in (value if isinstance(value, list) else [value]) if isinstance(entry, str))


def _matches(record: BatchRecord, folder: Path, out: Path) -> Iterator[Match]:
    pattern = PurePath(record.each or "")
    if not pattern.parts or pattern.is_absolute() or ".." in pattern.parts:
        raise InputError(f"each is {record.each!r}: give a pattern inside the folder of the recipe, such as captures/*")
    found = [path for path in sorted(folder.glob(str(pattern))) if not path.name.startswith(".")]
    found = [path for path in found if out.absolute() not in (path.absolute(), *path.absolute().parents)]
    if not found:
        raise InputError(f"each is {record.each!r}, which matches nothing in {folder}")
    for path in found:
        yield Match(path.relative_to(folder).as_posix(), path.name if path.is_dir() else path.stem)


class _Plan:
    """Steps in the making."""

    def __init__(self, folder: Path, home: Path) -> None:
        self.folder, self.home, self.steps = folder, home, list[Step]()
        self.made: dict[Path, int] = {}  # result → number of its step
        self.numbers: dict[tuple[str, Match | None], int] = {}

    def add(self, record: StepRecord, match: Match | None) -> None:
        """A step for a match of `each`; None: one that is done once."""
        values = {} if match is None else match._asdict()
        out = inside(self.home, PLACEHOLDER.sub(lambda found: values.get(found[1], found[0]), record.out)).absolute()
        title = f"{record.name} {match.name}" if match else record.name
        if out in self.made:
            raise InputError(f"{title} and {self.steps[self.made[out]].name} have one result, {out}: tell them apart")
        if out == self.home.absolute():
            raise InputError(f"{title} has no out: name a file or folder")
        words = _Words(self, values, match)
        words.add(*record.verb.split(), *record.arguments)
        for key, value in record.options.items():
            words.option(record.name, key, value)
        self.made[out], self.numbers[record.name, match] = len(self.steps), len(self.steps)
        step = Step(title, tuple(words.words), tuple(words.says), out, tuple(words.inputs), tuple(sorted(words.needs)))
        self.steps.append(step)

    def result(self, name: str, match: Match | None) -> int:
        """Number of the step of that name, for the match or for all."""
        return self.numbers[name, match] if (name, match) in self.numbers else self.numbers[name, None]


class _Words:
    """The words of a command, what they read and which steps they need."""

    def __init__(self, plan: _Plan, values: Mapping[str, str], match: Match | None) -> None:
        self.plan, self.values, self.match = plan, values, match
        self.words, self.says, self.inputs, self.needs = list[str](), list[str](), list[Input](), set[int]()

    def option(self, step: str, key: str, value: Any) -> None:
        """An option with its value."""
        if not re.fullmatch(r"[a-z][a-z0-9-]*", key) or key in ("out", "force", "scheduler"):
            raise InputError(f"step {step!r} has the option {key!r}: give one of its verb, without -- before it")
        if value is False:
            return
        self.words.append(f"--{key}")
        self.says.append(f"--{key}")
        for entry in () if value is True else value if isinstance(value, list) else (value,):
            if isinstance(entry, bool) or not isinstance(entry, (str, int, float)):
                raise InputError(
                    f"step {step!r}, option {key}: give text, a number, true or a list: given {entry!r:.60}"
                )
            self.add(str(entry))

    def add(self, *texts: str) -> None:
        """Words with their placeholders; one that is the path of a file or folder is an input."""
        for text in texts:
            needed: list[int] = []

            def value_of(found: re.Match[str], needed: list[int] = needed) -> str:
                if found[1] in self.values:
                    return self.values[found[1]]
                needed.append(self.plan.result(found[1], self.match))
                return str(self.plan.steps[needed[-1]].out)

            whole = PLACEHOLDER.sub(value_of, text)
            says = PLACEHOLDER.sub(lambda found: self.values.get(found[1], found[0]), text)
            self.says.append(says)
            self.needs |= set(needed)
            self.words.append(whole if needed else self._input(whole))

    def _input(self, text: str) -> str:
        """The word for `text`: where it is the path of an input, all of the path."""
        try:
            path = inside(self.plan.folder, text).absolute()
            there = bool(text) and (path.exists() or any(p in self.plan.made for p in (path, *path.parents)))
        except InputError:
            raise
        except (OSError, ValueError):
            return text  # no path
        if not there:
            return text
        for label, named in named_by(path, self.plan.made):
            maker = next((self.plan.made[p] for p in (named, *named.parents) if p in self.plan.made), None)
            if maker is None:
                self.inputs.append(Input(f"{text}{label}", named))
            else:
                self.needs.add(maker)
        return str(path)
