"""Spoilt files of every kind are read, or refused in one line without anything printed; files that once were not, too.

`make fuzz` tries more; here every reader, and every verb that does not take long, is given a fixed number of seeds.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from fuzz.judge import FAULT, judged, wrong_message
from fuzz.mutators import spoilt
from fuzz.readers import READERS
from fuzz.run import fuzzed, report
from fuzz.verbs import SLOW

CORPUS = Path(__file__).resolve().parents[2] / "fuzz" / "corpus"
FILES = sorted(path for path in CORPUS.rglob("*") if path.is_file())
COUNT = 10
SESSIONS = ".session"  # of the viewer, which tests/app/test_view_messages.py tries in a process that has one
QUICK = [name for name in READERS if name.removeprefix("verb-") not in SLOW and not name.endswith(SESSIONS)]


@pytest.mark.parametrize("half", [0, 1])
def test_spoilt_files_are_read_or_refused_in_one_line(half):
    """In a process of its own, whose memory is bounded, and which may crash."""
    outcome = fuzzed(QUICK[half::2], count=COUNT)
    assert not outcome.faults, report(outcome)
    assert sum(tally.total() for tally in outcome.tallies.values()) > 20 * COUNT


@pytest.mark.parametrize("file", FILES, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_files_that_once_failed_are_refused(tmp_path, file, capfd):
    """Corpus: one file of each kind that was found, with what is beside it in a good sample."""
    reader = READERS[file.parent.name]
    path = tmp_path / (reader.entry or reader.name)
    if reader.entry:
        reader.write(tmp_path)
    shutil.copy(file, path)
    with capfd.disabled():
        verdict = judged(reader.read, path)
    assert verdict.outcome != FAULT, verdict.text


def test_the_judge_sees_what_is_wrong(tmp_path, capfd):
    """A traceback, a message of two lines and a printed line are faults."""

    def prints(path):
        print("noise")

    with capfd.disabled():
        assert judged(lambda path: 1 // 0, tmp_path).kind.startswith("ZeroDivisionError")
        assert judged(prints, tmp_path).kind == "printed: noise"
        assert judged(lambda path: path, tmp_path).outcome == "read"
    assert (
        wrong_message("a\nb") and wrong_message("\x1b[31m") and wrong_message("\ud800") and not wrong_message("a — b")
    )


def test_a_seed_spoils_a_file_in_one_way():
    data = bytes(range(256)) * 4
    several = [spoilt("a.png", data, np.random.default_rng(seed)) for seed in range(20)]
    assert several == [spoilt("a.png", data, np.random.default_rng(seed)) for seed in range(20)]
    assert len(set(several)) > 15
