"""Bodies that are black, or hidden by their highlight: α = 0, and an interval up to what photographs allow."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.material_objective import expected
from hagoromo.measurement.material.uncertainty import values_at
from hagoromo.measurement.parameters import pack_theta
from hagoromo.measurement.sight import sight_of

SIZE, AWAY, ASIDE = 25, 2.0, 0.8  # pixels and m
FULL_WELL, READ_NOISE = 40_000.0, 4.0  # electrons
BETA = 0.5


def tile(body, gamma, side, lamps, seed=0):
    """A flat tile of `side` m, the first lamp mirrored in its middle; lamps: how far each is off that [m]."""
    focal, pixel = SIZE * AWAY / side, side / SIZE
    camera = hg.Camera(SIZE, SIZE, (focal, focal), (SIZE / 2, SIZE / 2))
    camera = camera.look_at((-ASIDE, 0.0, AWAY), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    row, column = (np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2) * pixel
    points = np.stack([column, -row, 0.0 * row], axis=2)
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    random, everywhere, photographs = np.random.default_rng(seed), np.ones((SIZE, SIZE), bool), []
    for off in lamps:
        lamp = hg.Lamp(position=(ASIDE + off, 0.0, AWAY), intensity=1.0)
        dark = np.zeros((SIZE, SIZE, 3), np.float32)
        blank = hg.Photograph(dark, dark + 1.0, everywhere, camera, (lamp,), "tile")
        seen = sight_of(blank, points.reshape(-1, 3), normals.reshape(-1, 3).astype(float))
        clean = expected(seen, pack_theta(body * np.array([1.2, 1.0, 0.8]), BETA, gamma, 1.5)).reshape(SIZE, SIZE, 3)
        scale = clean.max() / (0.9 * FULL_WELL)
        electrons = random.poisson(clean / scale) + READ_NOISE * random.standard_normal(clean.shape)
        variance = (np.maximum(electrons, 0.0) + READ_NOISE**2) * scale**2
        photographs.append(hg.Photograph(electrons * scale, variance, everywhere, camera, (lamp,), f"lamp {off}"))
    return hg.Capture(tuple(photographs), "tile", points=points.astype(np.float32), normals=normals.astype(np.float32))


def measured(*tile_of):
    labels = np.zeros((SIZE, SIZE), int)
    return measure_known_shape(tile(*tile_of), labels=labels, n=1.5).materials[0]


@pytest.mark.parametrize("seed", range(3))
def test_a_black_body_is_measured(seed):
    """Its α came out below 0 with every other seed of the noise, and the tile was refused."""
    found = measured(0.0, 0.3, 0.2, (0.0, 0.4), seed)
    assert 0.0 <= found.alpha < 3e-4 and found.interval_95["alpha"][0] == 0.0 and found.interval_95["alpha"][1] < 5e-4
    assert found.interval_95["beta"][0] <= BETA <= found.interval_95["beta"][1]
    assert found.gamma == pytest.approx(0.3, rel=0.01) and found.identifiable["gamma"]
    assert min(found.body_colour) >= 0.0


@pytest.mark.by_night(
    "0.1-0.3-0.2-1", "0.1-0.3-0.2-2", "0.01-0.1-0.2-1", "0.01-0.1-0.2-2", "0.01-0.6-1.0-1", "0.01-0.6-1.0-2"
)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("body", "gamma", "side"), [(0.01, 0.1, 0.2), (0.01, 0.6, 1.0), (0.1, 0.3, 0.2)])
def test_a_body_hidden_by_its_highlight_is_bounded(body, gamma, side, seed):
    """The highlight covers the tile, so that a broader and stronger one and less body look alike: α −0.07 … 0.01.

    Of the widest the best fit is a faint lobe of another width, whose own errors left the truth out: α 0.120 … 0.123.
    """
    found = measured(body, gamma, side, (0.0,), seed)
    assert found.alpha >= 0.0
    for key, true in (("alpha", body), ("beta", BETA), ("gamma", gamma)):
        low, high = found.interval_95[key]
        assert low <= true <= high
    dark = min(found.body_colour) <= 0.0
    assert dark == any("reflects nothing" in remark and "lamp is farther" in remark for remark in found.remarks)
    assert not (dark and found.identifiable["alpha"])


@pytest.mark.by_night("1")
@pytest.mark.parametrize("seed", range(2))
def test_an_interval_ends_where_a_body_comes_to_its_limit(seed):
    """Under a free index: χ² is flat until the body is black and rises steeply from there, between two points of the
    profile. The interval of β began at 0.536 with the first seed.
    """
    found = measure_known_shape(tile(0.0, 0.3, 0.2, (0.0, 0.4), seed), labels=np.zeros((SIZE, SIZE), int)).materials[0]
    for key, true in (("beta", BETA), ("n", 1.5), ("gamma", 0.3)):
        low, high = found.interval_95[key]
        assert low <= true <= high


def test_another_lamp_shows_a_body_hidden_by_its_highlight():
    found = measured(0.01, 0.1, 0.2, (0.0, 0.4))
    assert found.identifiable["alpha"] and found.alpha == pytest.approx(0.01, rel=0.05)


def test_a_body_of_nothing_has_no_colour():
    found = values_at(pack_theta(np.zeros(3), 0.5, 0.1, 1.5))
    assert found["alpha"] == 0.0 and found["body_colour"] == (1.0, 1.0, 1.0)
