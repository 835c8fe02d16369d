"""One scene: Hagoromo at all its settings, then every peer in turn with the setting of ours that equals it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from peers_child import AbsentError, Child
from peers_hagoromo import reference
from peers_scene import STUDIES, PeerScene
from peers_table import PeerRow

OURS = "hagoromo"
BUDGET = 4.0  # s, of one setting, after which no further round begins; a longer frame is rendered once
LONGEST, GROWTH = 30.0, 4.0  # s, of a frame; the next setting is taken to need GROWTH times the last, and left out
EQUAL = 1.2  # errors whose ratio is below this are taken for equal


class PeerContest:
    """The contest on study `number`, with matter and passing files in `folder`."""

    def __init__(self, number: int, folder: Path, rounds: int) -> None:
        self.number, self.folder, self.rounds = number, folder, rounds
        self.scene = PeerScene(STUDIES[number], folder)
        print(f"{self.scene.study.name}: reference", flush=True)
        self.reference, self.matter = reference(self.scene)
        self.own: list[PeerRow] = []

    def rows(self) -> list[PeerRow]:
        """The table's rows, ours first."""
        self.ours, row = self.begin(OURS)
        try:
            for setting in self.ours.settings:
                self.own.append(self.measured(self.ours, replace(row, setting=setting)))
            return self.own + [row for peer in self.scene.study.peers for row in self.peer_rows(peer)]
        finally:
            self.ours.close()

    def peer_rows(self, peer: str) -> list[PeerRow]:
        """Rows of one peer, a setting after the other until they take too long; one row that says why it is absent."""
        rows: list[PeerRow] = []
        try:
            child, row = self.begin(peer)
            for setting in child.settings:
                if rows and GROWTH * rows[-1].seconds > LONGEST:
                    break
                rows.append(self.measured(child, replace(row, setting=setting)))
            child.close()
        except AbsentError as error:
            print(f"  {peer}: {error}", flush=True)
            rows.append(PeerRow(self.scene.study.name, peer, absent=str(error)))
        return rows

    def begin(self, contender: str) -> tuple[Child, PeerRow]:
        """A contender started with its kernel cache and a row with its first picture.

        On its first scene it is started once before, with an empty cache.
        """
        home, cold = self.folder / f"{contender} home", None
        if not home.exists():
            home.mkdir()
            child = Child(contender, self.number, self.folder, home)
            cold = child.first
            child.close()
        child = Child(contender, self.number, self.folder, home)
        return child, PeerRow(self.scene.study.name, contender, first_cold=cold, first_cached=child.first)

    def measured(self, child: Child, row: PeerRow) -> PeerRow:
        """The row filled in; a peer's frames alternate with those of our setting that equals it."""
        first = child.frame(row.setting)
        error, mean = self.difference(child.seen())
        rival = None if child is self.ours else self.rival(error)
        turns = [(child, row.setting), *([(self.ours, rival.setting)] if rival else [])]
        if first > BUDGET:
            taken, *ours = [first], *in_turn(turns[1:], self.rounds)
        else:
            child.frame(row.setting)  # the second frame may compile yet
            taken, *ours = in_turn(turns, self.rounds)
        seconds = float(np.median(taken))
        row = replace(row, seconds=seconds, rounds=len(taken), error=error, mean=mean, peak=child.peak)
        if rival:
            equal, ratio = rival.error <= EQUAL * error, seconds / float(np.median(ours))
            row = replace(row, ratio=ratio, against=rival.setting, as_accurate=equal)
        versus = f", {row.ratio:.1f} × ours ({rival.setting}: error {rival.error:.5f})" if rival else ""
        print(f"  {row.who}, {row.setting}: {seconds:.3f} s, error {error:.5f}{versus}", flush=True)
        return row

    def rival(self, error: float) -> PeerRow:
        """The quickest of our settings that is as accurate as `error`, else the most accurate."""
        equal = [row for row in self.own if row.error <= EQUAL * error]
        return min(equal, key=lambda row: row.seconds) if equal else min(self.own, key=lambda row: row.error)

    def difference(self, picture: NDArray) -> tuple[float, float]:
        """Relative rmse and ratio of the means against the reference, over the compared pixels that show matter."""
        seen, true = self.scene.sampled(picture)[self.matter], self.reference[self.matter]
        return float(np.sqrt(np.mean((seen - true) ** 2) / np.mean(true**2))), float(seen.mean() / true.mean())


def in_turn(turns: Sequence[tuple[Child, str]], rounds: int) -> list[list[float]]:
    """Times [s] of frames, A B A B …: a list for each (contender, setting); no new round once one took BUDGET."""
    times: list[list[float]] = [[] for _ in turns]
    for _ in range(rounds):
        for taken, (child, setting) in zip(times, turns, strict=True):
            taken.append(child.frame(setting))
        if max(map(sum, times), default=BUDGET) >= BUDGET:
            break
    return times
