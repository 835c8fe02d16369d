"""The reflectance on NumPy arrays: f, and directions drawn by it."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.camera.camera import Camera

WHITE = hg.Spectrum.constant(1.0)
RED = hg.Spectrum([400.0, 500.0, 600.0, 700.0], [0.1, 0.1, 0.8, 0.8])
MATERIALS = {
    "matte": hg.Reflectance(0.2, 0.0, 0.2, 1.5, RED),
    "glossy": hg.Reflectance(0.1, 0.6, 0.08, 1.5, RED),
    "tails": hg.Reflectance(0.1, 0.3, 0.15, 1.4, WHITE, nu=1.2),
    "lobes": hg.Reflectance(0.1, 0.2, 0.3, 1.5, WHITE, lobes=((0.3, 0.05),)),
    "rough body": hg.Reflectance(0.1, 0.1, 0.3, 1.5, WHITE, epsilon=0.1, sigma=0.2),
}
FROM_ABOVE, ASIDE = (0.0, 0.0, 1.0), (0.4, -0.3, 0.7)


def sphere_directions(count):
    """Even over the sphere (N, 3), by a spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def test_f_of_a_matte_plane_is_lamberts_law():
    lamp = np.array([[0.0, 0.0, 2.0], [0.0, 3.0, 3.0], [0.0, 1.0, -0.1]])
    f = MATERIALS["matte"].evaluate(FROM_ABOVE, lamp, ASIDE, [450.0, 650.0])
    np.testing.assert_allclose(f, 0.2 * np.outer([1.0, math.sqrt(0.5), 0.0], [0.1, 0.8]), rtol=1e-9)
    assert MATERIALS["matte"].evaluate(FROM_ABOVE, lamp[None, :, None], ASIDE).shape == (1, 3, 1, 1)


def test_f_is_the_radiance_of_a_picture():
    """A plane that fills a picture under one far lamp, as `render` shows it: an independent way through the kernels."""
    plane = MATERIALS["lobes"]
    lamp = hg.Lamp(to_lamp=(0.3, 0.2, 0.9), intensity=2.0)
    view = Camera(3, 3, (40.0, 40.0), (1.5, 1.5)).look_at((0.3, 0.0, 0.9), (0.0, 0.0, 0.0), up=(0, 1, 0))
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    surface = hg.Surface(plane, vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    image = hg.render(hg.Scene(view, (lamp,), surfaces=(surface,)))
    seen = float(image.weights[1, 1].sum())  # the colours are 1
    assert seen == pytest.approx(2.0 * plane.evaluate(FROM_ABOVE, (0.3, 0.2, 0.9), (0.3, 0.0, 0.9)).item(), rel=2e-4)


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("to_eye", [ASIDE, (0.9, 0.0, 0.2)])
def test_the_density_is_that_of_the_samples(name, to_eye, double_precision):
    """It integrates to 1; means over samples are integrals, of f and of a direction's parts."""
    material, axis = MATERIALS[name], (0.2, 0.1, 1.0)
    numbers = np.random.default_rng(3).random((40000, 3))
    drawn, density = material.sample(axis, to_eye, numbers)
    np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0, rtol=double_precision)
    np.testing.assert_allclose(material.pdf(axis, drawn, to_eye), density, rtol=1e-4)
    every = sphere_directions(100_000)
    of_every = material.pdf(axis, every, to_eye)
    area = 4.0 * math.pi / len(every)
    assert of_every.sum() * area == pytest.approx(1.0, abs=3e-3)
    np.testing.assert_allclose(drawn.mean(axis=0), of_every @ every * area, atol=0.015)
    light = material.evaluate(axis, drawn, to_eye)[:, 0] / density
    expected = material.evaluate(axis, every, to_eye).sum() * area
    assert light.mean() == pytest.approx(expected, abs=4.0 * light.std() / 200.0 + 0.003 * expected)


def test_f_of_a_fibre_holds_what_passes_through():
    """Its integral over all directions is the albedo that the material states."""
    fibre = hg.Reflectance(0.05, 0.1, 0.2, 1.5, WHITE, element="cylinder", transmission=0.4)
    every = sphere_directions(100_000)
    f = fibre.evaluate((1.0, 0.0, 0.0), every, (0.0, 0.0, 1.0))
    assert f.sum() * 4.0 * math.pi / len(every) == pytest.approx(fibre.directional_albedo()[0], rel=5e-3)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: m.evaluate((0, 0, 0), FROM_ABOVE, ASIDE), "axis has a direction that is 0 or not finite"),
        (lambda m: m.evaluate(FROM_ABOVE, (0, 0, math.nan), ASIDE), "to_lamp has a direction that is 0 or not finite"),
        (lambda m: m.evaluate(FROM_ABOVE, np.ones((4, 3)), np.ones((5, 3))), r"to_lamp \(4, 3\), to_eye \(5, 3\)"),
        (lambda m: m.pdf(FROM_ABOVE, (1.0, 0.0), ASIDE), r"to_lamp has shape \(2,\): give \(..., 3\)"),
        (lambda m: m.sample(FROM_ABOVE, ASIDE, (0.5, 1.0, 0.5)), "numbers are to be from 0 to below 1"),
    ],
)
def test_directions_that_are_none_are_one_line(call, said):
    with pytest.raises(hg.InputError, match=said):
        call(MATERIALS["glossy"])


@pytest.mark.parametrize("element", ["cylinder", "sphere"])
def test_only_planes_have_a_density(element):
    with pytest.raises(hg.InputError, match=f"for planes that only reflect, and this is a {element}"):
        hg.Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, element=element).pdf(FROM_ABOVE, FROM_ABOVE, ASIDE)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda number: hg.Reflectance(0.1, 0.1, 0.2, 1.5, number), "body_colour"),
        (lambda number: hg.Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, number), "interface_colour"),
        (lambda number: hg.Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, transmitted_colour=number), "transmitted_colour"),
        (lambda number: hg.Lamp(to_lamp=FROM_ABOVE, spectrum=number), "spectrum"),
        (lambda number: hg.AreaLamp((0, 0, 1), radius=0.1, radiance=1.0, spectrum=number), "spectrum"),
        (lambda number: hg.SurfaceEmission(1.0, number), "spectrum"),
    ],
)
def test_a_number_is_no_spectrum(make, what):
    with pytest.raises(hg.InputError, match=rf"{what} is 0.5: give a Spectrum, as hg.Spectrum.constant\(0.5\)"):
        make(0.5)
