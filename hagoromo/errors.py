"""The exception for wrong input: its message says what is wrong, what was given and what to do."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """Wrong input. The message is one line; the command line prints it and ends with exit status 2."""


@contextmanager
def described(where: str) -> Iterator[None]:
    """Prefix the message of an `InputError` of the block with `where`, the source of the input, if it lacks it."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error) if where in str(error) else f"{where}: {error}") from error
