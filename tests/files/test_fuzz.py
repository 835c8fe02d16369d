"""Spoilt files of every kind are read, or refused in one line without anything printed; files that once were not, too.

`make fuzz` tries more; here every reader, and every verb that does not take long, is given a fixed number of seeds.
"""

import json
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest

from fuzz import extremes
from fuzz.judge import FAULT, judged, wrong_message
from fuzz.mutators import spoilt
from fuzz.readers import READERS, Reader
from fuzz.run import fuzzed, report, swapped
from fuzz.trees import SWAPS, nodes_of, swaps
from fuzz.verbs import SLOW, WORDS
from fuzz.worker import FuzzSample, swapped_file, tried

CORPUS = Path(__file__).resolve().parents[2] / "fuzz" / "corpus"
FILES = sorted(path for path in CORPUS.rglob("*") if path.is_file())
COUNT = 10
SESSIONS = ".session"  # of the viewer, which tests/app/test_view_messages.py tries in a process that has one
QUICK = [name for name in READERS if name.removeprefix("verb-") not in SLOW and not name.endswith(SESSIONS)]


@pytest.mark.nightly
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


def test_a_swap_is_one_node_of_another_type():
    """Every node of the tree by every type, the root of TOML by tables alone."""
    tree = {"a": [1, {"b": "text"}], "c": True}
    text = 'a = [1, {b = "text"}]\nc = true\n'
    for name, data, read in (("a.json", json.dumps(tree), json.loads), ("a.toml", text, tomllib.loads)):
        found: dict[tuple, set[type]] = {path: set() for path, _ in nodes_of(tree)}
        for made in swaps(name, data.encode(), 99):
            swapped_tree = read(made.decode())
            others = dict(nodes_of(swapped_tree))
            for path, value in nodes_of(tree):
                if path not in others or type(others[path]) is not type(value):
                    found[path].add(type(others.get(path)))
                    break
        types = {type(None), bool, int, float, str, list, dict}
        for path, value in nodes_of(tree):
            assert found[path] >= types - {type(value)} if path or name == "a.json" else not found[path], path
        roots = list(swaps(name, data.encode(), 0))
        assert roots == list(swaps(name, data.encode(), 99))[: len(roots)]
        assert len(roots) == (len(SWAPS) if name == "a.json" else 2)


@pytest.mark.nightly
def test_swaps_of_a_reader_are_tried_to_the_last():
    outcome = swapped(["camera-calibration.json"])
    assert not outcome.faults, report(outcome)
    assert outcome.tallies["camera-calibration.json"]["refused"] > 200


def test_arguments_of_commands_are_no_file_to_swap():
    reader = READERS["verb-info"]
    words = FuzzSample({WORDS: b"[]"}, False)
    assert swapped_file(reader, words, 0) is None


def test_extremes_are_deep_long_or_many():
    """Each is made of the sample by its seed; none is larger than it may be."""
    text = b'<a b="c"><d>long text</d><e/></a>\n<f g="h"/>\n'
    largest = 3 * extremes.LARGEST
    for act in (*extremes.XML, *extremes.TEXT, *extremes.BINARY):
        made = [act(text, np.random.default_rng(seed)) for seed in range(30)]
        assert made == [act(text, np.random.default_rng(seed)) for seed in range(30)]
        assert len(set(made)) > 1 and max(map(len, made)) < largest
    deep = [extremes.leaf_nested(text, np.random.default_rng(seed)) for seed in range(30)]
    assert max(len(re.findall(rb"<d>", made)) for made in deep) == extremes.DEEP + 1
    header = b"\x40\x00\x00\x01" * 8
    stated = {extremes.stated_size(header, np.random.default_rng(seed)) for seed in range(50)}
    assert any((2**16 - 1).to_bytes(2, "big") in made for made in stated)


@pytest.mark.parametrize(
    ("bound", "lowered", "act", "said"),
    [
        ("MOST_MEMORY", 50 << 20, lambda path: bytearray(200 << 20), "GiB of memory"),
        ("MOST_SECONDS", 0.2, lambda path: sum(range(20_000_000)), "s of computing"),
    ],
    ids=["memory", "seconds"],
)
def test_what_takes_too_much_is_a_fault(tmp_path, monkeypatch, bound, lowered, act, said):
    """Counted; one bound is lowered, not to take as much here."""
    monkeypatch.setattr(f"fuzz.costs.{bound}", lowered)
    reader = Reader("a.txt", lambda path: None, act)
    verdict = tried(reader, FuzzSample({"a.txt": b"text"}, True), 0, tmp_path)
    assert verdict.outcome == FAULT and said in verdict.kind
    working = reader._replace(works=True)
    assert tried(working, FuzzSample({"a.txt": b"text"}, True), 0, tmp_path).outcome == "read"
