"""Laws of mode path: the first event is that of the float64 oracle, energy, reciprocity, bands, samplers, seeds.

Significance 0.1 %, fixed seeds. Light is compared with oracles of other code: the quadrature of `tests/oracle`, and
photons in NumPy that start at the lamp, so that they also judge the exchange of lamp and eye.
"""

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.image.path import picture as path_picture
from hagoromo.image.path.walk_sums import WalkSums
from hagoromo.image.path.walked import Walked
from hagoromo.image.prepared.prepared_scene import PreparedScene
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import Palette, palette_of
from hagoromo.transport.path.bands import Bands, bands_of
from hagoromo.transport.path.free_flight import Matter
from hagoromo.transport.path.path import Walks, light_of_walks, random_numbers
from hagoromo.transport.path.scatter import Scattering
from tests.judges import sampler_follows_density, standard_normal
from tests.oracle.photons import area, escaped, span
from tests.oracle.radiance import radiance
from tests.oracle.reflection import element_weights
from tests.oracle.scenes import BLUE, DAY, DAYLIGHT, GREY, RED, flakes

AXIS, OTHER = np.array([0.36, -0.48, 0.8]), np.array([0.192, 0.744, -0.64])  # planes that face each other
LAMP, EYE = np.array([0.48, -0.64, 0.6]), np.array([-0.6, 0.0, 0.8])
SIDE = 0.2  # of the homogeneous cube [m]
STEP = hg.Spectrum((360, 549, 551, 830), (0.1, 0.1, 0.9, 0.9))
SHINY: dict[str, Any] = {"beta": 0.4, "gamma": 0.3, "n": 1.5}


def matter(element, alpha=0.18, colour=GREY, beta=0.0, gamma=0.2, n=1.5, **more: Any):
    return hg.Reflectance(alpha, beta, gamma, n, colour, element=element, **more)


def cube(material, depth, axis=AXIS, voxels=3):
    """Homogeneous matter about the origin, `depth` times τρ across; arrays are indexed [z, y, x]."""
    pose, shape = np.eye(4), (voxels,) * 3
    pose[:3, 3] = -0.5 * SIDE
    axes = np.broadcast_to(axis, (*shape, 3))
    return hg.VolumeBox.from_arrays(
        np.ones(shape), axes, SIDE / voxels, depth / SIDE, [material], pose=pose, extinction="projected"
    )


def scene_of(boxes, *lamps):
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.0, -1.0, 0.3), (0.0, 0.0, 0.0))
    return hg.Scene(camera, lamps or (hg.Lamp(to_lamp=LAMP),), tuple(boxes))


def walks_of(scene, wavelengths=(550.0,)):
    """The walks of a scene, and the origin that their places count from."""
    prepared = PreparedScene(scene, hg.Settings(shadows="none"))
    materials, bands = prepared.lighting.materials, Bands(np.array(wavelengths), 0.0)
    reflectances = [m for box in scene.boxes for m in box.materials] + [s.reflectance for s in scene.surfaces]
    medium = Matter(prepared.medium) if prepared.medium else None
    scattering = Scattering(reflectances, materials)
    return Walks(medium, prepared.surfaces, prepared.first_on_surface, prepared.lighting, scattering, bands), prepared


def light_along(scene, origin, direction, walks, seed=1, orders=path_picture.ALL_ORDERS, wavelengths=(550.0,)):
    """Channels of `walks` walks along each ray (rays, 3): (rays, walks, channels)."""
    of_scene, prepared = walks_of(scene, wavelengths)
    jit = arrays()
    number = dr.arange(jit.UInt, len(origin) * walks)
    ray, walk = number // dr.opaque(jit.UInt, walks), number % dr.opaque(jit.UInt, walks)

    def vector(values):
        columns = np.ascontiguousarray(np.broadcast_to(values, origin.shape).T, np.float32)
        return jit.Array3f(*(dr.gather(jit.Float, jit.Float(column), ray) for column in columns))

    found = light_of_walks(
        of_scene, vector(origin - prepared.origin), vector(direction), random_numbers(ray, walk, seed),
        dr.opaque(jit.UInt, orders),
    )  # fmt: skip
    return np.array(found.light).reshape(len(origin), walks, -1)


def disc(towards, count, seed=None):
    """Rays from everywhere on a disc around the cube that faces `towards` (3,) or (count, 3): origins (count, 3), and
    its area [m²]. They are drawn by a seed, or without one evenly spread (a sunflower's spiral).
    """
    radius = 0.5 * math.sqrt(3.0) * SIDE
    towards = np.broadcast_to(towards, (count, 3))
    one = np.cross(towards, [0.31, 0.2, 0.93])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(towards, one)
    even = np.arange(count) + 0.5
    drawn = [even / count, even * (0.5 * (math.sqrt(5.0) - 1.0)) % 1.0]
    if seed is not None:
        drawn = np.random.default_rng(seed).random((2, count))
    r, turn = radius * np.sqrt(drawn[0]), 2.0 * math.pi * drawn[1]
    places = (r * np.cos(turn))[:, None] * one + (r * np.sin(turn))[:, None] * other + towards
    return places, math.pi * radius**2


def flux(boxes, lamp, eye, count, seed, **walk):
    """∫ of the light that leaves towards `eye` over the disc [m²], of the first order and of higher ones: mean of
    (count, 2) draws.
    """
    origin, area = disc(eye, count, seed)
    light = light_along(scene_of(boxes, hg.Lamp(to_lamp=lamp)), origin, -np.broadcast_to(eye, origin.shape), 1, **walk)
    return area * np.stack([light[:, 0, :-1].sum(axis=1), light[:, 0, -1]], axis=1)


def everywhere(count, seed):
    """Directions, uniform on the sphere: (count, 3)."""
    way = np.random.default_rng(seed).normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True)


def same(ours, theirs, precision=0.02):
    """Whether the means of independent draws are one, at 0.1 %; precision: of their difference, that is asked for."""
    error = math.sqrt(sum(draws.var() / len(draws) for draws in (ours, theirs)))
    assert error < precision * theirs.mean()  # else nothing is told
    return abs(ours.mean() - theirs.mean()) < 3.3 * error


COUNTS = {"plane": (150_000, 60_000), "cylinder": (150_000, 40_000), "sphere": (100_000, 40_000)}  # walks, photons


@pytest.mark.parametrize("element", ELEMENTS)
def test_a_cube_sends_out_what_photons_from_the_lamp_do(element):
    """Flux into all directions, of the first order and of higher ones, body and interface: z-test against NumPy."""
    _flux_is_that_of_photons(element, *COUNTS[element], 0.06)


@pytest.mark.slow
@pytest.mark.parametrize("element", ELEMENTS)
def test_a_cube_sends_out_what_very_many_photons_do(element):
    walks, photons = COUNTS[element]
    _flux_is_that_of_photons(element, 50 * walks, 50 * photons, 0.008)


def _flux_is_that_of_photons(element, walks, photons, precision):
    """In two boxes that overlap, with elements that lean this way and that: planes alike would light only backs."""
    material, depth = matter(element, **SHINY), 4.0
    theirs = escaped([AXIS, OTHER], material, depth, SIDE, LAMP, photons, 3)
    boxes = [cube(material, 0.5 * depth), cube(material, 0.5 * depth, OTHER, 5)]
    ours = 4.0 * math.pi * flux(boxes, LAMP, everywhere(walks, 5), walks, 6)
    assert same(ours[:, 0], theirs[:, 0], precision)
    assert same(ours[:, 1], theirs[:, 1], precision)


@pytest.mark.parametrize("element", ["cylinder", "sphere"])
@pytest.mark.parametrize(
    ("walks", "precision"), [(60_000, 0.02), pytest.param(6_000_000, 1e-3, marks=pytest.mark.slow)]
)
def test_white_matter_sends_out_all_the_light_that_it_takes(element, walks, precision):
    """Energy of all orders, α = 1/π: ∫∫ L dA dV = ∫ (1 − exp(−σ s)) dA. A plane's back is black: see the photons."""
    white, depth = matter(element, 1.0 / math.pi), 6.0
    ours = 4.0 * math.pi * flux([cube(white, depth)], LAMP, everywhere(walks, 7), walks, 8).sum(axis=1)
    origin, across = disc(LAMP, 250_000)
    enter, leave = span(origin, np.broadcast_to(-LAMP, origin.shape), SIDE)
    sigma = depth / SIDE * area(element, np.array([AXIS @ LAMP]))[0]
    taken = across * np.mean(1.0 - np.exp(-sigma * np.maximum(leave - enter, 0.0)))
    error = ours.std() / math.sqrt(walks)
    assert error < precision * taken
    assert abs(ours.mean(dtype=float) - taken) < 3.3 * error + 1e-4 * taken  # of the grid on the disc


def test_lamp_and_eye_may_change_places():
    """The flux from a far lamp to a far eye, of every order, is that from the eye's place to the lamp's: z-test."""
    material, count = matter("cylinder", **SHINY), 100_000
    boxes = [cube(material, 2.0), cube(material, 2.0, OTHER, 5)]
    there, back = flux(boxes, LAMP, EYE, count, 10), flux(boxes, EYE, LAMP, count, 11)
    assert same(there[:, 0], back[:, 0], 0.03)
    assert same(there[:, 1], back[:, 1], 0.03)


def test_the_first_event_is_that_of_the_oracle_along_rays():
    """Flakes that lean this way and that, densities between voxels, a far lamp: z of every ray.

    Rays on which a part in 1000 of the walks decides are left to the total: their estimates are not normal.
    """
    voxels, rays, walks = flakes(9), 40, 4000
    box, lamp = voxels.box(), replace_lamp(DAYLIGHT)
    towards = everywhere(rays, 12)
    origin = 0.06 * np.random.default_rng(13).normal(size=(rays, 3)) * 0.5 + towards
    light = light_along(scene_of([box], lamp), origin, -towards, walks, orders=1)[..., :-1]
    spectra = np.array([c.at(550.0) for c in (voxels.materials[0].body_colour, voxels.materials[0].interface_colour)])
    ours = light.astype(float) @ spectra
    truth = radiance([voxels], [lamp], (origin, -towards), 550.0)[0][:, 0]
    error = ours.std(axis=1) / math.sqrt(walks)
    lit = truth > 0.05 * truth.max()
    assert standard_normal((ours.mean(axis=1) - truth)[lit] / error[lit], variance_tolerance=0.3)
    total, of_total = ours.mean(axis=1).sum(), math.sqrt(np.sum(error**2))
    assert abs(total - truth.sum()) < 3.3 * of_total < 0.05 * truth.sum()


def replace_lamp(lamp):
    """The lamp with a spectrum that is 1."""
    return hg.Lamp(to_lamp=lamp.to_lamp, intensity=lamp.intensity)


def test_bands_share_a_path():
    """Three bands together are each by itself, to rounding: before roulette, which looks at the brightest."""
    scene = scene_of([cube(matter("sphere", 0.31, hg.Spectrum((360, 830), (0.65, 1.0))), 6.0)])
    origin, _ = disc(EYE, 500, 15)
    along, bands = np.broadcast_to(-EYE, origin.shape), (470.0, 560.0, 630.0)
    together = light_along(scene, origin, along, 4, orders=2, wavelengths=bands)
    assert (together[..., 2:].max(axis=(0, 1)) > 0.0).all()
    for k, band in enumerate(bands):
        alone = light_along(scene, origin, along, 4, orders=2, wavelengths=(band,))
        assert alone[..., 2] == pytest.approx(together[..., 2 + k], rel=1e-5, abs=1e-9)


def test_bands_are_as_many_as_the_colours_need():
    """Grey needs the fewest; a step between two wavelengths needs more, and has the larger error."""
    lamps = [DAY]
    bands = [bands_of([colour], lamps) for colour in (GREY, RED, BLUE, STEP)]
    assert [each.count for each in bands[::3]] == [3, 31]
    assert all(3 < each.count < 31 and each.error <= 0.003 for each in bands[1:3])
    assert bands[0].error < 1e-9 and 0.003 < bands[3].error < 0.05
    between = np.linspace(360.0, 830.0, 95)
    assert sum(spectrum.at(between) for spectrum in bands[1].spectra) == pytest.approx(np.ones(95))


def test_too_few_bands_for_the_spectra_are_said_in_one_line():
    """A colour and a lamp of lines narrower than 31 bands: a picture warns; one of a broad colour does not."""
    lines = hg.Spectrum((360, 544, 545, 546, 830), (0.0, 0.0, 0.9, 0.0, 0.0))
    comb = hg.Spectrum(np.arange(400.0, 701.0, 2.0), np.where(np.arange(151) % 5 < 2, 0.95, 0.05))
    scene = scene_of([cube(matter("sphere", 0.3, comb), 4.0)], hg.Lamp(to_lamp=LAMP, spectrum=lines))
    with pytest.warns(UserWarning, match="31 bands are too few for the spectra of this scene: .* off by up to") as said:
        hg.render(scene, hg.Settings(samples=1), mode="path")
    assert len(said) == 1 and "\n" not in str(said[0].message)
    with pytest.warns(UserWarning, match="7 bands are too few"):
        hg.render(
            scene_of([cube(matter("sphere", 0.3, STEP), 4.0)]), hg.Settings(samples=1, orders=1, walks=0), mode="full"
        )
    hg.render(scene_of([cube(matter("sphere", 0.3, RED), 4.0)]), hg.Settings(samples=1), mode="path")  # a warning fails


def test_an_error_whose_sums_do_not_fit_the_memory_is_refused(monkeypatch):
    """In one line, before a walk is made."""
    scene = scene_of([cube(matter("sphere"), 4.0)])
    monkeypatch.setattr("hagoromo.files.memory.free_memory", lambda: 1 << 11)
    with pytest.raises(hg.InputError, match=r"an image of 8 × 8 pixels needs .* of memory") as refused:
        hg.render(scene, hg.Settings(error=0.01), mode="path")
    assert "\n" not in str(refused.value)


def test_dense_and_nearly_white_matter_is_finite_and_sends_out_less_than_it_takes():
    """Albedo 0.999 at 10⁵ times τρ across: every walk ends, and the face is no brighter than white (π L < E)."""
    box = cube(matter("sphere", 0.999 / math.pi), 1e5)
    x, y = np.random.default_rng(16).uniform(-0.4 * SIDE, 0.4 * SIDE, (2, 1000))
    origin = np.stack([x, y, np.ones(1000)], axis=-1)
    lamp = hg.Lamp(to_lamp=(0.0, 0.0, 1.0))
    light = light_along(scene_of([box], lamp), origin, np.broadcast_to([0.0, 0.0, -1.0], origin.shape), 4)
    assert np.isfinite(light).all()
    assert 0.8 < math.pi * light[..., 0].mean() + math.pi * light[..., 2].mean() < 1.25  # no Lambertian: bright ahead


@pytest.mark.by_night("plane", "sphere")
@pytest.mark.parametrize("element", ELEMENTS)
def test_draws_follow_what_the_element_sends_there(element):
    """χ² of the directions of a matte element against f/∫f of the float64 oracle; and in every cell of a glossy one
    with two lobes and tails the weights' sum against ∫ f dL: z-test, 1 % granted to quadratures.
    """
    matte = matter(element, 0.3)
    coat: dict[str, Any] = {"lobes": ((0.15, 0.6),)} if element != "sphere" else {}
    glossy = matter(element, 0.1, beta=0.3, gamma=0.35, n=1.6, nu=3.0, **coat)
    eye = np.array([0.1, 0.5, 0.86]) / np.linalg.norm([0.1, 0.5, 0.86])
    for material, tailed in ((matte, False), (glossy, True)):
        drawn, body, interface = _drawn(material, eye, 60_000)
        cell = _cell(drawn)
        expected, first = _expected(material, eye), np.bincount(cell, minlength=CELLS)
        if not tailed:
            assert sampler_follows_density(first, len(cell) * expected / expected.sum(), expected_error=0.01)
            assert body == pytest.approx(np.full(len(body), math.pi * 0.3), rel=2e-3)
            continue
        weight = body + interface
        sums, squares = (np.bincount(cell, weight**power, minlength=CELLS) / len(cell) for power in (1, 2))
        error = np.sqrt((squares - sums**2) / len(cell) + (0.01 * expected) ** 2)
        seen = expected > 1e-3 * expected.sum()
        assert standard_normal((sums - expected)[seen] / error[seen], mean_tolerance=0.3, variance_tolerance=0.5)


ROWS, COLUMNS = 8, 16  # of cells of equal solid angle
CELLS = ROWS * COLUMNS


def _cell(way):
    row = np.clip((0.5 * (way[:, 2] + 1.0) * ROWS).astype(int), 0, ROWS - 1)
    column = np.clip(((np.arctan2(way[:, 1], way[:, 0]) / (2.0 * math.pi) + 0.5) * COLUMNS).astype(int), 0, COLUMNS - 1)
    return row * COLUMNS + column


def _expected(material, eye, parts=7):
    """∫ f dL over every cell, by a grid in it."""
    z = ((np.arange(ROWS * parts) + 0.5) / (ROWS * parts)) * 2.0 - 1.0
    turn = ((np.arange(COLUMNS * parts) + 0.5) / (COLUMNS * parts) - 0.5) * 2.0 * math.pi
    z, turn = (grid.ravel() for grid in np.meshgrid(z, turn, indexing="ij"))
    sine = np.sqrt(1.0 - z * z)
    way = np.stack([sine * np.cos(turn), sine * np.sin(turn), z], axis=-1)
    eyes, axes = (np.broadcast_to(v, way.shape) for v in (eye, AXIS))
    f = sum(element_weights(material, axes, way, eyes))
    for beta, gamma in material.lobes:
        f = (
            f
            + element_weights(
                replace(material, alpha=0.0, beta=beta, gamma=gamma, nu=math.inf, lobes=()), axes, way, eyes
            )[1]
        )
    return np.bincount(_cell(way), f, minlength=CELLS) * 4.0 * math.pi / len(z)


def _drawn(material, eye, count):
    """Directions (count, 3) of `Scattering.drawn`, and their body and interface weights."""
    jit = arrays()
    scattering = Scattering([material], Materials([material], palette_of([material], [], [])))
    random = random_numbers(dr.arange(jit.UInt, count), dr.zeros(jit.UInt, count), 17)
    numbers = [random.next_float32() for _ in range(5)]
    way, sent, good = scattering.drawn(jit.UInt(0), jit.Array3f(*AXIS.tolist()), jit.Array3f(*eye.tolist()), numbers)
    weights = [np.array(dr.select(good, each, 0.0)) for each in sent]
    return np.array(way).T, *weights


def test_pictures_have_the_bits_of_their_seed_however_walks_are_launched(monkeypatch):
    scene = scene_of([cube(matter("sphere", 0.28, BLUE), 6.0)])
    settings = hg.Settings(samples=3, seed=4)
    picture = hg.render(scene, settings, mode="path")
    assert np.array_equal(picture.weights, hg.render(scene, settings, mode="path").weights)
    assert not np.array_equal(picture.weights, hg.render(scene, replace(settings, seed=5), mode="path").weights)
    monkeypatch.setattr(path_picture, "launch_size", lambda channels: 40)  # pixels apart, walks one by one
    apart = hg.render(scene, settings, mode="path")
    assert np.array_equal(apart.weights, picture.weights)
    assert np.array_equal(apart.variance, picture.variance)  # type: ignore[arg-type]


def test_the_variance_of_a_picture_is_that_of_its_mean():
    """Of Y: that of independent draws over their number, whichever way they are added."""
    draws = np.random.default_rng(18).exponential(size=(6, 50, 5)).astype(np.float32)
    lamps = [hg.Lamp(to_lamp=LAMP), hg.Lamp(to_lamp=EYE, spectrum=BLUE)]
    sums = WalkSums(2, 3, Palette((RED,), (GREY,), ()).with_lamps(lamps), lamps[0].spectrum)
    for begin in (0, 4):
        for part in (slice(0, 20), slice(20, 50)):
            some = np.arange(begin, min(begin + 4, 6))
            sums.add(some, Walked.of(draws[some, part]), np.full(len(some), len(draws[0, part])))
    weights, coverage = sums.mean()
    y = hg.Image(draws[..., :-1], draws[..., -1], sums.palette).xyz()[..., 1]
    assert weights.reshape(6, 4) == pytest.approx(draws[..., :-1].mean(axis=1), rel=1e-6)
    assert coverage.ravel() == pytest.approx(draws[..., -1].mean(axis=1), rel=1e-6)
    variance = sums.variance()
    assert variance is not None and variance.ravel() == pytest.approx(y.var(axis=1, ddof=1) / 50, rel=1e-4)


def test_a_picture_of_all_orders_is_exposed_after_it_was_read_back(tmp_path):
    """Bands and variance are kept; an exposure with all orders is brighter than without, and follows the lamp."""
    scene = scene_of([cube(matter("sphere", 0.3, RED), 6.0)])
    picture = hg.render(scene, hg.Settings(samples=16), mode="path")
    picture.save(tmp_path / "a.exr")
    read = hg.read_image(tmp_path / "a.exr")
    assert np.array_equal(read.weights, picture.weights)
    assert read.variance is not None and np.array_equal(read.variance, picture.variance)  # type: ignore[arg-type]
    once = hg.render(scene, hg.Settings(samples=16, orders=1), mode="path")
    camera = hg.Response.load("canon_eos_300d")
    assert read.expose(camera).sum() > 1.05 * once.expose(camera).sum()
    (warm, cold) = (read.expose(camera, [hg.Spectrum.named(name)]).sum(axis=(0, 1)) for name in ("A", "D65"))
    assert warm[0] / warm[2] > 1.5 * cold[0] / cold[2]
    assert read.with_lamps(strength={0: 2.0}).variance is None


def test_matter_that_gains_light_is_refused():
    thread = replace(cube(matter("cylinder"), 4.0), extinction="isotropic", name="thread")
    with pytest.raises(hg.InputError, match="'thread' has isotropic extinction, by which a cylinder"):
        hg.render(scene_of([thread]), mode="path")
    grain = replace(cube(matter("sphere"), 4.0), extinction="isotropic")
    hg.render(scene_of([grain]), hg.Settings(samples=1), mode="path")
    with pytest.raises(hg.InputError, match="orders is 0"):
        hg.Settings(orders=0)


def test_walks_go_on_until_the_error_is_met():
    """The stated error is that of the picture, and half of it takes four times the walks; an impossible one is refused.

    A picture of ten times the walks is the truth; 25 %: 576 pixels, of which some show little.
    """
    scene = scene_of([cube(matter("sphere", 0.28), 6.0)])
    side = 24
    camera = replace(scene.camera, width=side, height=side, focal=(side * 2.5,) * 2, principal=(side / 2,) * 2)
    scene = scene.with_camera(camera)
    wide, narrow = (hg.render(scene, hg.Settings(error=error, seed=1), mode="path") for error in (0.1, 0.05))
    assert narrow.metadata["walks"] / wide.metadata["walks"] == pytest.approx(4.0, rel=0.25)
    walks = math.ceil(10 * narrow.metadata["walks"])
    truth = hg.render(scene, hg.Settings(samples=walks, seed=2), mode="path").xyz()[..., 1]
    seen = narrow.alpha > 0.0
    off = np.sqrt(np.mean((narrow.xyz()[..., 1] - truth)[seen] ** 2)) / truth[seen].mean()
    assert off == pytest.approx(0.05 * math.sqrt(1.1), rel=0.25)
    assert narrow.metadata["noise"] < 0.05
    with pytest.raises(hg.InputError, match=r"takes about .* walks a pixel"):
        hg.render(scene, hg.Settings(error=1e-4), mode="path")
    with pytest.raises(hg.InputError, match="error is for mode path"):
        hg.render(scene, hg.Settings(error=0.01))


def test_light_without_an_end_is_refused():
    """A lamp amid a sphere that sends on all light."""
    sphere = hg.Surface.sphere(
        (0.0, 0.0, 0.0), 0.5, hg.Reflectance(1.0 / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
    )
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.0, -0.2, 0.1), (0.0, 0.3, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(position=(0.0, 0.0, 0.0)),), surfaces=(sphere,))
    with pytest.raises(hg.InputError, match="light has no end here: most walks were scattered"):
        hg.render(scene, hg.Settings(error=0.05), mode="path")
    assert hg.render(scene, hg.Settings(orders=3), mode="path").metadata["walks"] == 1


@pytest.mark.by_night("stop1-launches1")
@pytest.mark.parametrize(("stop", "launches"), [({"samples": 6}, (1, 7, 14)), ({"error": 0.2}, (7,))])
def test_an_interrupted_picture_goes_on_to_the_bits_of_one_that_was_not(monkeypatch, tmp_path, stop, launches):
    """Between two launches of 3000 walks, of which the last has pixels with more walks than others; as a file."""
    monkeypatch.setattr(path_picture, "launch_size", lambda channels: 3000)
    lamps = hg.Lamp(to_lamp=LAMP), hg.Lamp(to_lamp=EYE, spectrum=BLUE), hg.Lamp(to_lamp=(0, 0, 1))
    camera = hg.Camera(70, 50, (160.0, 160.0), (35.0, 25.0)).look_at((0.0, -1.0, 0.5), (0.0, 0.0, 0.0))
    ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.15, hg.Reflectance(0.25, 0.2, 0.3, 1.5, RED))
    scene, settings = hg.Scene(camera, lamps, surfaces=(ball,)), hg.Settings(seed=5, **stop)
    monkeypatch.setattr("hagoromo.image.prepared.lamp_batches.LAMPS_AT_ONCE", 2)
    whole = hg.render(scene, settings, mode="path")
    for calls in launches:
        left = iter(range(calls))

        def progress(*_, left=left):
            if next(left, None) is None:
                raise KeyboardInterrupt

        with pytest.raises(hg.RenderInterrupted, match="walks a pixel") as interrupted:
            hg.render(scene, settings, progress, mode="path")
        interrupted.value.image.save(tmp_path / "a.exr", force=True)
        unfinished = hg.read_image(tmp_path / "a.exr")
        assert unfinished.metadata["walks"] > 0.0 and "walks a pixel" in unfinished.metadata["unfinished"]
        again = hg.render(scene, settings, mode="path", unfinished=unfinished)
        assert again.sums is None and "unfinished" not in again.metadata
        assert np.array_equal(again.weights, whole.weights) and np.array_equal(again.alpha, whole.alpha)
        assert np.array_equal(again.variance, whole.variance)  # type: ignore[arg-type]
        with pytest.raises(hg.InputError, match="unfinished picture is of another settings"):
            hg.render(scene, replace(settings, seed=6), mode="path", unfinished=unfinished)
        with pytest.raises(hg.InputError, match="unfinished picture is of another scene"):
            hg.render(scene.with_lamps(*lamps[:2]), settings, mode="path", unfinished=unfinished)
    with pytest.raises(hg.InputError, match="not unfinished"):
        hg.render(scene, settings, mode="path", unfinished=whole)
    with pytest.raises(hg.InputError, match="only pictures of mode path are resumed"):
        hg.render(scene, unfinished=unfinished)


def test_walks_go_on_for_a_time():
    scene = scene_of([cube(matter("sphere", 0.28), 6.0)])
    assert hg.render(scene, hg.Settings(seconds=1e-3), mode="path").metadata["walks"] == 16
    assert hg.render(scene, hg.Settings(seconds=0.5, error=0.2), mode="path").metadata["walks"] >= 16


def test_a_closed_sphere_lights_itself_by_the_closed_form():
    """A lamp amid a Lambert sphere of albedo ρ = 0.8: L of the orders above one is ρ/(1 − ρ) times that of the first.

    The first event needs no draw: it is I ρ/(π r²) on every ray.
    """
    matte = hg.Reflectance(0.8 / math.pi, 0.0, 0.2, 1.5, GREY)
    sphere = hg.Surface.sphere((0.0, 0.0, 0.0), 0.5, matte)
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.0, -0.2, 0.1), (0.0, 0.3, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(position=(0.0, 0.0, 0.0), intensity=2.0),), surfaces=(sphere,))
    towards = everywhere(500, 20)
    light = light_along(scene, np.broadcast_to([0.1, -0.2, 0.15], towards.shape), towards, 40)
    assert light[..., 0] == pytest.approx(np.full((500, 40), 2.0 * 0.8 / (math.pi * 0.25)), rel=2e-3)  # shadow bias
    ratio = light[..., 2] / light[..., 0]
    error = ratio.std() / math.sqrt(ratio.size)
    assert abs(ratio.mean() - 4.0) < 3.3 * error + 0.01 and error < 0.04


def test_lamps_are_drawn_by_what_they_give():
    """A far lamp, a spot and a profile on a ball and a floor, first event: the mean over draws is the march's sum."""
    spot = hg.Lamp(position=(0.5, -0.5, 0.6), axis=(-0.5, 0.5, -0.6), axis_power=20.0, spectrum=BLUE)
    profile = hg.LampProfile([0], [0, 20, 60], [[1, 0.4, 0]])
    tube = hg.Lamp(position=(-0.4, -0.3, 0.8), intensity=0.7, axis=(0.4, 0.3, -0.8), profile=profile)
    matter_of = hg.Reflectance(0.2, 0.3, 0.3, 1.5, RED)
    surfaces = hg.Surface.sphere((0.0, 0.0, 0.1), 0.1, matter_of), hg.Surface.floor(0.0, 0.5, matter_of)
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.0, -1.0, 0.5), (0.0, 0.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=LAMP), spot, tube), surfaces=surfaces)
    offset = np.random.default_rng(21).uniform(-0.2, 0.2, (60, 2))
    origin = np.broadcast_to(camera.position, (60, 3))
    along = np.concatenate([offset, np.zeros((60, 1))], axis=1) - origin
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    marched = hg.RayMarch(scene)(origin, along).weights.reshape(60, -1, 2)  # group of lamps, colour
    light = light_along(scene, origin, along, 400, orders=1).reshape(60, 400, -1, 3)
    error = light.std(axis=1)[..., :2] / math.sqrt(400)
    off = np.abs(light.mean(axis=1)[..., :2] - marched)
    assert (error > 0.0).sum() > 100
    assert (off < 4.2 * error + 1e-4 * marched.max()).all()  # of 240 figures


def test_many_lamps_of_many_colours_are_a_sum_of_batches(monkeypatch):
    """Batches have one set of bands, and a variance of Y counted from the first lamp; as one batch, to the noise."""
    sphere = hg.Surface.sphere((0.0, 0.0, 0.0), 0.5, hg.Reflectance(0.2, 0.0, 0.2, 1.5, RED))
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.0, -0.2, 0.1), (0.0, 0.3, 0.0))
    lamps = [hg.Lamp(position=(0.1 * k, 0.0, 0.1), spectrum=each) for k, each in enumerate((STEP, GREY, BLUE))]
    scene = hg.Scene(camera, tuple(lamps), surfaces=(sphere,))
    whole = hg.render(scene, hg.Settings(samples=64), mode="path")
    monkeypatch.setattr("hagoromo.image.prepared.lamp_batches.LAMPS_AT_ONCE", 2)
    parts = hg.render(scene, hg.Settings(samples=64), mode="path")
    assert parts.palette.channels == whole.palette.channels and parts.variance is not None
    y, other = (picture.xyz()[..., 1].mean() for picture in (parts, whole))
    assert y == pytest.approx(other, rel=0.03)
    assert 0.3 < np.sqrt(parts.variance.mean() / whole.variance.mean()) < 1.5  # type: ignore[union-attr]


PEAK = hg.Spectrum((360, 553, 554, 555, 830), (0.5, 0.5, 1.2, 0.5, 0.5))  # above 1 in less than 2 nm


@pytest.mark.parametrize(("value", "basis", "good"), [(1.0, GREY, True), (1.2, GREY, False), (1.0, PEAK, False)])
def test_voxels_that_send_back_more_than_they_take_are_refused(value, basis, good):
    """At any wavelength."""
    box = cube(matter("sphere", 0.3), 4.0)
    colour = np.zeros((3, 3, 3, 4))
    colour[..., 0] = value
    axes = np.broadcast_to(AXIS, (3, 3, 3, 3))
    coloured = hg.VolumeBox.from_arrays(
        np.ones((3, 3, 3)), axes, SIDE / 3, box.tau, box.materials, body_colour=colour, basis=(basis,), name="dyed"
    )
    if good:
        hg.render(scene_of([coloured]), mode="path")
        return
    with pytest.raises(hg.InputError, match=r"'dyed': its voxels send back up to 1\.13 of the light"):
        hg.render(scene_of([coloured]), mode="path")


def test_a_material_that_sends_back_more_than_it_takes_at_some_wavelength_is_refused():
    with pytest.raises(hg.InputError, match="breaks energy conservation"):
        matter("sphere", 1.0 / math.pi, PEAK)
