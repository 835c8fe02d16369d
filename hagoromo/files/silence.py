"""Nothing on standard output and error while a library reads: some write there about a file that they then refuse."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout


@contextmanager
def silenced() -> Iterator[None]:
    """Standard output and error lead nowhere within the block, those of C libraries as well."""
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            with redirect_stdout(nowhere):
                yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
