"""A volume box written and read again is the same box; damaged and foreign groups are refused in one line."""

import json
import shutil

import numpy as np
import pytest
import zarr

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import load_box, save_box

GREY = Reflectance(0.2, 0.3, 0.2, 1.5, Spectrum([400, 550, 700], [0.2, 0.9, 0.4]), name="grey")


def a_box(shape=(71, 13, 19), colour=True) -> VolumeBox:
    rng = np.random.default_rng(3)
    density = rng.uniform(0.01, 1.0, shape).astype(np.float16)
    density[rng.random(shape) < 0.3] = 0
    density[20:60] = 0  # empty bricks, and matter on both sides of the border of two chunks
    density[63:66, 3, 4] = 1
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    pose = np.eye(4)
    pose[:3, 3] = (0.1, -0.2, 0.3)
    basis = (Spectrum.constant(1.0), Spectrum([400, 700], [0.0, 1.0])) if colour else ()
    return VolumeBox.from_arrays(
        density, axis, 0.001, 300.0, [GREY, GREY], material=(density > 0.5).astype(np.uint8),
        body_colour=rng.random((*shape, 2)) if colour else None, basis=basis, pose=pose, name="sample",
    )  # fmt: skip


def assert_same_bricks(box: VolumeBox, other: VolumeBox) -> None:
    """Bit by bit: halves hold densities as they are, and the 11-bit steps of an axis apart."""
    assert np.array_equal(box.bricks.places, other.bricks.places)
    voxels, others = (b.bricks.read(0, b.bricks.kept) for b in (box, other))
    assert voxels.keys() == others.keys()
    for name in voxels:
        assert np.array_equal(voxels[name], others[name]), name


@pytest.mark.parametrize("colour", [True, False])
def test_a_box_written_and_read_is_the_same_box(tmp_path, colour):
    box = a_box(colour=colour)
    save_box(box, tmp_path / "box.zarr")
    read = load_box(tmp_path / "box.zarr")
    assert_same_bricks(read, box)
    assert np.array_equal(read.pose, box.pose) and (read.tau, read.voxel_size, read.name) == (300.0, 0.001, "sample")
    assert read.materials[1].record() == GREY.record()
    assert [s.record() for s in read.basis] == [s.record() for s in box.basis]


@pytest.mark.parametrize("shape", [(9, 9, 9), (65, 11, 64), (66, 129, 13), (2, 5, 7)])
def test_no_voxel_is_lost_at_the_borders_of_bricks_blocks_and_lattice(tmp_path, shape):
    box = a_box(shape)
    save_box(box, tmp_path / "box.zarr")
    assert_same_bricks(load_box(tmp_path / "box.zarr"), box)


def test_a_box_without_matter_is_a_box(tmp_path):
    box = VolumeBox.from_arrays(np.zeros((9, 9, 9)), np.zeros((9, 9, 9, 3)), 0.1, 1.0, [GREY])
    save_box(box, tmp_path / "box.zarr")
    assert load_box(tmp_path / "box.zarr").bricks.kept == 0


def test_a_group_of_another_writer_without_its_bricks_is_read_all_the_same(tmp_path):
    """Its chunks may have any shape, and the chunks without matter may be there."""
    box = a_box()
    save_box(box, tmp_path / "box.zarr")
    group = zarr.open_group(tmp_path / "box.zarr")
    for name, chunks in (("density", (5, 13, 19)), ("axis", (100, 7, 7, 3)), ("material", (64, 64, 64))):
        values = np.asarray(group[name])
        group.create_array(name, data=values, chunks=chunks, overwrite=True, config={"write_empty_chunks": True})
    shutil.rmtree(tmp_path / "box.zarr" / "bricks")
    assert_same_bricks(load_box(tmp_path / "box.zarr"), box)


def test_dense_arrays_come_back_from_bricks():
    density = np.zeros((11, 17, 23), np.float16)
    density[4:9, 10:12, 3:20] = 0.5
    box = VolumeBox.from_arrays(density, np.zeros((11, 17, 23, 3)), 0.1, 1.0, [GREY])
    assert np.array_equal(box.bricks.dense()[0], density)


def test_empty_chunks_are_absent(tmp_path):
    density = np.zeros((130, 9, 9), np.float16)
    density[1, 4, 4] = 1
    box = VolumeBox.from_arrays(density, np.zeros((130, 9, 9, 3)), 0.1, 1.0, [GREY])
    save_box(box, tmp_path / "b.zarr")
    chunks = [p for p in (tmp_path / "b.zarr" / "density").rglob("*") if p.is_file() and p.name != "zarr.json"]
    assert len(chunks) == 1


def test_a_box_is_not_overwritten(tmp_path):
    box = a_box(colour=False)
    save_box(box, tmp_path / "b.zarr")
    with pytest.raises(InputError, match="exists"):
        save_box(box, tmp_path / "b.zarr")
    save_box(box, tmp_path / "b.zarr", force=True)


def _damage_attributes(path):
    meta = json.loads((path / "zarr.json").read_text())
    meta["attributes"]["hagoromo"]["tau"] = -1
    (path / "zarr.json").write_text(json.dumps(meta))


def _truncate_chunk(path):
    chunk = next(p for p in (path / "density").rglob("*") if p.is_file() and p.name != "zarr.json")
    chunk.write_bytes(chunk.read_bytes()[:20])


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: (path / "zarr.json").unlink(),
        lambda path: (path / "zarr.json").write_text("{"),
        lambda path: (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}'),
        lambda path: (path / "density" / "zarr.json").unlink(),
        _damage_attributes,
        _truncate_chunk,
    ],
)
def test_damaged_and_foreign_groups_are_refused_in_one_line(tmp_path, damage):
    save_box(a_box(colour=False), tmp_path / "b.zarr")
    damage(tmp_path / "b.zarr")
    with pytest.raises(InputError) as refused:
        load_box(tmp_path / "b.zarr")
    assert "\n" not in str(refused.value) and "b.zarr" in str(refused.value)
