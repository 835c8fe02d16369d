"""The extension for Blender: its zip, and in Blender itself, where `make cycles` put it, pictures beside Cycles'."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / ".venv/cycles/bin/python"
BLENDER = pytest.mark.skipif(not PYTHON.exists(), reason="Blender's module bpy is not here: make cycles")
BLOCK = 8  # px: Cycles' noise is that of 256 rays a pixel


def test_the_zip_has_the_manifest_and_every_module(tmp_path):
    command = [sys.executable, ROOT / "packaging/extension.py", tmp_path]
    archive = Path(subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip())
    with zipfile.ZipFile(archive) as held:
        names, manifest = set(held.namelist()), tomllib.loads(held.read("blender_manifest.toml").decode())
    assert names == {path.name for path in (ROOT / "hagoromo_blender").iterdir() if path.is_file()}
    assert archive.name == f"hagoromo_blender-{hg.__version__}.zip" and manifest["version"] == hg.__version__


def in_blender(*arguments, **more):
    """What a script prints that Blender's Python runs."""
    command = Path(sys.executable).with_name("hagoromo")
    environment = {**os.environ, "HAGOROMO_COMMAND": str(command), **more}
    done = subprocess.run(
        [PYTHON, *arguments], env=environment, capture_output=True, text=True, check=False, timeout=3000
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def blocks(folder, side):
    """Means of both pictures over blocks of pixels."""
    both = (np.load(folder / f"{name}.npy") for name in ("hagoromo", "cycles"))
    return [
        each.reshape(each.shape[0] // side, side, each.shape[1] // side, side, 3).mean(axis=(1, 3)) for each in both
    ]


@BLENDER
@pytest.mark.nightly
def test_cameras_lamps_and_materials_are_those_of_cycles(tmp_path):
    """Light of the first order on matt bodies: blocks within 3 % (they differ where coloured light meets colours)."""
    in_blender(ROOT / "studies/blender_session.py", "surfaces", tmp_path)
    ours, theirs = blocks(tmp_path, BLOCK)
    assert np.sqrt(np.mean((ours - theirs) ** 2) / np.mean(theirs**2)) < 0.03
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1)), rtol=0.03)


@BLENDER
@pytest.mark.nightly
def test_normals_heights_and_tiles_are_those_of_cycles(tmp_path):
    """Each of three squares, in blocks of 4 × 4 pixels, within 3 %: slopes are taken by other differences."""
    in_blender(ROOT / "studies/blender_session.py", "mapped", tmp_path)
    ours, theirs = blocks(tmp_path, 4)
    for one, other in zip(np.split(ours, 3, axis=1), np.split(theirs, 3, axis=1), strict=True):
        assert np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2)) < 0.03
    inside = ours[5:11, 5:11, 1], theirs[5:11, 5:11, 1]
    assert all(np.ptp(each) > 0.2 * each.mean() for each in inside)


@BLENDER
@pytest.mark.nightly
def test_a_moving_cube_is_blurred_as_by_cycles(tmp_path):
    """Its ramps, by walks and by Cycles, each with noise: 2 % of the middle in the mean."""
    in_blender(ROOT / "studies/blender_session.py", "moving", tmp_path)
    ours, theirs = (each.mean(axis=0)[:, 1] for each in blocks(tmp_path, 1))
    assert np.abs(ours - theirs).mean() < 0.02 * theirs.max()
    edge = np.flatnonzero((theirs > 0.1 * theirs.max()) & (theirs < 0.9 * theirs.max()))
    assert len(edge) > 20  # ramps of half of the picture, and no steps
    assert np.abs(ours - theirs)[edge].max() < 0.03 * theirs.max()


@BLENDER
@pytest.mark.nightly
def test_what_cannot_be_rendered_or_dressed_is_one_line(tmp_path):
    said = in_blender(ROOT / "tests/app/blender_faults.py").splitlines()
    expected = [
        "Cannot render, no camera", "Hagoromo: nothing is visible", "Hagoromo: nothing gives light", "Plane is flat",
        "is neither a capture", "Hagoromo: camera camera is ortho",
    ]  # fmt: skip
    lines = [line for line in said if line.strip() and not line.startswith(("Error: ", "Info: ", "Warning: "))]
    assert len(lines) == len(expected), said
    for line, part in zip(lines, expected, strict=True):
        assert part in line


@BLENDER
@pytest.mark.nightly
def test_blender_takes_the_zip(tmp_path):
    command = [sys.executable, ROOT / "packaging/extension.py", tmp_path]
    archive = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    place = "lib/python*/site-packages/bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
    (judge,) = PYTHON.parents[1].glob(place)
    assert "Success" in in_blender(judge, "validate", archive)


@BLENDER
@pytest.mark.nightly
def test_without_the_command_it_says_what_to_install(tmp_path):
    said = in_blender(ROOT / "tests/app/blender_faults.py", HAGOROMO_COMMAND="", PATH="")
    assert "the command hagoromo was not found" in said
