"""Depth of normals: its rule on shapes of closed form, and that its errors are those of simulated noise."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.normals.drawn_errors import independent_variance, own_errors
from hagoromo.measurement.normals.normals import least_squares_fit
from hagoromo.measurement.normals.smooth_normals import SmoothField
from hagoromo.measurement.normals.smooth_share import SmoothShare, Stiffness
from hagoromo.measurement.normals.views import views_from_capture
from hagoromo.measurement.surface.chords import BEND, chords
from hagoromo.measurement.surface.depth import surface_from_normals

SIZE, LAMPS, RADIUS = 37, 7, 26.0  # px, lamps, px


def camera_at(size: int, focal: float, distance: float) -> hg.Camera:
    camera = hg.Camera(size, size, (focal, focal), (size / 2, size / 2))
    return camera.look_at((0.0, 0.0, distance), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))


@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_depth_of_a_plane_and_of_a_sphere_is_exact_in_perspective_up_to_the_rim(shape):
    camera = camera_at(61, 200.0, 2.0)
    ray = camera.pixel_directions().astype(np.float64)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    if shape == "plane":
        normals = np.broadcast_to([0.36, 0.48, 0.8], ray.shape)
        along = -2.0 * 0.8 / (ray @ [0.36, 0.48, 0.8])
        true = camera.position + along[..., None] * ray
    else:
        middle = ray @ -camera.position  # of a ball of radius 0.25 at the origin
        under = middle**2 - (4.0 - 0.0625)
        along = middle - np.sqrt(np.maximum(under, 0.0))
        true = camera.position + along[..., None] * ray
        normals = np.where(under[..., None] > 0.0, true / 0.25, 0.0)
    known = np.linalg.norm(normals, axis=2) > 0.5
    found = surface_from_normals(normals, camera, 2.0, np.full(known.shape, 1e-6), draws=0).points
    depth = np.log((2.0 - found[known][:, 2]) / (2.0 - true[known][:, 2]))  # but for the distance of the whole
    np.testing.assert_allclose(depth, depth.mean(), atol=1e-5)  # which is held by a weak constraint


def test_the_rule_is_unsure_at_an_edge_and_not_where_normals_turn_evenly():
    camera, variance = camera_at(SIZE, 1000.0, 2.0), np.full((SIZE, SIZE), 1e-12)
    x = (np.arange(SIZE) + 0.5 - SIZE / 2) / 1000.0
    every = np.ones((SIZE, SIZE), bool)
    roof = np.where(x < 0.0, -0.3, 0.3)
    for turn, largest in ((roof, BEND * 0.6 / np.sqrt(1.0 + 0.09) / 1000.0), (1e-3 * np.arange(SIZE), 2e-7)):
        normals = np.stack([np.tile(turn, (SIZE, 1)), np.zeros((SIZE, SIZE)), np.ones((SIZE, SIZE))], axis=2)
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        rule = chords(normals, camera, every, variance).rule[: SIZE * (SIZE - 1)].reshape(SIZE, -1)
        assert rule[:, 2:-2].max() <= 1.1 * largest
    # the middle of the roof: the change of the slope, 0.6, times the unknown place of its ridge
    normals = np.stack([np.tile(roof, (SIZE, 1)), np.zeros((SIZE, SIZE)), np.ones((SIZE, SIZE))], axis=2)
    rule = chords(normals / np.sqrt(1.09), camera, every, variance).rule[: SIZE * (SIZE - 1)].reshape(SIZE, -1)
    assert rule.max() == pytest.approx(BEND * 0.6 / 1000.0, rel=0.1)


@pytest.mark.by_night("1000000.0")
@pytest.mark.parametrize("stiffness", [0.0, 1e6])
def test_stated_errors_of_depth_are_those_of_noise_on_a_ball(stiffness):
    """Oracle: noise is added to true normals, smoothed and integrated, many times."""
    camera, random, spread = camera_at(SIZE, 1e5, 50.0), np.random.default_rng(1), 0.01
    turn = 2.0 * np.pi * np.arange(LAMPS) / LAMPS
    values = np.full((SIZE, SIZE, 1), 0.3, np.float32)
    shots = tuple(
        hg.Photograph(values, 1e-6 * values, np.ones((SIZE, SIZE), bool), camera, (lamp,), f"{k}")
        for k, lamp in enumerate(
            hg.Lamp(to_lamp=(0.5 * np.cos(t), 0.5 * np.sin(t), np.sqrt(0.75)), intensity=np.pi) for t in turn
        )
    )
    views = views_from_capture(hg.Capture(shots, "square"))
    x, y = (views.columns + 0.5 - SIZE / 2) / RADIUS, (SIZE / 2 - views.rows - 0.5) / RADIUS
    true = np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=1).astype(np.float64)
    variance = np.full(len(true), 2.0 * spread**2)
    field = SmoothField(views, stiffness)

    def distance(normals: np.ndarray) -> np.ndarray:
        points = surface_from_normals(views.image(normals), camera, 50.0, views.image(variance), draws=0).points
        found = np.linalg.norm(points[views.rows, views.columns] - views.eye, axis=1)
        return found - found.mean()

    def seen() -> np.ndarray:
        noise = spread * random.normal(size=true.shape)
        noisy = true + noise - np.sum(noise * true, axis=1, keepdims=True) * true
        noisy /= np.linalg.norm(noisy, axis=1, keepdims=True)
        return distance(field.smoothed(noisy, variance) if stiffness else noisy)

    exact, draws = distance(true), 48
    found = np.mean([(seen() - exact) ** 2 for _ in range(draws)])
    fit = replace(least_squares_fit(views), normals=true, variance=variance)
    if stiffness:
        share = field.share(true, variance)
        fit = replace(fit, variance=share * variance, smooth=SmoothShare(Stiffness(stiffness, 1.0), share, variance))
    draw = own_errors(views, fit)
    weights = views.image(independent_variance(fit))
    np.testing.assert_allclose(weights, views.image(variance), rtol=1e-9)
    stated = surface_from_normals(
        views.image(true), camera, 50.0, weights, draws=draws, drawn=lambda random: views.image(draw(random))
    )
    # few long waves hold most of the variance: some ten of them, 48 times, twice
    assert float(stated.variance.mean()) == pytest.approx(float(found), rel=0.25)
