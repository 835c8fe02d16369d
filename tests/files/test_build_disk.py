"""A box streamed to disk is the box built in memory: colours, materials and the borders of bricks and blocks too."""

import errno
from collections import namedtuple

import drjit as dr
import numpy as np
import pytest
import zarr

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store import disk_budget, field_blocks
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.box_store import load_box
from hagoromo.volume.store.build_store import build_box
from hagoromo.volume.store.disk_budget import check_disk, estimated_size, size_on_disk
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.store.zarr_plan import ZarrVolume

GREY = Reflectance(0.2, 0.1, 0.2, 1.5, Spectrum.constant(0.8))
VOXEL = 0.5  # m
STEP = 2.0 / 511  # of an axis' coarsest part: it went through halves before it was brought to its bits


def coloured(point):
    """Matter in three layers of half a brick each, coloured and of two materials everywhere."""
    density = dr.select(dr.abs(point.z - 4.0 * dr.round(point.z * 0.25)) < 0.6, 0.25 + 0.001 * point.x, 0.0)
    material = dr.select(point.y > 10.0, arrays().UInt(1), 0)
    return density, dr.normalize(point), material, [0.01 * point.x, 0.02 * point.y]


def plain(point):
    return coloured(point)[:2]


def low_half(middle, radius):
    return middle.x < 20.0 + radius


def left_plain(point):
    density, axis = plain(point)
    return dr.select(point.x < 20.0, density, 0.0), axis


@pytest.mark.parametrize("shape", [(66, 71, 65), (9, 17, 131), (2, 3, 5)])
@pytest.mark.parametrize(("field", "occupied"), [(coloured, None), (plain, None), (left_plain, low_half)])
def test_a_box_streamed_to_disk_is_the_box_built_in_memory(tmp_path, field, occupied, shape):
    basis = (Spectrum.constant(1.0), Spectrum([400, 700], [0.0, 1.0])) if field is coloured else ()
    header = BoxHeader(VOXEL, 1.0, (GREY, GREY), basis=basis, name="layers")
    build_box(BoxPlan(header, FieldBlocks(field, shape, VOXEL, occupied)), tmp_path / "box.zarr", "layers")
    box = load_box(tmp_path / "box.zarr")
    whole = VolumeBox.from_field(field, shape[::-1], VOXEL, 1.0, (GREY, GREY), occupied, basis=basis)
    assert np.array_equal(box.bricks.places, whole.bricks.places) and whole.bricks.kept
    found, wanted = (b.bricks.read(0, b.bricks.kept) for b in (box, whole))
    assert found.keys() == wanted.keys()
    for name, values in wanted.items():
        if name == "axis":
            assert np.abs(found[name].astype(float) - values).max() < STEP
        else:
            assert np.array_equal(found[name], values), name
    assert box.name == "layers" and len(box.basis) == len(basis)


def upper(point):
    """Matter from the first layer of the second blocks on: the last bricks of the first ones share it."""
    return dr.select(point.z > 64 * VOXEL, 0.5, 0.0), dr.normalize(point)


def test_a_block_that_only_shares_the_matter_of_the_next_survives_a_resumed_build(tmp_path, monkeypatch):
    shape, path, write = (66, 9, 70), tmp_path / "box.zarr", BoxGroup.write
    monkeypatch.setattr(field_blocks, "BRICKS_AT_ONCE", 1)
    plan = BoxPlan(BoxHeader(VOXEL, 1.0, (GREY,)), FieldBlocks(upper, shape, VOXEL))

    def failing(group, block, values):
        if block == (1, 0, 1):
            raise OSError(errno.EIO, "Input/output error")
        write(group, block, values)

    monkeypatch.setattr(BoxGroup, "write", failing)
    with pytest.raises(InputError):
        build_box(plan, path, "upper")
    monkeypatch.setattr(BoxGroup, "write", write)
    build_box(plan, path, "upper")
    whole = VolumeBox.from_field(upper, (70, 9, 66), VOXEL, 1.0, (GREY,))
    assert np.array_equal(load_box(path).bricks.places, whole.bricks.places)
    assert (whole.bricks.places[:, 0] == 7).any()


def layers(shape=(66, 71, 131)) -> BoxPlan:
    return BoxPlan(BoxHeader(VOXEL, 1.0, (GREY, GREY)), FieldBlocks(left_plain, shape, VOXEL, low_half))


def free_on_disk(monkeypatch, size: float) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(disk_budget.shutil, "disk_usage", lambda folder: usage(0, 0, int(size)))


def test_a_box_that_will_not_fit_the_disk_is_refused_before_it_is_built(tmp_path, monkeypatch):
    """Its size is estimated from some blocks: within three standard errors of what it is."""
    plan = layers()
    needed, error = estimated_size(plan)
    build_box(plan, tmp_path / "box.zarr", "layers")
    size = size_on_disk(tmp_path / "box.zarr")
    assert size > 1e5 and abs(needed - size) < 3.0 * error + 0.05 * size
    free_on_disk(monkeypatch, 0.3 * size)
    with pytest.raises(InputError, match=r"b\.zarr: the box needs about .* GiB on the disk and .* GiB are free in"):
        build_box(layers(), tmp_path / "new" / "b.zarr", "layers")
    assert [path.name for path in tmp_path.iterdir()] == ["box.zarr"]
    (tmp_path / ".b.zarr.building").mkdir()  # what was written before an interruption takes no new room
    (tmp_path / ".b.zarr.building" / "done").write_bytes(bytes(size))
    check_disk(layers(), tmp_path / "b.zarr")


def test_where_all_voxels_fit_the_disk_nothing_is_estimated(tmp_path, monkeypatch):
    monkeypatch.setattr(disk_budget, "estimated_size", lambda plan: pytest.fail("it need not be"))
    free_on_disk(monkeypatch, 1e9)
    check_disk(layers((66, 9, 70)), tmp_path / "box.zarr")


def test_the_size_of_a_box_from_a_zarr_array_is_estimated(tmp_path):
    """Noise, in tiles of several blocks."""
    density = np.random.default_rng(3).random((50, 60, 250)).astype(np.float32)
    zarr.create_array(tmp_path / "noise", data=density, chunks=(50, 60, 30))
    plan = BoxPlan(BoxHeader(VOXEL, 1.0, (GREY,)), ZarrVolume(tmp_path / "noise"))
    needed, error = estimated_size(plan)
    build_box(plan, tmp_path / "noise.zarr", "noise")
    size = size_on_disk(tmp_path / "noise.zarr")
    assert len(plan.blocks.parts()) > 1
    assert abs(needed - size) < 3.0 * error + 0.2 * size, (needed, error, size)
