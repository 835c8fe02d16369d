"""Spots and measured profiles: the light of a lamp over the direction, on surfaces and in volume boxes."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import hagoromo as hg
from hagoromo.errors import InputError

WHITE = hg.Spectrum.constant(1.0)
MATTE = hg.Reflectance(0.3, 0.0, 0.2, 1.5, WHITE)
GRAIN = hg.Reflectance(0.3, 0.0, 0.2, 1.5, WHITE, element="sphere")
RANDOM = np.random.default_rng(12)
FLOOD = hg.LampProfile([0, 35, 90, 130, 180], [0, 11, 30, 75, 90], RANDOM.uniform(0.2, 1.0, (5, 5)))
LAMPS = {
    "spot": hg.Lamp((0.2, -0.1, 0.9), intensity=3.0, axis=(-0.2, 0.3, -1.0), axis_power=7.3),
    "led": hg.Lamp((0.2, -0.1, 0.9), intensity=3.0, axis=(0.1, 0.2, -0.4), axis_power=1.0),
    "profile": hg.Lamp((0.2, -0.1, 0.9), intensity=3.0, axis=(0.3, 0.1, -0.7), profile=FLOOD, roll=0.7),
}


def irradiance(name: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions to the lamp and irradiance facing it, float64, by formulas written out here."""
    lamp = LAMPS[name]
    offset = np.asarray(lamp.position) - points
    distance = np.linalg.norm(offset, axis=-1)
    away = -offset / distance[..., None]
    axis = np.asarray(lamp.axis) / np.linalg.norm(np.asarray(lamp.axis))
    if name != "profile":
        share = np.maximum(away @ axis, 0.0) ** lamp.axis_power
    else:
        share = profile_share(away, axis, 0.7)
    return -away, 3.0 * share / distance**2


def profile_share(away: np.ndarray, axis: np.ndarray, roll: float) -> np.ndarray:
    """FLOOD in the directions `away`, its mirror symmetry undone on the angle and not on the table."""
    half = np.array([0.0, 0.0, -1.0]) + axis  # a turn by 180° about the bisector, then one about −z: the shortest turn
    half /= np.linalg.norm(half)
    turned = 2.0 * (away @ half)[..., None] * half - away
    turned = turned * np.array([-1.0, -1.0, 1.0])
    c = np.mod(np.degrees(np.arctan2(turned[..., 1], turned[..., 0]) - roll), 360.0)
    c = np.where(c > 180.0, 360.0 - c, c)
    gamma = np.degrees(np.arccos(np.clip(-turned[..., 2], -1.0, 1.0)))
    lateral, vertical = np.array([0, 35, 90, 130, 180.0]), np.array([0, 11, 30, 75, 90.0])
    rows = np.stack([np.interp(gamma.ravel(), vertical, row, right=0.0) for row in FLOOD.intensity[:5]])
    picked = [np.interp(one, lateral, column) for one, column in zip(c.ravel(), rows.T, strict=True)]
    return np.array(picked).reshape(gamma.shape)


def floor_camera() -> hg.Camera:
    return hg.Camera(31, 23, (40.0, 40.0), (15.5, 11.5)).look_at((0.1, -0.6, 0.7), (0.05, 0.0, 0.0))


@pytest.mark.parametrize("name", LAMPS)
def test_a_floor_under_a_lamp_with_an_axis_has_the_radiance_of_the_formula(name):
    """α cosθ E of the point that each pixel's centre sees.

    2e-4 of the brightest: surfaces are lit 2e-5 of their extent, here 0.06 mm, above themselves.
    """
    camera = floor_camera()
    scene = hg.Scene(camera, (LAMPS[name],), surfaces=(hg.Surface.floor(0.0, 1.0, MATTE),))
    ours = hg.render(scene).weights[..., 0]
    y, x = np.mgrid[:23, :31] + 0.5
    rays = np.stack([(x - 15.5) / 40.0, (y - 11.5) / 40.0, np.ones_like(x)], axis=-1) @ camera.world_to_camera[:3, :3]
    eye = np.asarray(camera.position)
    points = eye - rays * (eye[2] / rays[..., 2])[..., None]
    to_lamp, facing = irradiance(name, points)
    theirs = 0.3 * to_lamp[..., 2] * facing
    assert theirs.max() > 1.2 * theirs.min()  # the lamp's axis matters in this picture
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-4 * theirs.max())


@pytest.mark.parametrize("name", LAMPS)
def test_a_box_under_a_lamp_with_an_axis_has_the_radiance_of_eq_11(name):
    """∫ exp(−∫σ) σ E f dt over a random density, in float64 in steps of a fiftieth of a voxel, without shadows.

    Spheres: f = α (2/3π) (sin χ + (π − χ) cos χ). Bound 0.5 %: the tolerance of the march.
    """
    density, size, tau = RANDOM.random((7, 11, 13)), 0.02, 4.0
    box = hg.VolumeBox.from_arrays(density, np.zeros((7, 11, 13, 3)), size, tau, [GRAIN])
    camera = hg.Camera(5, 7, (18.0, 18.0), (2.5, 3.5)).look_at((0.1, -0.5, 0.45), (0.13, 0.11, 0.07))
    scene = hg.Scene(camera, (LAMPS[name],), (box,))
    ours = hg.render(scene, hg.Settings(tolerance=2e-3, shadows="none")).weights[..., 0]
    y, x = np.mgrid[:7, :5] + 0.5
    rays = np.stack([(x - 2.5) / 18.0, (y - 3.5) / 18.0, np.ones_like(x)], axis=-1) @ camera.world_to_camera[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    step = size / 50.0
    along = np.arange(0.2, 1.2, step)
    points = np.asarray(camera.position) + rays[..., None, :] * along[:, None]
    inside = ((points > 0.0) & (points < np.array([13, 11, 7]) * size)).all(axis=-1)
    places = np.moveaxis(points[..., ::-1] / size - 0.5, -1, 0)
    held = np.array(np.float16(density), np.float64)  # as boxes store it
    sigma = np.where(inside, tau * map_coordinates(held, places, order=1, mode="nearest"), 0.0)
    depth = (np.cumsum(sigma, axis=-1) - 0.5 * sigma) * step
    to_lamp, facing = irradiance(name, points)
    phase = np.arccos(np.clip(-(to_lamp * rays[..., None, :]).sum(axis=-1), -1.0, 1.0))
    f = 0.3 * (np.sin(phase) + (np.pi - phase) * np.cos(phase)) * 2.0 / (3.0 * np.pi)
    theirs = (np.exp(-depth) * sigma * facing * f).sum(axis=-1) * step
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 5e-3 * theirs.mean()


def test_a_frame_turns_the_shortest_way_from_straight_down():
    """Oracle: pointing down, C = 0 is +x and C = 90° is +y, counterclockwise from above; a tilt about y keeps +y."""
    lamp = hg.Lamp((0, 0, 1), profile=FLOOD)
    np.testing.assert_allclose(lamp.frame, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-15)
    tilted = hg.Lamp((0, 0, 1), axis=(-1, 0, 0), profile=FLOOD)
    np.testing.assert_allclose(tilted.frame, [[0, 0, -1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)
    turned = hg.Lamp((0, 0, 1), profile=FLOOD, roll=np.pi / 2)  # C = 0 where C = 90° was
    np.testing.assert_allclose(turned.frame, [[0, 1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-15)
    up = hg.Lamp((0, 0, 1), axis=(0, 0, 1), profile=FLOOD)
    np.testing.assert_allclose(up.frame, [[1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-15)


@pytest.mark.parametrize(
    ("lateral", "same"),
    [
        ([0], lambda c: 0.0 * c),
        ([0, 20, 90], lambda c: np.minimum(np.minimum(c, abs(180 - c)), 360 - c)),
        ([0, 20, 110, 180], lambda c: np.minimum(c, 360 - c)),
        ([90, 140, 200, 270], lambda c: np.where(c < 90, 180 - c, np.where(c > 270, 540 - c, c))),
        ([0, 90, 200, 333, 360], lambda c: c),
    ],
)  # fmt: skip
def test_every_symmetry_of_lateral_angles_is_unfolded(lateral, same):
    """A whole turn, by the plane of the table that each C is the same as. Rounding of float64."""
    values = RANDOM.uniform(0.1, 1.0, (len(lateral), 4))
    values[-1] = values[0] if lateral[-1] == 360 else values[-1]
    profile = hg.LampProfile(lateral, [0, 40, 90, 180], values)
    c, gamma = np.meshgrid(np.linspace(0.5, 359.5, 360), [3.0, 40.0, 77.7, 180.0])
    column = np.stack([np.interp(gamma.ravel(), [0, 40, 90, 180], row) for row in values])
    expected = [np.interp(one, lateral, v) for one, v in zip(same(c).ravel(), column.T, strict=True)]
    np.testing.assert_allclose(profile.at(c, gamma).ravel(), np.array(expected) / values.max(), rtol=1e-12)


def test_the_flux_of_a_profile_is_its_integral_over_directions():
    """Against Gauss quadrature of `at` between the angles: 1e-12."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for c0, c1 in zip(FLOOD.lateral, FLOOD.lateral[1:], strict=False):
        for g0, g1 in zip(FLOOD.vertical, FLOOD.vertical[1:], strict=False):
            c, g = c0 + (c1 - c0) * (nodes + 1) / 2, g0 + (g1 - g0) * (nodes + 1) / 2
            inner = FLOOD.at(c[:, None], g) * np.sin(np.radians(g)) * weights * weights[:, None]
            total += inner.sum() * np.radians(c1 - c0) * np.radians(g1 - g0) / 4
    assert FLOOD.solid_angle() == pytest.approx(total, rel=1e-12)


def test_a_lamp_of_the_files_candela_gives_them():
    """683 lm/W ∫ I E ȳ dλ at 1 nm, of the brightest direction, is the candela of the profile: 1e-4, that of the sum."""
    import colour

    profile = hg.LampProfile([0], [0, 90], [[120.0, 60.0]], peak_candela=120.0)
    lamp = hg.Spectrum.named("D65")
    nm = np.arange(360.0, 831.0)
    y = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].values[:, 1]
    assert 683.0 * profile.intensity_of(lamp) * (lamp.at(nm) * y).sum() == pytest.approx(120.0, rel=1e-4)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"to_lamp": (0, 0, 1), "profile": FLOOD}, "a far lamp has no profile"),
        ({"position": (0, 0, 1), "profile": FLOOD, "axis_power": 2.0}, "leave axis_power out"),
        ({"position": (0, 0, 1), "roll": 0.5}, "turns a profile"),
        ({"position": (0, 0, 1), "profile": FLOOD, "roll": np.nan}, "finite"),
    ],
)
def test_a_lamp_whose_figures_contradict_each_other_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        hg.Lamp(**given)
