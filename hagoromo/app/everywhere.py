"""Options of every command: --allow FOLDER, --verbose and --quiet; where messages go, and how they are printed."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from hagoromo.errors import InputError
from hagoromo.files.checks import ALLOWED
from hagoromo.files.names import printable

LOG = logging.getLogger("hagoromo")
HELP = (
    "Every command takes --allow FOLDER (files there may be named by scenes, recipes and captures of other folders), "
    "--verbose (what is done meanwhile, with times) and --quiet (errors and results alone)."
)


class Everywhere(NamedTuple):
    """allow: folders; level: of the messages that are shown, of `logging`."""

    allow: tuple[str, ...] = ()
    level: int = logging.WARNING


def taken(arguments: Sequence[str]) -> tuple[list[str], Everywhere]:
    """The arguments of the command alone, and the options of every command; `InputError` where one lacks its value."""
    rest: list[str] = []
    allow: list[str] = []
    levels: set[int] = set()
    given = iter(arguments)
    for word in given:
        if word == "--":
            rest += [word, *given]
        elif word == "--allow" or word.startswith("--allow="):
            folder = word.partition("=")[2] or next(given, "")
            if not os.path.isdir(folder):
                raise InputError(f"--allow needs a folder: given {printable(folder)!r}")
            allow.append(os.path.realpath(folder))
        elif word in ("--verbose", "--quiet"):
            levels.add(logging.DEBUG if word == "--verbose" else logging.ERROR)
        else:
            rest.append(word)
    if len(levels) > 1:
        raise InputError("--verbose and --quiet contradict each other: give one")
    return rest, Everywhere(tuple(allow), *levels)


@contextmanager
def everywhere(options: Everywhere) -> Iterator[None]:
    """Apply the options while a command runs; warnings and messages are lines on standard error."""
    if any(isinstance(each, _Lines) for each in LOG.handlers):  # within a batch, whose options hold
        yield
        return
    handler, before, allowed = _Lines(), LOG.level, os.environ.get(ALLOWED)
    LOG.addHandler(handler)
    LOG.setLevel(options.level)
    if options.allow:
        os.environ[ALLOWED] = os.pathsep.join([*options.allow, *filter(None, [allowed])])
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: LOG.warning("%s", message)
            yield
    finally:
        LOG.removeHandler(handler)
        LOG.setLevel(before)
        if options.allow:
            os.environ.pop(ALLOWED) if allowed is None else os.environ.update({ALLOWED: allowed})


def quiet() -> bool:
    """Whether errors and results alone are wanted."""
    return LOG.level > logging.WARNING


def verbose() -> bool:
    """Whether what is done meanwhile is wanted, too."""
    return 0 < LOG.level < logging.INFO


class _Lines(logging.Handler):
    """On standard error `hagoromo: warning: …`; what is done meanwhile, with the seconds since the start."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line."""
        kind = "warning" if record.levelno >= logging.WARNING else f"{record.relativeCreated / 1e3:.2f} s"
        print(f"hagoromo: {kind}: {printable(record.getMessage())}", file=sys.stderr)


def printable_streams() -> None:
    """Let standard output and standard error take any text: ΔE₀₀, α, arrows, names of files that are not Unicode.

    A file or pipe gets UTF-8 unless `PYTHONIOENCODING` says otherwise; Windows would choose a code page of 256
    characters. A terminal keeps its encoding. What an encoding lacks is written as an escape such as \\u0394. What is
    said on a standard error that is closed is lost.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is None:
            continue  # a stream of a notebook or of another program, or none at all
        if stream.isatty() or os.environ.get("PYTHONIOENCODING"):
            reconfigure(errors="backslashreplace")
        else:
            reconfigure(encoding="utf-8", errors="backslashreplace")


def give_up_streams() -> None:
    """Write nothing more to the standard streams: it would fail again when the process ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, OSError, ValueError):
            stream.flush()
            continue
        with contextlib.suppress(AttributeError, OSError, ValueError):
            os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
