"""Silence: C libraries that parse a file write nothing to standard output and standard error.

Some libraries print messages about a damaged file in addition to the error that they return.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout


@contextmanager
def silenced() -> Iterator[None]:
    """Discard standard output and standard error within the block, also those of C libraries."""
    stderr = os.dup(2)
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            with redirect_stdout(nowhere):
                yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
