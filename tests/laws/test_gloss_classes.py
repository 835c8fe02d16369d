"""Gloss classes: a relief shows the gloss that was measured in each pixel."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.image.render import render
from hagoromo.light.spectrum import smooth_rgb_basis
from hagoromo.matter.relief.relief import CLASSES, gloss_classes, read_relief, relief_plan, surface_reflectances
from hagoromo.photograph.pixels import write_points
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import write_materials

WIDTH, HEIGHT, FOCAL = 61, 17, 5000.0
CAMERA = hg.Camera(WIDTH, HEIGHT, (FOCAL, FOCAL), (WIDTH / 2, HEIGHT / 2), response=hg.Response.load("cie1931"))
PARAMETERS = ("alpha", "beta", "gamma", "n", "nu", "specular_albedo")
MATERIAL = MaterialEstimate(
    name="glaze",
    pixels=WIDTH * HEIGHT,
    alpha=0.05,
    body_colour=(1.0, 1.0, 1.0),
    interface_colour=(1.0, 1.0, 1.0),
    beta=1.0,
    gamma=0.2,
    n=1.5,
    specular_albedo=0.1,
    standard_error={key: 0.01 for key in PARAMETERS} | {"body_colour": (0.01,) * 3, "interface_colour": None},
    interval_95={key: (0.1, 0.2) for key in PARAMETERS}
    | {"body_colour": ((0.9, 1.1),) * 3, "interface_colour": ((0.0, 2.0),) * 3},
    correlation=((1.0,) * 4,) * 4,
    identifiable={key: True for key in PARAMETERS},
    chi_square=1.0,
)


def measured(folder, beta):
    """A flat plate across the line of sight, 1 m away, whose β varies from pixel to pixel."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    write_materials((MATERIAL,), folder / "materials.json", True)
    write_png(folder / "labels.png", np.ones((HEIGHT, WIDTH), np.uint8))
    normals = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    normals[..., 2] = -1.0
    write_exr(folder / "normals.exr", dict(zip(("N.X", "N.Y", "N.Z"), np.moveaxis(normals, 2, 0), strict=True)))
    write_points(folder / "points.exr", np.stack([u / FOCAL, v / FOCAL, np.ones_like(u)], axis=2))
    gamma = np.full((HEIGHT, WIDTH), 0.2, np.float32)
    error = {"error.beta": gamma, "error.gamma": gamma}
    write_exr(folder / "gloss.exr", {"beta": beta.astype(np.float32), "gamma": gamma, **error})
    return folder


def test_boxes_have_the_gloss_of_each_pixel(tmp_path):
    """β from 0.5 to 3 over a plate in the mirror's direction: its light to 4 %, half a class; one β was 100 % off."""
    beta = np.broadcast_to(np.geomspace(0.5, 3.0, WIDTH), (HEIGHT, WIDTH))
    relief, materials = read_relief(measured(tmp_path, beta))
    assert len(materials) <= CLASSES + 1 and materials[0].beta == MATERIAL.beta
    basis = smooth_rgb_basis()
    relief = replace(relief, body=0.1 * relief.body)
    box = relief_plan(relief, CAMERA, surface_reflectances(materials, basis, 0.1)).box()
    lamp = hg.Lamp(to_lamp=(0.0, 0.0, -1.0))
    assert CAMERA.response is not None
    shown = render(hg.Scene(CAMERA, (lamp,), (box,)), hg.Settings(tolerance=0.01)).expose(CAMERA.response)[..., 1]
    middle = shown[HEIGHT // 2]
    f0 = 0.04
    expected = 0.05 + f0 * np.geomspace(0.5, 3.0, WIDTH)
    ratio = middle / expected
    assert ratio[2:-2] / np.median(ratio) == pytest.approx(np.ones(WIDTH - 4), abs=0.04)


def test_classes_are_as_many_as_the_gloss_needs():
    random = np.random.default_rng(1)
    two = np.repeat(np.log([[0.5, 0.1], [2.0, 0.3]]), 50, axis=0) + 1e-3 * random.normal(size=(100, 2))
    assert gloss_classes(two, 32).max() == 1
    wide = random.normal(size=(5000, 2))
    classes = gloss_classes(wide, 32)
    assert classes.max() == 31
    means = np.array([wide[classes == one].mean(axis=0) for one in range(32)])
    # better than the best 5 levels of each number, whose mean squared error is 0.0799 (Max 1960, normal distribution)
    assert np.mean((wide - means[classes]) ** 2) < 0.0799
