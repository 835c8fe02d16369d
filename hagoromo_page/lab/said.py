"""What a command says, in the words of the window: its options are the choices and tools that stand for them here."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from hagoromo.calibration.lamps.ball_search import OFFERED, PAINT
from hagoromo_page.lab.folder import Circle
from hagoromo_page.lab.step import LabStep

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
OFFER = re.compile(rf"{re.escape(OFFERED)} \(--mask (?P<circle>[-\d.,]+) or [^)]*\), else {re.escape(PAINT)}")
COMMAND = re.compile(r" \(hagoromo [a-z ]+\)")  # that the window has no step for
ASKED = re.compile(r", and no terminal to ask at: .*")  # of `archive` without a profile
FILL_IN = ": fill in Made by, Institution and Licence under Who, where, with what"
DRAW, LOOK = "draw its circle with the tool Ball", "look at it, and drag it onto the ball"


class Said(NamedTuple):
    """text: a line; circle: of what may be the ball, where it offers one."""

    text: str
    circle: Circle | None


def in_the_window(line: str, step: LabStep, table: Sequence[LabStep]) -> Said:
    """A line of a command of `step`. Options that the window does not have stay as they are."""
    offered = OFFER.search(line)
    circle = None
    if offered is not None:
        x, y, radius = map(float, offered["circle"].split(","))
        circle = x, y, radius
        line = OFFER.sub(LOOK, line)
    labels = dict(_labels([*table[::-1], step]))
    line = COMMAND.sub("", ASKED.sub(FILL_IN, line.replace(PAINT, DRAW)))
    text = OPTION.sub(lambda found: labels.get(found[0], found[0]), line)
    return Said(text, circle)


def _labels(steps: Sequence[LabStep]) -> Iterator[tuple[str, str]]:
    for step in steps:
        yield from step.stands_for.items()
        yield from ((option.flag, option.label) for option in step.options if option.flag)
