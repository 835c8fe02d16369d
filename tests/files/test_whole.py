"""What is written appears whole or not at all, whoever else writes there and whatever was left there."""

import errno
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import write_views
from hagoromo.errors import InputError
from hagoromo.files import exchange, whole
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.record import save_json, write_json
from hagoromo.files.table import write_table
from hagoromo.files.whole import (
    names_written,
    replaceable_files,
    scratch_folder,
    whole_file,
    whole_files,
    whole_folder,
    write_text,
)

LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
from hagoromo.app.cli import main
sys.exit(main(sys.argv[2:]))
"""
KILLED = """
import os, signal, sys
from pathlib import Path
from hagoromo.files import leftovers, whole
replace, moved = os.replace, []
def counted(source, target):
    if "writing" in str(source) and "writing" not in str(target):
        if len(moved) == int(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
        moved.append(target)
    replace(source, target)
os.replace = counted
home = Path(sys.argv[1])
with whole.whole_files((home / "a.exr", home / "a.png"), force=True) as partials:
    for partial in partials:
        partial.write_text("new")
"""


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def killed(code: str, *arguments: object) -> None:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL


def test_a_link_is_followed_and_stays(tmp_path):
    (tmp_path / "far").mkdir()
    write_json(tmp_path / "far" / "a.json", [1])
    (tmp_path / "a.json").symlink_to("far/a.json")
    save_json(tmp_path / "a.json", [2], force=True)
    assert (tmp_path / "a.json").is_symlink() and (tmp_path / "far" / "a.json").read_text() == "[\n 2\n]\n"
    (tmp_path / "made").mkdir()
    (tmp_path / "box").symlink_to("made")
    with whole_folder(tmp_path / "box") as folder:
        (folder / "new").touch()
    assert (tmp_path / "box").is_symlink() and (tmp_path / "made" / "new").exists()
    assert names(tmp_path) == ["a.json", "box", "far", "made"] and names(tmp_path / "far") == ["a.json"]


@pytest.mark.parametrize("write", [whole_file, whole_folder])
def test_links_to_nothing_devices_and_pipes_are_refused(tmp_path, write):
    (tmp_path / "dangling").symlink_to("nothing")
    (tmp_path / "round").symlink_to("round")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to(os.devnull)
    before = names(tmp_path)
    for name in before:
        with pytest.raises(InputError, match=name), write(tmp_path / name, force=True):
            raise AssertionError
    assert names(tmp_path) == before and (tmp_path / "null").is_char_device()


def test_the_folder_one_is_in_is_no_target(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    for path in (".", "..", tmp_path):
        with pytest.raises(InputError, match="this runs in"), whole_folder(path, force=True):
            raise AssertionError


def test_of_two_that_write_one_target_the_second_is_refused(tmp_path):
    """Threads, which hold locks as processes do; the one who was first is undisturbed."""
    said = []

    def second():
        for write in (whole_file, whole_folder):
            try:
                with write(tmp_path / write.__name__, force=True):
                    raise AssertionError
            except InputError as error:
                said.append(str(error))

    with whole_file(tmp_path / "whole_file") as file, whole_folder(tmp_path / "whole_folder") as folder:
        file.write_text("first")
        (folder / "first").touch()
        thread = threading.Thread(target=second)
        thread.start()
        thread.join()
    assert [f"is being written by process {os.getpid()}" in line for line in said] == [True, True]
    assert (tmp_path / "whole_file").read_text() == "first" and (tmp_path / "whole_folder" / "first").exists()
    assert names(tmp_path) == ["whole_file", "whole_folder"]


@pytest.mark.parametrize("force", [False, True])
def test_leftovers_of_a_process_that_ended_are_removed_whatever_its_number(tmp_path, force):
    """As in a container, where each process is number 1: the lock file names a process that lives, this one."""
    for name in ("a.txt", "b"):
        (tmp_path / f".{name}.lock").write_text(str(os.getpid()))
        (tmp_path / f".{name}.writing" / name).mkdir(parents=True)
        (tmp_path / f".{name}.writing" / ".hagoromo").touch()
    with whole_file(tmp_path / "a.txt", force) as path:
        path.write_text("new")
    with whole_folder(tmp_path / "b", force) as folder:
        (folder / "new").touch()
    assert names(tmp_path) == ["a.txt", "b"]


def test_a_work_folder_of_somebody_else_s_files_is_left_alone(tmp_path):
    (tmp_path / ".a.txt.writing").mkdir()
    (tmp_path / ".a.txt.writing" / "mine").touch()
    with pytest.raises(InputError, match="did not write: move them"), whole_file(tmp_path / "a.txt"):
        raise AssertionError
    assert names(tmp_path / ".a.txt.writing") == ["mine"] and names(tmp_path) == [".a.txt.writing"]


@pytest.mark.parametrize(("moves", "expected"), [(0, ["old", "old"]), (1, ["old", "new"]), (2, ["new", "new"])])
def test_files_that_belong_together_are_completed_by_the_next_who_looks(tmp_path, moves, expected):
    """Killed before the first, the second and no move; the main file is never new without the other."""
    for name in ("a.exr", "a.png"):
        (tmp_path / name).write_text("old")
    if moves < 2:
        killed(KILLED, tmp_path, moves)
    else:
        subprocess.run([sys.executable, "-c", KILLED, str(tmp_path), "9"], check=True)
    assert [(tmp_path / name).read_text() for name in ("a.exr", "a.png")] == expected
    with pytest.raises(InputError, match="exists"):
        replaceable_files([tmp_path / "a.exr", tmp_path / "a.png"])
    assert [(tmp_path / name).read_text() for name in ("a.exr", "a.png")] == ["new", "new"]
    assert names(tmp_path) == ["a.exr", "a.png"]


def test_a_lone_write_of_one_of_them_completes_the_others_first(tmp_path):
    killed(KILLED, tmp_path, 0)
    with whole_file(tmp_path / "a.png", force=True) as path:
        path.write_text("newest")
    assert ((tmp_path / "a.exr").read_text(), (tmp_path / "a.png").read_text()) == ("new", "newest")
    assert names(tmp_path) == ["a.exr", "a.png"]


@pytest.mark.parametrize("cut", [False, True])
def test_a_folder_is_replaced_in_turns_where_names_cannot_be_exchanged(tmp_path, monkeypatch, cut):
    """As on Windows; cut off between the turns, the old one is put back by the next who looks."""
    with whole_folder(tmp_path / "box") as folder:
        (folder / "old").touch()
    monkeypatch.setattr(exchange, "_system_call", lambda: None)
    if cut:
        replace = os.replace

        def killed_in_between(source, target):
            if Path(target) == tmp_path / "box":
                raise SystemExit
            replace(source, target)

        monkeypatch.setattr(os, "replace", killed_in_between)
        monkeypatch.setattr(whole, "remove_work", lambda work: None)
        with pytest.raises(SystemExit), whole_folder(tmp_path / "box", force=True) as folder:
            (folder / "new").touch()
        assert names(tmp_path) == [".box.writing"]
        monkeypatch.undo()
        with pytest.raises(InputError, match="exists"), whole_folder(tmp_path / "box"):
            raise AssertionError
    else:
        with whole_folder(tmp_path / "box", force=True) as folder:
            (folder / "new").touch()
    assert names(tmp_path) == ["box"] and ("old" if cut else "new") in names(tmp_path / "box")


def test_a_target_that_somebody_makes_meanwhile_is_not_replaced(tmp_path):
    with pytest.raises((InputError, FileExistsError)), whole_file(tmp_path / "a.txt") as path:
        path.write_text("ours")
        (tmp_path / "a.txt").write_text("theirs")
    (tmp_path / "new").mkdir()
    (tmp_path / "box").mkdir()
    with pytest.raises(FileExistsError):
        exchange.move_new(tmp_path / "new", tmp_path / "box")
    assert (tmp_path / "a.txt").read_text() == "theirs" and names(tmp_path) == ["a.txt", "box", "new"]


def test_names_as_long_as_the_system_has_them_are_written(tmp_path):
    for name in ("a" * 255, "布" * 85):
        write_text(tmp_path / name, "text")
        with whole_folder(tmp_path / f"b{name[1:]}") as folder:
            (folder / "new").touch()
    assert len(names(tmp_path)) == 4


def test_folders_made_for_a_target_that_fails_are_removed(tmp_path):
    with pytest.raises(RuntimeError), whole_file(tmp_path / "a" / "b" / "c.txt"):
        raise RuntimeError
    assert names(tmp_path) == []


def test_files_that_are_to_be_written_together_lie_in_one_folder(tmp_path):
    for pair in ((tmp_path / "a" / "b", tmp_path / "b"), (tmp_path / "a", tmp_path / "a")):
        with pytest.raises(InputError, match="different files of one folder"), whole_files(pair):
            raise AssertionError


def test_what_libraries_did_not_write_is_not_called_written(tmp_path, monkeypatch):
    write_text(tmp_path / "a", "old")
    for wrote in (lambda path: None, Path.touch):
        with pytest.raises(OSError, match="less was written"), whole_file(tmp_path / "a", force=True) as path:
            wrote(path)
    assert (tmp_path / "a").read_text() == "old" and names(tmp_path) == ["a"]


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="names of open files are Linux's")
def test_what_was_written_is_on_the_disk_before_it_is_moved(tmp_path, monkeypatch):
    done, sync, rename = [], os.fsync, exchange._renamed
    monkeypatch.setattr(os, "fsync", lambda file: done.append(os.readlink(f"/proc/self/fd/{file}")) or sync(file))
    monkeypatch.setattr(exchange, "_renamed", lambda *moved: done.append("move") or rename(*moved))
    with whole_folder(tmp_path / "box") as folder:
        (folder / "in").mkdir()
        (folder / "in" / "file").write_text("text")
    work = tmp_path / ".box.writing" / "box"
    assert [str(path) for path in (work / "in" / "file", work / "in", work)] == [
        path for path in done[: done.index("move")] if not path.endswith(".hagoromo")
    ]
    assert done[-1] == str(tmp_path)


def test_scratch_of_killed_processes_is_removed(tmp_path):
    killed(
        "import os, signal, sys; from pathlib import Path; from hagoromo.files.whole import scratch_folder\n"
        "with scratch_folder(Path(sys.argv[1])) as scratch:\n"
        "    (scratch / 'large').touch(); os.kill(os.getpid(), signal.SIGKILL)",
        tmp_path,
    )
    assert len(names(tmp_path)) == 2
    with scratch_folder(tmp_path) as one, scratch_folder(tmp_path) as other:
        assert one != other and len(names(tmp_path)) == 4
    assert names(tmp_path) == []


@pytest.mark.nightly
def test_cameras_on_a_full_disk_are_not_called_written(tmp_path):
    """OpenCV writes nothing and does not tell."""
    pytest.importorskip("resource")
    lens = Camera(40, 30, (50.0, 50.0), (20.0, 15.0))
    write_views(tmp_path / "c.yml", {"a.png": lens.with_pose(np.eye(4))})
    before = (tmp_path / "c.yml").read_bytes()
    arguments = ["100", "convert", str(tmp_path / "c.yml"), "--out"]
    for out, more in ((tmp_path / "d.yml", []), (tmp_path / "c.yml", ["--force"])):
        ended = subprocess.run(
            [sys.executable, "-c", LIMITED, *arguments, str(out), *more], capture_output=True, text=True, check=False
        )
        assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (2, "", 1)
        assert str(out) in ended.stderr and "larger than the system allows" in ended.stderr
    assert names(tmp_path) == ["c.yml"] and (tmp_path / "c.yml").read_bytes() == before


def test_an_exr_is_whole_or_refused_at_every_size_of_the_disk(tmp_path):
    resource = pytest.importorskip("resource")
    image = np.random.default_rng(1).uniform(size=(40, 30)).astype(np.float32)
    write_exr(tmp_path / "a.exr", {"R": image})
    size, limits = (tmp_path / "a.exr").stat().st_size, resource.getrlimit(resource.RLIMIT_FSIZE)
    ended = []
    for limit in (*range(0, size, size // 9), size - 1, size):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
        try:
            write_exr(tmp_path / "b.exr", {"R": image})
            ended.append(limit)
            np.testing.assert_array_equal(read_exr(tmp_path / "b.exr")[0]["R"], image)
        except OSError as error:
            assert error.errno == errno.EIO
        except InputError as error:
            assert "larger than the system allows" in str(error)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert ended == [size] and names(tmp_path) == ["a.exr", "b.exr"]


def test_a_table_is_made_before_it_is_written(tmp_path):
    write_table(tmp_path / "a.csv", {"n": [1.0]}, "one")
    before = (tmp_path / "a.csv").read_bytes()
    with pytest.raises(ValueError):
        write_table(tmp_path / "a.csv", {"n": [1.0], "m": [1.0, 2.0]})
    assert (tmp_path / "a.csv").read_bytes() == before


def test_what_was_written_is_known(tmp_path):
    names_written.clear()
    with whole_folder(tmp_path / "box") as folder:
        write_text(folder / "part", "text")
    assert names_written == [tmp_path / "box"]


def test_a_disk_that_is_full_from_the_start_leaves_nothing(tmp_path, monkeypatch):
    def full(path, *_):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(Path, "touch", full)
    for write in (whole_file, whole_folder):
        with pytest.raises(InputError, match="the disk is full"), write(tmp_path / "a"):
            raise AssertionError
    assert names(tmp_path) == []


@pytest.mark.skipif(not os.path.ismount("/dev"), reason="the system mounts nothing at /dev")
def test_where_a_file_system_is_mounted_no_folder_is_put():
    with pytest.raises(InputError, match="is mounted"), whole_folder("/dev", force=True):
        raise AssertionError


def test_of_many_that_write_one_target_each_is_whole_or_refused(tmp_path):
    """Threads, which hold locks as processes do; nobody waits, and none leaves anything."""
    ended: list[str] = []

    def write(number: int) -> None:
        for _ in range(10):
            try:
                with whole_file(tmp_path / "a", force=True) as path:
                    path.write_text(f"{number}" * 1000)
                with whole_folder(tmp_path / "b", force=True) as folder:
                    (folder / f"{number}").touch()
                ended.append("written")
            except InputError as error:
                ended.append("refused" if "is being written by process" in str(error) else str(error))

    threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(ended) == 40 and set(ended) <= {"written", "refused"} and "written" in ended
    text = (tmp_path / "a").read_text()
    assert len(text) == 1000 and len(set(text)) == 1 and len(names(tmp_path / "b")) == 2
    assert names(tmp_path) == ["a", "b"]


def test_files_that_belong_together_are_said_to_be_written(tmp_path, caplog):
    with caplog.at_level("DEBUG", "hagoromo"), whole_files((tmp_path / "a.exr", tmp_path / "a.png")) as partials:
        for partial in partials:
            partial.write_bytes(b"1")
    (line,) = (record.getMessage() for record in caplog.records)
    assert line.startswith("wrote ") and "a.exr" in line and "a.png" in line
