"""Exports: what is written part by part has the bytes of what is written at once, in memory that does not grow."""

import tracemalloc

import numpy as np
import pytest

from hagoromo.files.volume_file import read_volume
from hagoromo.volume.box import VolumeBox
from hagoromo_formats.volumes import lattice_field, openvdb_out, volumes_out
from hagoromo_formats.volumes.lattice_field import BoxField, slabs
from hagoromo_formats.volumes.mitsuba_volume import write_mitsuba_volume
from hagoromo_formats.volumes.nrrd_file import write_nrrd
from hagoromo_formats.volumes.openvdb_out import write_openvdb
from hagoromo_formats.volumes.volumes_out import lattice_matrix
from hagoromo_formats.volumes.vtk_images import write_vti
from tests.files.test_box import GREY, a_box
from tests.oracle.dense_field import dense_field

FIELDS = ("density", "axis", "colour")
WRITERS = {
    ".vdb": lambda path, fields, box: write_openvdb(path, fields, lattice_matrix(box)),
    ".vti": lambda path, fields, box: write_vti(path, fields, lattice_matrix(box)),
    ".nrrd": lambda path, fields, box: write_nrrd(path, fields["colour"], lattice_matrix(box), "colour"),
    ".vol": lambda path, fields, box: write_mitsuba_volume(path, fields["axis"], box.voxel_size),
}


@pytest.mark.parametrize("coloured", [True, False])
def test_every_part_of_a_field_is_that_of_all_voxels(coloured, monkeypatch):
    """Parts that begin and end within bricks, at the ends of the lattice, and where no brick is stored."""
    monkeypatch.setattr(lattice_field, "BRICKS_AT_ONCE", 5)
    box = a_box((71, 13, 19), coloured)
    for field in FIELDS:
        whole = dense_field(box, field)
        for low, high in (((0, 0, 0), whole.shape[:3]), ((7, 8, 9), (17, 13, 10)), ((30, 0, 0), (50, 13, 19))):
            part = BoxField(box, field).part(low, high)
            assert part.dtype == np.float32 and np.array_equal(part, whole[tuple(map(slice, low, high))]), (low, high)


@pytest.mark.parametrize("suffix", WRITERS)
def test_files_written_by_parts_have_the_bytes_of_those_written_at_once(tmp_path, suffix, monkeypatch):
    """At once: one slab, and one cube of a tree, hold all voxels of arrays; by parts: a layer of bricks, bricks."""
    box = a_box((71, 13, 19))
    arrays = {field: dense_field(box, field) for field in FIELDS}
    WRITERS[suffix](tmp_path / f"once{suffix}", arrays, box)
    monkeypatch.setattr(lattice_field, "VOXELS_AT_ONCE", 1)
    assert len(list(slabs(BoxField(box, "density")))) == 9
    WRITERS[suffix](tmp_path / f"parts{suffix}", {field: BoxField(box, field) for field in FIELDS}, box)
    assert (tmp_path / f"once{suffix}").read_bytes() == (tmp_path / f"parts{suffix}").read_bytes()


def test_leaves_of_several_cubes_are_written_in_the_order_of_the_tree(tmp_path):
    """Matter on both sides of the border of two cubes of 128 voxels, along every axis."""
    values = np.zeros((131, 5, 133), np.float32)
    values[[0, 127, 128, 130, 130], [0, 4, 1, 0, 2], [0, 127, 128, 132, 3]] = [1, 2, 3, 4, 5]
    write_openvdb(tmp_path / "a.vdb", {"density": values}, np.eye(4))
    assert np.array_equal(read_volume(tmp_path / "a.vdb").values, values)
    assert openvdb_out.CUBE == 128


def sheet(layers: int) -> VolumeBox:
    """A sheet, one brick thick, in a lattice of many layers: a few per cent of them hold matter."""
    density = np.zeros((layers, 96, 96), np.float16)
    density[3:6] = 0.5
    axis = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float16), (*density.shape, 3))
    return VolumeBox.from_arrays(density, axis, 1e-3, 100.0, [GREY])


@pytest.mark.by_night(".nrrd", ".vti")
@pytest.mark.parametrize("suffix", [".vdb", ".nrrd", ".vti", ".vol"])
def test_memory_of_an_export_does_not_grow_with_the_lattice(tmp_path, suffix):
    """Peaks of what NumPy and Python take: those of twice as many voxels are a tenth more at most."""
    write, peaks = getattr(volumes_out, suffix[1:]), []
    for layers in (16, 384, 768):  # the first imports what is needed
        box = sheet(layers)
        tracemalloc.start()
        write(box, tmp_path / f"a{suffix}", "axis")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.1 * peaks[1], peaks
