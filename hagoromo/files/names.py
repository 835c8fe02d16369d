"""Names: texts that files bring, made safe to show in a terminal and in a plot.

A name in a file may hold codes that clear a terminal, write over what stands there, or turn its direction.
"""

from __future__ import annotations

from hagoromo.errors import escaped


def printable(text: object) -> str:
    """The text in one line, `escaped`; line ends and other whitespace are one blank."""
    return escaped(" ".join(str(text).split()))


def reason(error: BaseException, most: int = 200) -> str:
    """The message of an exception in one line of at most `most` characters; its type if it has no message."""
    return printable(error)[:most] or type(error).__name__


def plot_label(text: str) -> str:
    """The text as a label of Matplotlib, which takes dollars for the marks of a formula and hides names after _."""
    shown = printable(text).replace("$", r"\$")
    return f"\u200b{shown}" if shown.startswith("_") else shown
