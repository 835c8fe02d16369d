"""Sums over walks: their noise is what is promised, also where few walks bring most of the light."""

import math

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import name
from hagoromo.image.settings import Settings
from hagoromo.image.sums_channels import channels_of_sums, sums_of_channels
from hagoromo.image.walk_sums import COVERED, TILE, Stop, WalkSums
from hagoromo.image.walked import Walked
from hagoromo.transport.palette import Palette

WHITE = hg.Spectrum.constant(1.0)
SIDE = 40  # px; more than two tiles, the last ones cut off


def sums_of_picture():
    palette = Palette((WHITE,), (), ()).with_lamps([hg.Lamp(to_lamp=(0, 0, 1))])
    return WalkSums(SIDE, SIDE, palette, WHITE)


def even(random, mean, count):
    return mean[:, None] * random.exponential(size=(len(mean), count))


def wide(random, mean, count):
    """Log-normal with a standard deviation of 2.5 times the mean."""
    sigma = math.sqrt(math.log(1.0 + 2.5**2))
    return mean[:, None] * random.lognormal(-0.5 * sigma**2, sigma, (len(mean), count))


def fireflies(random, mean, count):
    """Half of the light in one of 400 walks."""
    bright = random.random((len(mean), count)) < 1.0 / 400.0
    return mean[:, None] * (0.5 * random.exponential(size=bright.shape) + 200.0 * bright)


def picture(draw, seed, error):
    """A picture of a ramp with one dark tile by `draw`: its error, and walks a pixel on each side."""
    random, sums = np.random.default_rng(seed), sums_of_picture()
    truth = np.linspace(0.2, 1.8, SIDE**2).reshape(SIDE, SIDE).T
    truth[:TILE, :TILE] *= 0.01
    stop = Stop(Settings(error=error), 1.0)
    while stop.goes_on(sums):
        for pixels, count in sums.launches(1 << 16):
            values = draw(random, truth.ravel()[pixels], count)
            sums.add(pixels, Walked.of(np.stack([values, np.ones_like(values)], axis=-1).astype(np.float32)), count)
    seen = sums.mean()[0][..., 0]
    off = np.sqrt(np.mean((seen - truth) ** 2)) / truth.mean()
    return off, seen.mean() / truth.mean(), sums.walks.reshape(SIDE, SIDE)


@pytest.mark.parametrize(("draw", "error"), [(even, 0.1), (wide, 0.1), (fireflies, 0.3)])
def test_the_error_that_was_asked_for_is_met(draw, error):
    """In 9 of 10 pictures at least; and walks are not wasted: the root mean square is above 70 % of it.

    The mean of all pictures is the truth to three of its standard errors.
    """
    results = [picture(draw, seed, error) for seed in range(40)]
    off, mean = (np.array([r[k] for r in results]) for k in (0, 1))
    assert (off <= error).mean() >= 0.9
    assert math.sqrt(np.mean(off**2)) > 0.7 * error
    assert abs(mean.mean() - 1.0) < 3.0 * mean.std() / math.sqrt(len(mean))


def outlines():
    """Coverage of a disk with a soft rim, down to nothing."""
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE / 2 + 0.5
    return np.clip(13.3 - np.hypot(x, y), 0.0, 1.0) ** 2


def barbs():
    """Coverage of thin threads, each with a faint edge that most walks miss."""
    x = np.broadcast_to(np.arange(SIDE) % 5, (SIDE, SIDE))
    cover = np.where(x < 1, 0.5, np.where(x < 2, 0.02, 0.0))
    cover[:, :8] = cover[:5] = 0.0
    return cover


def rim_picture(cover, draw, seed, error):
    """A picture of matter that walks hit by chance: its error where there is matter, and its mean over the truth."""
    random, sums, chance = np.random.default_rng(seed), sums_of_picture(), cover.ravel()
    stop = Stop(Settings(error=error), 1.0)
    while stop.goes_on(sums):
        for pixels, count in sums.launches(1 << 16):
            hit = random.random((len(pixels), count)) < chance[pixels, None]
            values = hit * draw(random, np.ones(len(pixels)), count)
            sums.add(pixels, Walked.of(np.stack([values, hit], axis=-1).astype(np.float32)), count)
    seen, matter = sums.mean()[0][..., 0].ravel(), chance > 0.0
    off = np.sqrt(np.mean((seen - chance)[matter] ** 2)) / chance[matter].mean()
    return off, seen[matter].mean() / chance[matter].mean()


@pytest.mark.parametrize(("cover", "draw", "error"), [(outlines, even, 0.1), (barbs, even, 0.2), (barbs, wide, 0.3)])
def test_the_error_is_met_where_first_walks_miss_the_matter(cover, draw, error):
    """In 19 of 20 pictures: pixels that 16 walks have missed get walks, and a part of the error.

    Of the sums of before, which left such pixels out, no picture of the barbs held, and their mean was 3 % low. Walks
    by the noise that was found cost a bias of 0.2 % still; it is held below 1 %.
    """
    results = np.array([rim_picture(cover(), draw, seed, error) for seed in range(20)])
    assert (results[:, 0] <= error).sum() >= 19
    assert abs(results[:, 1].mean() - 1.0) < 0.01


def test_walks_go_where_the_noise_is():
    _, _, walks = picture(even, 3, 0.03)
    dark, dull, bright = walks[:TILE, :TILE], walks[2 * TILE :, :TILE], walks[:, 2 * TILE :]
    assert dark.mean() < 0.7 * dull.mean() and dull.mean() < 0.7 * bright.mean()


def test_sums_are_the_same_bits_as_channels_of_a_file():
    """Of single-precision numbers of all sizes, added in double precision."""
    random = np.random.default_rng(8)
    values = (random.random((2, 3, 4, 5, 50)) * 10.0 ** random.uniform(-42, 30, (2, 3, 4, 5, 50))).astype(np.float32)
    sums = values.sum(axis=-1, dtype=np.float64)
    channels = channels_of_sums(sums)
    assert {c.dtype for c in channels.values()} == {np.dtype(np.float32)}
    assert np.array_equal(sums_of_channels(channels), sums)  # type: ignore[arg-type]
    assert sums_of_channels({"R": values[0, ..., 0, 0]}) is None
    channels.popitem()
    with pytest.raises(ValueError, match="are missing"):
        sums_of_channels(channels)


@pytest.mark.parametrize(("pixels", "walks", "channels"), [(1, 1, 1), (1, 7, 3), (5, 3, 1), (5, 4, 11)])
def test_sums_are_those_of_numpy_walk_by_walk(pixels, walks, channels):
    """In double precision, as NumPy adds them; single pixels, walks and channels, too. On the CPU the same bits."""
    random = np.random.default_rng(4)
    values = random.lognormal(0.0, 3.0, (pixels, walks, channels + 1)).astype(np.float32)
    sums, luminance = random.random((pixels, channels + 2)), random.random(channels)
    wanted, y = sums.copy(), np.zeros((pixels, walks))
    for k in range(channels):
        y += values[..., k].astype(np.float64) * luminance[k]
    for walk in range(walks):
        wanted[:, :-1] += values[:, walk]
        wanted[:, -1] += np.square(y[:, walk].astype(np.float32))
    found = Walked.of(values).added(sums, luminance, walks)
    if name() == "llvm":
        assert np.array_equal(found, wanted)
    np.testing.assert_allclose(found, wanted, rtol=2e-7)  # on a GPU products and sums of Y may be joined


def test_an_interrupt_finds_whole_rows():
    """A launch is in the table with all its numbers or none."""
    sums = sums_of_picture()
    sums.want(2)
    for pixels, count in sums.launches(700):
        before = sums.table.copy()
        sums.add(pixels, Walked.of(np.ones((len(pixels), count, 2), np.float32)), count)
        changed = (sums.table != before).any(axis=1)
        assert set(np.flatnonzero(changed)) == set(pixels)
        assert (sums.table[changed][:, [0, COVERED]] == sums.walks[changed][:, None]).all()
    assert (sums.walks == 2).all()
