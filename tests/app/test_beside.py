"""Work beside this process: it is done when waited for, its failure harms nobody, and it ends with its block."""

import os
import time

from hagoromo_matter.demo import beside as module
from hagoromo_matter.demo.beside import beside


def write(path, text):
    print("noise")
    path.write_text(text, encoding="utf-8")


def fail(path):
    raise RuntimeError(path)


def begin_and_wait(path):
    path.write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(600)


def test_what_is_waited_for_is_done_in_another_process(tmp_path, capfd):
    with beside(write, tmp_path / "a", "done") as wait:
        wait()
        assert (tmp_path / "a").read_text(encoding="utf-8") == "done"
    with beside(fail, tmp_path / "b") as wait:
        wait()
    assert capfd.readouterr() == ("", "")


def test_nothing_runs_where_it_is_not_wanted_or_there_is_one_core(tmp_path, monkeypatch):
    with beside(write, tmp_path / "a", "done", wanted=False) as wait:
        wait()
    monkeypatch.setattr(module.os, "cpu_count", lambda: 1)
    with beside(write, tmp_path / "a", "done") as wait:
        wait()
    assert not (tmp_path / "a").exists()


def test_it_ends_with_its_block(tmp_path):
    with beside(begin_and_wait, tmp_path / "pid"):
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text(encoding="utf-8"):
            time.sleep(0.01)
    number = int((tmp_path / "pid").read_text(encoding="utf-8"))
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return
    raise AssertionError(f"process {number} goes on")
