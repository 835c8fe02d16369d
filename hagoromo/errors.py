"""The one exception for what a user can mend: it says what is wrong, what was given, what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Bad input. The message is one line; the command line prints it and ends with exit status 2."""


@contextmanager
def described(where: str) -> Iterator[None]:
    """An `InputError` of the block says where the input came from, if it does not yet."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error) if where in str(error) else f"{where}: {error}") from error
