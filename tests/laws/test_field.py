"""Laws of mode full: light of all orders in volume boxes, solved on a coarse grid (`transport/field`).

The oracles are NumPy, written from the equations: quadrature over directions and ways, and the energy that must leave
white matter.
"""

import math
from dataclasses import replace
from typing import cast

import drjit as dr
import numpy as np
import pytest
from scipy.ndimage import binary_dilation

import hagoromo.image.full.picture as full
import hagoromo.transport.field.solve as solve
from hagoromo.backend import arrays, column
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_profile import LampProfile
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import Element, element_weights, projected_area
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.field.cell_size import cell_size as real_cell_size
from hagoromo.transport.field.cell_size import light_bytes
from hagoromo.transport.field.cells import Cells, with_neighbours
from hagoromo.transport.field.directions import directions, turn
from hagoromo.transport.field.scattering import ScatteringTables, scattered
from hagoromo.transport.field.second_order import projected, second_order
from hagoromo.transport.field.sweep import Path
from hagoromo.transport.film import pixel_points
from hagoromo.volume.box import VolumeBox

WHITE = Spectrum.constant(1.0)
GLOSSY = {e: Reflectance(0.15, 0.5, 0.35, 1.5, WHITE, element=e) for e in ("plane", "cylinder", "sphere")}
TO_LAMP = np.array([0.48, -0.6, 0.64])
SOLVED = Settings(walks=0)  # the solution, without walks that mend it
SIDE = 12  # voxels along an edge of a box of 1 m


def matter(element: Element = "sphere", albedo=1.0, beta=0.0, colour=WHITE):
    return Reflectance(albedo / math.pi, beta, 0.3, 1.5, colour, element=element)


def cube(material, depth, side=SIDE, axis=(0.36, -0.48, 0.8)):
    """A full box of 1 m, `depth` mean free paths of mean extinction along an edge."""
    axes = np.broadcast_to(axis, (side, side, side, 3))
    return VolumeBox.from_arrays(
        np.ones(axes.shape[:3]), axes, 1 / side, 2.0 * depth, [material], extinction="projected"
    )


def scene_of(*boxes, lamps=(TO_LAMP,), size=12, eye=(1.7, -2.2, 1.6)):
    camera = Camera(size, size, (1.6 * size, 1.6 * size), (size / 2, size / 2)).look_at(eye, (0.5, 0.5, 0.5))
    return Scene(camera, tuple(Lamp(to_lamp=tuple(way)) for way in lamps), boxes)


def light_along(scene, origins, ways, **settings):
    """First order and higher orders of a grey scene along rays: (rays,) each."""
    settings = Settings(tolerance=settings.pop("tolerance", 0.01), **settings)
    prepared = PreparedScene(scene, settings)
    bands = full.bands_of_scene(scene, prepared.palette.lamps)
    prepared.lighting.field, _ = full.light_of(scene, prepared, settings, bands, SceneCache())
    channels, _ = prepared.radiance(vectors(origins), vectors(ways))
    body, _, higher = (np.array(channel, float) for channel in channels)
    return body, higher


def spiral(count):
    """Unit directions of a golden spiral, all of one weight."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, math.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)


def phase(cosine):
    """f of a Lambertian sphere of albedo 1 [1/sr]."""
    chi = np.arccos(np.clip(cosine, -1, 1))
    return 2 / (3 * math.pi**2) * (np.sin(chi) + (math.pi - chi) * np.cos(chi))


def way_out(points, ways):
    """Length from points in the unit cube along ways to its faces."""
    with np.errstate(divide="ignore"):
        return np.where(ways > 0, (1 - points) / ways, np.where(ways < 0, -points / ways, np.inf)).min(axis=-1)


def two_orders(origin, way, sigma, albedo):
    """Light of the second order along a ray that enters the unit cube, by quadrature over both ways and directions."""
    x, w = (0.5 + 0.5 * np.polynomial.legendre.leggauss(14)[0], 0.5 * np.polynomial.legendre.leggauss(14)[1])
    enter = np.where(way > 0, -origin / way, (1 - origin) / way).max()
    begin = origin + enter * way
    span = way_out(begin + 1e-9 * way, way)
    points = begin + np.outer(x * span, way)
    seen = w * span * sigma * np.exp(-sigma * x * span)
    to_light = spiral(1500)
    length = way_out(points[:, None], np.broadcast_to(to_light, (len(x), *to_light.shape)))
    places = points[:, None, None] + (length[..., None] * x)[..., None] * to_light[None, :, None]
    through = np.exp(-sigma * (length[..., None] * x + way_out(places, np.broadcast_to(TO_LAMP, places.shape))))
    arriving = sigma * (length * (through @ w)) * phase(-to_light @ TO_LAMP)
    return albedo**2 * seen @ (arriving @ phase(-to_light @ way)) * 4 * math.pi / len(to_light)


def rays_into_the_cube():
    """Origins and ways of rays that miss the edges."""
    random = np.random.default_rng(3)
    ways = spiral(8)
    return 0.5 + 0.25 * random.normal(size=ways.shape).clip(-1, 1) * np.abs(np.cross(ways, [0, 0, 1])).clip(
        0.3
    ) - 2 * ways, ways


@pytest.fixture(autouse=True)
def small_cells(monkeypatch):
    """Cells of two voxels, of which each holds half a mean free path at a depth of 3."""
    monkeypatch.setattr(full, "cell_size", lambda boxes, channels: 2 * boxes[0].voxel_size)


def vectors(v):
    return arrays().Array3f(*(column(arrays().Float, v[:, k].astype(np.float32)) for k in range(3)))


@pytest.mark.parametrize("element", ["plane", "cylinder", "sphere"])
def test_smooth_light_is_scattered_as_by_quadrature_over_all_directions(element):
    """∫ f L dω of light of the second order, and what of A(V) ∫ f L dω is of the second order.

    5e-3 of the largest: tables of 65 angles; not along a plane's edge, where its highlight is narrower than that.
    """
    jit, count, numbers = arrays(), 3000, np.random.default_rng(1).normal(size=9)
    axis, ways = np.array([0.36, -0.48, 0.8]), spiral(count)
    axes, each, scattering = jit.Array3f(*map(float, axis)), 4 * math.pi / count, ScatteringTables([GLOSSY[element]])
    light = np.array(second_order([jit.Float(float(x)) for x in numbers]).at(vectors(ways)), float)
    eyes = ways[:: count // 25][np.abs(ways[:: count // 25] @ axis) > 0.25]
    pairs = vectors(np.tile(ways, (len(eyes), 1))), vectors(np.repeat(eyes, count, axis=0))
    weights = element_weights(element, axes, *pairs, 0.15, 0.5, 0.35, 1.5)
    for part, f in enumerate(weights):
        seen = np.array(f, float).reshape(len(eyes), count) @ light * each
        table = radiance(scattering, part, axes, eyes, numbers)
        assert np.abs(table - seen).max() < 5e-3 * np.abs(seen).max()
        leaving = radiance(scattering, part, axes, ways, numbers) * projected_area(element, jit.Float(ways @ axis))
        oracle = np.array([np.sum(np.array(p) * leaving) * each for p in projected(vectors(ways))])
        blocks = scattering.blocks(jit.UInt(0), part)
        sent = scattered(blocks, axes, second_order([jit.Float(float(x)) for x in numbers])).numbers()
        assert np.abs(np.array([np.array(x).item() for x in sent]) - oracle).max() < 5e-3 * np.abs(oracle).max()


def radiance(scattering, part, axis, eyes, numbers):
    """∫ f L dω of incident light of nine numbers, towards eyes (n, 3)."""
    factors = scattering.towards(arrays().UInt(0), part, axis, vectors(eyes))
    return sum(np.array(factor, float) * x for factor, x in zip(factors, numbers, strict=True))


def test_directions_integrate_polynomials_however_they_are_turned():
    """The mean of x^2a y^2b z^2c is (2a − 1)!! (2b − 1)!! (2c − 1)!! / (2a + 2b + 2c + 1)!!, else 0; one is not."""
    degree, (ways, weights) = 5, directions()
    ways = ways @ turn(np.random.default_rng(4)).T
    odd = lambda n: math.prod(range(n, 0, -2))  # noqa: E731
    for powers in (p for p in np.ndindex(11, 11, 11) if sum(p) <= degree):
        mean = 0.0 if any(k % 2 for k in powers) else math.prod(odd(k - 1) for k in powers) / odd(sum(powers) + 1)
        assert weights @ np.prod(ways**powers, axis=1) / (4 * math.pi) == pytest.approx(mean, abs=1e-12)
    assert weights @ ways[:, 0] ** (degree + 1) / (4 * math.pi) != pytest.approx(1 / (degree + 2), abs=1e-4)


def test_one_sweep_is_the_second_order_and_finer_cells_come_nearer(monkeypatch):
    """Against quadrature along single rays, over three seeds: 2 % with cells of a quarter mean free path."""
    origins, ways = rays_into_the_cube()
    oracle = np.array([two_orders(o, w, 3.0, 0.8) for o, w in zip(origins, ways, strict=True)])
    errors = []
    for size in (0.25, 1 / 12):
        monkeypatch.setattr(full, "cell_size", lambda boxes, channels, size=size: size)
        scene = scene_of(cube(matter(albedo=0.8), 3.0))
        higher = np.array([light_along(scene, origins, ways, orders=2, seed=seed)[1] for seed in range(3)])
        errors.append(np.sqrt(np.mean((higher - oracle) ** 2)) / oracle.mean())
    assert errors[1] < 0.02 and errors[1] < 0.5 * errors[0]


def lit_plane(way, count=20):
    """Points of the plane across `way` through the middle of the unit cube that cover it, and the area of each."""
    along = ((np.arange(count) + 0.5) / count - 0.5) * math.sqrt(3.0)
    a, b = (grid.reshape(-1, 1) for grid in np.meshgrid(along, along))
    one = np.cross(way, [0.31, 0.2, 0.93])
    one /= np.linalg.norm(one)
    return 0.5 + a * one + b * np.cross(way, one), 3.0 / count**2


@pytest.mark.parametrize("element", ["sphere", "cylinder"])
def test_what_enters_white_matter_leaves_it(element):
    """∫ of all light that leaves, over directions and the plane across each, is what the lamp brings and matter takes.

    2.5 %, at half a mean free path a cell; more than half of it was scattered again.
    """
    scene, ways = scene_of(cube(matter(element), 3.0)), spiral(30)
    origins = np.concatenate([lit_plane(way)[0] + 2 * way for way in ways])
    first, higher = light_along(scene, origins, np.repeat(-ways, len(origins) // len(ways), axis=0))
    starts, area = lit_plane(TO_LAMP, 100)
    chord = np.maximum(way_out(starts, TO_LAMP[None]) + way_out(starts, -TO_LAMP[None]), 0)
    sigma = 6.0 * projected_area(element, float(TO_LAMP @ (0.36, -0.48, 0.8)))
    enters = (1 - np.exp(-sigma * chord)).sum() * area
    leaves = [order.sum() * lit_plane(TO_LAMP)[1] * 4 * math.pi / len(ways) for order in (first, higher)]
    assert sum(leaves) == pytest.approx(enters, rel=0.025) and leaves[1] > 0.35 * enters


@pytest.mark.parametrize("element", ["sphere", "cylinder"])
def test_higher_orders_agree_with_random_walks(element):
    """With an interface, in the whole picture: 1 % of all light, of which they are a fifth."""
    glossy = Reflectance(0.22, 0.35, 0.3, 1.5, WHITE, element=element)
    scene = scene_of(cube(glossy, 3.0), size=10)
    solved, walked = (
        render(scene, Settings(samples=8, walks=0), mode="full"),
        render(scene, Settings(samples=600), mode="path"),
    )
    higher = walked.weights[..., 2:].mean(axis=-1).sum()  # of a grey scene each band has all of it
    everything = walked.weights[..., :2].sum() + higher
    assert abs(solved.weights[..., 2].sum() - higher) < 0.01 * everything and higher > 0.15 * everything


@pytest.mark.by_night("0.75-0.6875")
@pytest.mark.parametrize(("ends", "cuts"), [(0.75, 0.6875), (1.5, 1.375)])
def test_faces_of_matter_lie_anywhere_in_cells(ends, cuts, monkeypatch):
    """Higher orders of a cube of 12 voxels in cells that end at its faces and in such that do not: 5 % of each other.

    Matter that was sampled in the middles of parts of cells alone had 16 % less light in the latter.
    """
    lights = []
    for voxels in (ends, cuts):
        monkeypatch.setattr(full, "cell_size", lambda boxes, channels, voxels=voxels: voxels * boxes[0].voxel_size)
        solved = render(scene_of(cube(matter(albedo=0.9), 10.0), size=16), Settings(samples=4, walks=0), mode="full")
        lights.append(solved.weights[..., 2].sum())
    assert lights[1] == pytest.approx(lights[0], rel=0.05)


@pytest.mark.parametrize("depth", [1e3, 1e5])
def test_light_in_very_dense_white_matter_is_solved(depth):
    """Albedo 0.999, hundreds of mean free paths a cell and more: finite, not below 0, and less than the lamp's."""
    with pytest.warns(UserWarning, match="mean free paths deep in a cell"):
        image = render(scene_of(cube(matter(albedo=0.999), depth)), SOLVED, mode="full")
    assert np.isfinite(image.weights).all() and image.weights.min() >= 0.0
    assert image.metadata["field"]["residual"] < 0.01
    assert 0.0 < image.weights[..., 2].max() < 1 / math.pi


def test_light_that_is_not_solved_is_said(monkeypatch):
    monkeypatch.setattr(solve, "MOST_SWEEPS", 3)
    with pytest.warns(UserWarning, match="still changes by .* after 3 sweeps"):
        render(scene_of(cube(matter(albedo=0.999), 20.0)), SOLVED, mode="full")


def test_mirrored_lamps_give_mirrored_light():
    """About the middle of a box across x; 4 %: directions are turned, and places in cells drawn, at random."""
    ways = spiral(30)
    origins = 0.5 + 0.2 * np.random.default_rng(5).uniform(-1, 1, ways.shape) - 2 * ways
    mirror = np.array([-1.0, 1.0, 1.0])
    box = cube(matter(albedo=0.9), 3.0)
    _, one = light_along(scene_of(box), origins, ways)
    _, other = light_along(
        scene_of(box, lamps=(TO_LAMP * mirror,)), np.array([1.0, 0, 0]) + origins * mirror, ways * mirror
    )
    assert np.sqrt(np.mean((one - other) ** 2)) < 0.04 * one.mean()


def test_another_camera_costs_a_march_and_light_of_a_seed_has_the_same_bits(monkeypatch):
    scene, cache, points = scene_of(cube(matter(), 3.0)), SceneCache(), pixel_points(1, 0)
    first = full.full_picture(scene, SOLVED, points, cache)
    assert np.array_equal(first.weights, render(scene, SOLVED, mode="full").weights)
    monkeypatch.setattr(full.Solver, "solved", lambda *_: pytest.fail("it was solved again"))
    turned = scene.with_camera(scene_of(scene.boxes[0], eye=(-1.5, -2, 1)).camera)
    second = full.full_picture(turned, SOLVED, points, cache)
    assert second.weights[..., 2].sum() > 0 and not np.array_equal(first.weights, second.weights)
    with pytest.raises(pytest.fail.Exception, match="solved again"):
        full.full_picture(turned.with_lamps(Lamp(to_lamp=(0, 0, 1))), SOLVED, points, cache)


@pytest.mark.nightly
def test_the_light_of_a_picture_is_within_the_memory_that_cells_are_chosen_for():
    """With the cells around matter, which were not counted: of a full box they are a fifth. What is chosen for has nine
    numbers in whole packets, of 24 bytes; kept are 18.
    """
    box = cube(matter(), 20.0, 40)
    field = render(scene_of(box, size=2), SOLVED, mode="full").metadata["field"]
    packed = field["bytes"] + 6 * field["cells"]
    assert 0.8 < packed / light_bytes([box], field["cell"], 1) <= 1.0
    some = np.random.default_rng(5).random((7, 5, 6)) < 0.05
    assert np.array_equal(with_neighbours(some), binary_dilation(some, np.ones((3, 3, 3))))


@pytest.mark.parametrize(("side", "channels"), [(100, 1), (100, 5), (40, 1)])
def test_light_takes_a_quarter_of_the_memory_of_the_bricks(side, channels):
    """Of a full box whose cells would be finer; of a small one a MiB."""
    box = cube(matter(), 40.0, side)
    size = real_cell_size([box], channels)
    share = light_bytes([box], size, channels) / box.bricks.bytes
    assert share <= 0.25 or share * box.bricks.bytes <= 1 << 20
    finer = light_bytes([box], 0.95 * size, channels)
    assert size == pytest.approx(0.5 / 40.0, rel=0.1) or finer > max(0.23 * box.bricks.bytes, 0.9 * (1 << 20))


def test_matter_of_large_scenes_has_fewer_samples(monkeypatch):
    """As many as the memory is for, at least one a cell, and the light of higher orders stays within 5 %."""
    assert [solve.samples_along(8.0, cells, 100.0) for cells in (1e5, 1e6, 1e9)] == [4, 2, 1]
    assert solve.samples_along(1.0, 1e3, 100.0) == 2
    scene = scene_of(cube(matter(), 3.0))
    with_all = render(scene, SOLVED, mode="full")
    monkeypatch.setattr(solve, "MOST_BYTES", 0.0)
    with_one = render(scene, SOLVED, mode="full")
    assert not np.array_equal(with_one.weights, with_all.weights)
    assert with_one.weights[..., 2].sum() == pytest.approx(with_all.weights[..., 2].sum(), rel=0.05)


def test_a_lamp_of_another_profile_is_another_field():
    """Whatever place in memory its profile has, and its roll."""
    wide, narrow = (LampProfile([0], [0, angle], [[1, 0]]) for angle in (90, 20))
    scene, cache, points = scene_of(cube(matter(), 3.0)), SceneCache(), pixel_points(1, 0)
    lights = []
    for profile, roll in ((wide, 0.0), (narrow, 0.0), (narrow, 0.5)):
        lamp = Lamp(position=(2, -2, 2), axis=(-1.5, 2.5, -1.5), profile=profile, roll=roll)
        image = full.full_picture(scene.with_lamps(lamp), SOLVED, points, cache)
        lights.append((image.weights[..., 2].sum(), cache.key("field")))
    assert lights[0][0] > 1.05 * lights[1][0] and len({key for _, key in lights}) == 3


def test_each_band_is_the_light_of_its_colour():
    """A body of two albedos at the ends of the spectrum, against grey bodies of these: rounding of halves.

    A grey scene has one band.
    """
    dull, bright = 0.3, 0.6
    sloped = matter(colour=Spectrum([360, 400, 700, 830], [dull, dull, bright, bright]))
    bands = render(scene_of(cube(sloped, 3.0)), SOLVED, mode="full")
    assert 3 <= len(bands.palette.bands) <= 5
    for albedo, band in ((dull, 2), (bright, -1)):
        grey = render(scene_of(cube(matter(albedo=albedo), 3.0)), SOLVED, mode="full")
        assert len(grey.palette.bands) == 1
        one, most = grey.weights[..., 2], grey.weights[..., 2].max()
        assert np.abs(bands.weights[..., band] - one).max() < 5e-3 * most


def test_batches_of_lamps_share_their_bands(monkeypatch):
    """One choice for all lamps, in batches of few channels; two batches are then the two lamps together."""
    blue, slope = Spectrum([360, 445, 450, 455, 830], [0, 0, 1, 0, 0]), Spectrum([360, 440, 460, 830], [0, 0, 1, 1])
    lamps = [Lamp(to_lamp=(0, -1, k), spectrum=s) for k, s in enumerate((WHITE, blue, WHITE, slope))]
    assert full.batches_of(lamps, 1, False) == [[0, 1, 2, 3]] and full.batches_of(lamps, 4, False) == [[0, 1, 2], [3]]
    assert full.batches_of(lamps, 7, True) == [[0], [1], [2], [3]]
    seen = []

    def one_batch(settings, points, bands, cache, number, scene, progress):
        seen.append((len(scene.lamps), bands))
        palette = replace(full.palette_of_scene(scene, settings), bands=bands.spectra)
        return np.ones((2, 2, palette.channels), np.float32), np.ones((2, 2), np.float32), {}

    monkeypatch.setattr(full, "_traced", one_batch)
    scene = scene_of(cube(matter(colour=slope), 3.0)).with_lamps(*lamps)
    with pytest.warns(UserWarning, match="7 bands are too few for the spectra"):  # of the blue lamp's line
        image = render(scene, SOLVED, mode="full")
    assert [count for count, _ in seen] == [2, 1, 1] and len({id(bands) for _, bands in seen}) == 1
    assert 3 < seen[0][1].count <= 7 and image.weights.shape[-1] == 3 * (2 + seen[0][1].count)


def test_what_mode_full_cannot_do_is_said_in_one_line():
    box = cube(matter("cylinder"), 3.0)
    with pytest.raises(InputError, match=r'isotropic extinction.*set extinction = "projected"'):
        render(scene_of(replace(box, extinction="isotropic")), SOLVED, mode="full")


@pytest.mark.parametrize("begin", [0.5, 3000.0, 20000.0, 1e5, 1e7])
def test_ways_go_on_however_far_they_come_from(begin):
    """A way whose next face is where it is, by rounding: 20,000 cells away 0.0005 of one is lost in a float."""
    place = vectors(np.array([[-begin, 0.5, 0.5]]))
    path = Path(cast(Cells, None), place, vectors(np.array([[1.0, 0.0, 0.0]])))
    jit = arrays()
    at = dr.opaque(jit.Float, begin)
    end = path.end(jit.Array3f(-1.0, 0.0, 0.0), jit.Int(0), at)  # the face in front of the cell, which ends at `begin`
    assert float(end[0]) > float(at[0])


def test_a_box_without_matter_beside_another_changes_no_light():
    shape, full_box = (SIDE, SIDE, SIDE), cube(matter(), 3.0)
    nothing = VolumeBox.from_arrays(np.zeros(shape), np.zeros((*shape, 3)), 1 / SIDE, 1.0, [matter()])
    alone, beside = (render(scene_of(*boxes), SOLVED, mode="full") for boxes in ([full_box], [full_box, nothing]))
    np.testing.assert_allclose(beside.weights, alone.weights, rtol=1e-3, atol=1e-3 * alone.weights.max())
    with pytest.raises(InputError, match="no volume box holds matter"):
        render(scene_of(nothing), SOLVED, mode="full")
