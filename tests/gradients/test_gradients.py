"""Derivatives of f and of the march against central finite differences."""

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import ELEMENTS, element_weights
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Lighting, Materials, palette_of
from hagoromo.transport.march import march
from hagoromo.transport.medium import Medium
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import PlainVoxels

FIGURES = (0.23, 0.41, 0.27, 1.45)  # alpha, beta, gamma, n


def directions(seed, count=301):
    """Axis, to_lamp, to_eye with lamp and eye on the axis' side, away from the kinks of G and of the horizon."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(3, count, 3)) * (0.5, 0.5, 0.0) + (0, 0, 1.0)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    double = arrays().Float64
    return [arrays().Array3f64(*(double(np.ascontiguousarray(d[:, k])) for k in range(3))) for d in v]


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("which", range(4), ids=("alpha", "beta", "gamma", "n"))
def test_gradient_of_f(element, which):
    def f(figures):
        weights = element_weights(element, *directions(3), *figures)
        return weights.body + weights.interface

    figures = [arrays().Float64(value) for value in FIGURES]
    dr.enable_grad(figures[which])
    value = f(figures)
    dr.forward(figures[which])
    derivative = np.array(dr.grad(value)) * np.ones(301)
    h = 1e-6
    ends = [f([v + sign * h * (k == which) for k, v in enumerate(map(arrays().Float64, FIGURES))]) for sign in (1, -1)]
    difference = (np.array(ends[0]) - np.array(ends[1])) / (2 * h)
    # a central difference in double precision: h² and 1e-16/h, both below 1e-8; the cylinder's reach has kinks
    assert np.abs(derivative).max() > 1e-3
    assert np.quantile(np.abs(derivative - difference), 0.97) < 1e-7 * np.abs(difference).max()


def march_of(medium, lighting):
    kinds = arrays()
    x = dr.linspace(kinds.Float, -0.03, 0.03, 127)
    origin, direction = kinds.Array3f(x, 0.013, -1.0), kinds.Array3f(0.0, 0.0, 1.0) + 0 * x
    channels, passed = march(medium, lighting, origin, direction, kinds.Float(0), kinds.Float(9))
    return channels[0] + channels[1], passed


@pytest.fixture
def ball():
    """A thin soft ball, its grid in single precision; rays pass it, so CUT, which cuts the gradient, is not met."""

    def field(p):
        offset = p - 0.08
        radius = dr.norm(offset)
        return dr.fmin(dr.fmax((0.06 - radius) / 0.03, 0.0), 1.0), offset / dr.fmax(radius, 1e-6)

    material = Reflectance(*FIGURES, Spectrum.constant(1.0))
    pose = np.eye(4)
    pose[:3, 3] = -0.08
    box = VolumeBox.from_field(field, (24, 24, 24), 0.16 / 24, 20.0, [material], pose=pose)
    lighting = Lighting(
        [Lamp(to_lamp=(0.3, 0.2, -1.0))], Materials([material], palette_of([material], [], [Spectrum.constant(1.0)]))
    )
    medium = Medium([box])
    held = box.bricks.read(0, box.bricks.kept)
    values = np.concatenate([held["density"][..., None], held["axis"]], axis=-1).astype(np.float32)
    medium.voxels = PlainVoxels(arrays().Float(values.ravel()))
    return medium, lighting


def test_gradient_of_the_march_by_density(ball):
    medium, lighting = ball
    kinds, voxels = arrays(), arrays().Float(medium.voxels.values)
    change = np.random.default_rng(4).uniform(0, 1, (dr.width(voxels) // 4, 4)) * (
        np.array(voxels).reshape(-1, 4)[:, :1] > 0
    )
    change[:, 1:] = 0  # density only
    change = kinds.Float(change.ravel().astype(np.float32))
    dr.enable_grad(medium.voxels.values)
    dr.set_grad(medium.voxels.values, change)
    values = march_of(medium, lighting)
    dr.enqueue(dr.ADMode.Forward, medium.voxels.values)
    dr.traverse(dr.ADMode.Forward)
    derivatives = [np.array(dr.grad(value)) for value in values]
    h = 2e-3
    ends = []
    for sign in (1, -1):
        medium.voxels.values = voxels + sign * h * change
        ends.append([np.array(value) for value in march_of(medium, lighting)])
    for derivative, high, low in zip(derivatives, *ends, strict=True):
        difference = (high - low) / (2 * h)
        # single precision: 1e-7 / h on values near 1
        assert np.abs(derivative - difference).max() < 2e-3 * np.abs(difference).max() > 0


def test_gradient_of_the_march_by_colour(ball):
    """The body coefficient enters linearly: its derivative is the body part itself."""
    medium, lighting = ball
    rows = np.array(lighting.materials.rows)
    entry = 5  # the first coefficient on the palette, after alpha, beta, gamma, n and element
    dr.enable_grad(lighting.materials.rows)
    dr.set_grad(lighting.materials.rows, arrays().Float((np.arange(rows.size) == entry).astype(np.float32)))
    value, _ = march_of(medium, lighting)
    dr.enqueue(dr.ADMode.Forward, lighting.materials.rows)
    dr.traverse(dr.ADMode.Forward)
    derivative = np.array(dr.grad(value))
    ends = []
    for sign in (1, -1):
        moved = rows.copy()
        moved[entry] += sign * 0.25
        lighting.materials.rows = arrays().Float(moved)
        ends.append(np.array(march_of(medium, lighting)[0]))
    difference = (ends[0] - ends[1]) / 0.5
    assert np.abs(derivative - difference).max() < 1e-5 * np.abs(difference).max() > 0
