"""Numbers that no camera, response or lamp has, and photographs of nothing, are refused in one line by every verb."""

import json

import numpy as np
import pytest

from hagoromo.files.exr import write_exr
from hagoromo.files.table import write_table

FIGURES = {
    "bits = 12": "bits = 4000000000",
    "read_noise = 5": "read_noise = 1e300",
    "gain = 10": "gain = 1e-300",
    "exposure = 40000": "exposure = 1e300",
}


@pytest.mark.parametrize("old", FIGURES)
def test_a_sensor_that_cannot_be_is_refused(refused, scene, tmp_path, old):
    assert old.split(" = ", 1)[0] in refused("simulate", scene(old, FIGURES[old]), "--out", tmp_path / "c")


def test_a_response_beyond_single_precision_is_refused(refused, scene, tmp_path):
    waves = np.arange(400.0, 701.0, 50.0)
    write_table(tmp_path / "r.csv", {"wavelength_nm": waves} | {c: waves * 1e90 for c in "RGB"})
    path = scene('response = "canon_eos_300d"', 'response = "r.csv"')
    assert "above 1e+15" in refused("render", path, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize(("value", "said"), [(0.0, "variance"), (-1.0, "variance"), (1e30, "above 1e+15")])
def test_photographs_of_nothing_are_refused(refused, tmp_path, value, said):
    for k in range(4):
        write_exr(tmp_path / f"{k}.exr", {c: np.full((16, 18), value, np.float32) for c in "RGB"})
    lamps = [{"to_lamp": [np.cos(a), np.sin(a), 1.0]} for a in range(4)]
    (tmp_path / "lamps.json").write_text(json.dumps({"lamps": lamps}))
    files = [tmp_path / f"{k}.exr" for k in range(4)]
    assert said in refused("capture", *files, "--lamps", tmp_path / "lamps.json", "--out", tmp_path / "c")


@pytest.mark.parametrize("seed", ["18446744073709551616", "-1", "9" * 400])
def test_a_seed_beyond_its_range_is_refused(refused, tmp_path, recipe, seed):
    (tmp_path / "a.toml").write_text(recipe.replace("size_mm", f"seed = {seed}\nsize_mm"))
    assert "seed" in refused("build", tmp_path / "a.toml", "--out", tmp_path / "a.zarr")


@pytest.mark.parametrize("out", [".", "..", "/"])
def test_the_folder_that_one_is_in_is_no_output(refused, tmp_path, monkeypatch, recipe, out):
    (tmp_path / "a.toml").write_text(recipe)
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")
    assert "name" in refused("build", tmp_path / "a.toml", "--out", out)
