"""Registration of commands: a function becomes a command with its arguments, and runs after they have been parsed."""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import arg

from hagoromo.app.everywhere import quiet
from hagoromo.app.stage import named, run_staged
from hagoromo.app.written import Writes, Written, alone
from hagoromo.errors import escaped

Out = Annotated[Path, arg(help="where to write the result")]
Force = Annotated[bool, arg(help="replace an existing result")]

verbs = tyro.extras.SubcommandApp()
_writes: dict[Callable[..., Any], Writes] = {}


def verb(
    group: Any, name: str | None = None, writes: Writes = alone
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function as a command of `group`; parsing returns it with its arguments, without running it.

    writes: what it writes for the name that --out gives it.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def prepared(*args: Any, **kwargs: Any) -> Callable[[], Any]:
            return functools.partial(run_staged, function, *args, **kwargs)

        _writes[function] = writes
        group.command(prepared, name=name or function.__name__)
        return function

    return register


def load_verbs() -> None:
    """Add the commands of the packages beside the core: modules by entry points of the group `hagoromo.verbs`."""
    for point in sorted(entry_points(group="hagoromo.verbs"), key=lambda point: point.name):
        point.load()


def written_by_verb(function: Callable[..., Any], out: Path) -> Written:
    """What the command that calls `function` writes for the name `out`."""
    return _writes[function](out)


def wrote(*paths: Path) -> None:
    """Print the files that a command wrote, unless results alone are wanted."""
    for path in () if quiet() else paths:
        say(f"wrote {named(path)}")


def say(*lines: str) -> None:
    """Print lines, in which names from files may stand, without the codes that a terminal obeys."""
    for line in lines:
        print(escaped(line))
