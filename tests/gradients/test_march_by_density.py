"""The derivative of the march by densities and axes, with its shadows, against float64 and against central differences.

The ratio of two derivatives is that of least squares over all rays, Σ d·t / Σ t²: along single rays they cross 0.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

import hagoromo as hg
from tests.oracle.lattice import Array, OracleVoxels
from tests.oracle.radiance import camera_rays, radiance
from tests.oracle.scenes import (
    DAYLIGHT,
    GRAINS,
    LOW_LAMP,
    MATTE,
    SHINY,
    box_of,
    camera,
    centres,
    cloud,
    gaussian_ball,
    outwards,
)

WAVELENGTH = np.array([550.0])  # [nm]
STEP = 1e-2  # of central differences in float64; halving it changes them by less than 1e-4
FIRST_STEP = 1e-3  # of differences by densities that only grow
RAYS = camera_rays(camera(12))


def soft_ball(depth: float, matter: hg.Reflectance, count: int = 17) -> OracleVoxels:
    """Density 1 within 5 cm, and 0 beyond 10 cm; depth: mean free paths a voxel at density 1."""
    radius, normal = outwards(*centres((count, count, count)))
    return as_stored(box_of(np.clip((0.1 - radius) / 0.05, 0.0, 1.0), normal, depth, matter))


def as_stored(voxels: OracleVoxels) -> OracleVoxels:
    """The voxels as their box has them, rounded."""
    density, axis = voxels.box().bricks.dense()
    return with_density(voxels, density.astype(float), axis.astype(float))


def with_density(voxels: OracleVoxels, density: Array, axis: Array | None = None) -> OracleVoxels:
    """Voxels of other densities, and axes if given, not rounded."""
    changed = replace(voxels)
    object.__setattr__(changed, "density", density)
    object.__setattr__(changed, "axis", voxels.axis if axis is None else axis)
    return changed


def some_change(voxels: OracleVoxels) -> Array:
    """A change of the density of every voxel that has any."""
    return voxels.density * np.random.default_rng(7).uniform(0.2, 1.0, voxels.density.shape)


def true_slopes(
    boxes: list[OracleVoxels], lamps: list[hg.Lamp], changes: list[Array], differences: dict[float, float] | None = None
) -> tuple[Array, Array]:
    """Derivatives of radiance (rays,) and transmittance (rays,) in float64; differences: weights by their places."""

    def at(place: float) -> tuple[Array, Array]:
        moved = [with_density(v, v.density + place * c) for v, c in zip(boxes, changes, strict=True)]
        light, transmittance = radiance(moved, lamps, RAYS, WAVELENGTH, accuracy=1e-5)
        return light[:, 0], transmittance

    differences = differences or {STEP: 0.5 / STEP, -STEP: -0.5 / STEP}
    ends = [(weight, at(place)) for place, weight in differences.items()]
    light, transmittance = (sum((weight * end[k] for weight, end in ends), np.zeros(len(RAYS[0]))) for k in range(2))
    return light, transmittance


def slopes(
    boxes: list[OracleVoxels], lamps: list[hg.Lamp], changes: list[Array], settings: hg.Settings
) -> tuple[Array, Array]:
    """What `RayMarch.derivative` gives of radiance and transmittance."""
    volume = tuple(voxels.box() for voxels in boxes)
    march = hg.RayMarch(hg.Scene(camera(), tuple(lamps), volume), settings, differentiable=True)
    _, slope = march.derivative(*RAYS, voxels=in_bricks(volume, changes, march))
    pairs = [(lamp, body) for lamp in march.palette.lamps for body in march.palette.colours]
    spectra = [lamp.at(WAVELENGTH) * body.at(WAVELENGTH) for lamp, body in pairs]
    return slope.weights.astype(float) @ np.array(spectra)[:, 0], slope.transmittance.astype(float)


def in_bricks(boxes: tuple[hg.VolumeBox, ...], changes: list[Array], march: hg.RayMarch) -> Array:
    """Changes of the densities of boxes (z, y, x) as one of the march's voxels (voxels, 4)."""
    voxels = np.zeros((len(np.array(march.voxels)) // 4 // 9**3, 9, 9, 9, 4))
    for box, change in zip(boxes, changes, strict=True):
        whole = np.pad(change, [(0, 8 * m + 1 - n) for m, n in zip(box.bricks.lattice, change.shape, strict=True)])
        for k, (z, y, x) in enumerate(box.bricks.corners()):
            voxels[box.bricks.density.first + k, ..., 0] = whole[z : z + 9, y : y + 9, x : x + 9]
    return voxels.reshape(-1, 4)


def ratio(slope: Array, true: Array) -> float:
    """See the head of this file."""
    return float((slope * true).sum() / (true * true).sum())


def off(slope: Array, true: Array) -> float:
    """Root mean square of the difference, over that of the truth."""
    return float(np.sqrt(np.mean((slope - true) ** 2) / np.mean(true**2)))


@cache
def ball_and_truth(depth: float, matter: hg.Reflectance) -> tuple[OracleVoxels, Array, Array]:
    """A soft ball, and its derivatives in float64."""
    ball = soft_ball(depth, matter)
    return ball, *true_slopes([ball], [DAYLIGHT], [some_change(ball)])


@pytest.mark.by_night("sphere-60.0-0.04", "plane-60.0-0.04", "plane-2.0-0.04")
@pytest.mark.parametrize(
    ("matter", "depth", "tolerance"),
    [(GRAINS, depth, tolerance) for depth in (0.1, 2.0, 60.0) for tolerance in (0.04, 0.001)]
    + [(SHINY, 0.1, 0.04), (SHINY, 2.0, 0.001), (SHINY, 60.0, 0.04)],
    ids=lambda value: value.element if isinstance(value, hg.Reflectance) else None,
)
def test_the_derivative_by_density_is_right(matter, depth, tolerance):
    """1 % of the light's, with its shadow, at every density and tolerance; 0.1 % of the transmittance's, an exact one.

    Along single rays: 2 % of their root mean square, and 4 % where planes end suddenly at their horizon.
    """
    ball, true_light, true_passed = ball_and_truth(depth, matter)
    light, passed = slopes([ball], [DAYLIGHT], [some_change(ball)], hg.Settings(tolerance=tolerance))
    assert abs(ratio(light, true_light) - 1.0) < 0.01
    assert off(light, true_light) < (0.04 if matter is SHINY else 0.02)
    assert off(passed, true_passed) < 1e-3


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("far_boxes", "lamps"),
    [
        pytest.param([], [DAYLIGHT, LOW_LAMP], id="two boxes, two lamps"),
        pytest.param([cloud(6.0, (-0.35, 0.1, 0.0), 20.0)], [DAYLIGHT], id="in two slots", marks=pytest.mark.slow),
    ],
)
def test_so_is_that_of_turned_boxes_that_overlap(far_boxes, lamps):
    """1 %, and 2 % along single rays."""
    boxes = [gaussian_ball(5.0, GRAINS, 15), cloud(6.0, (0.05, -0.04, 0.03), 30.0), *far_boxes]
    boxes = [as_stored(voxels) for voxels in boxes]
    changes = [some_change(voxels) for voxels in boxes]
    light, passed = slopes(boxes, lamps, changes, hg.Settings())
    true_light, true_passed = true_slopes(boxes, lamps, changes)
    assert abs(ratio(light, true_light) - 1.0) < 0.01 and off(light, true_light) < 0.02
    assert off(passed, true_passed) < 1e-3


@pytest.mark.parametrize("depth", [0.1, 2.0])
def test_so_is_that_by_density_where_there_is_no_matter_yet(depth):
    """1 %, and 4 % along single rays: how the first matter spreads over its cell is not known.

    By one-sided differences of the second order. A layer of empty voxels around the ball gets matter.
    """
    ball = soft_ball(depth, GRAINS)
    layer = binary_dilation(ball.density > 0.0) & (ball.density == 0.0)
    differences = {0.0: -1.5 / FIRST_STEP, FIRST_STEP: 2.0 / FIRST_STEP, 2.0 * FIRST_STEP: -0.5 / FIRST_STEP}
    light, passed = slopes([ball], [DAYLIGHT], [layer.astype(float)], hg.Settings())
    true_light, true_passed = true_slopes([ball], [DAYLIGHT], [layer.astype(float)], differences)
    assert abs(ratio(light, true_light) - 1.0) < 0.01 and off(light, true_light) < 0.04
    assert off(passed, true_passed) < 5e-3  # differences of the second order: 1e-3 where the layer is dense


def own_differences(
    scene: hg.Scene, settings: hg.Settings, change_of: Callable[[Array], Array], step: float
) -> list[tuple[Array, Array]]:
    """The derivative of light and of transmittance, each beside central differences of the march itself."""
    march = hg.RayMarch(scene, settings, differentiable=True)
    voxels = np.array(march.voxels).reshape(-1, 4)
    change = change_of(voxels)
    _, slope = march.derivative(*RAYS, voxels=change)
    ends = []
    for sign in (1, -1):
        march.voxels = (voxels + sign * step * change).astype(np.float32).ravel()
        ends.append(march(*RAYS))
    return [(own, (high - low) / (2.0 * step)) for own, high, low in zip(slope, *ends, strict=True)]


def test_so_is_that_of_a_box_among_surfaces_and_of_one_with_a_shadow_bias():
    """Shadows of the box on surfaces, too. 1 % of differences in single precision, 1e-7 / step on values near 1."""
    surfaces = (hg.Surface.sphere((0.05, -0.1, 0.1), 0.03, MATTE), hg.Surface.sphere((0.0, 0.2, -0.3), 0.2, MATTE))
    box = replace(soft_ball(0.5, GRAINS).box(), shadow_bias=0.01)
    scene = hg.Scene(camera(), (DAYLIGHT,), (box,), surfaces)

    def change_of(voxels: Array) -> Array:
        return voxels * np.random.default_rng(4).uniform(0.2, 1.0, (len(voxels), 1)) * (1.0, 0.0, 0.0, 0.0)

    for own, difference in own_differences(scene, hg.Settings(), change_of, 3e-3):
        assert abs(ratio(own, difference) - 1.0) < 0.01 and off(own, difference) < 0.02


def test_the_derivative_by_axes_with_shadows_is_that_of_differences():
    """Of projected extinction, where axes change light, transmittance and shadows; all lean to eye and lamp, away from
    their horizon.

    2 %: the derivative is small, and single precision leaves 1e-7 / step.
    """
    ball = soft_ball(0.3, MATTE)
    x, y, z = centres(ball.density.shape)
    axis = np.stack([0.4 + 2.0 * y, -0.7 + 2.0 * z, 0.6 + 2.0 * x], axis=-1)
    leaning = replace(ball, axis=axis / np.linalg.norm(axis, axis=-1, keepdims=True), extinction="projected")
    scene = hg.Scene(camera(), (DAYLIGHT,), (leaning.box(),))

    def change_of(voxels: Array) -> Array:
        change = np.random.default_rng(4).normal(size=voxels.shape) * (voxels[:, :1] > 0.0)
        return change * (0.0, 1.0, 1.0, 1.0)

    for own, difference in own_differences(scene, hg.Settings(), change_of, 3e-3):
        assert abs(ratio(own, difference) - 1.0) < 0.02 and off(own, difference) < 0.03
