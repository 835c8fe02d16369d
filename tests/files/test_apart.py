"""A file is read apart: what ends that process, fills the memory or never ends is one line; the next file is read."""

import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files import apart
from hagoromo.files.apart import read_apart
from hagoromo.files.shared_arrays import arrays_of_layout, bytes_of, layout_of

ON_LINUX = sys.platform == "linux"


def process(path) -> Any:
    return {"number": os.getpid(), "folder": os.getcwd(), "text": path.read_text() if path.is_file() else ""}


def dies(path, number) -> Any:
    os.kill(os.getpid(), number)


def computes(path) -> Any:
    while True:
        pass


def waits(path) -> Any:
    time.sleep(60)


def fills(path):
    return {"all": np.ones(1 << 44, np.uint8)}


def prints(path):
    os.write(1, b"noise")
    os.write(2, b"noise")
    return {}


def arrays(path, size):
    made = np.arange(size, dtype=np.float64)
    return {
        "line": made, "turned": made[: size // 2 * 2].reshape(2, -1).T, "swapped": made.astype(">f4"), "none": made[:0],
        "flag": np.array(True), "texts": np.array(["ä", "bc"]),
    }  # fmt: skip


def refuses(path) -> Any:
    raise InputError(f"{path} is refused")


def has_a_bug(path) -> Any:
    return 1 // 0


@pytest.mark.parametrize("number", [signal.SIGABRT, signal.SIGSEGV] if os.name == "posix" else [])
def test_a_library_that_crashes_is_one_line(tmp_path, number):
    with pytest.raises(InputError, match=r"a.dng cannot be read as camera RAW: the library that reads it has crashed"):
        read_apart(dies, tmp_path / "a.dng", "camera RAW", int(number))
    assert read_apart(process, tmp_path, "a folder")["number"] != os.getpid()


@pytest.mark.skipif(os.name != "posix", reason="other systems bound the time by the clock alone")
def test_a_library_that_does_not_end_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "SECONDS", 0.3)
    with pytest.raises(InputError, match=r"takes more than .* s of computing"):
        read_apart(computes, tmp_path, "a folder")


def test_a_library_that_waits_for_ever_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "SECONDS", 0.02)
    with pytest.raises(InputError, match=r"takes more than .* s of computing"):
        read_apart(waits, tmp_path, "a folder")


@pytest.mark.skipif(not ON_LINUX, reason="other systems do not heed the bound of addresses")
def test_a_library_that_takes_too_much_memory_is_one_line(tmp_path):
    with pytest.raises(InputError, match="the memory is not enough"):
        read_apart(fills, tmp_path, "a folder")


def test_what_is_wrong_with_the_file_and_what_with_the_program_are_told_apart(tmp_path):
    with pytest.raises(InputError, match=r"a.dng is refused"):
        read_apart(refuses, tmp_path / "a.dng", "camera RAW")
    with pytest.raises(RuntimeError, match="ZeroDivisionError"):
        read_apart(has_a_bug, tmp_path / "a.dng", "camera RAW")


def test_one_process_reads_file_after_file_where_the_program_works(tmp_path, monkeypatch, capfd):
    (tmp_path / "a.txt").write_text("a text")
    first = read_apart(process, tmp_path / "a.txt", "a text")
    monkeypatch.chdir(tmp_path)
    second = read_apart(process, "a.txt", "a text")
    assert first["number"] == second["number"] and second["folder"] == os.path.realpath(tmp_path)
    assert first["text"] == second["text"] == "a text"
    assert not read_apart(prints, "a.txt", "a text") and capfd.readouterr() == ("", "")


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("size", [3, 1_000_001])
def test_arrays_come_as_they_are(tmp_path, monkeypatch, shared, size):
    if not shared:
        monkeypatch.setattr(apart, "_idle", [])
        monkeypatch.delattr(os, "memfd_create", raising=False)
    came, made = read_apart(arrays, tmp_path, "a folder", size), arrays(tmp_path, size)
    assert list(came) == list(made)
    for name, array in made.items():
        assert came[name].dtype == array.dtype and np.array_equal(came[name], array)
    came["line"] += 1.0  # callers may write
    again = read_apart(arrays, tmp_path, "a folder", size)
    assert np.array_equal(again["line"], made["line"])
    if not shared:
        apart._end_all()


@pytest.mark.parametrize(
    "wrong",
    [["a", "|O", [1], 0], ["a", "<f8", [9], 0], ["a", "<f8", [1], 64], ["a", "<f8", [-1], 0], ["a", "<f8", [1], -8],
     ["a", "V8", [1], 0], ["a", "<f8", [1 << 40, 1 << 40], 0]],
)  # fmt: skip
def test_a_layout_that_does_not_fit_is_refused(wrong):
    """What the other process says may come from a file: a type of objects would be taken for addresses."""
    held = bytes_of(*layout_of({"a": np.ones(2)}), {"a": np.ones(2)})
    with pytest.raises((ValueError, TypeError)):
        arrays_of_layout([wrong], held)


@pytest.mark.skipif(os.name != "posix", reason="other systems send no signal to a thread")
def test_an_interrupt_ends_the_other_process(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "_idle", [])
    helper = apart._taken()
    monkeypatch.setattr(apart, "_taken", lambda: helper)
    main = threading.main_thread().ident
    assert main is not None
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a shell runs the tests behind it
    try:
        threading.Timer(0.3, signal.pthread_kill, (main, signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            read_apart(waits, tmp_path, "a folder")
    finally:
        signal.signal(signal.SIGINT, before)
    assert helper.process.returncode is not None
