"""Reading: what a library raises about a damaged file becomes one line that names the file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.memory import is_shortage, shortage
from hagoromo.files.names import reason


@contextmanager
def reading(path: str | Path, what: str) -> Iterator[None]:
    """Turn any exception of the block but `InputError` into one: libraries raise what comes to them at damaged bytes.

    what: what the file is read as, such as "TIFF". Only calls of a library and the use of what it gave belong in the
    block. Warnings of the library about the file are not shown.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except InputError:
        raise
    except Exception as error:
        if is_shortage(error):
            raise InputError(f"{path}: {shortage(error)}") from error
        raise InputError(f"{path} cannot be read as {what}, it may be cut off or damaged: {reason(error)}") from error
