"""A verb of the command line: a function whose arguments are the command's, run after all of them were read."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import arg

Out = Annotated[Path, arg(help="where to write the result")]
Force = Annotated[bool, arg(help="replace an existing result")]

verbs = tyro.extras.SubcommandApp()


def verb(group: Any, name: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a function a verb of `group`; parsing gives it back with its arguments, not yet run."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def prepared(*args: Any, **kwargs: Any) -> Callable[[], None]:
            return functools.partial(function, *args, **kwargs)

        group.command(prepared, name=name or function.__name__)
        return function

    return register


def wrote(*paths: Path) -> None:
    """Say which files a verb wrote."""
    for path in paths:
        print(f"wrote {path}")
