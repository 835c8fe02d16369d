"""Errors of solved normals: what is a pixel's own, what all share, and that both together hold the truth."""

import numpy as np
import pytest
from scipy.stats import f

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.measurement.error_files import SharedErrors, read_shared_errors, write_errors
from hagoromo.measurement.normals.normal_errors import blocks_of
from hagoromo.measurement.normals.pixel_errors import PixelErrors, footprint
from hagoromo.measurement.normals.views import Views, views_from_capture
from hagoromo.measurement.surface.depth import surface_from_normals
from studies.errors_of_normals import _row, _solved
from studies.faulty_balls import CONDITIONS, faulty_ball, lamp_directions

SIZE = 44  # px


def seen(lamps: int) -> Views:
    return views_from_capture(faulty_ball(CONDITIONS["noise"], lamps, seed=0, size=11).capture)


def sphere(size: int, radius: float) -> np.ndarray:
    rows, columns = np.mgrid[:size, :size] + 0.5
    x, y = (columns - size / 2.0) / radius, (size / 2.0 - rows) / radius
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    return np.where(z[..., None] > 0.0, np.stack([x, y, z], axis=2), 0.0)


@pytest.mark.parametrize(("lamps", "size", "freedom"), [(4, 1, 3.0), (5, 1, 4.0), (8, 2, 4.5), (12, 2, 7.5)])
def test_blocks_are_a_lamp_and_those_nearest_to_it(lamps, size, freedom):
    views = seen(lamps)
    blocks, found = blocks_of(views)
    assert found == freedom
    assert len(blocks) == lamps
    cosine = lamp_directions(lamps) @ lamp_directions(lamps).T
    for k, block in enumerate(blocks):
        assert len(block) == size
        assert k in block
        others = np.setdiff1d(np.arange(lamps), block)
        assert cosine[k, block].min() >= cosine[k, others].max() - 1e-9


def test_a_plane_has_no_footprint_and_a_ball_has_that_of_its_curvature():
    plane = np.broadcast_to([0.0, 0.6, 0.8], (7, 5, 3))
    inner = footprint(plane)[:, 1:-1, 1:-1]
    assert np.abs(inner).max() < 1e-20
    radius, size = 60.0, 131
    edges, curved = footprint(sphere(size, radius))
    middle = size // 2
    # N = (x, y, z): z has ∂²z/∂x² = −(1 − y²) / z³ and ∂²z/∂y² = −(1 − x²) / z³ in radii; the tangential part of a
    # vector along z is its √(1 − z²), and the mean over a pixel is off by 1/24 of their sum
    column, normal = middle + 30, sphere(size, radius)
    x, y, z = normal[middle, column]
    bend = (2.0 - y * y - x * x) / z**3 * np.sqrt(1.0 - z * z) / radius**2
    np.testing.assert_allclose(np.linalg.norm(curved[middle, column]), bend / 24.0, rtol=5e-3)  # of a pixel's width
    # at the edge: the mean square of ¼ px × a uniform number, times the change of the normal per pixel
    edge = np.flatnonzero(np.linalg.norm(normal[middle], axis=1) > 0.5)[-1]
    change = np.sum((normal[middle, edge] - normal[middle, edge - 1]) ** 2)
    # the part of it that turns the normal is √(1 − change/4) of its length
    found = np.sum(edges[middle, edge] ** 2)
    np.testing.assert_allclose(found, change * (1.0 - change / 4.0) / 48.0, rtol=1e-9)


def test_modes_that_hold_nearly_all_keep_the_whole_variance():
    random = np.random.default_rng(0)
    few = random.normal(size=(3, 50, 3))
    modes = np.concatenate([few, 1e-3 * random.normal(size=(8, 50, 3))])
    bodies = random.normal(size=(11, 2, 50))
    errors = PixelErrors(np.ones(50), modes, np.zeros(50), np.ones((2, 50)), bodies, np.zeros((2, 50, 3)))
    kept = errors.leading()
    assert len(kept.modes) == 3
    np.testing.assert_allclose(kept.own + kept.shared, errors.own + errors.shared, rtol=1e-12)
    np.testing.assert_allclose(kept.body_variance, errors.body_variance, rtol=1e-12)


def test_a_shared_turn_of_all_normals_tilts_the_surface():
    size, focal, distance, angle = 24, 1000.0, 2.0, 1e-3
    camera = hg.Camera(size, size, (focal, focal), (size / 2, size / 2))
    camera = camera.look_at((0.0, 0.0, distance), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    normals = np.zeros((size, size, 3))
    normals[..., 2] = 1.0
    turn = np.zeros((1, size, size, 3))
    turn[0, ..., 0] = angle  # a plane z = −angle · x
    surface = surface_from_normals(normals, camera, distance, np.full((size, size), 1e-12), modes=turn)
    x = (np.arange(size) + 0.5 - size / 2) / focal * distance
    assert surface.modes is not None
    # perspective: second order in x / distance
    np.testing.assert_allclose(surface.modes[0], np.tile(angle * x, (size, 1)), atol=2e-2 * angle * x.max())
    np.testing.assert_allclose(surface.variance, surface.modes[0] ** 2, atol=1e-9)


def test_shared_errors_hold_for_means_and_read_back(tmp_path):
    random = np.random.default_rng(1)
    parts = (random.normal(size=size).astype(np.float32) for size in ((2, 5, 7, 3), (2, 5, 7)))
    shared = SharedErrors(*parts)
    whole = tuple(one + 0.5 for one in shared.variances)
    write_errors(tmp_path, (whole[0], whole[1]), shared)
    layers, _ = read_exr(tmp_path / "variance.exr")
    np.testing.assert_allclose(layers["own.normal"], 0.5, rtol=1e-5)
    np.testing.assert_allclose(layers["own.distance"], 0.5, rtol=1e-5)
    loaded = read_shared_errors(tmp_path / "shared_errors.exr", (5, 7))
    assert loaded is not None
    np.testing.assert_array_equal(loaded.normals, shared.normals)
    one = np.zeros((5, 7))
    one[2, 3] = 4.0
    found = loaded.variance_of_mean(one)
    np.testing.assert_allclose(found, [part[2, 3] for part in shared.variances], rtol=1e-5)
    with pytest.raises(InputError, match="size"):
        read_shared_errors(tmp_path / "shared_errors.exr", (7, 5))
    write_exr(tmp_path / "shared_errors.exr", {"other": one})
    with pytest.raises(InputError, match="channels"):
        read_shared_errors(tmp_path / "shared_errors.exr", (5, 7))


def test_lamps_that_are_off_are_in_the_errors_of_normals():
    ball = faulty_ball(CONDITIONS["lamps"], lamps=8, seed=1, size=SIZE)
    pixels = _solved(ball.capture, ball)[0]
    inside = pixels["radius"] < 0.95
    square = (pixels["turns"][inside] ** 2).sum(axis=1)
    by_own, by_all = (np.mean(square / pixels[name][inside]) for name in ("own", "variance"))
    # five modes, whose variance has 4.5 degrees of freedom: once in a hundred balls their ratio is larger by chance
    largest = f.ppf(0.99, 5, blocks_of(views_from_capture(ball.capture))[1])
    assert by_all < largest < by_own


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["noise", "lamps"])
def test_stated_errors_hold_over_many_balls(name):
    found = []
    for seed in range(8):
        ball = faulty_ball(CONDITIONS[name], lamps=12, seed=seed, size=SIZE)
        pixels = _solved(ball.capture, ball)[0]
        inside = pixels["radius"] < 0.95
        found.append(_row({key: one[inside] for key, one in pixels.items()}))
    total = np.array([row["total"] for row in found])
    assert 0.91 <= total.mean()
    assert 0.5 < np.sqrt(np.mean([row["ratio"] ** 2 for row in found])) < 1.2  # neither short nor of no use
