"""The recipe of a batch, a TOML file, and the steps that it stands for: one command each, with what it reads and needs.

    each = "captures/*"

    [[step]]
    name = "measured"
    verb = "measure"
    arguments = ["{path}"]
    options = { n = 1.5 }
    out = "measured/{name}"

{path} and {name} are a file or folder that `each` (a pattern, or a list of them) matches and its name without the
suffix; {measured} is the result of the step of that name, for the same match. A step that names none of them is done
once. A step may have an `each` of its own: it, and the steps that use its result, are then repeated for that.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Any

from hagoromo.app.batch.batch_record import BatchRecord, StepRecord
from hagoromo.app.batch.call import USERS
from hagoromo.app.batch.plan import PLACEHOLDER, Match, Plan, Step, Words
from hagoromo.errors import InputError, described
from hagoromo.files.record import decode, read_toml

MOST_STEPS = 200_000
OF_MATCH = ("path", "name")  # placeholders that differ between matches
Each = tuple[str, ...]  # patterns


def read_batch(recipe: str | Path, out: Path) -> list[Step]:
    """The steps of the recipe in a TOML file, with results in the folder `out`; each stands after those it needs.

    `InputError` for a recipe that is none, a pattern that matches nothing, and results that would fall together.
    """
    recipe = Path(recipe)
    record = decode(read_toml(recipe), BatchRecord, str(recipe))
    with described(str(recipe)):
        repeated = _repeated(record)
        matches = {each: list(_matches(each, recipe.parent, out)) for each in filter(None, repeated.values())}
        if sum(len(matches[each]) for each in repeated.values() if each) > MOST_STEPS:
            raise InputError(f"the matches of each give more than {MOST_STEPS} steps: divide the batch")
        plan, words = Plan(recipe.parent, out), {step.name: _words(step) for step in record.step}
        for name, each in repeated.items():
            if not each:
                plan.add(words[name], None)
        for each, found in matches.items():
            for match in found:
                for name in (name for name, own in repeated.items() if own == each):
                    plan.add(words[name], match)
    return plan.steps


def _repeated(record: BatchRecord) -> dict[str, Each]:
    """Step → patterns of what it is repeated for; none for a step that is done once."""
    repeated: dict[str, Each] = {}
    for step in record.step:
        if step.name in repeated or step.name in OF_MATCH:
            raise InputError(f"step {step.name!r}: the name is taken, give each step its own")
        used = {name for text in _texts(step) for name in PLACEHOLDER.findall(text)}
        unknown = used - set(repeated) - set(OF_MATCH)
        if unknown:
            known = ", ".join((*OF_MATCH, *repeated))
            raise InputError(f"step {step.name!r} uses {{{min(unknown)}}}: known are {known}; a step uses earlier ones")
        repeated[step.name] = _each(step, record, {repeated[name] for name in used & set(repeated)} - {()}, used)
        if repeated[step.name] and "name" not in PLACEHOLDER.findall(step.out):
            raise InputError(f"step {step.name!r} is repeated and its out is {step.out!r}: write {{name}} in it")
    if not repeated:
        raise InputError("there is no [[step]]: give at least one")
    return repeated


def _each(step: StepRecord, record: BatchRecord, needed: set[Each], used: set[str]) -> Each:
    """The patterns of a step; needed: those of the steps whose results it uses."""
    if not needed and not used & set(OF_MATCH):
        if step.each is not None:
            raise InputError(f"step {step.name!r} has each and names neither {{path}} nor {{name}}: write one of them")
        return ()
    own = step.each if step.each is not None or needed else record.each
    if own is not None:
        needed = needed | {tuple([own] if isinstance(own, str) else own)}
    if len(needed) > 1:
        raise InputError(f"step {step.name!r} uses results for other files than it is repeated for: give both one each")
    return next(iter(needed), ()) or ("",)


def _texts(step: StepRecord) -> Iterator[str]:
    yield from step.arguments
    yield step.out
    for value in step.options.values():
        yield from (entry for entry in (value if isinstance(value, list) else [value]) if isinstance(entry, str))


def _matches(each: Each, folder: Path, out: Path) -> Iterator[Match]:
    """What the patterns match in the folder of the recipe, each once, in the order of the patterns."""
    paths: dict[Path, None] = {}
    for text in each:
        pattern = PurePath(text)
        if not pattern.parts or pattern.is_absolute() or ".." in pattern.parts:
            raise InputError(
                f"each is {text or None!r}: give a pattern inside the folder of the recipe, such as captures/*"
            )
        found = [path for path in sorted(folder.glob(str(pattern))) if not path.name.startswith(".")]
        found = [path for path in found if out.absolute() not in (path.absolute(), *path.absolute().parents)]
        if not found:
            raise InputError(f"each is {text!r}, which matches nothing in {folder}")
        paths |= dict.fromkeys(found)
    for path in paths:
        yield Match(path.relative_to(folder).as_posix(), path.name if path.is_dir() else path.stem)


def _words(step: StepRecord) -> Words:
    """The words of a step: its verb, arguments and options."""
    words = [*step.verb.split(), *step.arguments]
    for key, value in step.options.items():
        words += _option(step.name, key, value)
    return Words(step.name, tuple(words), step.out)


def _option(step: str, key: str, value: Any) -> Iterator[str]:
    """The words of an option with its value."""
    if not re.fullmatch(r"[a-z][a-z0-9-]*", key) or key in USERS:
        raise InputError(f"step {step!r} has the option {key!r}: give one of its verb, without -- before it")
    if value is False:
        return
    yield f"--{key}"
    for entry in () if value is True else value if isinstance(value, list) else (value,):
        if isinstance(entry, bool) or not isinstance(entry, (str, int, float)):
            raise InputError(f"step {step!r}, option {key}: give text, a number, true or a list: given {entry!r:.60}")
        yield str(entry)
