"""Curvature, occlusion and decorrelation stretch of surfaces that have closed forms."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.measurement.inspection.curvature import curvature
from hagoromo.measurement.inspection.occlusion import occlusion
from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo.measurement.inspection.stretch import decorrelation_stretch

AWAY = 0.5  # m, of the camera from the plane z = 0
FAR = 1e3  # m, of a camera that sees nearly in parallel


def camera(width, height, pitch, away=AWAY):
    """A camera over the plane, whose pixels are `pitch` [m] wide there."""
    focal = away / pitch
    made = hg.Camera(width, height, (focal, focal), (width / 2, height / 2))
    return made.look_at((0.0, 0.0, away), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))


def seen(seen_by, points, normals, known=None, variance=None):
    """A surface without colours."""
    known = np.ones(points.shape[:2], bool) if known is None else known
    own = None if variance is None else np.full(known.shape, variance)
    return SeenSurface(
        seen_by, known, np.where(known[..., None], points, 0.0), np.where(known[..., None], normals, 0.0),
        None, None, own, own, None, True,
    )  # fmt: skip


def on_plane(seen_by):
    """(h, w, 2) where the rays meet z = 0."""
    ray = seen_by.pixel_directions()
    return (seen_by.position + ray * (-seen_by.position[2] / ray[..., 2])[..., None])[..., :2]


def ball(seen_by, radius, away=AWAY):
    """Points of a ball whose top is at the origin, unit normals, and which pixels see it well."""
    ray, middle = seen_by.pixel_directions(), np.array([0.0, 0.0, -radius])
    offset = seen_by.position - middle
    along = ray @ offset
    under = along**2 - (offset @ offset - radius**2)
    t = -along - np.sqrt(np.maximum(under, 0.0))
    points = seen_by.position + t[..., None] * ray
    normals = (points - middle) / radius
    return points, normals, (under > 0.0) & (-np.einsum("hwi,hwi->hw", normals, ray) > 0.5)


@pytest.mark.parametrize("width", [0.7, 1.0, 3.0])
def test_a_ball_of_radius_R_has_the_curvature_1_over_R(width):
    """In perspective, to 60° from the line of sight; a Gaussian of σ px flattens by (σ/R)², here below 0.3 %."""
    radius = 0.013
    view = camera(131, 127, 2.5e-4)
    found = curvature(seen(view, *ball(view, radius)), width)
    known = np.isfinite(found.value)
    assert found.unit == "mm" and known.sum() > 3000
    np.testing.assert_allclose(found.value[known], 1.0 / (1e3 * radius), rtol=0.01)


def test_a_hollow_cylinder_has_half_of_minus_1_over_R():
    radius, view = 0.02, camera(61, 53, 2.5e-4, FAR)
    x = on_plane(view)[..., 0]
    z = -np.sqrt(radius**2 - x**2) + radius
    points = np.stack([x, on_plane(view)[..., 1], z], axis=2)
    normals = np.stack([-x, 0.0 * x, radius - z], axis=2) / radius
    value = curvature(seen(view, points, normals)).value
    np.testing.assert_allclose(value[np.isfinite(value)], -0.5 / (1e3 * radius), rtol=2e-3)


def test_a_plane_aslant_is_flat_and_open():
    view = camera(41, 37, 3e-4)
    ray, normal = view.pixel_directions(), np.array([0.4, -0.3, 0.866])
    normal = normal / np.linalg.norm(normal)
    t = -(view.position @ normal) / (ray @ normal)
    surface = seen(view, view.position + t[..., None] * ray, np.broadcast_to(normal, ray.shape))
    np.testing.assert_allclose(np.nan_to_num(curvature(surface).value), 0.0, atol=1e-12)
    np.testing.assert_allclose(occlusion(surface), 1.0, atol=5e-3)  # single precision, one pixel from another


@pytest.mark.parametrize("width", [0.7, 2.0])
def test_the_error_of_the_curvature_is_the_scatter_of_measured_ones(width):
    """Over 60 draws of the errors of normals; 37 × 41 px of 60 draws: a standard deviation is known to 1 %."""
    turn = 0.01  # rad about each of two axes
    view = camera(61, 57, 2.5e-4)
    points, normals, known = ball(view, 0.03)
    random, values = np.random.default_rng(5), []
    for _ in range(60):
        noisy = normals + turn * random.standard_normal(normals.shape)
        noisy /= np.linalg.norm(noisy, axis=2, keepdims=True)
        found = curvature(seen(view, points, noisy, known, 2.0 * turn**2), width)
        values.append(found.value)
    inside = np.isfinite(found.value)
    assert found.error is not None
    ratio = np.std(values, axis=0)[inside] / found.error[inside]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.nightly
@pytest.mark.parametrize("slope", [45.0, 60.0])
def test_the_middle_of_a_groove_sees_the_sky_that_its_walls_leave(slope):
    """On a wall of a long V-groove it is ½(1 + sin θ), θ from the normal down to the rim of the other wall."""
    view, half = camera(91, 601, 1e-4, FAR), 3e-3  # ten times as long as wide
    x, y = np.moveaxis(on_plane(view), 2, 0)
    tangent = np.tan(np.radians(slope))
    z = np.where(np.abs(x) < half, (np.abs(x) - half) * tangent, 0.0)
    wall = np.abs(x) < half
    nx = np.where(wall, -np.sign(x) * np.sin(np.radians(slope)), 0.0)
    normals = np.stack([nx, 0.0 * x, np.where(wall, np.cos(np.radians(slope)), 1.0)], axis=2)
    found = occlusion(seen(view, np.stack([x, y, z], axis=2), normals), directions=64)
    row = found[300]
    for column in (20, 28, 36):
        px, pz = x[300, column], z[300, column]
        to_rim = np.array([half - px, -pz])
        to_rim /= np.linalg.norm(to_rim)
        own = np.array([np.sin(np.radians(slope)), np.cos(np.radians(slope))])
        # the form factor of a strip: ½ (sin θ₂ − sin θ₁), from the wall's own plane (−90°) to the other rim
        along = np.array([own[1], -own[0]])
        assert row[column] == pytest.approx(0.5 * (1.0 + to_rim @ along), abs=0.015)
    assert row[4] == pytest.approx(1.0, abs=0.01)


@pytest.mark.nightly
def test_the_floor_of_a_trench_sees_the_sine_of_half_its_opening():
    """Of depth d and width w, in its middle: w / √(w² + 4 d²); its walls are one pixel wide."""
    view, half, depth = camera(241, 401, 1e-4, FAR), 3e-3, 2e-3
    x, y = np.moveaxis(on_plane(view), 2, 0)
    z = np.where(np.abs(x) < half, -depth, 0.0)
    normals = np.broadcast_to(np.array([0.0, 0.0, 1.0]), (*x.shape, 3))
    found = occlusion(seen(view, np.stack([x, y, z], axis=2), normals), directions=64)
    assert found[200, 120] == pytest.approx(half / np.hypot(half, depth), abs=0.015)


@pytest.mark.parametrize("by", ["correlation", "covariance"])
def test_stretched_channels_are_uncorrelated_and_alike(by):
    """Their covariance is the unit matrix, to rounding; the matrix is that of the closed form."""
    random = np.random.default_rng(3)
    mix = np.array([[1.0, 0.9, 0.8], [0.9, 1.1, 0.85], [0.8, 0.85, 0.9]])
    colours = 0.2 + 0.02 * random.standard_normal((37, 41, 3)) @ mix
    known = random.random((37, 41)) > 0.2
    found = decorrelation_stretch(colours, known, by)
    np.testing.assert_allclose(np.cov(found.value[known], rowvar=False, bias=True), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(found.value[known].mean(axis=0), 0.0, atol=1e-9)
    if by == "covariance":  # the inverse of the symmetric root of the covariance
        root = found.matrix @ np.cov(colours[known], rowvar=False, bias=True) @ found.matrix
        np.testing.assert_allclose(root, np.eye(3), atol=1e-9)
        np.testing.assert_allclose(found.matrix, found.matrix.T, rtol=1e-9)


def test_noise_of_the_faintest_component_is_stated():
    random = np.random.default_rng(4)
    grey = 0.2 + 0.05 * random.standard_normal((53, 47, 1))
    colours = np.repeat(grey, 3, axis=2) + 1e-3 * random.standard_normal((53, 47, 3))
    found = decorrelation_stretch(colours, np.ones((53, 47), bool), error=np.full(colours.shape, 1e-3))
    assert found.noise is not None
    np.testing.assert_allclose(found.noise, [0.0, 1.0, 1.0], atol=0.06)


def test_colours_that_do_not_differ_have_no_stretch():
    grey = np.random.default_rng(1).random((7, 5, 1))
    for colours, words in ((grey, "one channel"), (np.repeat(grey, 3, axis=2), "fewer ways")):
        with pytest.raises(InputError, match=words):
            decorrelation_stretch(colours, np.ones((7, 5), bool))


@pytest.mark.parametrize("by", ["correlation", "covariance"])
def test_an_object_of_one_colour_has_nothing_to_pull_apart(by):
    one = np.broadcast_to([0.3, 0.2, 0.1], (9, 7, 3))
    with pytest.raises(InputError, match="nothing to pull apart"):
        decorrelation_stretch(one, np.ones((9, 7), bool), by)
