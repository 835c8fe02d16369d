"""A build that is interrupted, killed, out of disk or not alone leaves nothing half-written and loses nothing done."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.matter.build import build, build_to, fingerprint
from hagoromo.volume.store import field_blocks
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.box_store import load_box

RECIPE = """
kind = "solid"
voxel_mm = 0.5
shape = { form = "sphere", radius_mm = 20.0 }
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }
"""  # 8 blocks of 64³ voxels
SLOW_BUILD = """
import os, sys, time
from hagoromo.app.cli import main
from hagoromo.volume.store import field_blocks
from hagoromo.volume.store.box_group import BoxGroup
field_blocks.BRICKS_AT_ONCE = 1
write = BoxGroup.write
written = []

def slowly(*a):
    while written and not os.path.exists(sys.argv[1]):
        time.sleep(0.02)
    written.append(write(*a))

BoxGroup.write = slowly
sys.exit(main(["build", *sys.argv[2:]]))
"""


@pytest.fixture
def recipe(tmp_path, monkeypatch) -> Path:
    """A recipe that is built in eight parts, a block each."""
    monkeypatch.setattr(field_blocks, "BRICKS_AT_ONCE", 1)
    path = tmp_path / "ball.toml"
    path.write_text(RECIPE)
    return path


@pytest.fixture
def written(monkeypatch) -> list:
    """The blocks written, in order; set `written.fail` to what the fifth shall raise."""

    class BlocksWritten(list):
        fail: BaseException | None = None

    blocks, write = BlocksWritten(), BoxGroup.write

    def noted(group, block, values):
        if blocks.fail and len(blocks) == 4:
            raise blocks.fail
        write(group, block, values)
        blocks.append(block)

    monkeypatch.setattr(BoxGroup, "write", noted)
    return blocks


def assert_whole(path: Path, recipe: Path) -> None:
    """Densities are those of the box built in memory; axes went through halves: a step of 10 bits at most."""
    box, whole = load_box(path), build(recipe)
    found, wanted = (b.bricks.read(0, b.bricks.kept) for b in (box, whole))
    assert np.array_equal(box.bricks.places, whole.bricks.places)
    assert np.array_equal(found["density"], wanted["density"])
    assert np.abs(found["axis"].astype(float) - wanted["axis"]).max() < 2.0 / 511
    assert sorted(path.parent.glob(".*")) == []  # no work, no lock is left


def test_a_box_built_on_disk_is_the_box_built_in_memory(recipe, tmp_path):
    build_to(recipe, tmp_path / "ball.zarr")
    assert_whole(tmp_path / "ball.zarr", recipe)


@pytest.mark.parametrize(
    ("fault", "raised", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), InputError, "the disk is full"),
        (OSError(errno.EIO, "Input/output error"), InputError, "Input/output error"),
        (KeyboardInterrupt(), KeyboardInterrupt, "the same command resumes it"),
    ],
)
def test_a_build_cut_off_leaves_no_box_and_goes_on_where_it_stopped(recipe, tmp_path, written, fault, raised, said):
    written.fail = fault
    with pytest.raises(raised) as told:
        build_to(recipe, tmp_path / "ball.zarr")
    assert said in str(told.value) and "the same command resumes it" in str(told.value) and "\n" not in str(told.value)
    assert not (tmp_path / "ball.zarr").exists()
    written.fail = None
    before = set(written)
    build_to(recipe, tmp_path / "ball.zarr")
    assert set(written[len(before) :]).isdisjoint(before) and len(set(written)) == 8
    assert_whole(tmp_path / "ball.zarr", recipe)


@pytest.mark.by_night("None-axis/c/0/0/1/0", "-density/c/0/0/0", "-axis/c/0/0/1/0")
@pytest.mark.parametrize("lost", ["density/c/0/0/0", "axis/c/0/0/1/0"])
@pytest.mark.parametrize("left", [None, b""])
def test_a_chunk_lost_from_the_work_is_made_again(recipe, tmp_path, written, lost, left):
    """As a loss of power may leave it: away, or empty."""
    written.fail = OSError(errno.EIO, "Input/output error")
    with pytest.raises(InputError):
        build_to(recipe, tmp_path / "ball.zarr")
    written.fail = None
    chunk = tmp_path / ".ball.zarr.building" / "whole" / lost
    chunk.unlink() if left is None else chunk.write_bytes(left)
    build_to(recipe, tmp_path / "ball.zarr")
    assert_whole(tmp_path / "ball.zarr", recipe)


def test_an_interrupted_build_says_in_one_line_how_to_go_on(recipe, tmp_path, written, capsys):
    written.fail = KeyboardInterrupt()
    assert main(["build", str(recipe), "--out", str(tmp_path / "ball.zarr")]) == 130
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "the same command resumes it" in said


def test_another_recipe_does_not_take_up_the_work(recipe, tmp_path, written):
    written.fail = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(InputError):
        build_to(recipe, tmp_path / "ball.zarr")
    written.fail = None
    recipe.write_text(RECIPE.replace("20.0", "19.0"))
    with pytest.warns(UserWarning, match="another recipe"):
        build_to(recipe, tmp_path / "ball.zarr")
    assert_whole(tmp_path / "ball.zarr", recipe)


def test_a_file_that_a_recipe_names_is_part_of_it(tmp_path):
    record = {"shape": {"file": "ball.ply"}, "name": "ball"}
    (tmp_path / "ball.ply").write_text("one")
    before = fingerprint(record, tmp_path)
    assert fingerprint(record, tmp_path) == before
    (tmp_path / "ball.ply").write_text("another")
    assert fingerprint(record, tmp_path) != before


def test_bad_input_met_while_building_leaves_nothing_behind(recipe, tmp_path, written):
    written.fail = InputError("density has NaN")
    with pytest.raises(InputError, match="NaN"):
        build_to(recipe, tmp_path / "ball.zarr")
    assert os.listdir(tmp_path) == ["ball.toml"]


def test_the_box_that_is_replaced_stands_until_the_new_one_is_whole(recipe, tmp_path, written):
    path = tmp_path / "ball.zarr"
    build_to(recipe, path)
    with pytest.raises(InputError, match="--force"):
        build_to(recipe, path)
    recipe.write_text(RECIPE.replace("20.0", "19.0"))
    written.clear()
    written.fail = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(InputError):
        build_to(recipe, path, force=True)
    assert load_box(path).provenance["recipe"]["shape"]["radius_mm"] == 20.0
    written.fail = None
    build_to(recipe, path, force=True)
    assert_whole(path, recipe)


def _started(recipe: Path, path: Path) -> subprocess.Popen:
    """A process that builds, once its first part is done: it does not go on before there is a file `go` beside it."""
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_BUILD, str(path.with_name("go")), str(recipe), "--out", path]
    )
    done = path.with_name(f".{path.name}.building") / "done" / "0.npz"
    while not done.exists():
        assert process.poll() is None
        time.sleep(0.02)
    return process


def test_a_killed_build_is_taken_up_and_its_lock_with_it(recipe, tmp_path, written):
    path = tmp_path / "ball.zarr"
    process = _started(recipe, path)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not path.exists()
    build_to(recipe, path)
    assert 0 < len(written) < 8  # the rest was done before
    assert_whole(path, recipe)


@pytest.mark.nightly
def test_of_two_processes_that_build_one_box_the_second_is_refused(recipe, tmp_path):
    path = tmp_path / "ball.zarr"
    process = _started(recipe, path)
    try:
        with pytest.raises(InputError, match=f"process {process.pid}"):
            build_to(recipe, path)
        with pytest.raises(InputError, match=f"process {process.pid}"):
            build_to(recipe, path, force=True)
    finally:
        (tmp_path / "go").touch()
        assert process.wait() == 0  # undisturbed
    assert_whole(path, recipe)


def test_a_work_folder_of_somebody_else_s_files_is_no_work(recipe, tmp_path):
    (tmp_path / ".ball.zarr.building").mkdir()
    (tmp_path / ".ball.zarr.building" / "mine").touch()
    with pytest.raises(InputError, match="did not write"):
        build_to(recipe, tmp_path / "ball.zarr")
    assert (tmp_path / ".ball.zarr.building" / "mine").exists()
    shutil.rmtree(tmp_path / ".ball.zarr.building")
    build_to(recipe, tmp_path / "ball.zarr")
