"""Volume boxes that are damaged, or hold what is no density, are refused before memory is asked for."""

import json
from typing import Any

import numpy as np
import pytest

from hagoromo.files.zarr_arrays import ZarrArray


@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_a_density_that_is_none_is_refused(refused, scene, box, tmp_path, value):
    import zarr

    density: Any = zarr.open_group(box)["density"]
    density[3, 2, 1] = value
    seen = scene(more='[[box]]\nfile = "slab.zarr"\n')
    assert "density" in refused("render", seen, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("key", "value"), [("voxel_size", 0.0), ("voxel_size", "NaN"), ("tau", -1.0), ("pose", [0.0] * 16), ("tau", None)]
)
def test_a_lattice_of_no_size_is_refused(refused, box, key, value):
    record = json.loads((box / "zarr.json").read_text())
    record["attributes"]["hagoromo"][key] = value
    (box / "zarr.json").write_text(json.dumps(record))
    assert key in refused("info", box)


@pytest.mark.parametrize(("shape", "said"), [([0, 5, 7], "0"), ([1 << 18, 1 << 18, 1 << 18], "GiB of memory")])
def test_a_lattice_that_is_empty_or_does_not_fit_memory_is_refused_before_allocation(
    refused, box, scene, monkeypatch, shape, said
):
    for name, more in (("density", []), ("axis", [3])):
        record = json.loads((box / name / "zarr.json").read_text())
        record["shape"] = [*shape, *more]
        (box / name / "zarr.json").write_text(json.dumps(record))

    def read(*_):
        raise AssertionError("it is read before it is refused, which would take hours")

    monkeypatch.setattr(ZarrArray, "read", read)
    assert said in refused("info", box)
    assert said in refused("render", scene(more='[[box]]\nfile = "slab.zarr"\n'), "--out", box.with_name("a.exr"))


@pytest.mark.parametrize("name", ["zarr.json", "density/zarr.json", "bricks/c/0/0/0"])
def test_a_damaged_box_is_refused(refused, box, name):
    path = box / name
    path.write_bytes(path.read_bytes()[:5])
    refused("info", box)
