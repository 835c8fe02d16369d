"""Judge: what may come of a spoilt file is a result, or one line that says what is wrong; nothing else is printed."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hagoromo.errors import LONGEST, InputError

READ, REFUSED, FAULT = "read", "refused", "fault"


class FuzzVerdict(NamedTuple):
    """outcome: READ, REFUSED or FAULT. kind: one for faults of the same cause. text: message, or what went wrong."""

    outcome: str
    kind: str = ""
    text: str = ""


def judged(read: Callable[[Path], Any], path: Path) -> FuzzVerdict:
    """The verdict on reading `path`, which must be done by a process that prints nothing of its own meanwhile."""
    with printed() as noise:
        verdict = _read(read, path)
    said = noise()
    if said.strip() and verdict.outcome != FAULT:
        return FuzzVerdict(FAULT, f"printed: {' '.join(said.split())[:60]}", said[-2000:])
    return verdict


def _read(read: Callable[[Path], Any], path: Path) -> FuzzVerdict:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", UserWarning)  # the package's own remarks
            warnings.simplefilter("error", RuntimeWarning)
            read(path)
    except InputError as error:
        wrong = wrong_message(str(error).replace(str(path.parent), "…"))
        return (
            FuzzVerdict(FAULT, f"message: {wrong}", repr(str(error))[:2000])
            if wrong
            else FuzzVerdict(REFUSED, text=str(error))
        )
    except OSError as error:
        if error.errno is not None and type(error).__module__ == "builtins":
            return FuzzVerdict(REFUSED, text=str(error))
        return _fault(error)
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        return _fault(error)
    return FuzzVerdict(READ)


def wrong_message(message: str) -> str:
    """What is wrong with a message: "" for one line of printable characters that a terminal can take."""
    if not message:
        return "empty"
    for character in message:
        if unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp"):
            return f"character {unicodedata.category(character)}"
    return "" if len(message) <= LONGEST else "too long"


def _fault(error: BaseException) -> FuzzVerdict:
    """kind: the exception, and the line of this package, or of the library, that it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame
        for frame in frames
        if f"{os.sep}hagoromo{os.sep}" in frame.filename and "site-packages" not in frame.filename
    ]
    place = own[-1] if own else frames[-1]
    kind = f"{type(error).__name__} in {Path(place.filename).name}:{place.name}"
    return FuzzVerdict(FAULT, kind, "".join(traceback.format_exception(error))[-3000:])


@contextmanager
def printed() -> Iterator[Callable[[], str]]:
    """Gives, when the block has ended, what this process wrote to its standard output and error, C libraries too."""
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        before = [os.dup(number) for number in (1, 2)]
        text: list[str] = []
        try:
            for number in (1, 2):
                os.dup2(file.fileno(), number)
            yield lambda: text[0]
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for number, old in zip((1, 2), before, strict=True):
                os.dup2(old, number)
                os.close(old)
            size = os.fstat(file.fileno()).st_size
            text.append(os.pread(file.fileno(), min(size, 100_000), 0).decode("utf-8", "replace"))
