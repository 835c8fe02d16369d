"""Builds: matter that is made part by part is what it is made at once, in little memory beside the result."""

import tracemalloc

import numpy as np
import pytest

from hagoromo.transport import texel_pools
from hagoromo.transport.textures import Textures
from hagoromo.volume.texel import Texel
from hagoromo_matter.hair import fibres
from hagoromo_matter.hair.fibres import Curves, fibre_blocks
from hagoromo_matter.texel import texel_levels
from hagoromo_matter.texel.texel_levels import Nodes, levels_of

RANDOM = np.random.default_rng(4)


def nodes(cells: tuple[int, int, int], populations: int = 2, variants: int = 3) -> Nodes:
    """Random axes and densities, 0 for two fifths, in cells along u, v and height."""
    shape = cells[1], variants * cells[0], cells[2] + 1
    density = RANDOM.random(shape) * (RANDOM.random(shape) > 0.4)
    axis = RANDOM.normal(size=(*shape, 3)) / 2.0
    population = RANDOM.integers(0, populations, shape).astype(np.uint8)
    return Nodes(density.astype(np.float32), axis.astype(np.float32), population, populations, variants)


def steps(one: np.ndarray, other: np.ndarray) -> int:
    """The largest distance of two arrays of halves, in steps between neighbouring halves of a sign."""
    ways = [np.where(a.view(np.int16) < 0, -(a.view(np.int16) & 0x7FFF), a.view(np.int16)) for a in (one, other)]
    return int(np.abs(ways[0].astype(int) - ways[1]).max(initial=0))


def test_levels_of_a_texel_do_not_depend_on_how_many_nodes_are_averaged_at_once(monkeypatch):
    """The finest one to the bit. Means are sums by BLAS, whose order may depend on sizes: to a step between halves."""
    made = nodes((37, 53, 11))
    whole = levels_of(made)
    monkeypatch.setattr(texel_levels, "NODES_AT_ONCE", 4000)
    parts = levels_of(made)
    assert len(whole) == len(parts) == 6
    for level, (one, other) in enumerate(zip(whole, parts, strict=True)):
        assert steps(one.density, other.density) <= (level > 0)
        matter = one.density > 0.01  # axes of next to nothing are those of rounding
        assert steps(one.axis[matter], other.axis[matter]) <= 8 * (level > 0)


def test_the_mean_of_a_level_is_that_of_the_finest_one():
    """Of every population, over whole periods of all variants: halves round to 5e-4, and errors average."""
    made = nodes((40, 32, 8))
    for k in range(2):
        means = [
            np.average(level.density[k, :-1, :-1].astype(float).mean(axis=(0, 1)), weights=ends(level.nodes[2]))
            for level in levels_of(made)
        ]
        assert means == pytest.approx([means[0]] * len(means), rel=2e-4)


def ends(heights: int) -> np.ndarray:
    """Weights of heights: half of the cells around the first and the last is beyond the ends."""
    weights = np.ones(heights)
    weights[[0, -1]] = 0.5
    return weights


def test_levels_take_little_more_memory_than_they_have(monkeypatch):
    """Peak of what NumPy takes: all levels, and moments (40 bytes) of three eighths of the nodes of a population."""
    monkeypatch.setattr(texel_levels, "NODES_AT_ONCE", 1 << 12)
    made = nodes((160, 160, 15), variants=2)
    tracemalloc.start()
    levels = levels_of(made)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    held = sum(level.density.nbytes + level.axis.nbytes for level in levels)
    assert peak < held + 3.0 * 40.0 * made.density.size / 8, (peak, held)


def test_pools_of_textures_do_not_depend_on_how_many_rows_are_packed_at_once(monkeypatch):
    levels = levels_of(nodes((20, 31, 5)))
    texel = Texel((1e-3, 2e-3), 0.0, 1e-3, 3, levels)
    pools = []
    for count in (1 << 20, 900):
        monkeypatch.setattr(texel_pools, "NODES_AT_ONCE", count)
        made = Textures([(texel, (0.0, 1e-3), 1.0)], kept=False)
        pools.append((np.array(made.densities_pool), np.array(made.axes_pool)))
    assert all(np.array_equal(one, other) for one, other in zip(*pools, strict=True))
    halves = np.concatenate([level.density.ravel() for level in levels])
    low = np.concatenate([own(pools[0][0], levels, k) for k in range(len(levels))])
    assert np.array_equal(low, halves) and len(pools[0][1]) == halves.size


def own(pool: np.ndarray, levels: tuple, number: int) -> np.ndarray:
    """Densities of the populations of a level in the pool, without those of all together."""
    sizes = [level.density.size // 2 * 3 for level in levels]
    level = pool[sum(sizes[:number]) : sum(sizes[: number + 1])]
    return (level[sizes[number] // 3 :] & 0xFFFF).astype(np.uint16).view(np.float16)


def some_curves() -> Curves:
    """Forty fibres of two diameters, thinner and thicker than a voxel of 0.2 mm, all over a few hundred bricks."""
    points = np.cumsum(RANDOM.normal(size=(40, 9, 3)), axis=1).reshape(-1, 3) * 1.5
    return Curves(points, np.arange(0, 361, 9), np.repeat([0.05, 0.7], 180))


def test_fibres_do_not_depend_on_how_many_bricks_are_summed_up_at_once(monkeypatch):
    """Bit by bit: a voxel gets its pieces in the same order."""
    curves = some_curves()
    whole = fibre_blocks(curves, 0.2)[0].bricks(1)
    monkeypatch.setattr(fibres, "BRICKS_AT_ONCE", 7)
    parts = fibre_blocks(curves, 0.2)[0].bricks(1)
    assert whole.kept > 100 and np.array_equal(whole.places, parts.places)
    for name, values in whole.read(0, whole.kept).items():
        assert np.array_equal(values, parts.read(0, parts.kept)[name]), name


@pytest.mark.nightly
def test_fibres_take_little_more_memory_than_their_voxels(monkeypatch):
    """Peak of what NumPy takes while they are summed up: 16 bytes a voxel, and what the pieces and some bricks need."""
    monkeypatch.setattr(fibres, "BRICKS_AT_ONCE", 64)
    monkeypatch.setattr(fibres, "POINTS_AT_ONCE", 1 << 12)
    curves = some_curves()
    peaks = []
    for voxel in (0.2, 0.1):
        tracemalloc.start()
        made, _ = fibre_blocks(curves, voxel)
        peaks.append(tracemalloc.get_traced_memory()[1] / (16.0 * 512 * made.bricks(1).kept))
        tracemalloc.stop()
    assert peaks[1] < 1.5, peaks
