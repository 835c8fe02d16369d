"""Laws of flights through matter: where light collides, what of it passes, and which element it meets.

The oracle is the optical depth of the same voxels in NumPy, double precision. Significance 0.1 %, fixed seeds.
"""

import math
from typing import Any

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.transport.medium import Medium
from hagoromo.transport.path.free_flight import Matter, first_collision, transmittance
from hagoromo.transport.path.majorants import largest_densities
from hagoromo.transport.path.path import random_numbers
from tests.judges import mean_is, sampler_follows_density
from tests.oracle.photons import area

SIDE, VOXELS = 0.2, 18  # [m], of the box: three bricks along an edge, the middle one empty
START, WAY = np.array([-0.05, 0.03, 0.06]), np.array([0.86, 0.42, 0.29]) / math.sqrt(0.86**2 + 0.42**2 + 0.29**2)
DRAWS, CELLS = 40_000, 30
AXIS = np.array([0.36, -0.48, 0.8])


def densities(seed):
    """Densities that halves hold exactly, 0 amid the box: [z, y, x]."""
    density = np.random.default_rng(seed).integers(0, 65, (VOXELS,) * 3) / 64.0
    density[:, :, 7:13] = 0.0
    return density


def box_of(density, depth, element):
    material = hg.Reflectance(0.2, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element=element)
    axes = np.broadcast_to(AXIS, (*density.shape, 3))
    return hg.VolumeBox.from_arrays(density, axes, SIDE / VOXELS, depth / SIDE, [material], extinction="projected")


def optical_depth(boxes, distances):
    """∫σ from START to distances [m] along WAY: the middle rule, 0.01 mm a step."""
    step = 1e-5
    t = np.arange(0.0, distances.max() + step, step) + 0.5 * step
    sigma = np.zeros(t.size)
    for density, depth, element in boxes:
        place = (START + t[:, None] * WAY) / (SIDE / VOXELS) - 0.5
        inside = ((place > -0.5) & (place < VOXELS - 0.5)).all(axis=1)
        low = np.clip(np.floor(place).astype(int), 0, VOXELS - 2)
        share = np.clip(place - low, 0.0, 1.0)
        trilinear = np.zeros(t.size)
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (low + corner).T
            weight = np.prod(np.where(corner, share, 1.0 - share), axis=1)
            trilinear += weight * density[z, y, x]
        sigma += inside * trilinear * depth / SIDE * float(area(element, np.array([AXIS @ WAY]))[0])
    return np.interp(distances, np.append(0.0, t + 0.5 * step), np.append(0.0, np.cumsum(sigma) * step))


def rays(count):
    jit = arrays()
    lane = dr.arange(jit.UInt, count)
    origin, way = (dr.zeros(jit.Array3f, count) + jit.Array3f(*v.tolist()) for v in (START, WAY))
    return origin, way, random_numbers(lane, dr.zeros(jit.UInt, count), 5)


BOXES: dict[str, list[Any]] = {element: [(densities(1), 8.0, element)] for element in ELEMENTS}
SPARSE = densities(1) * (np.random.default_rng(3).random((VOXELS,) * 3) < 0.08)  # deep bricks, most of them empty
BOXES["deep bricks"] = [(SPARSE, 60.0, "cylinder")]
BOXES["two that overlap"] = [(densities(1), 4.0, "sphere"), (densities(2), 6.0, "cylinder")]


def test_majorants_of_parts_hold_the_densities_in_them():
    """Bounds of 2³ voxels and the layer behind: never less, and more by a step of their shares at most."""
    box = box_of(SPARSE, 120.0, "sphere")
    densest, shares = largest_densities(box.bricks)
    place = {tuple(corner): number for number, corner in enumerate(box.bricks.places)}
    used = 0
    for z, y, x in np.ndindex(VOXELS // 2, VOXELS // 2, VOXELS // 2):
        held = SPARSE[2 * z : 2 * z + 3, 2 * y : 2 * y + 3, 2 * x : 2 * x + 3].max()
        brick = place.get((z // 4, y // 4, x // 4))
        if brick is None:
            assert held == 0.0
            continue
        bound = densest[brick] * shares[brick].reshape(4, 4, 4)[z % 4, y % 4, x % 4] / 255.0
        assert held * (1.0 - 1e-6) <= bound <= held + densest[brick] / 255.0
        used += held > 0.0
    assert used > 100


@pytest.mark.parametrize("boxes", BOXES.values(), ids=BOXES)
def test_flights_end_by_the_optical_depth(boxes):
    """χ² of the distances over cells of equal chance, and of the flights that meet nothing."""
    matter = Matter(Medium([box_of(*each) for each in boxes]))
    origin, way, random = rays(DRAWS)
    found, _ = first_collision(matter, origin, way, dr.full(arrays().Float, dr.inf, DRAWS), random)
    distance = np.array(found.distance, float)
    free = math.exp(-optical_depth(boxes, np.array([1.0]))[0])
    assert 0.02 < free < 0.5
    hit = np.isfinite(distance)
    chance = 1.0 - np.exp(-optical_depth(boxes, np.where(hit, distance, 0.0)))
    edges = np.linspace(0.0, 1.0 - free, CELLS + 1)
    counts = np.append(np.histogram(chance[hit], np.append(edges[:-1], 1.0))[0], (~hit).sum())
    expected = DRAWS * np.append(np.full(CELLS, (1.0 - free) / CELLS), free)
    assert sampler_follows_density(counts, expected)


@pytest.mark.parametrize("boxes", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize("far", [0.12, 1.0])
def test_what_passes_is_the_exponential_of_the_optical_depth(boxes, far):
    """The mean over draws, to a lamp amid the matter and behind it: t-test, 1 %."""
    matter = Matter(Medium([box_of(*each) for each in boxes]))
    origin, way, random = rays(DRAWS)
    jit = arrays()
    passed, _ = transmittance(matter, origin, way, jit.Float(far), dr.full(jit.Bool, True, DRAWS), random)
    draws, truth = np.array(passed, float), math.exp(-optical_depth(boxes, np.array([far]))[0])
    assert mean_is(draws, truth) and draws.std() / math.sqrt(DRAWS) < 0.01 * truth
