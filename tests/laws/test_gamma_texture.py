"""Laws of surfaces whose half width of facets γ differs from place to place, in all modes.

The oracles are the same surface with one γ, two surfaces in place of two values, eq. (3) in float64 at the γ of each
pixel, and its quadrature. Significance 0.1 %, fixed seeds.
"""

import math
import tomllib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
import hagoromo.image.scene.patch_meshes as patch_meshes
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.image.scene.read_once import read_once
from hagoromo.image.scene.scene_file import load_scene, readers, scene_from_tables
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.gamma_rows import GammaRows, gammas_between
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from hagoromo.transport.path.path import random_numbers
from hagoromo.transport.path.scatter import Scattering
from tests.judges import blocks_agree, mean_is, sampler_follows_density, standard_normal
from tests.laws.test_lights import radiance
from tests.oracle.reflection import element_weights
from tests.surface_scene import BEFORE_A_SURFACE

WHITE = hg.Spectrum.constant(1.0)
SQUARE = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
FACES = np.array([(0, 1, 2), (0, 2, 3)])
UV = 0.5 + 0.5 * SQUARE[:, :2]
LAMP = hg.Lamp(to_lamp=(-0.28, 0.0, 0.96))
RAMP = hg.SurfaceTexture(np.linspace(0.06, 0.36, 16)[None])  # [rad], from left to right
WALL = np.array([[0, 0, 1, -1.0], [0, 1, 0, 0], [-1, 0, 0, 1.0], [0, 0, 0, 1]])


def coat(gamma=0.2, alpha=0.08, beta=0.6, **more: Any):
    return hg.Reflectance(alpha, beta, gamma, 1.5, WHITE, **more)


def square(texture=None, gamma=0.2, **more: Any):
    return hg.Surface(coat(gamma, **more), "mesh", SQUARE, FACES, uv=UV, gamma_texture=texture, smooth=False)


def half(x, gamma, **more: Any):
    corners = SQUARE * (0.5, 1.0, 1.0) + (x, 0.0, 0.0)
    return hg.Surface(coat(gamma, **more), "mesh", corners, FACES, smooth=False)


def steps(material, least, largest):
    return [(replace(material, gamma=gamma), 1.0) for gamma in gammas_between(least, largest)]


def beside_a_wall(*floors):
    """A white wall, and the lamp's light mirrored to the camera off the middle of the floor."""
    camera = hg.Camera(32, 24, (32, 32), (16, 12)).look_at((-0.3, -1.4, 2.0), (0.0, 0.0, 0.1))
    wall = hg.Surface(hg.Reflectance(0.8 / math.pi, 0.0, 0.2, 1.5, WHITE), "rectangle", pose=WALL)
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.25, 0.55, 0.8)),), surfaces=(*floors, wall))


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    monkeypatch.setattr(patch_meshes, "MOST_PATCHES", 1500)


@pytest.mark.parametrize("mode", ["march", "full", "path"])
@pytest.mark.parametrize("lobes", [(), ((0.1, 0.05),)])
def test_one_value_is_the_material_of_that_gamma(mode, lobes):
    """To single precision, of all orders; the γ of its own reflectance does not matter."""
    settings = hg.Settings(samples=4, walks=0)
    one = hg.render(beside_a_wall(square(gamma=0.25, lobes=lobes)), settings, mode=mode)
    texture = hg.SurfaceTexture([[0.25]], smooth=False)
    same = hg.render(beside_a_wall(square(texture, gamma=0.1, lobes=lobes)), settings, mode=mode)
    np.testing.assert_allclose(same.weights, one.weights, rtol=1e-5, atol=1e-6 * float(one.weights.max()))
    other = hg.render(beside_a_wall(square(gamma=0.1, lobes=lobes)), settings, mode=mode)
    assert np.abs(other.weights - one.weights).max() > 0.1 * one.weights.max()


@pytest.mark.parametrize("mode", ["march", "full", "path"])
@pytest.mark.parametrize("gloss", ["beta alike", "beta by gamma"])
def test_two_values_are_two_materials_pixel_by_pixel(mode, gloss):
    """First order, and the light that walks bring by the wall, to single precision; also with two values of β, of
    which the larger one would give back too much at the wider γ.
    """
    settings = hg.Settings(samples=4, walks=0)
    gammas, betas = ((0.1, 0.3), (0.6, 0.6)) if gloss == "beta alike" else ((0.06, 0.4), (4.0, 0.2))
    factors = hg.SurfaceTexture([[1.0, betas[1] / betas[0]]], smooth=False)
    whole = replace(
        square(beta=betas[0], gamma=gammas[0]),
        gamma_texture=hg.SurfaceTexture([gammas], smooth=False),
        beta_texture=None if gloss == "beta alike" else factors,
    )
    halves = half(-0.5, gammas[0], beta=betas[0]), half(0.5, gammas[1], beta=betas[1])
    one, two = (hg.render(beside_a_wall(*floors), settings, mode=mode) for floors in ((whole,), halves))
    colours = len(one.palette.bodies) + len(one.palette.interfaces) if mode == "full" else None
    largest = float(two.weights.max())
    np.testing.assert_allclose(one.weights[..., :colours], two.weights[..., :colours], rtol=1e-4, atol=1e-5 * largest)


@pytest.mark.parametrize("betas", [(0.6, 0.6), (0.6, 3.0)])
def test_patches_with_two_values_send_on_as_two_materials(betas):
    """Facets alone, so that all light of higher orders off the floor is by γ and β: the mean of either half to 3 %, as
    the patches are cut otherwise.
    """
    texture = hg.SurfaceTexture([[0.3, 0.1]], smooth=False)
    factor = hg.SurfaceTexture([[betas[0] / betas[1], 1.0]], smooth=False)
    whole = replace(square(alpha=0.0, beta=betas[1], gamma=0.1), gamma_texture=texture, beta_texture=factor)
    halves = half(-0.5, 0.3, alpha=0.0, beta=betas[0]), half(0.5, 0.1, alpha=0.0, beta=betas[1])
    one, two = (
        hg.render(beside_a_wall(*floors), hg.Settings(samples=4, walks=0), mode="full", layers=True)
        for floors in ((whole,), halves)
    )
    assert two.layers is not None
    seen = [two.layers["material.id"] == number for number in (1, 2)]
    (left, right), expected = ([float(radiance(i.part("higher"))[s].mean()) for s in seen] for i in (one, two))
    assert (left, right) == pytest.approx(expected, rel=0.03)
    assert left > betas[0] / betas[1] * 2.0 * right > 0.0


@pytest.mark.parametrize("of", ["image", "vertices", "rectangle"])
def test_each_pixel_has_the_equation_at_its_own_gamma(of):
    """March against eq. (3) in float64, by a straight line of γ between two pixels, or two vertices."""
    size, height = 24, 2.0
    focal, middle = 0.5 * size * height, 0.5 * size
    camera = hg.Camera(size, size, (focal, focal), (middle, middle)).look_at(
        (0.0, 0.0, height), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    )
    x, y = np.meshgrid((np.arange(size) + 0.5) / size * 2 - 1, 1 - (np.arange(size) + 0.5) / size * 2)
    texture = (
        hg.SurfaceTexture(0.25 + 0.2 * SQUARE[:, 0], of="vertices")
        if of == "vertices"
        else hg.SurfaceTexture([[0.15, 0.35]])
    )
    made = hg.Surface(coat(), "rectangle", gamma_texture=texture) if of == "rectangle" else square(texture)
    image = hg.render(hg.Scene(camera, (LAMP,), surfaces=(made,)), hg.Settings(samples=1))
    inside = np.abs(x) < (1.0 if of == "vertices" else 0.5)  # nearer to the edge an image repeats
    point = np.stack([x, y, 0.0 * x], axis=-1)[inside]
    to_eye = np.array([0.0, 0.0, height]) - point
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    up, to_lamp = (np.broadcast_to(way, point.shape) for way in ((0.0, 0.0, 1.0), (-0.28, 0.0, 0.96)))
    here = SimpleNamespace(**vars(coat()) | {"gamma": 0.25 + 0.2 * point[:, 0]})
    expected = element_weights(here, up, to_lamp, to_eye)[1]  # type: ignore[arg-type]
    got = image.part("interface").weights.sum(axis=-1)[inside]
    np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-6 * expected.max())
    assert expected.max() > 0.01


def test_first_order_of_walks_is_that_of_the_march():
    """Z per block of 4 × 4 pixels; the march takes its light along 64 rays a pixel, 0.5 % for where they are."""
    scene = beside_a_wall(square(RAMP))
    walked = hg.render(scene, hg.Settings(samples=256, orders=1), mode="path")
    marched = hg.render(scene, hg.Settings(samples=64))
    assert walked.variance is not None
    both = (image.part("first") if image is walked else image for image in (walked, marched))
    first, second = (radiance(image) for image in both)
    assert blocks_agree(first, second, walked.variance * (1.0 + 256 / 64), relative_bias=0.005)


def test_every_gamma_of_a_surface_has_its_albedo_in_a_furnace():
    """Drawn by the γ of each hit, beside light that is drawn: L = L_sky ∫ f of eq. (3), four stripes at once."""
    gammas = np.array([0.05, 0.11, 0.24, 0.5])
    floor = square(hg.SurfaceTexture(gammas[None], smooth=False), alpha=0.1, beta=0.4)
    to_eye = np.array([0.0, -1.0, 0.4]) / 1.16**0.5
    far = 1000.0
    camera = hg.Camera(8, 8, (4.0 * far, 12.0 * far), (4.0, 4.0)).look_at(far * to_eye, (0.0, 0.0, 0.0))
    sky = hg.Environment(np.ones((8, 16)), 2.0)
    image = hg.render(hg.Scene(camera, (), (), (floor,), environment=sky), hg.Settings(samples=600), mode="path")
    seen = radiance(image)
    polar, turn = (np.arange(800) + 0.5) / 800 * 0.5 * math.pi, (np.arange(1600) + 0.5) / 1600 * 2.0 * math.pi
    polar, turn = (angle.ravel() for angle in np.meshgrid(polar, turn, indexing="ij"))
    ways = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    up, eyes = (np.broadcast_to(way, ways.shape) for way in ((0.0, 0.0, 1.0), to_eye))
    for k, gamma in enumerate(gammas):
        f = sum(element_weights(coat(float(gamma), 0.1, 0.4), up, ways, eyes))
        truth = 2.0 * float(f @ np.sin(polar)) * (0.5 * math.pi / 800) * (2.0 * math.pi / 1600)
        assert mean_is(seen[:, 2 * k : 2 * k + 2], truth, tolerance=1e-3 * truth)  # of the quadrature
        assert seen[:, 2 * k : 2 * k + 2].std() / 4 < 0.01 * truth


ROWS, COLUMNS = 8, 16  # of cells of equal solid angle
EYE = np.array([0.1, 0.5, 0.86]) / np.linalg.norm([0.1, 0.5, 0.86])


def _cell(way):
    row = np.clip((0.5 * (way[2] + 1.0) * ROWS).astype(int), 0, ROWS - 1)
    column = np.clip(((np.arctan2(way[1], way[0]) / (2.0 * math.pi) + 0.5) * COLUMNS).astype(int), 0, COLUMNS - 1)
    return row * COLUMNS + column


def _grid(parts=7):
    """Directions (3, n) all around, as many in each cell."""
    z = (np.arange(ROWS * parts) + 0.5) / (ROWS * parts) * 2.0 - 1.0
    turn = ((np.arange(COLUMNS * parts) + 0.5) / (COLUMNS * parts) - 0.5) * 2.0 * math.pi
    z, turn = (grid.ravel() for grid in np.meshgrid(z, turn, indexing="ij"))
    sine = np.sqrt(1.0 - z * z)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), z])


def test_directions_are_drawn_by_the_gamma_of_each_hit():
    """Lanes of four γ, at rows of the table and between them, in one kernel: the draws of each follow the stated
    density (χ², 1 % for its grid), and their weights add up to ∫ f dL of eq. (3) in each cell.
    """
    jit, count, gammas = arrays(), 60_000, (0.2, 0.27, 0.45, 0.7)
    material = coat(beta=0.25, alpha=0.01, lobes=((0.05, 0.5),))
    rows = GammaRows([coat(0.05), material], {1: steps(material, gammas[0], gammas[-1])})
    palette = palette_of([material], [], [])
    scattering = Scattering([coat(0.05), material], Materials([coat(0.05), material], palette), rows)
    lane = dr.arange(jit.UInt, len(gammas) * count)
    gamma = dr.gather(jit.Float, jit.Float(gammas), lane // count)
    random = random_numbers(lane, dr.zeros(jit.UInt, len(lane)), 23)
    numbers = [random.next_float32() for _ in range(5)]
    up, eye = jit.Array3f(0, 0, 1), jit.Array3f(*EYE.tolist())
    way, sent, good = scattering.drawn(jit.UInt(1), up, eye, numbers, gamma)
    weights = np.array(dr.select(good, sent[0] + sent[1], 0.0)).reshape(len(gammas), -1)
    ways = np.array(way).reshape(3, len(gammas), -1)
    grid = _grid()
    each = 4.0 * math.pi / grid.shape[1]
    for k, width in enumerate(gammas):
        density = scattering.density(jit.UInt(1), jit.Array3f(*grid.astype(np.float32)), eye, jit.Float(width))
        expected = np.bincount(_cell(grid), np.array(density), minlength=ROWS * COLUMNS) * each
        cell = _cell(ways[:, k])
        counts = np.bincount(cell, minlength=ROWS * COLUMNS)
        assert sampler_follows_density(counts, count * expected, expected_error=0.01)
        axes, eyes = (np.broadcast_to(v, (grid.shape[1], 3)) for v in ((0.0, 0.0, 1.0), EYE))
        f = sum(element_weights(coat(width, 0.01, 0.25), axes, grid.T, eyes))
        f = f + element_weights(coat(0.5, 0.0, 0.05), axes, grid.T, eyes)[1]
        truth = np.bincount(_cell(grid), f, minlength=ROWS * COLUMNS) * each
        sums, squares = (np.bincount(cell, weights[k] ** p, minlength=ROWS * COLUMNS) / count for p in (1, 2))
        error = np.sqrt((squares - sums**2) / count + (0.01 * truth) ** 2)
        seen = truth > 1e-3 * truth.sum()
        assert standard_normal((sums - truth)[seen] / error[seen], mean_tolerance=0.3, variance_tolerance=0.5)


def test_what_patches_send_on_between_two_rows_is_that_of_its_gamma():
    """The factors on smooth light, against tables of a material of that γ: 0.5 % of the largest."""
    jit, gammas = arrays(), np.geomspace(0.03, 0.9, 23)
    material, cosines = coat(beta=0.15), np.linspace(0.05, 1.0, 12)
    scattering = ScatteringTables([material], GammaRows([material], {0: steps(material, 0.03, 0.9)}))
    eye = jit.Array3f(*(jit.Float(part.tolist()) for part in (np.sqrt(1.0 - cosines**2), 0.0 * cosines, cosines)))
    for gamma in gammas.tolist():
        alone = ScatteringTables([replace(material, gamma=gamma)])
        got, expected = (
            np.array([np.array(f) for f in one.towards(jit.UInt(0), 1, jit.Array3f(0, 0, 1), eye, jit.Float(gamma))])
            for one in (scattering, alone)
        )
        assert np.abs(got - expected).max() < 0.005 * np.abs(expected).max()


def test_patches_send_on_by_the_gamma_of_each_place():
    """Light of all orders, full against path per block; 3 % of the light for the patches, 3.3 standard errors."""
    scene = beside_a_wall(square(RAMP))
    full, path = (
        hg.render(scene, hg.Settings(samples=4, walks=0), mode="full"),
        hg.render(scene, hg.Settings(samples=512), mode="path"),
    )
    assert path.variance is not None

    def blocks(values):
        return values.reshape(6, 4, 8, 4).mean(axis=(1, 3))

    solved, walked = (blocks(radiance(image.part("higher"))) for image in (full, path))
    noise = 3.3 * np.sqrt(blocks(path.variance) / 16)
    assert (np.abs(solved - walked) < 0.03 * blocks(radiance(path)).max() + noise).all()
    assert walked.max() > 5.0 * noise.max()


def glossy(gammas, factors, smooth=False):
    textures = (hg.SurfaceTexture([values], smooth=smooth) for values in (gammas, factors))
    gamma, beta = textures
    return replace(square(gamma=0.06, beta=4.0), gamma_texture=gamma, beta_texture=beta)


BAD = {
    "gamma_texture has 2 values outside 0.0001…1.571 rad, first 0 in row 0, column 1": lambda: square(
        hg.SurfaceTexture([[0.2, 0.0, 1.6]])
    ),
    "first 1.6 in vertex 3": lambda: square(hg.SurfaceTexture([0.2, 0.2, 0.2, 1.6], of="vertices")),
    "first nan in row 0, column 1": lambda: square(hg.SurfaceTexture([[0.2, math.nan]])),
    "first -0.1 in row 0, column 0": lambda: square(hg.SurfaceTexture([[-0.1, 0.2]])),
    "gamma_texture has 3 values a place": lambda: square(hg.SurfaceTexture([[(0.2, 0.3, 0.4)]])),
    "its mesh has no UVs": lambda: replace(square(RAMP), uv=None),
    "gamma_texture is up to 1.4 rad: reflectance breaks energy": lambda: square(hg.SurfaceTexture([[0.1, 1.4]])),
    "is up to 0.4 rad and its beta_texture up to 1: reflectance breaks": lambda: glossy((0.06, 0.4), (0.5, 1)),
    "is up to 0.4 rad and its beta_texture up to 0.5: reflectance": lambda: glossy((0.06, 0.4), (1, 0.5)),
    "up to 0.4 rad and its beta_texture up to 1 at neighbours, as": lambda: glossy((0.06, 0.4), (1, 0.05), smooth=True),
    "has a gamma_texture: leave one": lambda: replace(square(RAMP), optics="mirror"),
}


def test_the_ends_of_gamma_are_taken_though_single_precision_is_beyond():
    """float32 of 0.0001 is below it, and that of π/2 above."""
    for gammas in ((1e-4, 0.2), (0.5, math.pi / 2)):
        made = replace(square(beta=0.01), gamma_texture=hg.SurfaceTexture([gammas]))
        image = hg.render(beside_a_wall(made), hg.Settings(samples=1), mode="path")
        assert np.isfinite(image.weights).all()


@pytest.mark.parametrize("message", BAD)
def test_what_is_no_gamma_is_refused_in_one_line(message):
    with pytest.raises(InputError) as error:
        BAD[message]()
    assert message in str(error.value) and "\n" not in str(error.value)


SCENE = (
    BEFORE_A_SURFACE
    + """[[surface]]
shape = "rectangle"
reflectance = { alpha = 0.1, beta = 0.3, gamma = 0.2, n = 1.5, body_colour = 1.0 }
gamma_texture = { file = "rough.png", range = [0.05, 0.4], smooth = false }
"""
)


@pytest.fixture
def scene(tmp_path):
    pixels = np.array([[(0, 9, 9), (255, 9, 9)], [(51, 9, 9), (204, 9, 9)]], np.uint8)
    hg.write_png(tmp_path / "rough.png", pixels)

    def path(old="", new=""):
        assert old in SCENE
        (tmp_path / "scene.toml").write_text(SCENE.replace(old, new), encoding="utf-8")
        return tmp_path / "scene.toml"

    return path


def test_a_scene_file_says_how_pixels_are_gamma(scene):
    """The first channel, linear, from the first number of range at 0 to the second at 255."""
    surface = load_scene(scene())[0].surfaces[0]
    assert surface.gamma_texture is not None and not surface.gamma_texture.smooth
    expected = np.array([[0.05, 0.4], [0.12, 0.33]])
    np.testing.assert_allclose(surface.gamma_texture.values[..., 0], expected, rtol=1e-6)
    assert surface.reflectance.gamma == pytest.approx(0.225)  # the mean, which files without textures get


def test_a_scene_file_has_gamma_of_colours_of_vertices(scene, tmp_path):
    """R, linear, of a mesh read anew or kept from the last table."""
    lines = [f"v {x} {y} {z} {r} 0.5 0.5" for (x, y, z), r in zip(SQUARE, (0.0, 1.0, 0.4, 0.2), strict=True)]
    (tmp_path / "square.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4"]), encoding="utf-8")
    table = scene('shape = "rectangle"', 'mesh = "square.obj"').read_text(encoding="utf-8")
    table = table.replace('file = "rough.png", ', "vertex_colours = true, ").replace(", smooth = false", "")
    kept = read_once()
    for read in (readers(), kept, kept):
        (surface,) = scene_from_tables(tomllib.loads(table), tmp_path, tmp_path / "scene.toml", read)[0].surfaces
        assert surface.gamma_texture is not None and surface.vertices is not None and surface.body_texture is None
        places = [tuple(place[:2]) for place in surface.vertices]
        corner = dict(zip(places, surface.gamma_texture.values[:, 0], strict=True))
        assert corner == pytest.approx({(-1, -1): 0.05, (1, -1): 0.4, (1, 1): 0.19, (-1, 1): 0.12}, rel=1e-6)


@pytest.mark.parametrize("mode", ["march", "full", "path"])
def test_a_dark_image_leaves_room_for_wide_facets(mode):
    """A body whose own colour would be too bright beside them: its image stands in its place, and is dark."""
    image, wide = hg.SurfaceTexture([[0.2, 0.3]]), hg.SurfaceTexture([[0.1, 0.5]])
    bright = hg.Reflectance(0.28, 0.6, 0.1, 1.5, WHITE)
    with pytest.raises(InputError, match="energy"):
        hg.Surface(bright, "rectangle", gamma_texture=wide)
    surface = hg.Surface(bright, "rectangle", gamma_texture=wide, body_texture=image)
    view = hg.Camera(4, 3, (9, 9), (2, 1.5)).look_at((0, -1, 3), (0, 0, 0))
    assert (
        hg.render(hg.Scene(view, (LAMP,), surfaces=(surface,)), hg.Settings(walks=0), mode=mode).weights > 0.0
    ).any()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("range = [0.05, 0.4], ", "", "first 0 in row 0, column 0: mend it, or give another range"),
        ("0.05, 0.4", "0.4, 0.0", "first 0 in row 0, column 1"),
        ("0.05, 0.4", "0.1, 2.0", "range is [0.1, 2]: give γ of the values 0 and 1, 0 to 1.571 rad"),
        ("0.05, 0.4", "nan, 0.4", "nan"),
        ("0.05, 0.4", "-0.1, 0.4", "range is [-0.1, 0.4]"),
        ("0.05, 0.4", "0.4", "range"),
        ("rough.png", "../rough.png", "outside"),
        ("rough.png", "none.png", "none.png"),
        ('file = "rough.png"', "vertex_colours = true", "a shape has no vertices: give file"),
        ('file = "rough.png", ', "", "give either file (an image) or vertex_colours = true"),
        ("[0.05, 0.4]", "[0.05, 0.4], size = 2", "size"),
    ],
)
def test_gamma_of_a_scene_file_is_checked(scene, old, new, message):
    with pytest.raises(InputError, match=r"surface 1|surface") as error:
        load_scene(scene(old, new))
    assert message in str(error.value) and "\n" not in str(error.value)
