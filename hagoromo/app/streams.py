"""Standard output and standard error that can print every message, whatever encoding the system has set for them."""

from __future__ import annotations

import contextlib
import os
import sys


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
