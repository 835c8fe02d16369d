"""The call of a step: its words, read by the command line's own parser. What runs is the call, not the words.

A recipe may come from anyone. So the parser decides what a word is, not how it is spelt, and nothing is parsed again
after the values have been checked. --out, --force, --scheduler and the options of every command (--allow) are the
user's: a recipe has none of them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError

USERS = ("out", "force", "scheduler", "trust-scheduler", "allow", "verbose", "quiet")  # options that no recipe has
GROUPS = ("calibrate",)  # verbs whose next word says which of them
ELSEWHERE = "the result of a step"
NOT_HERE = "which only the user gives, on the command line of batch"


@dataclasses.dataclass(frozen=True)
class Call:
    """A command of the package with its arguments, but for where the result goes. function: of a module."""

    function: Callable[..., Any]
    values: dict[str, Any]

    def changed(self, change: Callable[[Any], Any]) -> Call:
        """The call with every text and path among its values replaced by what `change` makes of it."""
        return Call(self.function, {name: _changed(value, change) for name, value in self.values.items()})

    def to(self, out: Path) -> Callable[[], int | None]:
        """The call with its result at `out`, in place of what is there; ready to run."""
        from hagoromo.app.stage import run_staged

        return functools.partial(run_staged, self.function, **self.values, out=out, force=True)


def call_of(words: Sequence[str]) -> Call:
    """The call that the words of a step stand for; `InputError` for words that are none, or have what is the user's."""
    from hagoromo.app.shared_options import HERE, SchedulerOptions

    begin = 2 if words[0] in GROUPS else 1
    command = _command([*words[:begin], "--out", ELSEWHERE, *words[begin:]])
    values = dict(command.keywords)
    if str(values.pop("out")) != ELSEWHERE:  # the last one counts
        raise InputError(f"it has --out, {NOT_HERE}: its out says where the result goes")
    if values.pop("force"):
        raise InputError(f"it has --force, {NOT_HERE}")
    if any(isinstance(value, SchedulerOptions) and value != HERE for value in values.values()):
        raise InputError(f"it has --scheduler, {NOT_HERE}")
    return Call(command.args[0], values)


def _command(words: Sequence[str]) -> functools.partial[int | None]:
    from hagoromo.app.cli import parsed

    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return parsed(words)
    except SystemExit:
        raise InputError("it asks for help (--help), which is no command") from None


def _changed(value: Any, change: Callable[[Any], Any]) -> Any:
    if isinstance(value, (str, Path)):
        return change(value)
    if isinstance(value, tuple):
        return tuple(_changed(one, change) for one in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return dataclasses.replace(value, **{name: _changed(one, change) for name, one in fields.items()})
    if value is None or isinstance(value, (bool, int, float)):
        return value
    raise TypeError(f"a value of {type(value)} in a command: say whether it names a file")
