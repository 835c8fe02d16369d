"""What is not finite is not written: one line says which quantity it is, and what was there stays."""

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.finite import check_finite
from hagoromo.files.record import write_json
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import save_box

GREY = np.full((5, 7), 0.5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39])
def test_a_picture_with_a_pixel_that_is_not_finite_is_not_written(tmp_path, value):
    """1e39 is finite in double precision and infinite in the file."""
    bad = GREY.copy()
    bad[2, 3] = bad[4, 4] = value
    (tmp_path / "a.exr").write_text("mine")
    with pytest.raises(
        InputError, match=r"^a\.exr cannot be written: channel G is not finite in 2 of 35 pixels: "
    ) as said:
        write_exr(tmp_path / "a.exr", {"R": GREY, "G": bad})
    assert "\n" not in str(said.value) and (tmp_path / "a.exr").read_text() == "mine"


@pytest.mark.parametrize("value", [np.nan, np.inf, float("-inf")])
def test_a_record_or_table_with_a_number_that_is_not_finite_is_not_written(tmp_path, value):
    with pytest.raises(InputError, match=r"a\.json cannot be written: fit\.steps\[1\] is "):
        write_json(tmp_path / "a.json", {"name": "a", "fit": {"steps": [1.0, value]}})
    with pytest.raises(InputError, match=r"a\.csv cannot be written: column R is not finite in 1 of 2 rows"):
        write_table(tmp_path / "a.csv", {"wavelength_nm": [400.0, 500.0], "R": [1.0, value]})
    assert not list(tmp_path.iterdir())


def test_a_box_that_memory_spoilt_is_not_written(tmp_path, monkeypatch):
    """Boxes are checked where they are made: here the voxels are spoilt behind that."""
    axis = np.broadcast_to(np.array((0.0, 0.0, 1.0)), (9, 9, 9, 3))
    matter = Reflectance(0.1, 0.1, 0.3, 1.5, Spectrum.constant(1.0))
    box = VolumeBox.from_arrays(np.ones((9, 9, 9)), axis, 0.001, 10.0, [matter])
    read = type(box.bricks).read

    def spoilt(self, begin, end):
        held = read(self, begin, end)
        held["axis"][0, 1, 2, 3] = np.nan
        return held

    monkeypatch.setattr(type(box.bricks), "read", spoilt)
    with pytest.raises(InputError, match="axis is not finite in 3 of"):
        save_box(box, tmp_path / "a.zarr")
    assert not list(tmp_path.iterdir())


def test_whole_numbers_and_halves_are_looked_at_as_they_are():
    check_finite({"labels": np.arange(5), "half": np.ones((3, 4), np.float16)}, "a")
    with pytest.raises(InputError, match="half is not finite in 1 of 12"):
        check_finite({"half": np.where(np.arange(12).reshape(3, 4) == 5, np.inf, 1.0).astype(np.float16)}, "a")
