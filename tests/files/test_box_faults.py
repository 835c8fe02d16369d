"""Damaged and foreign groups are refused in one line that names what is wrong, before anything large is allocated."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import zarr

from hagoromo.errors import InputError
from hagoromo.files import memory
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box, look_at_box, save_box
from hagoromo.volume.table import in_table_order, table_of

GREY = Reflectance(0.2, 0.3, 0.2, 1.5, Spectrum.constant(0.8), name="grey")


@pytest.fixture
def box(tmp_path) -> Path:
    """A box of 2 × 1 × 1 blocks on disk, matter in both."""
    density = np.zeros((71, 13, 19))
    density[5:9, 3:7, 3:17] = density[66:70, 3:7, 3:17] = 0.5
    axis = np.broadcast_to((0.0, 0.6, 0.8), (*density.shape, 3))
    material = np.zeros(density.shape, np.uint8)
    save_box(VolumeBox.from_arrays(density, axis, 0.001, 300.0, [GREY], material), tmp_path / "b.zarr")
    return tmp_path / "b.zarr"


def set_key(path: Path, *keys_and_value) -> None:
    *keys, last, value = keys_and_value
    record = json.loads(path.read_text())
    place = record
    for key in keys:
        place = place[key]
    place[last] = value
    path.write_text(json.dumps(record))


def replace_array(box: Path, name: str, values: np.ndarray, **kind) -> None:
    zarr.open_group(box).create_array(name, data=values, overwrite=True, **kind)


def values_of(box: Path, name: str) -> np.ndarray:
    return np.asarray(zarr.open_group(box, mode="r")[name])


def with_nan(box: Path) -> None:
    density = values_of(box, "density")
    density[67, 4, 4] = np.nan
    replace_array(box, "density", density, chunks=(64, 13, 19))


def with_lost_matter(box: Path) -> None:
    density = values_of(box, "density")
    density[40, 4, 4] = 1
    replace_array(box, "density", density, chunks=(64, 13, 19))


def with_link(box: Path) -> None:
    chunk = box / "density" / "c" / "1" / "0" / "0"
    chunk.rename(box.parent / "elsewhere")
    chunk.symlink_to(box.parent / "elsewhere")


def with_linked_array(box: Path) -> None:
    (box / "axis").rename(box.parent / "elsewhere")
    (box / "axis").symlink_to(box.parent / "elsewhere")


def with_vast_shape(box: Path) -> None:
    for name, more in (("density", []), ("axis", [3]), ("material", [])):
        set_key(box / name / "zarr.json", "shape", [40_000_000] * 3 + more)


def with_vast_chunk(box: Path) -> None:
    shape = [4_000_000] * 3
    set_key(box / "density" / "zarr.json", "shape", shape)
    set_key(box / "density" / "zarr.json", "chunk_grid", "configuration", "chunk_shape", shape)


def with_unknown_codec(box: Path) -> None:
    set_key(box / "density" / "zarr.json", "codecs", 1, {"name": "numcodecs.pickle", "configuration": {}})


FAULTS = {
    "no chunk": (lambda box: (box / "axis/c/1/0/0/0").unlink(), "axis/c/1/0/0/0 is missing"),
    "cut chunk": (lambda box: os.truncate(box / "density/c/1/0/0", 20), "density/c/1/0/0 cannot be decoded"),
    "empty chunk": (lambda box: os.truncate(box / "axis/c/0/0/0/0", 0), "axis/c/0/0/0/0 cannot be decoded"),
    "foreign chunk": (lambda box: (box / "axis/c/0/0/0/0").write_bytes(b"x" * 999), "axis/c/0/0/0/0 cannot be decoded"),
    "chunk of another array": (
        lambda box: (box / "density/c/1/0/0").write_bytes((box / "axis/c/0/0/0/0").read_bytes()),
        "density/c/1/0/0 cannot be decoded",
    ),
    "no axis": (lambda box: (box / "axis/zarr.json").unlink(), "lacks the array 'axis'"),
    "no density": (lambda box: (box / "density/zarr.json").unlink(), "lacks the array 'density'"),
    "bad metadata": (lambda box: (box / "density/zarr.json").write_text('{"zarr_format": 3}'), "be read as Zarr"),
    "other axes": (lambda box: replace_array(box, "axis", np.zeros((71, 13, 19, 2), "f2")), "needs (71, 13, 19, 3)"),
    "whole axes": (lambda box: replace_array(box, "axis", np.zeros((71, 13, 19, 3), "i2")), "floating-point"),
    "flat density": (lambda box: replace_array(box, "density", np.zeros((71, 13), "f2")), "three numbers"),
    "complex density": (lambda box: replace_array(box, "density", np.zeros((71, 13, 19), "c8")), "complex64"),
    "text density": (lambda box: replace_array(box, "density", np.zeros((71, 13, 19), "S3")), "an array of numbers"),
    "other bricks": (lambda box: replace_array(box, "bricks", np.ones((3, 2, 3), bool)), "needs (9, 2, 3)"),
    "material 1 of 1": (lambda box: replace_array(box, "material", np.ones((71, 13, 19), "u1")), "material number 1"),
    "material -1": (lambda box: replace_array(box, "material", -np.ones((71, 13, 19), "i1")), "from -1"),
    "NaN": (with_nan, "near voxel"),
    "lost matter": (with_lost_matter, "holds matter where `bricks` names none"),
    "link": (with_link, "is a link"),
    "linked array": (with_linked_array, "is a link"),
    "vast shape": (with_vast_shape, "GiB"),
    "vast chunk": (with_vast_chunk, "GiB"),
    "unknown codec": (with_unknown_codec, "pickle"),
    "format 2": (lambda box: set_key(box / "zarr.json", "attributes", "hagoromo", "format", 2), "update Hagoromo"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*does not have a Zarr V3 specification")  # where a test writes such types
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_in_one_line(box, name):
    damage, said = FAULTS[name]
    damage(box)
    with pytest.raises(InputError) as refused:
        load_box(box)
    assert said in str(refused.value) and "\n" not in str(refused.value) and "b.zarr" in str(refused.value)


def test_a_pipe_among_the_chunks_is_refused_and_not_waited_for(box):
    (box / "density/c/0/0/0").unlink()
    os.mkfifo(box / "density/c/0/0/0")
    with pytest.raises(InputError, match="not a regular file"):
        load_box(box)


def test_a_box_that_does_not_fit_the_memory_is_refused_with_both_sizes(box, monkeypatch):
    need = look_at_box(box).bytes
    monkeypatch.setattr(memory, "free_memory", lambda: need // 2)
    with pytest.raises(InputError, match=r"needs .* GiB of memory and .* GiB are free"):
        load_box(box)


def test_looking_at_a_box_reads_no_voxels(box):
    (box / "density/c/1/0/0").write_bytes(b"")
    assert look_at_box(box).kept == load_kept(box)


def load_kept(box: Path) -> int:
    return int(values_of(box, "bricks").sum())


@pytest.mark.parametrize("bricks", [(1, 1, 1 << 67), (1 << 24,) * 3, (1 << 21,) * 3])
def test_a_table_of_a_lattice_beyond_any_memory_is_refused(bricks):
    """The product of its sides is beyond what NumPy counts; a shell states its shape by itself."""
    for act in (in_table_order, table_of):
        with pytest.raises(InputError, match="the table of a lattice of"):
            act(np.zeros((1, 3), np.int32), bricks)
