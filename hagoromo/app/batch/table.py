"""What became of the steps of a batch, and their table: those that failed or would run, and how many of each kind."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

State = Literal["done", "unchanged", "failed", "not run"]
WIDEST = 40  # letters of a column of names


@dataclass(frozen=True)
class Outcome:
    """The result of a step. said: its last line, if it failed. seconds: its duration."""

    step: str
    out: Path
    state: State
    said: str = ""
    seconds: float = 0.0


def table(outcomes: Sequence[Outcome], dry_run: bool = False) -> list[str]:
    """A line per step that failed or was not run, with its reason; of a dry run, a line per step."""
    shown = [one for one in outcomes if dry_run or one.state in ("failed", "not run")]
    width = min(max((len(one.step) for one in shown), default=0), WIDEST)
    words = {"not run": "would run"} if dry_run else {}
    return [f"{one.step:{width}}  {words.get(one.state, one.state):9}  {one.said}".rstrip() for one in shown]


def summary(outcomes: Sequence[Outcome], dry_run: bool = False) -> str:
    """How many steps are done, unchanged, failed and not run."""
    count = Counter(one.state for one in outcomes)
    if dry_run:
        return f"{count['not run']} of {len(outcomes)} steps would run, {count['unchanged']} are unchanged"
    kinds = ("done", "unchanged", "failed", "not run")
    return f"{len(outcomes)} steps: " + ", ".join(f"{count[kind]} {kind}" for kind in kinds if count[kind])
