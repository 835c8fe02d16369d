"""Registration of commands: a function becomes a command with its arguments, and runs after they have been parsed."""

from __future__ import annotations

import functools
import glob
import inspect
import os
import shutil
import sys
import textwrap
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro
from tyro.conf import arg

from hagoromo.app.everywhere import quiet
from hagoromo.app.stage import named, run_staged
from hagoromo.errors import escaped

Out = Annotated[Path, arg(help="where to write the result")]
Force = Annotated[bool, arg(help="replace an existing result")]

CONTINUED = " " * 8  # before a further line of an argument, in a docstring
verbs = tyro.extras.SubcommandApp()
abouts: dict[str, str] = {}  # of the commands of `verbs`: the first paragraphs of their docstrings
_writes: dict[Callable[..., Any], Writes] = {}


class Written(NamedTuple):
    """What a command writes. files: files and folders, that of --out first.

    pictures: start of the names of further pictures beside it, START…_….png with a number, as many as its input has;
    "": none.
    """

    files: tuple[Path, ...]
    pictures: str = ""

    def there(self) -> tuple[Path, ...]:
        """Which of them exist."""
        out = self.files[0]
        beside = out.parent.glob(f"{glob.escape(self.pictures)}[0-9]*_*.png") if self.pictures else ()
        return (*(file for file in self.files if file.exists()), *sorted(beside))


Writes = Callable[[Path], Written]


def alone(out: Path) -> Written:
    """The file or folder itself."""
    return Written((out,))


def with_picture(out: Path) -> Written:
    """A file, and a picture of it beside it."""
    return Written((out, out.with_suffix(".png")))


def picture_or_film(out: Path) -> Written:
    """What `render` writes: a picture and its PNG, a film and the folder of its frames, or that folder alone."""
    from hagoromo.files.film_file import SUFFIXES, frames_of

    if out.suffix.lower() in SUFFIXES:
        return Written((out, frames_of(out)))
    return with_picture(out) if out.suffix else alone(out)


def response_files(out: Path) -> Written:
    """What `calibrate response` writes: the curves, their intervals, what was found, and a plot."""
    from hagoromo.calibration.response.response_calibration import ResponseCalibration

    return Written((*ResponseCalibration.paths(out), out.with_suffix(".png")))


def verb(
    group: Any, name: str | None = None, writes: Writes = alone
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function as a command of `group`; parsing returns it with its arguments, without running it.

    writes: what it writes for the name that --out gives it.
    """

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        function.__doc__ = unbroken(function.__doc__ or "")

        @functools.wraps(function)
        def prepared(*args: Any, **kwargs: Any) -> Callable[[], Any]:
            return functools.partial(run_staged, function, *args, **kwargs)

        _writes[function] = writes
        if group is verbs:
            abouts[name or function.__name__] = function.__doc__.partition("\n\n")[0].replace("\n", " ")
        group.command(prepared, name=name or function.__name__)
        return function

    return register


def overview(description: str) -> str:
    """What `hagoromo --help` prints: a few lines for each command, whose own help says the rest."""
    columns = shutil.get_terminal_size().columns
    indent = max(map(len, abouts)) + 4
    lines = (f"  {name}".ljust(indent) + about for name, about in sorted(abouts.items()))
    wrapped = (textwrap.fill(line, columns, subsequent_indent=" " * indent, break_long_words=False) for line in lines)
    head = "usage: hagoromo COMMAND ...", "", textwrap.fill(description, columns), ""
    return "\n".join([*head, "Commands; `hagoromo COMMAND --help` says more:", "", *wrapped])


def unbroken(docstring: str) -> str:
    """A docstring with the text of each argument in one line: a terminal breaks lines where it is full."""
    lines: list[str] = []
    for line in inspect.cleandoc(docstring).splitlines():
        if line.startswith(CONTINUED):
            lines[-1] += f" {line.strip()}"
        else:
            lines.append(line)
    return "\n".join(lines)


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


def show_in_browser(address: str) -> None:
    """Open an address where there is a screen; elsewhere a browser that runs in the terminal might be begun."""
    import webbrowser

    if sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
