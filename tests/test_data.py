"""Real data: absent sets are no fault, a file that differs or is missing is named."""

import hashlib
import shutil
import subprocess
import sys

import pytest

from tests.data import DATA, DataSet, data_sets, report


def test_every_set_states_source_licence_and_sums():
    for one in data_sets():
        assert one.what and one.source and one.licence, one.name
        assert one.sums and all(len(digest) == 64 for digest in one.sums.values()), one.name


def test_absent_sets_are_no_fault(tmp_path, capsys):
    assert report(tmp_path) == 0
    assert capsys.readouterr().out.count("absent") == len(data_sets())


def test_a_file_that_differs_and_one_that_is_missing_are_named(tmp_path):
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "a").write_bytes(b"right")
    (tmp_path / "set" / "b").write_bytes(b"wrong")
    sums = {f"set/{name}": hashlib.sha256(b"right").hexdigest() for name in "abc"}
    faults = DataSet("set", "", "", "", sums).faults(tmp_path)
    assert faults is not None and len(faults) == 2
    assert "set/b differs" in faults[0] and "set/c is missing" in faults[1]


@pytest.mark.skipif(not (DATA / "nist_skin").is_dir(), reason="needs one set, to spoil a copy of it")
def test_the_command_ends_with_2_where_a_sum_is_wrong(tmp_path):
    shutil.copytree(DATA / "nist_skin", tmp_path / "nist_skin", copy_function=shutil.copyfile)
    command = [sys.executable, "-m", "tests.data", str(tmp_path)]
    assert subprocess.run(command, capture_output=True).returncode == 0
    next((tmp_path / "nist_skin").glob("*.csv")).write_text("spoiled")
    told = subprocess.run(command, capture_output=True, text=True)
    assert told.returncode == 2 and "differs" in told.stderr
