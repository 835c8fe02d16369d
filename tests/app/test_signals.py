"""Signals, pipes that close and a full standard output end a command in one line, or quietly, wherever they come."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hagoromo.app import interrupt
from hagoromo.app.cli import main
from hagoromo.app.interrupt import signals_as_interrupt
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import write_views
from hagoromo.files import leftovers
from hagoromo.files.whole import whole_folder

# the command; while the module in the first argument is imported, the signal in the second arrives
AT_AN_IMPORT = """
import os, signal, sys
for name in ("SIGINT", "SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
module, number = sys.argv.pop(1), int(sys.argv.pop(1))
class Arrives:
    def find_spec(self, name, *_):
        if name == module:
            sys.meta_path.remove(self)
            signal.raise_signal(number)
sys.meta_path.insert(0, Arrives())
from hagoromo_start import main
sys.exit(main())
"""


@pytest.fixture
def cameras(tmp_path) -> Path:
    write_views(tmp_path / "c.yml", {"": Camera(40, 30, (50.0, 50.0), (20.0, 15.0))})
    return tmp_path / "c.yml"


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "hagoromo", *map(str, arguments)]


@pytest.mark.by_night("numpy-15", "cv2-1")
@pytest.mark.parametrize(
    ("module", "number"),
    [("tyro", signal.SIGINT), ("numpy", signal.SIGTERM), ("cv2", signal.SIGHUP), ("filelock", signal.SIGINT)],
)
def test_a_signal_while_the_command_loads_is_one_line(cameras, module, number):
    """From the first module that the command line needs to the last that writing needs.

    Nothing is written, or the line says what.
    """
    arguments = [module, int(number), "convert", cameras, "--out", cameras.with_name("d.yml")]
    ended = subprocess.run(
        [sys.executable, "-c", AT_AN_IMPORT, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    written = cameras.with_name("d.yml").exists()
    said = f"{cameras.with_name('d.yml')} was written" if written else "nothing was written"
    assert (ended.returncode, ended.stderr) == (128 + number, f"hagoromo: interrupted: {said}\n")
    assert sorted(os.listdir(cameras.parent)) == ["c.yml", *["d.yml"] * written]
    assert not (written and module == "tyro")


def test_a_signal_in_a_step_of_a_kernel_is_put_off_until_it_has_ended():
    """An exception there goes through compiled code, which may abort the process."""
    passed = []

    def _loop_body():  # as @dr.syntax calls the steps of a loop
        signal.raise_signal(signal.SIGTERM)
        passed.append(True)

    with pytest.raises(KeyboardInterrupt), signals_as_interrupt():
        _loop_body()
        while True:  # until it is raised again
            pass
    assert passed == [True]


def test_a_signal_does_not_cut_off_the_removal_of_work(tmp_path, monkeypatch):
    remove = leftovers.shutil.rmtree

    def removed(*given, **more):
        signal.raise_signal(signal.SIGINT)
        remove(*given, **more)

    monkeypatch.setattr(leftovers.shutil, "rmtree", removed)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), signals_as_interrupt(), whole_folder(tmp_path / "box") as folder:
            (folder / "in").mkdir()
            raise RuntimeError
    finally:
        signal.signal(signal.SIGINT, before)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_signals_that_are_ignored_stay_so(number):
    """As nohup and shells in the background want."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with signals_as_interrupt():
            signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_an_interrupt_after_the_write_says_what_was_written(cameras, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("hagoromo_formats.convert_verb.wrote", interrupted)
    out = cameras.with_name("d.yml")
    assert main(["convert", str(cameras), "--out", str(out)]) == 130
    assert capsys.readouterr().err == f"hagoromo: interrupted: {out} was written\n" and out.exists()


def test_a_reader_that_has_read_enough_ends_a_command_quietly(cameras):
    reading, writing = os.pipe()
    os.close(reading)
    for arguments in (("info", cameras), ("--version",)):
        ended = subprocess.run(command(*arguments), stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
        assert (ended.returncode, ended.stderr) == (141, "")
    os.close(writing)


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no system but Linux has a disk that is always full")
def test_a_full_disk_behind_the_standard_output_is_one_line(cameras):
    with open("/dev/full", "w") as full:
        ended = subprocess.run(command("info", cameras), stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1) and "No space left" in ended.stderr


def test_a_closed_standard_output_is_no_fault(cameras):
    ended = subprocess.run(
        ["sh", "-c", 'exec "$@" >&-', "sh", *command("convert", cameras, "--out", cameras.with_name("d.json"))],
        stderr=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    assert sorted(os.listdir(cameras.parent)) == ["c.yml", "d.json"]


@pytest.mark.nightly
def test_a_closed_standard_error_is_no_fault(cameras):
    """Neither progress nor messages have a place; those for people do not go to the output for programs."""
    ended = subprocess.run(
        ["sh", "-c", 'exec "$@" 2>&-', "sh", *command("simulate", "absent.toml", "--out", cameras.with_name("d"))],
        stdout=subprocess.PIPE, cwd=cameras.parent, text=True, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (2, "")


def test_a_signal_that_one_command_put_off_leaves_the_next_alone():
    """A timer raises it again a moment later, when the next command of the process may already run."""
    try:
        with interrupt.signals_as_interrupt():
            interrupt._raise_again(signal.SIGINT)
    except KeyboardInterrupt:
        pytest.fail("the next command was interrupted")
