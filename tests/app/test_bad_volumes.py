"""Volumes of other programs that are damaged, too large or ambiguous are refused in one line."""

import gzip
import struct

import pytest

from hagoromo.app.cli import main
from hagoromo.files.volume_file import resampled
from hagoromo.volume.store.box_store import load_box
from tests.files.test_volume_files import EDGES, RAW, VALUES, a_box, metaimage, nifti, nrrd, vol

REFUSED = {
    "cut.nrrd": (nrrd()[:-3], "cut off"),
    "large.nrrd": (nrrd().replace(b"sizes: 5 4 3", b"sizes: 500000 400000 300000"), "states"),
    "bomb.nrrd": (nrrd("gzip", gzip.compress(RAW[:8])), "unpacks to 8 bytes"),
    "type.nrrd": (nrrd().replace(b"uint16", b"block"), "type.nrrd"),
    "text.nrrd": (nrrd("ascii"), "is packed by"),
    "shear.nrrd": (nrrd().replace(b"(0.0,0.5,0.0)", b"(0.5,0.5,0.0)"), "right angles"),
    "cut.mha": (metaimage() + RAW[:-1], "cut off"),
    "flat.mha": (metaimage().replace(b"5 4 3", b"5 4"), "three"),
    "name.raw": (RAW, "no header"),
    "cut.vol": (vol()[:-1], "cut off"),
    "old.vol": (b"VOL\2" + vol()[4:], "version 2"),
    "cut.nii": (nifti()[:-5], "cut.nii"),
    "large.nii": (nifti()[:42] + struct.pack("<3h", 32767, 32767, 32767) + nifti()[48:], "states"),
    "a.txt": (b"1 2 3\n", "no"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_volume_that_cannot_be_read_is_refused_in_one_line(tmp_path, refused, name):
    data, said = REFUSED[name]
    (tmp_path / name).write_bytes(data)
    line = refused("convert", tmp_path / name, "--out", tmp_path / "a.zarr", "--scale", "1")
    assert said in line and name in line


def test_a_box_is_not_written_as_what_is_only_read(tmp_path, refused):
    a_box(tmp_path)
    assert "written as .nrrd, .nhdr, .vti, .vol, .vdb" in refused(
        "convert", tmp_path / "a.zarr", "--out", tmp_path / "a.nii"
    )


def test_whole_numbers_need_a_scale_or_a_window(tmp_path, refused):
    (tmp_path / "a.mha").write_bytes(metaimage() + RAW)
    out = ("--out", tmp_path / "a.zarr")
    said = refused("convert", tmp_path / "a.mha", *out)
    assert "whole numbers (uint16)" in said and "scale" in said and "window" in said
    box = a_box(tmp_path, window=None)
    assert main(["convert", str(tmp_path / "a.mha"), "--window", "50", "150", "--out", str(tmp_path / "b.zarr")]) == 0
    windowed = load_box(tmp_path / "b.zarr")
    densest = resampled(VALUES, EDGES, 0.5).max() / 200
    assert windowed.bricks.densest == 1.0 and box.bricks.densest == pytest.approx(densest, abs=1e-3)
    other = ("--out", tmp_path / "c.zarr")
    assert "two different numbers" in refused("convert", tmp_path / "a.mha", *other, "--window", "1", "1")
