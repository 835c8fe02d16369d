"""A box is opened from its packed bricks, which are never more than a copy of the arrays beside them."""

import errno
import shutil
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest
import zarr

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store import box_store as store
from hagoromo.volume.store import build_store, packed_bricks
from hagoromo.volume.store.box_store import load_box, save_box
from hagoromo.volume.store.build_store import build_box
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan

GREY = Reflectance(0.2, 0.3, 0.2, 1.5, Spectrum.constant(0.8), name="grey")
SHAPE = (71, 23, 19)


def a_box(shape=SHAPE, colours=2, seed=3) -> VolumeBox:
    """Random voxels, which no codec shortens: chunks keep their size whatever is in them."""
    rng = np.random.default_rng(seed)
    density = rng.uniform(0.01, 1.0, shape)
    density[20:60] = 0
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return VolumeBox.from_arrays(
        density, axis, 0.001, 300.0, [GREY, GREY], material=rng.integers(0, 2, shape).astype(np.uint8),
        body_colour=rng.random((*shape, colours)) if colours else None, basis=(Spectrum.constant(1.0),) * colours,
    )  # fmt: skip


@pytest.fixture
def path(tmp_path, monkeypatch) -> Path:
    """A box on disk with several chunks of packed bricks, the last one not full."""
    monkeypatch.setattr(packed_bricks, "BRICKS_PER_CHUNK", 7)
    save_box(a_box(), tmp_path / "b.zarr")
    return tmp_path / "b.zarr"


def assert_same_bricks(box: VolumeBox, other: VolumeBox) -> None:
    """Bit by bit, in the memory of the device."""
    assert np.array_equal(box.bricks.places, other.bricks.places)
    for name in ("density", "axis", "colour", "material"):
        grid, wanted = getattr(box.bricks, name), getattr(other.bricks, name)
        assert (grid is None) == (wanted is None), name
        if grid:
            assert np.array_equal(np.array(grid.read(0, grid.count)), np.array(wanted.read(0, grid.count))), name


def packed_is_used(path: Path, monkeypatch) -> bool:
    """Whether a box is opened without its arrays being cut into bricks."""
    cut = []
    read_bricks = store.read_bricks
    with monkeypatch.context() as patched:
        patched.setattr(store, "read_bricks", lambda *given: cut.append(given) or read_bricks(*given))
        load_box(path)
    return not cut


@pytest.mark.parametrize(("shape", "colours"), [(SHAPE, 0), (SHAPE, 3), ((9, 9, 9), 4), ((2, 5, 7), 0)])
@pytest.mark.parametrize("together", [5, 512])
def test_packed_bricks_are_those_cut_from_the_arrays(tmp_path, monkeypatch, shape, colours, together):
    monkeypatch.setattr(packed_bricks, "BRICKS_PER_CHUNK", together)
    box = a_box(shape, colours)
    save_box(box, tmp_path / "b.zarr")
    assert packed_is_used(tmp_path / "b.zarr", monkeypatch)
    assert_same_bricks(load_box(tmp_path / "b.zarr"), box)
    shutil.rmtree(tmp_path / "b.zarr" / "packed")
    assert not packed_is_used(tmp_path / "b.zarr", monkeypatch)
    assert_same_bricks(load_box(tmp_path / "b.zarr"), box)


def test_packed_bricks_follow_their_box_to_another_place(path, monkeypatch):
    path.rename(path.with_name("c.zarr"))
    assert packed_is_used(path.with_name("c.zarr"), monkeypatch)


@pytest.mark.parametrize("name", ["density", "axis", "body_colour", "material"])
def test_one_voxel_that_another_program_changes_is_noticed(path, name, monkeypatch):
    """Chunks of random halves keep their size: their checksums tell."""
    voxel, array = (65, 3, 4), an_array(path, name)
    array[voxel] = 1 - array[voxel] if name == "material" else 0.25
    assert not packed_is_used(path, monkeypatch)
    changed = load_box(path)
    with pytest.raises(AssertionError, match="colour" if name == "body_colour" else name):
        assert_same_bricks(changed, a_box())
    shutil.rmtree(path / "packed")
    assert_same_bricks(changed, load_box(path))


def an_array(group: Path, name: str) -> Any:
    return zarr.open_group(group)[name]


def edit(path: Path, name: str, change, **kind) -> None:
    """Write an array of the packed bricks anew, changed."""
    array = an_array(path / "packed", name)
    kind.setdefault("chunks", array.chunks)
    zarr.open_group(path / "packed").create_array(name, data=change(np.asarray(array)), overwrite=True, **kind)


def with_bits(voxel, value):
    def change(values):
        values[voxel] = value
        return values

    return change


FAULTS = {
    "no array": (lambda path: shutil.rmtree(path / "packed/axis"), "packed/axis is no array int32"),
    "fewer bricks": (lambda path: edit(path, "axis", lambda v: v[:-1]), "packed/axis is no array int32"),
    "other type": (lambda path: edit(path, "density", lambda v: v.astype("f4")), "packed/density is no array float16"),
    "other voxels": (lambda path: edit(path, "material", lambda v: v[:, :8]), "packed/material is no array uint8"),
    "cut across": (lambda path: edit(path, "axis", lambda v: v, chunks=(7, 3, 9, 9)), "packed/axis is no array"),
    "no chunk": (lambda path: (path / "packed/density/c/1/0/0/0").unlink(), "chunk 1 of"),
    "cut chunk": (lambda path: (path / "packed/axis/c/0/0/0/0").write_bytes(b"x" * 20), "axis/c/0/0/0/0 cannot be"),
    "NaN": (lambda path: edit(path, "density", with_bits((3, 4, 4, 4), np.nan)), "is no density"),
    "infinite": (lambda path: edit(path, "density", with_bits((0, 8, 8, 8), np.inf)), "is no density"),
    "dense": (lambda path: edit(path, "density", with_bits((0, 0, 0, 0), 65000.0)), "is no density"),
    "negative": (lambda path: edit(path, "density", with_bits((1, 0, 0, 0), -1.0)), "is no density"),
    "colour": (lambda path: edit(path, "colour", with_bits((1, 0, 0, 0, 1), np.nan)), "is no colour"),
    "material": (lambda path: edit(path, "material", with_bits((1, 0, 0, 0), 2)), "is no material"),
}  # fmt: skip


@pytest.mark.by_night("other type", "other voxels", "infinite", "dense", "cut chunk")
@pytest.mark.parametrize("name", FAULTS)
def test_damaged_packed_bricks_are_named_in_one_line_and_the_box_is_read_without(path, name):
    damage, said = FAULTS[name]
    damage(path)
    with pytest.raises(InputError) as refused:
        load_box(path)
    assert said in str(refused.value) and "\n" not in str(refused.value) and "packed" in str(refused.value)
    shutil.rmtree(path / "packed")
    assert_same_bricks(load_box(path), a_box())


def test_a_flipped_bit_in_a_packed_chunk_is_noticed(path):
    chunk = path / "packed/axis/c/1/0/0/0"
    damaged = bytearray(chunk.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    chunk.write_bytes(damaged)
    with pytest.raises(InputError, match=r"axis/c/1/0/0/0 cannot be decoded"):
        load_box(path)


def test_packed_bricks_of_another_format_are_passed_over(path, monkeypatch):
    zarr.open_group(path / "packed").attrs["format"] = 2
    assert not packed_is_used(path, monkeypatch)


def test_a_build_cut_off_while_packing_goes_on_with_it(tmp_path, monkeypatch):
    def ball(point):
        return dr.select(dr.norm(point - 4.0) < 3.0, 0.5, 0.0), dr.normalize(point)

    plan = BoxPlan(BoxHeader(0.5, 1.0, (GREY,)), FieldBlocks(ball, (17, 17, 17), 0.5))
    path = tmp_path / "ball.zarr"
    with monkeypatch.context() as patched:
        patched.setattr(packed_bricks, "seal", lambda arrays: (_ for _ in ()).throw(OSError(errno.ENOSPC, "full")))
        with pytest.raises(InputError, match="disk is full"):
            build_box(plan, path, "ball")
    assert not path.exists()
    told: list[float] = []
    build_box(plan, path, "ball", progress=lambda share, step="": told.append(share))
    assert told == sorted(told) and told[-1] == 1.0
    assert packed_is_used(path, monkeypatch) and build_store.BUILT in told
    packed = load_box(path)
    shutil.rmtree(path / "packed")
    assert_same_bricks(packed, load_box(path))
