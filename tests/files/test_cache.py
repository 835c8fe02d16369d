"""The cache gives what was made, or lets it be made again: nothing in it is trusted that is not as it was written."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import filelock
import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.cache import DATA, NOTE, cache, key_of
from hagoromo.files.leftovers import MARK, alone, begin_work, beside
from hagoromo.image.render import render
from hagoromo.matter import build as matter_build
from tests.ball_scene import KEY, camera

SOLID = """
kind = "solid"
voxel_mm = 1.0
shape = { form = "sphere", radius_mm = 6.0 }
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = "body.csv" }
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The folder of an empty cache that is in use."""
    monkeypatch.setenv("HAGOROMO_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("HAGOROMO_CACHE_MB", raising=False)
    return tmp_path / "cache"


class CountedText:
    """Text of an entry; counts how often it was made."""

    def __init__(self, text="what was made"):
        self.text, self.times = text, 0

    def __call__(self):
        self.times += 1
        return self.text

    def kept(self, depends_on="this", make=None, once=False):
        """The text, from the cache or made."""
        return cache().kept(
            depends_on,
            lambda folder: (folder / "text").read_text(),
            make or self,
            lambda text, folder: (folder / "text").write_text(text),
            once,
        )


def test_what_was_made_is_read_again(place):
    made = CountedText()
    assert [made.kept(), made.kept(), made.kept("other")] == [made.text] * 3
    assert made.times == 2 and len(list(cache().entries())) == 2


def spoil_byte(entry):
    (entry / DATA / "text").write_text("what was made?")


def spoil_note(entry):
    (entry / NOTE).write_text('{"content": "' + "0" * 64 + '"}')


def long_note(entry):
    (entry / NOTE).write_text((entry / NOTE).read_text() + " " * 5000)


def no_json(entry):
    (entry / NOTE).write_text("[" * 2000)


def no_note(entry):
    (entry / NOTE).unlink()


def no_data(entry):
    shutil.rmtree(entry / DATA)


def one_more(entry):
    (entry / DATA / "more").write_text("")


def leads_out(entry):
    other = entry.parent.parent / "other"
    os.replace(entry / DATA / "text", other)
    (entry / DATA / "text").symlink_to(other)


def is_link(entry):
    elsewhere = entry.parent.parent / "elsewhere"
    os.replace(entry, elsewhere)
    entry.symlink_to(elsewhere, target_is_directory=True)


def is_file(entry):
    shutil.rmtree(entry)
    entry.write_text("")


@pytest.mark.parametrize(
    "spoil",
    [spoil_byte, spoil_note, long_note, no_json, no_note, no_data, one_more, leads_out, is_link, is_file],
)
def test_an_entry_that_is_not_as_it_was_written_is_made_again(place, spoil):
    """And is right afterwards; what a link leads to is left alone."""
    made = CountedText()
    made.kept()
    spoil(place / key_of("this"))
    outside = sorted(place.parent.iterdir())
    assert made.kept() == made.text and made.times == 2
    assert made.kept() == made.text and made.times == 2
    assert sorted(place.parent.iterdir()) == outside


def test_a_folder_without_the_mark_is_never_read_nor_removed(place):
    made = CountedText()
    made.kept()
    entry = place / key_of("this")
    (entry / MARK).unlink()
    (entry / DATA / "text").write_text("foreign")
    assert made.kept() == made.text and made.times == 2


def test_the_key_is_of_the_data_and_of_the_program(monkeypatch):
    keys = [key_of(one) for one in ("this", "that", ["this"], {"this": 1}, {"this": 1.5})]
    monkeypatch.setattr("hagoromo.files.cache.program", lambda: "another")
    assert len({*keys, key_of("this")}) == 6


def test_what_was_not_used_for_longest_goes_first(place, monkeypatch):
    monkeypatch.setenv("HAGOROMO_CACHE_MB", "0.0025")
    text = "x" * 1000
    for number, name in enumerate("ab"):
        CountedText(text).kept(name)
        os.utime(place / key_of(name) / NOTE, (1000 + number, 1000 + number))
    CountedText(text).kept("a")  # used now
    CountedText(text).kept("c")
    assert {entry.name for entry, _, _ in cache().entries()} == {key_of("a"), key_of("c")}
    CountedText("x" * 3000).kept("large")
    assert sum(size for _, size, _ in cache().entries()) <= 2500


def test_an_entry_that_another_process_writes_is_left_to_it(place):
    made = CountedText()
    made.kept("first")
    with alone(place / key_of("this")):
        assert made.kept() == made.text
        assert len(list(cache().entries())) == 1
    assert made.kept() == made.text and len(list(cache().entries())) == 2


def test_work_of_a_killed_process_is_removed(place):
    made = CountedText()
    made.kept()
    (begin_work(beside(place / key_of("killed"), "writing")) / "half").write_text("half")
    made.kept("other")
    assert not [left for left in place.iterdir() if left.name.startswith(".")]


def test_one_makes_what_several_ask_for_at_once_and_the_others_read_it(place):
    """Three ask while the first one makes."""
    made, begun, go_on = CountedText(), threading.Event(), threading.Event()

    def make():
        begun.set()
        assert go_on.wait(60)
        return made()

    with ThreadPoolExecutor(3) as pool:
        asked = [pool.submit(made.kept, make=make, once=True)]
        assert begun.wait(60)
        asked += [pool.submit(made.kept, make=make, once=True) for _ in range(2)]
        go_on.set()
        assert [one.result(60) for one in asked] == [made.text] * 3
    assert made.times == 1 and [one.name for one in place.iterdir()] == [key_of("this")]


MAKER = """
import os, signal
from hagoromo.files.cache import cache
def make():
    print("making", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
cache().kept("this", lambda folder: "", make, lambda value, folder: None, once=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signal")
def test_where_the_maker_is_killed_the_next_one_makes(place):
    """Its lock is left on the disk, and held by nobody."""
    killed = subprocess.run([sys.executable, "-c", MAKER], capture_output=True, text=True)
    assert killed.stdout == "making\n" and killed.returncode == -signal.SIGKILL
    assert beside(place / key_of("this"), "making").is_file()
    shutil.copy(beside(place / key_of("this"), "making"), beside(place / key_of("other"), "making"))
    made = CountedText()
    assert made.kept(once=True) == made.text and made.times == 1
    assert [one.name for one in place.iterdir()] == [key_of("this")]


def test_without_locks_of_the_system_nobody_waits(place, monkeypatch):
    """There the lock is a file, which a killed process leaves for ever."""
    monkeypatch.setattr(filelock, "FileLock", filelock.SoftFileLock)
    place.mkdir()
    beside(place / key_of("this"), "making").write_text("")
    made = CountedText()
    assert made.kept(once=True) == made.text


def test_what_cannot_be_written_is_still_given(place):
    def full(text, folder):
        raise OSError(28, "No space left on device")

    assert cache().kept("this", lambda folder: "read", lambda: "made", full) == "made"
    assert list(cache().entries()) == [] and list(place.iterdir()) == []


def test_errors_of_what_is_made_are_not_swallowed(place):
    def wrong():
        raise InputError("wrong")

    with pytest.raises(InputError, match="wrong"):
        cache().kept("this", lambda folder: "read", wrong, lambda value, folder: None)


@pytest.mark.parametrize("stated", ["off", "{file}/below"])
def test_without_a_cache_everything_is_made(tmp_path, monkeypatch, stated):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HAGOROMO_CACHE", stated.format(file=tmp_path / "file"))
    made = CountedText()
    assert cache().why_not and made.kept() == made.kept() == made.text and made.times == 2


def test_a_machine_without_a_home_works(tmp_path, monkeypatch):
    monkeypatch.delenv("HAGOROMO_CACHE")
    for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA", "USERPROFILE"):
        monkeypatch.setenv(name, "/dev/null/none" if name == "HOME" else "")
    assert CountedText().kept() == "what was made"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no modes of this kind")
def test_a_folder_that_others_may_write_to_is_not_used(place, capsys):
    place.mkdir()
    place.chmod(0o777)
    made = CountedText()
    for _ in range(2):
        made.kept()
    assert made.times == 2 and list(place.iterdir()) == []
    assert main(["cache"]) == 0 and "others may write to it" in capsys.readouterr().out


@pytest.mark.parametrize("bound", ["much", "-1", "nan", "inf"])
def test_a_bound_that_is_no_number_is_refused(place, monkeypatch, bound, capsys):
    monkeypatch.setenv("HAGOROMO_CACHE_MB", bound)
    assert main(["cache"]) == 2 and capsys.readouterr().err.count("\n") == 1


def test_cache_shows_and_clears(place, capsys):
    for name in "ab":
        CountedText().kept(name)
    (place / "mine.txt").write_text("not of this package")
    assert main(["cache"]) == 0
    said = capsys.readouterr().out
    assert str(place) in said and "in 2 entries" in said and "4000 MB" in said
    assert main(["cache", "--clear"]) == 0
    assert "removed 2 entries" in capsys.readouterr().out
    assert [left.name for left in place.iterdir()] == ["mine.txt"]


def test_the_box_of_a_recipe_is_built_once(place, tmp_path, monkeypatch):
    """The picture has the same bits; another recipe, or another file that it names, is another box."""
    (tmp_path / "solid.toml").write_text(SOLID)
    (tmp_path / "body.csv").write_text("wavelength_nm,value\n400,0.5\n700,0.5\n")
    (tmp_path / "scene.toml").write_text(camera((31, 23), 45.0) + KEY + '\n[[box]]\nrecipe = "solid.toml"\n')
    built, build = [], matter_build.build
    monkeypatch.setattr(matter_build, "build", lambda recipe: built.append(recipe) or build(recipe))
    told: list[tuple[Any, ...]] = []
    pictures = [render(tmp_path / "scene.toml", progress=lambda *step: told.append(step)) for _ in range(2)]
    assert len(built) == 1 and pictures[0].alpha.max() > 0.5
    np.testing.assert_array_equal(pictures[0].weights, pictures[1].weights)
    assert pictures[0].metadata == pictures[1].metadata
    assert any("building solid.toml" in step for _, step in told)
    (tmp_path / "body.csv").write_text("wavelength_nm,value\n400,0.5\n700,0.7\n")
    render(tmp_path / "scene.toml")
    (tmp_path / "solid.toml").write_text(SOLID.replace("6.0", "5.0"))
    render(tmp_path / "scene.toml")
    assert len(built) == 3
