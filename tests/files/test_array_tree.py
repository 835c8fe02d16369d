"""Records of arrays come back with their bits; what is no such record is one line, and a pickle is not run."""

import math
import os
import pickle
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.files.array_tree import TREE, read_tree, write_tree
from hagoromo.measurement.surface import tile_pixels


class KindOfPart(Enum):
    ROUND, FLAT = 1, 2


class PartOfTree(NamedTuple):
    values: NDArray[np.float32]
    kind: KindOfPart
    of: Path


@dataclass(frozen=True, eq=False)
class Whole:
    parts: tuple[PartOfTree | None, ...]
    weights: NDArray[np.float64] | None
    largest: float
    count: np.int16
    settings: dict[str, Any]
    name: str = "whole"


@dataclass(frozen=True)
class Other:
    name: str


@pytest.fixture
def whole():
    values = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
    parts = (PartOfTree(values, KindOfPart.FLAT, Path("a/b")), None, PartOfTree(values[::2], KindOfPart.ROUND, Path()))
    settings = {"n": 0.1, "of": (1, True, None)}
    return Whole(parts, np.array([np.nan, -0.0, 1e-310]), math.inf, np.int16(-7), settings, "é")


def test_a_record_comes_back_with_its_bits(whole, tmp_path):
    write_tree(tmp_path / "a", whole)
    read = read_tree(tmp_path / "a", Whole)
    assert [part and part[1:] for part in read.parts] == [part and part[1:] for part in whole.parts]
    pairs = [(one.values, other.values) for one, other in zip(whole.parts, read.parts, strict=True) if one and other]
    assert len(pairs) == 2
    for one, other in [*pairs, (whole.weights, read.weights)]:
        assert one is not None and other is not None and one.dtype == other.dtype and one.tobytes() == other.tobytes()
    assert type(read.count) is np.int16 and read.count == -7
    rest = [field.name for field in fields(Whole) if field.name not in ("parts", "weights")]
    assert [getattr(read, name) for name in rest] == [getattr(whole, name) for name in rest]


def test_an_array_that_stands_twice_is_stored_once(tmp_path):
    values = np.zeros(10_000)
    write_tree(tmp_path / "a", Whole((), values, 0.0, np.int16(0), {"again": values, "and again": (values,)}))
    assert (tmp_path / "a").stat().st_size < 1.1 * values.nbytes
    assert read_tree(tmp_path / "a", Whole).settings["again"].tobytes() == values.tobytes()


class PickledProgram:
    """What runs a program when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


def arrays(tree: str, **more: Any) -> dict[str, Any]:
    return {TREE: np.frombuffer(tree.encode(), np.uint8), **more}


def test_a_file_of_somebody_else_is_one_line_and_runs_nothing(whole, tmp_path):
    """Pickles, also inside an .npz; types that the record does not name; a part of it; another one; damaged files."""
    mark, name, place = tmp_path / "ran", f"{Whole.__module__}.{{}}", tmp_path / "b"
    pickle.loads(pickle.dumps(PickledProgram(mark)))
    assert mark.is_dir()  # it would run
    mark.rmdir()
    write_tree(tmp_path / "a", whole)
    good = (tmp_path / "a").read_bytes()
    program = np.array([PickledProgram(mark)], object)
    record = '{"record": "%s", "fields": {"name": "a"}}'
    files = {
        "a pickle": pickle.dumps(PickledProgram(mark)),
        "cut off": good[:-100],
        "empty": b"",
        "a pickled array": arrays('{"array": "a"}', a=program),
        "a pickled array beside": arrays("null", a=program),
        "another type": arrays(record % name.format("Other")),
        "a function": arrays(record % "os.system"),
        "a class of its module": arrays(record % name.format("Program")),
        "a part": arrays(record % name.format("Part")),
        "no record": arrays("[1, 2]"),
        "an array that is not there": arrays('{"array": "none"}'),
        "no JSON": arrays("{"),
        "deep": arrays('{"tuple":[' * 5000 + "]}" * 5000),
        "no tree": {"a": np.zeros(3)},
    }
    for what, content in files.items():
        if isinstance(content, dict):
            with place.open("wb") as file:
                np.savez(file, **dict[str, Any](content))
        else:
            place.write_bytes(content)
        with pytest.raises(hg.InputError) as refused:
            read_tree(place, Whole)
        assert str(place) in str(refused.value) and not mark.exists(), what
    with pytest.raises(hg.InputError, match="cannot be read as records and arrays"):
        read_tree(tmp_path / "a", Other)


def test_what_is_no_plain_record_is_not_written(tmp_path):
    for value in (PickledProgram(tmp_path), {1: 2}, [1], np.array([{}], object)):
        with pytest.raises((TypeError, ValueError)):
            write_tree(tmp_path / "a", Whole((), None, 0.0, np.int16(0), {"value": value}))


def test_what_workers_share_is_no_pickle(tmp_path):
    """Who may write into the scratch folder of a measurement runs nothing on its workers."""
    (tmp_path / "shared").write_bytes(pickle.dumps(PickledProgram(tmp_path / "ran")))
    with pytest.raises(hg.InputError, match="shared cannot be read"):
        tile_pixels._from_file(str(tmp_path / "shared"))
    assert not (tmp_path / "ran").exists()
