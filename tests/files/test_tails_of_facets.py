"""The exponent ν of the facets' tails in files: kept, absent or null where facets are Gaussian, and old files load."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.record import read_json, write_json
from hagoromo.light.spectrum import smooth_rgb_basis
from hagoromo.matter.relief.relief import surface_reflectances
from hagoromo.reflectance.material.material_table import reflectance_from_table
from tests.files.test_schemas import material

WHITE = hg.Spectrum.constant(1.0)
GAUSSIAN = hg.Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, name="Gaussian")
TAILED = replace(GAUSSIAN, nu=0.8, name="tailed")
FIGURES = "alpha = 0.1\nbeta = 0.1\ngamma = 0.2\nn = 1.5\nbody_colour = 1.0\n"


def nus(materials) -> list[float]:
    return [one.nu for one in materials]


def test_boxes_keep_the_tails_of_each_material(tmp_path):
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (5, 7, 3, 3))
    box = hg.VolumeBox.from_arrays(np.ones((5, 7, 3), np.float32), axis, 0.01, 9.0, [GAUSSIAN, TAILED])
    hg.save_box(box, tmp_path / "box.zarr")
    stored = json.loads((tmp_path / "box.zarr" / "zarr.json").read_text())["attributes"]["hagoromo"]["materials"]
    assert [one.get("nu") for one in stored] == [None, 0.8] and "nu" not in stored[0]  # as boxes were before
    assert nus(hg.load_box(tmp_path / "box.zarr").materials) == [math.inf, 0.8]


def test_materials_json_keeps_the_tails(tmp_path):
    path = hg.write_materials([material(), replace(material(), name="glaze", nu=1.7)], tmp_path / "materials.json")
    stored = read_json(path)
    assert [one["nu"] for one in stored] == [None, 1.7]
    assert nus(hg.read_materials(path)) == [math.inf, 1.7]
    assert [hg.info(path)[name]["nu"] for name in ("silk", "glaze")] == [None, 1.7]
    write_json(path, [{key: value for key, value in one.items() if key != "nu"} for one in stored])  # an older file
    assert nus(hg.read_materials(path)) == [math.inf, math.inf]
    write_json(path, [stored[0] | {"nu": 0.2}])
    with pytest.raises(hg.InputError, match=r"nu must be a number, 0.3 or more.*: given 0.2"):
        hg.read_materials(path)


def test_a_measured_material_carries_its_tails_and_interface_colour_into_matter(tmp_path):
    glaze = replace(material(), name="glaze", nu=1.7)
    hg.write_materials([glaze], tmp_path / "materials.json")
    table = {"file": "materials.json", "material": "glaze"}
    assert reflectance_from_table(table, tmp_path, "material").nu == 1.7
    coloured = replace(glaze, interface_colour=(1.2, 1.0, 0.8))
    plain, golden = surface_reflectances([glaze, coloured], smooth_rgb_basis(), 0.5)
    assert nus([plain, golden]) == [1.7, 1.7]
    wavelengths = np.array([460.0, 540.0, 630.0])
    np.testing.assert_allclose(plain.interface_colour.at(wavelengths), 1.0)
    np.testing.assert_allclose(golden.interface_colour.at(wavelengths), (0.8, 1.0, 1.2))


def test_recipes_and_scenes_state_the_tails(tmp_path: Path):
    solid = 'kind = "solid"\nvoxel_mm = 4.0\nshape = {form = "sphere", radius_mm = 30.0}\n[material]\n'
    for said, nu in (("", math.inf), ("nu = 0.8\n", 0.8)):
        (tmp_path / "ball.toml").write_text(solid + FIGURES + said)
        assert nus(hg.build(tmp_path / "ball.toml").materials) == [nu]
    camera = "[camera]\nsize = [7, 5]\nfocal = [20.0, 20.0]\neye = [0.0, -1.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n"
    inline = "{" + FIGURES.strip().replace("\n", ", ") + ", nu = 2.5}"
    scene = f'{camera}[[lamp]]\nto_lamp = [0.0, -1.0, 0.0]\n[[surface]]\nshape = "sphere"\nreflectance = {inline}\n'
    (tmp_path / "scene.toml").write_text(scene)
    surface = hg.load_scene(tmp_path / "scene.toml")[0].surfaces[0]
    assert surface.reflectance.nu == 2.5
    (tmp_path / "scene.toml").write_text(scene.replace("nu = 2.5", "nu = 0.1"))
    with pytest.raises(hg.InputError, match=r"nu must be a number, 0.3 or more: given 0.1"):
        hg.load_scene(tmp_path / "scene.toml")
