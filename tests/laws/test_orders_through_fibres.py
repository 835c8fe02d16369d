"""Laws of light of all orders through elements: draws against the oracle in float64, furnaces; path = march = full."""

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, column
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.transport.field.scattering import ScatteringTables, scattered
from hagoromo.transport.field.second_order import projected, second_order
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from hagoromo.transport.path.path import random_numbers
from hagoromo.transport.path.scatter import Scattering
from tests.judges import sampler_follows_density, standard_normal
from tests.oracle.reflection import element_weights
from tests.oracle.transmission import transmitted

AXIS, WHITE = np.array([0.36, -0.48, 0.8]), hg.Spectrum.constant(1.0)
ROWS, COLUMNS = 8, 16
CELLS = ROWS * COLUMNS
EYE = np.array([0.1, 0.5, 0.86]) / np.linalg.norm([0.1, 0.5, 0.86])


def matter(element, clearness=0.0, **keys):
    figures: dict[str, Any] = {"alpha": 0.6 / math.pi, "beta": 0.0, "gamma": 0.5, "n": 1.5, "transmission": 0.4} | keys
    return hg.Reflectance(**figures, body_colour=WHITE, element=element, clearness=clearness)


def cell_of(way):
    row = np.clip((0.5 * (way[:, 2] + 1.0) * ROWS).astype(int), 0, ROWS - 1)
    column = np.clip(((np.arctan2(way[:, 1], way[:, 0]) / (2.0 * math.pi) + 0.5) * COLUMNS).astype(int), 0, COLUMNS - 1)
    return row * COLUMNS + column


def sent_to_cells(material, parts=4):
    """∫ f dL of the oracle over every cell, each weight: (4, CELLS)."""
    z = ((np.arange(ROWS * parts) + 0.5) / (ROWS * parts)) * 2.0 - 1.0
    turn = ((np.arange(COLUMNS * parts) + 0.5) / (COLUMNS * parts) - 0.5) * 2.0 * math.pi
    z, turn = (grid.ravel() for grid in np.meshgrid(z, turn, indexing="ij"))
    r = np.sqrt(1.0 - z * z)
    way = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
    eyes, axes = (np.broadcast_to(v, way.shape) for v in (EYE, AXIS))
    f = (*element_weights(material, axes, way, eyes), *transmitted(material, axes, way, eyes))
    return np.stack([np.bincount(cell_of(way), part, minlength=CELLS) for part in f]) * 4.0 * math.pi / len(z)


def drawn(material, count):
    """Directions (count, 3) and the four weights of each."""
    jit = arrays()
    scattering = Scattering([material], Materials([material], palette_of([material], [], [])))
    random = random_numbers(dr.arange(jit.UInt, count), dr.zeros(jit.UInt, count), 23)
    numbers = [random.next_float32() for _ in range(5)]
    way, sent, good = scattering.drawn(jit.UInt(0), jit.Array3f(*AXIS.tolist()), jit.Array3f(*EYE.tolist()), numbers)
    return np.array(way).T, np.stack([np.array(dr.select(good, each, 0.0)) for each in sent])


@pytest.mark.by_night("sphere")
@pytest.mark.parametrize("element", ELEMENTS)
def test_far_side_body_light_is_drawn_as_it_is_sent(element):
    """χ² against f/∫f of the oracle: every draw has one weight, T."""
    way, sent = drawn(matter(element, alpha=0.0), 40_000)
    expected = sent_to_cells(matter(element, alpha=0.0))[2]
    counts = np.bincount(cell_of(way), minlength=CELLS)
    assert sampler_follows_density(counts, len(way) * expected / expected.sum(), expected_error=0.01)
    assert sent[2] == pytest.approx(np.full(len(way), 0.4), rel=2e-3)


@pytest.mark.parametrize(
    ("element", "clearness"), [*((e, 0.0) for e in ELEMENTS), ("cylinder", 0.6), ("cylinder", 1.0)]
)
def test_weights_of_draws_add_up_to_what_is_sent(element, clearness):
    """In every cell, what is reflected and each way through, against ∫ f dL: z-test, 1 % granted to quadratures."""
    one = matter(element, clearness, alpha=0.1, beta=0.2)
    way, sent = drawn(one, 60_000)
    cell = cell_of(way)
    sent, true = ([part[0] + part[1], *part[2:]] for part in (sent, sent_to_cells(one)))
    for weights, expected in zip(sent, true, strict=True):
        sums, squares = (np.bincount(cell, weights**power, minlength=CELLS) / len(cell) for power in (1, 2))
        seen = expected > 3e-3 * max(expected.sum(), 1e-9)
        error = np.sqrt((squares - sums**2) / len(cell) + (0.01 * expected) ** 2)
        if seen.any():
            z = (sums - expected)[seen] / error[seen]
            assert standard_normal(z, mean_tolerance=0.3, variance_tolerance=0.5)
        assert sums.sum() == pytest.approx(expected.sum(), rel=0.02, abs=1e-9)


def cube(material, depth, side=12):
    """A full box of 1 m, `depth` mean free paths of mean extinction along an edge."""
    axes = np.broadcast_to(AXIS, (side, side, side, 3))
    return hg.VolumeBox.from_arrays(
        np.ones(axes.shape[:3]), axes, 1 / side, 2.0 * depth, [material], extinction="projected"
    )


def scene_of(material, depth=2.0, size=10, lamp=(0.48, -0.6, 0.64)):
    camera = hg.Camera(size, size, (1.6 * size, 1.6 * size), (size / 2, size / 2)).look_at(
        (1.7, -2.2, 1.6), (0.5, 0.5, 0.5)
    )
    return hg.Scene(camera, (hg.Lamp(to_lamp=lamp),), (cube(material, depth),))


def test_paths_of_one_event_are_the_march():
    """Each of the four weights in the mean of a backlit picture; four standard errors and 0.5 % of the whole."""
    scene = scene_of(matter("cylinder", 0.5, alpha=0.1, beta=0.2), lamp=(-0.5, 0.7, -0.4))
    marched = hg.render(scene, hg.Settings(samples=4, tolerance=0.005)).weights
    walked = hg.render(scene, hg.Settings(samples=256, orders=1), mode="path").weights[..., :4]
    whole = marched.sum(axis=-1).mean()
    parts = [hg.render(scene, hg.Settings(samples=64, orders=1, seed=s), mode="path").weights[..., :4] for s in (1, 2)]
    error = np.abs(parts[0].mean(axis=(0, 1)) - parts[1].mean(axis=(0, 1))) / 2.0
    apart = np.abs(walked.mean(axis=(0, 1)) - marched.mean(axis=(0, 1)))
    assert (apart < 4.0 * error + 0.005 * whole).all() and marched[..., 2].mean() > 0.5 * whole


@pytest.mark.parametrize("element", ["plane", "cylinder"])
def test_smooth_light_is_transmitted_as_by_quadrature(element):
    """Moments and blocks of mode full for each of the weights: 5e-3 of the largest of all weights."""
    one = matter(element, 0.5 if element == "cylinder" else 0.0, gamma=0.6, n=1.8, alpha=0.1, beta=0.1)
    jit, count, numbers = arrays(), 3000, np.random.default_rng(1).normal(size=9)
    scattering, ways = ScatteringTables([one]), spiral(count)
    axes, each = jit.Array3f(*map(float, AXIS)), 4 * math.pi / count
    light = np.array(second_order([jit.Float(float(x)) for x in numbers]).at(vectors(ways)), float)
    eyes = ways[:: count // 25][np.abs(ways[:: count // 25] @ AXIS) > 0.25]
    pairs = vectors(np.tile(ways, (len(eyes), 1))), vectors(np.repeat(eyes, count, axis=0))
    weights = one.weights(axes, *pairs)
    assert scattering.parts == (4 if element == "cylinder" else 3)
    largest = 0.0
    for part in range(scattering.parts):
        seen = np.array(weights[part], float).reshape(len(eyes), count) @ light * each
        largest = max(largest, np.abs(seen).max())
        assert np.abs(radiance(scattering, part, axes, eyes, numbers) - seen).max() < 5e-3 * largest
        leaving = radiance(scattering, part, axes, ways, numbers) * projected_area(element, jit.Float(ways @ AXIS))
        oracle = np.array([np.sum(np.array(p) * leaving) * each for p in projected(vectors(ways))])
        blocks = scattering.blocks(jit.UInt(0), part)
        sent = scattered(blocks, axes, second_order([jit.Float(float(x)) for x in numbers])).numbers()
        assert np.abs(np.array([np.array(x).item() for x in sent]) - oracle).max() < 5e-3 * largest


def radiance(scattering, part, axis, eyes, numbers):
    """∫ f L dω of incident light of nine numbers, towards eyes (n, 3)."""
    factors = scattering.towards(arrays().UInt(0), part, axis, vectors(eyes))
    return sum(np.array(factor, float) * x for factor, x in zip(factors, numbers, strict=True))


def spiral(count):
    """Unit directions of a golden spiral, all of one weight."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, math.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)


def vectors(v):
    return arrays().Array3f(*(column(arrays().Float, v[:, k].astype(np.float32)) for k in range(3)))


@pytest.mark.by_night("0.0")
@pytest.mark.parametrize("clearness", [0.0, 0.5])
def test_higher_orders_of_full_agree_with_random_walks(clearness):
    """2 % of all light: clear light ahead is sharper than the second order holds."""
    one = matter("cylinder", clearness, alpha=0.5 / math.pi, beta=0.05)
    scene = scene_of(one, 3.0)
    solved, walked = (
        hg.render(scene, hg.Settings(samples=4, walks=0), mode="full"),
        hg.render(scene, hg.Settings(samples=400), mode="path"),
    )
    first = len(walked.palette.colours) - len(walked.palette.bands)
    higher = walked.weights[..., first:].mean(axis=-1).sum()
    everything = walked.weights[..., :first].sum() + higher
    assert abs(solved.weights[..., first].sum() - higher) < 0.02 * everything and higher > 0.2 * everything


@pytest.mark.parametrize("gamma", [0.2, 1.2])
def test_draws_of_white_clear_fibres_weigh_one(gamma):
    """The furnace of a walk's step: n = 1 reflects nothing. 4 standard errors and 1e-3."""
    one = matter("cylinder", 0.7, n=1.0, gamma=gamma)
    _, sent = drawn(one, 200_000)
    whole = sent.sum(axis=0)
    assert abs(whole.mean() - 1.0) < 4.0 * whole.std() / math.sqrt(whole.size) + 1e-3


@pytest.mark.parametrize(("element", "clearness"), [("plane", 0.0), ("cylinder", 0.0), ("cylinder", 0.6)])
def test_a_furnace_of_white_matter_that_transmits_looks_like_nothing(element, clearness):
    """All orders by path, in light that is the same all around: 3.3 standard errors, of 1e-3 or so. n = 1 reflects
    nothing; a sheet is white on both sides.
    """
    sky = hg.Environment(np.ones((4, 8)), 2.0, visible=True)
    scene = replace(scene_of(matter(element, clearness, n=1.0), 3.0, size=12), lamps=(), environment=sky)
    image = hg.render(scene, hg.Settings(samples=400), mode="path")
    assert image.variance is not None
    error = math.sqrt(float(image.variance.mean()) / image.variance.size)
    first = len(image.palette.colours) - len(image.palette.bands)
    seen = image.weights[..., :first].sum(axis=-1) + image.weights[..., first:].mean(axis=-1)
    assert error < 4e-3 and image.alpha.mean() > 0.1
    assert abs(seen.mean() - 2.0) < 3.3 * error
