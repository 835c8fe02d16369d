"""Derivatives of f and of the march against central finite differences."""

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, lookup
from hagoromo.reflectance.element import ELEMENTS, element_weights
from tests.laws.test_texel import quick_sheet

FIGURES = (0.23, 0.41, 0.27, 1.45)  # alpha, beta, gamma, n


def directions(seed, count=301):
    """Axis, to_lamp, to_eye with lamp and eye on the axis' side, away from the kinks of G and of the horizon."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(3, count, 3)) * (0.5, 0.5, 0.0) + (0, 0, 1.0)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    return [arrays().Array3f64(*(lookup(arrays().Float64, d[:, k]) for k in range(3))) for d in v]


@pytest.mark.usefixtures("exact_derivatives")
@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("which", range(4), ids=("alpha", "beta", "gamma", "n"))
def test_gradient_of_f(element, which):
    gradient_is_the_difference(element, which, FIGURES)


@pytest.mark.usefixtures("exact_derivatives")
@pytest.mark.parametrize("element", ["plane", "cylinder"])
@pytest.mark.parametrize("which", [2, 3, 4], ids=("gamma", "n", "nu"))
def test_gradient_of_f_with_tails(element, which):
    """The forms of D that are stable for every ν have derivatives that are."""
    gradient_is_the_difference(element, which, (*FIGURES, 0.8))


def gradient_is_the_difference(element, which, all_figures):
    def f(values):
        weights = element_weights(element, *directions(3), *values)
        return weights.body + weights.interface

    def opaque(values):
        """Kernels read these numbers from memory: one kernel serves all of an element's parameters and steps."""
        return [dr.opaque(arrays().Float64, value) for value in values]

    figures = opaque(all_figures)
    dr.enable_grad(figures)
    value = f(figures)
    for figure, tangent in zip(figures, opaque(np.eye(len(all_figures))[which].tolist()), strict=True):
        dr.set_grad(figure, tangent)
    derivative = np.array(dr.forward_to(value)) * np.ones(301)
    h = 1e-6
    ends = [np.array(f(opaque(v + sign * h * (k == which) for k, v in enumerate(all_figures)))) for sign in (1, -1)]
    difference = (ends[0] - ends[1]) / (2 * h)
    # a central difference in double precision: h² and 1e-16/h, both below 1e-8; the cylinder's reach has kinks
    assert np.abs(derivative).max() > 1e-3
    assert np.quantile(np.abs(derivative - difference), 0.97) < 1e-7 * np.abs(difference).max()


WHITE = hg.Spectrum.constant(1.0)
RAYS = 127
ORIGINS = np.stack([np.linspace(-0.03, 0.03, RAYS), np.full(RAYS, 0.013), np.full(RAYS, -1.0)], axis=1)
FORWARD = np.broadcast_to([0.0, 0.0, 1.0], (RAYS, 3))


def both(light: hg.RayLight) -> list[np.ndarray]:
    """The sum of the body's and the interface's weights, and the transmittance."""
    return [light.weights[:, 0] + light.weights[:, 1], light.transmittance]


@pytest.fixture
def ball():
    """A thin soft ball, its grid in single precision; rays pass it whole: an early end would cut the gradient."""

    def field(p):
        offset = p - 0.08
        radius = dr.norm(offset)
        return dr.fmin(dr.fmax((0.06 - radius) / 0.03, 0.0), 1.0), offset / dr.fmax(radius, 1e-6)

    material = hg.Reflectance(*FIGURES, hg.Spectrum.constant(1.0))
    pose = np.eye(4)
    pose[:3, 3] = -0.08
    box = hg.VolumeBox.from_field(field, (24, 24, 24), 0.16 / 24, 20.0, [material], pose=pose)
    camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, 0.013, -1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.3, 0.2, -1.0)),), (box,))
    return hg.RayMarch(scene, hg.Settings(shadows="none"), differentiable=True)


def test_gradient_of_the_march_by_density(ball):
    voxels = np.array(ball.voxels)
    change = np.random.default_rng(4).uniform(0, 1, (voxels.size // 4, 4)) * (voxels.reshape(-1, 4)[:, :1] > 0)
    change[:, 1:] = 0  # density only
    derivatives = both(ball.derivative(ORIGINS, FORWARD, voxels=change)[1])
    h = 2e-3
    ends = []
    for sign in (1, -1):
        ball.voxels = (voxels + sign * h * change.ravel()).astype(np.float32)
        ends.append(both(ball(ORIGINS, FORWARD)))
    for derivative, high, low in zip(derivatives, *ends, strict=True):
        difference = (high - low) / (2 * h)
        # the derivative holds where a cell is cut into steps, which moves in the differences: errors of the march
        assert np.abs(derivative - difference).max() < 1e-2 * np.abs(difference).max() > 0


def test_gradient_of_the_march_by_colour(ball):
    """The body coefficient enters linearly: its derivative is the body part itself."""
    rows = np.array(ball.materials)
    entry = 5  # the first coefficient on the palette, after alpha, beta, gamma, n and element
    unit = np.arange(rows.size) == entry
    derivative = both(ball.derivative(ORIGINS, FORWARD, materials=unit)[1])[0]
    ends = []
    for sign in (1, -1):
        ball.materials = (rows + sign * 0.25 * unit).astype(np.float32)
        ends.append(both(ball(ORIGINS, FORWARD))[0])
    difference = (ends[0] - ends[1]) / 0.5
    assert np.abs(derivative - difference).max() < 1e-5 * np.abs(difference).max() > 0


@pytest.mark.parametrize("element", ["plane", "cylinder"])
def test_gradient_of_the_march_by_axes_of_projected_extinction(element):
    """Axes lean by 50° to the rays, away from the kink of |a·ω|; light and transmittance depend on them."""

    def field(p):
        radius = dr.norm(p - 0.08)
        axis = type(p)(0.7 + 2.0 * (p.y - 0.08), 0.3, -0.6 + 3.0 * (p.x - 0.08))
        return dr.fmin(dr.fmax((0.06 - radius) / 0.03, 0.0), 1.0), dr.normalize(axis)

    material, pose = hg.Reflectance(*FIGURES, hg.Spectrum.constant(1.0), element=element), np.eye(4)
    pose[:3, 3] = -0.08
    box = hg.VolumeBox.from_field(field, (24, 24, 24), 0.16 / 24, 20.0, [material], pose=pose, extinction="projected")
    camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.0, 0.013, -1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.3, 0.2, -1.0)),), (box,))
    rays = hg.RayMarch(scene, hg.Settings(shadows="none"), differentiable=True)
    voxels = np.array(rays.voxels)
    change = np.random.default_rng(4).normal(size=(voxels.size // 4, 4)) * (voxels.reshape(-1, 4)[:, :1] > 0)
    change[:, 0] = 0  # axes only
    derivatives, ends, h = both(rays.derivative(ORIGINS, FORWARD, voxels=change)[1]), [], 2e-3
    for sign in (1, -1):
        rays.voxels = (voxels + sign * h * change.ravel()).astype(np.float32)
        ends.append(both(rays(ORIGINS, FORWARD)))
    for derivative, high, low in zip(derivatives, *ends, strict=True):
        difference = (high - low) / (2 * h)
        # single precision: 1e-7 / h on values near 1
        assert np.abs(derivative - difference).max() < 5e-3 * np.abs(difference).max() > 0


@pytest.mark.parametrize("entry", [2, -1], ids=("gamma", "nu"))
def test_gradient_of_the_march_by_tails(entry):
    """In a scene with and without tails: an infinite ν has the derivative 0 and spoils no other."""
    tailed, gaussian = (hg.Reflectance(0.1, 0.1, 0.27, 1.45, WHITE, nu=nu) for nu in (0.8, np.inf))
    shape = (5, 23, 29)
    axis = np.broadcast_to(np.array([0.2, 0.6, -0.77]), (*shape, 3))
    number = np.broadcast_to(np.arange(29) > 14, shape).astype(np.uint8)
    box = hg.VolumeBox.from_arrays(np.ones(shape, np.float32), axis, 0.01, 50.0, [tailed, gaussian], number)
    camera = hg.Camera(8, 6, (10.0, 10.0), (4.0, 3.0)).look_at((0.1, 0.1, -1.0), (0.1, 0.1, 0.0), (0.0, 1.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.3, 0.2, -1.0)),), (box,))
    march = hg.RayMarch(scene, hg.Settings(shadows="none"))
    rows = np.array(march.materials).reshape(2, -1)
    assert rows[0, -1] == np.float32(0.8) and np.isinf(rows[1, -1])
    rays = np.stack([np.linspace(0.02, 0.27, 41), np.full(41, 0.11), np.full(41, -1.0)], axis=1), FORWARD[:41]
    change = np.zeros_like(rows)
    change[0, entry] = 1.0
    derivative = both(march.derivative(*rays, materials=change.ravel())[1])[0]
    ends = []
    for sign in (1, -1):
        march.materials = np.where(change > 0, rows + sign * 0.01, rows).astype(np.float32).ravel()
        ends.append(both(march(*rays))[0])
    difference = (ends[0] - ends[1]) / 0.02
    # single precision, 1e-7 / h on values near 0.1, and h² of the second order
    assert np.abs(derivative - difference).max() < 2e-3 * np.abs(difference).max() > 0
    assert (derivative[rays[0][:, 0] > 0.17] == 0).all()  # the half without tails
    march.materials = rows.ravel()
    whole = np.ones_like(rows)
    whole[:, 4:] = 0.0
    whole[:, -1] = 1.0  # every figure at once, the infinite exponents too
    assert np.isfinite(both(march.derivative(*rays, materials=whole.ravel())[1])[0]).all()


def test_rays_of_arrays_and_of_dr_jit_give_the_same_light(ball):
    light, jit = ball(ORIGINS, FORWARD), arrays()
    x = jit.Float(ORIGINS[:, 0].astype(np.float32))
    weights, transmittance = ball.along(jit.Array3f(x, 0.013, -1.0), jit.Array3f(0.0, 0.0, 1.0) + 0 * x)
    np.testing.assert_array_equal(light.weights[:, 0], np.array(weights[0]))
    np.testing.assert_array_equal(light.transmittance, np.array(transmittance))
    np.testing.assert_array_equal(hg.march(ball, ORIGINS, FORWARD).weights, light.weights)


def test_a_box_without_matter_has_no_light_and_a_derivative(ball):
    empty = hg.VolumeBox.from_arrays(
        np.zeros((9, 9, 9)), np.zeros((9, 9, 9, 3)), 0.01, 5.0, ball.scene.boxes[0].materials
    )
    rays = hg.RayMarch(hg.Scene(ball.scene.camera, ball.scene.lamps, (empty,)), differentiable=True)
    light, slope = rays.derivative(ORIGINS, FORWARD, voxels=np.zeros(dr.width(rays.voxels)))
    assert (light.weights == 0.0).all() and (light.transmittance == 1.0).all()
    assert (slope.weights == 0.0).all() and (slope.transmittance == 0.0).all()


def test_changes_that_do_not_fit_are_refused(ball, few_match_points):
    with pytest.raises(hg.InputError, match="nothing changes"):
        ball.derivative(ORIGINS, FORWARD)
    with pytest.raises(hg.InputError, match="materials: the change has 2 numbers"):
        ball.derivative(ORIGINS, FORWARD, materials=[1.0, 0.0])
    with pytest.raises(hg.InputError, match="a box of texels cannot be differentiated"):
        hg.RayMarch(hg.Scene(ball.scene.camera, ball.scene.lamps, (quick_sheet(),)), differentiable=True)
    with pytest.raises(hg.InputError, match="the voxels are packed"):
        hg.RayMarch(ball.scene).derivative(ORIGINS, FORWARD, voxels=[1.0])
    with pytest.raises(hg.InputError, match=r"\(rays, 3\)"):
        hg.march(ball, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
