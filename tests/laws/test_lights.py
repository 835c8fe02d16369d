"""Laws of lamps with a size and of environments: furnaces, irradiances in closed form, samplers, colours.

Significance 0.1 %, fixed seeds.
"""

import math
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, column
from hagoromo.camera.response import Response
from hagoromo.image.scene.surface import SHAPES
from hagoromo.light.environment import upsampled
from tests.judges import mean_is, sampler_follows_density
from tests.laws.test_path import SIDE, cube, light_along, matter, scene_of
from tests.oracle.photons import area
from tests.oracle.reflection import element_weights

GREY = hg.Spectrum.constant(1.0)
POINT = np.array([0.1, -0.2, 0.05])
RECTANGLE = hg.AreaLamp((0.3, 0.1, 0.6), edges=((0.4, 0.3, 0.0), (0.3, -0.4, 0.0)), radiance=5.0)
NARROW = hg.AreaLamp((0.3, 0.1, 6.0), edges=((0.4, 0.3, 0.0), (0.3, -0.4, 0.0)), radiance=5.0)
BALL = hg.AreaLamp((0.3, -0.4, 0.7), radius=0.35, radiance=5.0)
DRAWS = 200_000
SHARP = hg.Settings(samples=400)


def camera(size=12, focal=18.0, eye=(0.0, -1.0, 0.4)):
    return hg.Camera(size, size, (focal, focal), (size / 2, size / 2)).look_at(eye, (0.0, 0.0, 0.0))


def radiance(image, wavelength=550.0):
    spectra = [lamp.at(wavelength) * c.at(wavelength) for lamp in image.palette.lamps for c in image.palette.colours]
    return image.weights.astype(float) @ np.array(spectra)


@pytest.mark.parametrize(
    ("what", "walks", "precision"),
    [(what, 400, 2e-3) for what in ("surface", "sphere", "cylinder")]
    + [pytest.param(what, 30_000, 3e-4, marks=pytest.mark.slow) for what in ("sphere", "cylinder")],
)
def test_a_white_furnace_looks_like_nothing(what, walks, precision):
    """White matter in light that is the same all around has its radiance, of all orders: to 3.3 times `precision`, the
    standard error; slow: 1e-3 of each element. A plane's back is black: see `test_orders_through_fibres.py` for sheets.
    """
    white, sky = 1.0 / math.pi, hg.Environment(np.ones((4, 8)), 2.0, visible=True)
    surfaces = (hg.Surface.sphere((0.0, 0.0, 0.0), 0.15, matter("plane", white)),)
    boxes = () if what == "surface" else (cube(matter(what, white), 6.0),)
    scene = hg.Scene(camera(), (), boxes, () if boxes else surfaces, environment=sky)
    image = hg.render(scene, hg.Settings(samples=walks), mode="path")
    variance = image.variance
    assert variance is not None
    seen, error = radiance(image), math.sqrt(float(variance.mean()) / variance.size)
    assert image.alpha.mean() > 0.05 and error < 2.0 * precision
    assert abs(seen.mean() - 2.0) < 3.3 * error


@pytest.mark.parametrize(("walks", "precision"), [(1000, 2e-3), pytest.param(40_000, 3e-4, marks=pytest.mark.slow)])
def test_white_surfaces_of_every_shape_look_like_nothing_in_a_furnace(walks, precision):
    """All shapes in one picture, light of all orders between them too: 3.3 standard errors of each; slow: 1e-3."""
    white = matter("plane", 1.0 / math.pi)
    places = np.array([(x, 0.0, z) for z in (0.09, -0.09) for x in (-0.18, 0.0, 0.18)])
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], float)
    faces = np.array([(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    surfaces = []
    for shape, place in zip((*SHAPES, "mesh"), places, strict=True):
        pose = np.diag([0.06, 0.06, 0.06, 1.0])
        pose[:3, :3] @= np.array([[0.8, 0.0, 0.6], [0.36, 0.8, -0.48], [-0.48, 0.6, 0.64]])
        pose[:3, 3] = place
        mesh: dict[str, Any] = {"vertices": corners, "faces": faces, "smooth": False} if shape == "mesh" else {}
        surfaces.append(hg.Surface(white, shape, pose=pose, name=shape, **mesh))
    sky = hg.Environment(np.ones((4, 8)), 2.0, visible=True)
    view = hg.Camera(36, 24, (60.0, 60.0), (18, 12)).look_at((0.0, -1.0, 0.0), (0.0, 0.0, 0.0))
    scene = hg.Scene(view, (), (), tuple(surfaces), environment=sky)
    image = hg.render(scene, hg.Settings(samples=walks), mode="path", layers=True)
    assert image.layers is not None and image.variance is not None
    for number in range(1, len(surfaces) + 1):
        own = image.layers["material.id"] == number
        error = math.sqrt(float(image.variance[own].mean()) / own.sum())
        assert own.sum() > 10 and error < 2.0 * precision
        assert abs(radiance(image)[own].mean() - 2.0) < 3.3 * error


def test_lights_together_are_the_sum_of_each():
    """A point, a window, a ball and an environment, one of which is drawn at an event, over a floor of two lobes that
    walks leave towards lights by chance, too: z-test, 1 %.
    """
    point, sky = hg.Lamp(position=(0.4, -0.5, 0.6), intensity=0.5), hg.Environment(np.ones((4, 8)), 0.4)
    window = hg.AreaLamp((0.3, 0.1, 0.6), edges=((0.2, 0.15, 0.0), (0.15, -0.2, 0.0)), radiance=5.0)
    floor = hg.Surface.floor(0.0, 2.0, matter("plane", 0.2, beta=0.2, gamma=0.3))

    def light(*lamps, areas=(), environment=None, samples=1024):
        scene = hg.Scene(camera(8, 400.0), lamps, (), (floor,), area_lamps=areas, environment=environment)
        image = hg.render(scene, hg.Settings(samples=samples), mode="path")
        assert image.variance is not None
        return radiance(image).mean(), math.sqrt(float(image.variance.mean()) / image.variance.size)

    each = light(point), light(areas=(window,)), light(areas=(BALL,)), light(environment=sky)
    whole, error = light(point, areas=(window, BALL), environment=sky, samples=4096)
    error = math.hypot(error, *(noise for _, noise in each))
    total = sum(mean for mean, _ in each)
    assert min(mean for mean, _ in each) > 0.05 * total  # each counts
    assert abs(whole - total) < 3.3 * error < 0.01 * total


@pytest.mark.parametrize("gamma", [0.05, 0.3])
def test_a_glossy_floor_in_a_furnace_has_its_albedo(gamma):
    """Where directions of the walk and of the light are drawn otherwise: L = L_sky ∫ f, by quadrature in NumPy."""
    shiny = matter("plane", 0.1, beta=0.6, gamma=gamma)
    sky, floor = hg.Environment(np.ones((8, 16)), 2.0), hg.Surface.floor(0.0, 1.0, shiny)
    image = hg.render(hg.Scene(camera(8, 8e4), (), (), (floor,), environment=sky), SHARP, mode="path")
    polar, turn = (np.arange(800) + 0.5) / 800 * 0.5 * math.pi, (np.arange(1600) + 0.5) / 1600 * 2.0 * math.pi
    polar, turn = (angle.ravel() for angle in np.meshgrid(polar, turn, indexing="ij"))
    ways = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    up, to_eye = (np.broadcast_to(way, ways.shape) for way in ((0.0, 0.0, 1.0), np.array([0.0, -1.0, 0.4]) / 1.16**0.5))
    f = sum(element_weights(shiny, up, ways, to_eye))
    truth = 2.0 * float(f @ np.sin(polar)) * (0.5 * math.pi / 800) * (2.0 * math.pi / 1600)
    assert mean_is(radiance(image), truth, tolerance=1e-3 * truth)  # of the quadrature
    assert radiance(image).std() / 8 < 3e-3 * truth


def test_walks_may_end_in_the_sky_after_any_order():
    """A furnace cut at two orders: white matter has less light than all around, and all of it in the first event of
    a matte surface that nothing else is beside.
    """
    sky, ball = hg.Environment(np.ones((4, 8)), 2.0, visible=True), matter("plane", 0.5 / math.pi)
    scene = hg.Scene(camera(), (), (), (hg.Surface.sphere((0.0, 0.0, 0.0), 0.15, ball),), environment=sky)
    for orders in (1, 2):
        image = hg.render(scene, hg.Settings(samples=256, orders=orders), mode="path")
        inside = image.alpha == 1.0
        assert mean_is(radiance(image)[inside], 1.0) and mean_is(image.weights[inside][:, 0], 1.0)
        assert (image.weights[inside][:, 2:] == 0.0).all()  # it is the first order, exact for every colour


def irradiance_of_rectangle(lamp, point, normal):
    """Lambert's formula: E = L/2 Σ Θ_i Γ_i · n over the sides of a polygon above the horizon."""
    one, other = 0.5 * lamp.edges
    corners = [lamp.position + a * one + b * other - point for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    total = 0.0
    for k, corner in enumerate(corners):
        after = corners[(k + 1) % 4]
        across = np.cross(corner, after)
        angle = math.atan2(float(np.linalg.norm(across)), float(corner @ after))
        total += angle * float(across @ normal) / float(np.linalg.norm(across))
    return 0.5 * lamp.radiance * abs(total)


def irradiance(lamp, point, normal):
    if lamp.radius is None:
        return irradiance_of_rectangle(lamp, point, normal)
    away = lamp.position - point
    squared = float(away @ away)
    return math.pi * lamp.radiance * lamp.radius**2 / squared * float(away @ normal) / math.sqrt(squared)


@pytest.mark.parametrize("lamp", [RECTANGLE, NARROW, BALL], ids=["rectangle", "narrow rectangle", "sphere"])
@pytest.mark.parametrize("mode", ["path", "march"])
def test_a_floor_is_lit_as_in_closed_form(lamp, mode):
    """Lambert's floor seen at one point: L = α E."""
    floor = hg.Surface.floor(0.0, 2.0, matter("plane", 0.25))
    view = camera(8, 8e4, (0.0, -1.0, 1.0))  # 1e-4 rad across
    scene = hg.Scene(view, (), (), (floor,), area_lamps=(lamp,))
    settings = hg.Settings(samples=400 if mode == "path" else 1, orders=1 if mode == "path" else None)
    seen = radiance(hg.render(scene, settings, mode=mode))
    truth = 0.25 * irradiance(lamp, np.zeros(3), np.array([0.0, 0.0, 1.0]))
    if mode == "path":
        assert mean_is(seen, truth, tolerance=2e-4 * truth)  # of the pixels' place on the floor
        assert seen.std() / 8 < 4e-3 * truth
    else:
        np.testing.assert_allclose(seen, truth, rtol=settings.tolerance)


def drawn(light, *numbers):
    """Directions (n, 3), and densities (n,) [1/sr] as `seen` has them there."""
    jit = arrays()
    point = jit.Array3f(*map(float, POINT))
    to_light = light.drawn(point, *numbers)
    seen = light.seen(point, to_light.to_lamp)
    ways = np.stack([np.array(c) for c in to_light.to_lamp], axis=-1)
    each = [np.broadcast_to(np.array(v), len(ways)) for v in (to_light.density, seen.density, seen.distance)]
    return ways, each[0], each[1], each[2] / np.array(to_light.distance)


@pytest.mark.parametrize("lamp", [RECTANGLE, NARROW, BALL], ids=["rectangle", "narrow rectangle", "sphere"])
def test_directions_to_area_lamps_follow_their_density(lamp):
    """χ² over cells of a square about the middle direction, against the density on a grid 8 times as fine."""
    jit, light = arrays(), lamp.on_device()
    random = np.random.default_rng(3).random((2, DRAWS)).astype(np.float32)
    ways, density, seen, distances = drawn(light, *(jit.Float(row) for row in random))
    inner = seen > 0.0  # all but rounding at the outline
    assert inner.mean() > 0.9995
    np.testing.assert_allclose(seen[inner], density[inner], rtol=2e-3)
    np.testing.assert_allclose(distances[inner], 1.0, atol=2e-2)
    middle = lamp.position - POINT
    frame = np.linalg.svd(middle[None])[2]
    frame[0] *= np.sign(frame[0] @ middle)
    flat = ways @ frame[1:].T / (ways @ frame[0])[:, None]  # on the plane at distance 1
    reach = 1.05 * np.abs(flat).max()
    cells, fine = 12, 16
    edges = np.linspace(-reach, reach, cells + 1)
    counts, _, _ = np.histogram2d(*flat.T, bins=[edges, edges])
    at = (np.arange(cells * fine) + 0.5) / (cells * fine) * 2.0 * reach - reach
    x, y = np.meshgrid(at, at, indexing="ij")
    grid = (frame[0] + x[..., None] * frame[1] + y[..., None] * frame[2]).reshape(-1, 3)
    length = np.linalg.norm(grid, axis=1)
    grid /= length[:, None]
    there = light.seen(
        jit.Array3f(*map(float, POINT)), jit.Array3f(*(column(jit.Float, np.float32(c)) for c in grid.T))
    )
    share = np.array(there.density) / length**3 * (2.0 * reach / (cells * fine)) ** 2
    expected = DRAWS * share.reshape(cells, fine, cells, fine).sum(axis=(1, 3))
    assert sampler_follows_density(counts, expected, expected_error=0.03)  # of the grid, at the outline
    assert abs(expected.sum() / DRAWS - 1.0) < 0.01


def test_directions_to_an_environment_follow_its_light():
    """χ² over all pixels, and over the places in them; the pixel of a direction is the one that it was drawn in."""
    jit, random = arrays(), np.random.default_rng(4)
    values = random.random((6, 12, 3)) ** 4
    values[2, 3:6] = 0.0
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    sky = hg.Environment(values, rotation=turn * np.sign(np.linalg.det(turn)))
    light = sky.on_device()
    numbers = [jit.Float(row) for row in random.random((4, DRAWS)).astype(np.float32)]
    to_light = light.drawn(jit.Array3f(0.0), *numbers)
    pixel, ways = np.array(light.direction(*numbers)[1]), np.stack([np.array(c) for c in to_light.to_lamp], axis=-1)
    found = np.array(light.pixel(to_light.to_lamp))
    assert (found == pixel).mean() > 0.9999  # rounding at the sides of pixels
    row, column = sky.pixels(ways)
    assert (row * 12 + column == pixel).mean() > 0.9999
    solid = sky.solid_angles
    assert abs(12 * solid.sum() - 4.0 * math.pi) < 1e-12
    shares = sum(part.radiance for part in sky.parts) * solid[:, None]
    counts = np.bincount(pixel, minlength=72)
    expected = DRAWS * shares.ravel() / shares.sum()
    assert sampler_follows_density(counts, expected) and (counts[expected == 0.0] == 0).all()
    density = np.array(to_light.density) * np.repeat(solid, 12)[pixel] * shares.sum() / shares.ravel()[pixel]
    np.testing.assert_allclose(density, 1.0, rtol=1e-4)
    local = ways @ sky.rotation
    z_of = np.cos(math.pi * np.arange(7) / 6)
    down = (z_of[row] - local[:, 2]) / (z_of[row] - z_of[row + 1])
    across = (math.pi - np.arctan2(local[:, 1], local[:, 0])) * 12 / (2.0 * math.pi) % 1.0
    halves, _, _ = np.histogram2d(down, across, bins=8, range=((0, 1), (0, 1)))
    assert sampler_follows_density(halves, np.full(64, DRAWS / 64))


def test_the_map_lies_as_it_is_said_to():
    """Its middle towards +x, its top +z, columns clockwise seen from above; turned by a matrix into the world."""
    values = np.arange(1.0, 33.0).reshape(4, 8)
    sky = hg.Environment(values)
    assert sky.radiance_from([[0.9, 0.01, 0.1], [0.9, -0.01, 0.1]])[:, 0].tolist() == [values[1, 3], values[1, 4]]
    assert (
        sky.radiance_from([0.1, -0.02, 1.0])[0] == values[0, 4] and sky.radiance_from([0.0, -1.0, -0.1]) == values[2, 6]
    )
    turned = hg.Environment(values, rotation=[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert turned.radiance_from([0.01, 0.9, 0.1])[0] == values[1, 4]
    np.testing.assert_allclose(sky.directions(2.0, 4.0), (1.0, 0.0, 0.0), atol=1e-15)


def test_colours_of_a_map_are_those_of_its_spectra():
    """Under D65 a spectrum has the linear sRGB that it was made of, to the tables' steps; the parts add up to it."""
    observer, day = Response.load("cie1931"), hg.Spectrum.named("D65")
    values = np.random.default_rng(5).random((4, 8, 3))
    sky = hg.Environment(values, 1.5, day, visible=True)
    assert [part.name for part in sky.parts] == [f"environment {c}" for c in ("white", "red", "green", "blue")]
    assert all((part.radiance >= 0.0).all() for part in sky.parts)
    view = hg.Camera(8, 8, (4.0, 4.0), (4.0, 4.0)).look_at((0.0, 0.0, 0.0), (1.0, 0.2, 0.3))
    speck = hg.Surface.sphere((0.05, 0.01, 0.015), 1e-6, matter("plane", 0.1))
    image = hg.render(hg.Scene(view, (), (), (speck,), environment=sky), hg.Settings(samples=1), mode="path")
    assert observer.channels and image.weights.shape[-1] == 4 * len(image.palette.colours)
    shown = image.linear_srgb().reshape(-1, 3)
    wanted = 1.5 * values[sky.pixels(view.pixel_directions())].reshape(-1, 3)
    same = np.abs(shown - wanted).max(axis=1) < 0.004 * wanted.max()
    assert same.mean() > 0.8  # a walk passes its pixel anywhere: at the sides of a map's pixels it may see another
    assert len(hg.Environment(values[..., :1] * [0.2, 0.5, 0.9]).parts) == 1
    np.testing.assert_allclose(upsampled((1.0, 1.0, 1.0)).values, 1.0, atol=1e-12)


def test_a_window_at_a_grazing_angle_is_32_point_lamps():
    """In matter before and behind its plane, all orders: z-test."""
    window = hg.AreaLamp((-0.16, 0.04, 0.16), edges=((0.06, 0.0, -0.08), (0.0, 0.08, 0.0)), radiance=20.0)
    points = tuple(window.point_lamps(window.sources(32)))
    box, settings, view = cube(matter("sphere", 0.25), 3.0), hg.Settings(samples=3000), camera(12, 50.0)
    means, squares = [], 0.0
    for scene in (hg.Scene(view, (), (box,), area_lamps=(window,)), hg.Scene(view, points, (box,))):
        image = hg.render(scene, settings, mode="path")
        assert image.variance is not None
        means.append(float(radiance(image).mean()))
        squares += float(image.variance.mean()) / image.variance.size
    assert abs(means[0] - means[1]) < 3.3 * math.sqrt(squares) < 0.02 * means[0]


def test_a_lamp_within_matter_lights_it_in_mode_path():
    """First order beside a lamp in a homogeneous cube: quadrature of ∫ σ exp(−σ t) f I exp(−σ r) / r² dt."""
    depth, aside, walks = 2.0, 0.03, 400_000
    box = cube(matter("sphere", 0.25), depth)
    sigma = depth / SIDE * float(area("sphere", np.zeros(1))[0])
    scene = scene_of([box], hg.Lamp(position=(0.0, 0.0, 0.0), intensity=2.0))
    origin, way = np.array([[aside, -0.5, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    light = light_along(scene, origin, way, walks, orders=1)[0, :, :-1].sum(axis=1)
    t = (np.arange(20_000) + 0.5) / 20_000 * SIDE
    away = np.stack([np.full(len(t), -aside), -(t - 0.5 * SIDE), np.zeros(len(t))], axis=-1)
    r = np.linalg.norm(away, axis=1)
    f = sum(element_weights(box.materials[0], way, away / r[:, None], np.broadcast_to(-way, away.shape)))
    truth = float(np.sum(sigma * np.exp(-sigma * (t + r)) * f * 2.0 / r**2)) * SIDE / len(t)
    assert mean_is(light, truth, tolerance=1e-3 * truth)  # of single precision at the faces
    assert light.std() / math.sqrt(walks) < 0.01 * truth


def test_far_lamps_of_a_coarse_map_light_planes_as_all_of_its_pixels_do():
    """Maps of pixels 45° and 180° wide: irradiance of 40 planes, by quadrature of the map, to the stated tolerance.

    With one lamp in the middle of each pixel it was off by 5 % and 59 %, and said to be exact.
    """
    contrast = 0.2 + np.random.default_rng(2).random((4, 8))
    contrast[1, 2] = 10.0
    normals = np.random.default_rng(1).normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    rows, columns = np.meshgrid((np.arange(256) + 0.5) / 256, (np.arange(512) + 0.5) / 512, indexing="ij")
    for values in (contrast, np.ones((1, 2))):
        sky, height = hg.Environment(values), len(values)
        ways = sky.directions(rows * height, columns * 2 * height).reshape(-1, 3)
        light = sky.radiance_from(ways)[:, 0] * np.sin(math.pi * rows).ravel() * (math.pi / 256) ** 2
        truth = np.maximum(normals @ ways.T, 0.0) @ light
        few = sky.points(np.zeros(3), np.ones(3), 0.01)
        lamps = np.array([lamp.to_lamp for lamp in few.lamps]), np.array([lamp.intensity for lamp in few.lamps], float)
        away = np.maximum(normals @ lamps[0].T, 0.0) @ lamps[1] - truth
        error = np.linalg.norm(away) / np.linalg.norm(truth)
        assert few.error <= 0.01 and error < 0.01 and abs(lamps[1].sum() / light.sum() - 1.0) < 1e-3
