"""Wrong use is one line, nothing is overwritten unasked, and an interrupt leaves nothing behind."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from types import FrameType

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.app.interrupt import heed, signals_as_interrupt
from hagoromo.app.progress_bar import progress_bar
from hagoromo.files.png import write_png
from tests.app.started import STARTED


@contextlib.contextmanager
def calls_of_the_package() -> Iterator[list[str]]:
    """The functions of the package that are called meanwhile, modules that are imported included."""
    calls: list[str] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_globals.get("__name__", "").startswith("hagoromo"):
            calls.append(frame.f_code.co_name)

    sys.setprofile(note)
    try:
        yield calls
    finally:
        sys.setprofile(None)


def test_wrong_use_is_one_line(refused):
    assert "'nonsense' is no command" in refused("nonsense")
    assert "--out" in refused("calibrate", "response", "pairs.csv")
    said = refused("calibrate", "camera", "--board", "9x6", "--square", "wide", "--out", "a.json")
    assert said.startswith("hagoromo: Error parsing --square: could not convert string to float: 'wide'; Argument")


def test_an_existing_output_is_refused_without_force(refused, tmp_path):
    (tmp_path / "camera.json").write_text("mine")
    write_png(tmp_path / "a.png", np.zeros((31, 41), np.uint8))
    said = refused(
        *("calibrate", "camera", tmp_path / "a.png", "--board", "9x6", "--square", "0.025"),
        *("--out", tmp_path / "camera.json"),
    )
    assert "exists" in said and "--force" in said
    assert (tmp_path / "camera.json").read_text() == "mine"


def test_every_verb_refuses_an_existing_output_before_its_work(refused, scene, capture, tmp_path, recipe):
    (tmp_path / "skin.toml").write_text(recipe)
    for verb, given, out in (
        ("build", tmp_path / "skin.toml", "skin.zarr"),
        ("demo", None, "demo"),
        ("render", scene(), "a.exr"),
        ("simulate", scene(), "photographs"),
        ("measure", capture, "measured"),
    ):
        path = tmp_path / out
        if path.suffix == ".exr":
            path.write_text("mine")
        else:
            path.mkdir()
            (path / "mine").touch()
        with calls_of_the_package() as calls:
            assert "--force" in refused(verb, *([given] if given else []), "--out", path)
        assert 0 < len(calls) < 1000  # some tens; to read this scene alone takes thousands
    assert os.listdir(tmp_path / "measured") == ["mine"]


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch, capsys, whole_file_of):
    whole_file_of("png")
    before = sorted(tmp_path.rglob("*"))

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("hagoromo.calibration.camera.board.Board.find_by_windows", interrupted)
    arguments = ["calibrate", "camera", str(tmp_path / "a.png"), "--board", "9x6", "--square", "0.025"]
    assert main([*arguments, "--out", str(tmp_path / "new" / "camera.json")]) == 130
    assert capsys.readouterr().err == "hagoromo: interrupted: nothing was written\n"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == before


def test_an_interrupt_that_foreign_code_swallows_is_told_again():
    """By the next step of progress, or by any error that comes of it; afterwards it is forgotten."""

    def swallowed():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(KeyboardInterrupt), signals_as_interrupt(), progress_bar("work") as progress:
        progress(0.1)
        swallowed()
        progress(0.2)
    with pytest.raises(KeyboardInterrupt), signals_as_interrupt():
        swallowed()
        raise SystemError
    heed()
    with pytest.raises(SystemError), signals_as_interrupt():
        raise SystemError


@pytest.mark.by_night("1")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_of_a_long_verb_leaves_nothing_behind(tmp_path, scene, number):
    """Ctrl-C (or a polite kill) as soon as the work folder appears, in a process of its own."""
    slow = scene("size = [61, 47]", "size = [610, 470]", "[render]\nsamples = 40000\n")
    before = sorted(tmp_path.rglob("*"))
    command = [sys.executable, "-c", STARTED, "simulate", str(slow), "--out", str(tmp_path / "capture")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while sorted(tmp_path.rglob("*")) == before and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(number)
        _, said = process.communicate()
    assert (process.returncode, said) == (128 + number, "hagoromo: interrupted: nothing was written\n")
    assert sorted(tmp_path.rglob("*")) == before
