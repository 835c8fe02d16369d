"""Progress of long work: the share that is done, and the step that is being worked on.

A function that works for long takes `progress: Progress = silent` and calls it from time to time. Its caller decides
what becomes of these calls: a bar on the terminal, a line in a log, or nothing.
"""

from __future__ import annotations

from typing import Protocol

LOADING = 0.2  # of the work of a scene file, when its boxes are there


class Progress(Protocol):
    """Is called with the share of the work that is done, and the name of the step that is being worked on."""

    def __call__(self, share: float, step: str = "", /) -> None:
        """share: from 0 (begun) to 1 (done), never falling. step: a few words, empty where there is nothing to say."""


def silent(share: float, step: str = "") -> None:
    """Progress that nobody asked for."""


def part_of(progress: Progress, begin: float, length: float, name: str = "") -> Progress:
    """Progress of a part of the work, in terms of the whole: share s of the part is begin + length · s of the whole.

    name: of the part; it stands before the part's own steps.

    >>> report = part_of(lambda share, step="": print(f"{share:.2f} {step}"), 0.5, 0.25, "normals")
    >>> report(0.0), report(1.0, "tile 7")
    0.50 normals
    0.75 normals: tile 7
    (None, None)
    """
    if progress is silent:
        return silent

    def of_part(share: float, step: str = "") -> None:
        progress(begin + length * min(share, 1.0), ": ".join(text for text in (name, step) if text))

    return of_part
