"""The exception for wrong input: its message says what is wrong, what was given and what to do."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

LONGEST = 1000  # characters of a message: what is longer repeats a file
CONSIDERED = 2000  # characters at either end of a message that are looked at
PASSWORD = re.compile(r"(:/+)[^\s@:/]*:[^\s]*@")  # of an address such as scheme://user:password@host
BREAKS = re.compile(r"[\s\x1c-\x1f\x85\u2028\u2029]*[\n\r\t\v\f\x1c-\x1f\x85\u2028\u2029]\s*")


class InputError(ValueError):
    """Wrong input. The message is one line; the command line prints it and ends with exit status 2."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(message))


def listed(names: Sequence[str], most: int = 5) -> str:
    """Names in a sentence: the first `most`, and how many more there are.

    >>> listed(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def one_line(message: object) -> str:
    """A message as one line of printable characters, whatever names and values of a file it repeats.

    >>> one_line("a.json: name must be a text: given \x1b[31m")
    'a.json: name must be a text: given \\\\x1b[31m'
    """
    text = str(message)
    if len(text) > 2 * CONSIDERED:
        text = f"{text[:CONSIDERED]} … {text[-CONSIDERED:]}"
    text = escaped(BREAKS.sub(" ", text))
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 300]} … {text[-290:]}"


def without_password(text: str) -> str:
    """The text with "…" in place of user and password in the addresses that it holds.

    >>> without_password("tcp://me:opensesame@host:8786 does not answer")
    'tcp://…@host:8786 does not answer'
    """
    return PASSWORD.sub(r"\1…@", text) if "@" in text else text


def escaped(line: str) -> str:
    """The text with control and invisible characters as escapes such as \\x1b; blanks of any width stay.

    All that is shown to people goes through here, so that no password of an address is.
    """
    line = without_password(line)
    if line.isprintable():
        return line
    return "".join(sign if sign.isprintable() or unicodedata.category(sign) == "Zs" else _escape(sign) for sign in line)


def _escape(sign: str) -> str:
    return sign.encode("unicode_escape").decode("ascii")


@contextmanager
def described(where: str) -> Iterator[None]:
    """Prefix the message of an `InputError` of the block with `where`, the source of the input, if it lacks it."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error) if where in str(error) else f"{where}: {error}") from error
