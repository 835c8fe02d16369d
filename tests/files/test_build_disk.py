"""A box streamed to disk is the box built in memory: colours, materials and the borders of bricks and blocks too."""

import errno

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store import field_blocks
from hagoromo.volume.store.box_group import BoxGroup
from hagoromo.volume.store.box_store import load_box
from hagoromo.volume.store.build_store import build_box
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan

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
