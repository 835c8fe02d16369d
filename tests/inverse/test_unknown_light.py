"""Recovery under light that nobody measured: what it is fixed to, and cameras that all look a little aside."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo_recovery.descent.pixel_table import UNLIT_ERROR, PixelTable
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.recovered import score
from hagoromo_recovery.shading.unknown_light import BANDS, TERMS, UnknownLight, harmonics, within_bounds
from studies.recover_scenes import Shots, TrueObject, around, simulated

SETTINGS = hg.RecoverySettings(side=32, steps=60, rays=1 << 13, keep=8)
ASIDE = 2.0  # px by which principal points are wrong
SEED = 4


def unlit(lamp_of):
    """24 views of an object under one lamp for each, of which no photograph says anything."""
    views = around(24, turn=0.3)
    lamps = [np.asarray(lamp_of(view), float)[None] for view in views]
    taken = simulated(TrueObject(beta=0.0, flat=True), Shots(views, lamps, 64), SEED)
    return hg.Capture(tuple(replace(p, lamps=()) for p in taken.capture.photographs), "unlit")


def beside_the_camera(view):
    """A lamp 40° above the eye."""
    up = np.array([0.0, 0.0, 1.0]) - view[2] * view
    up /= np.linalg.norm(up)
    return 0.5 * (np.cos(np.radians(40.0)) * view + np.sin(np.radians(40.0)) * up)


@pytest.fixture(scope="module")
def moving():
    return unlit(beside_the_camera)


@pytest.fixture(scope="module")
def standing():
    return unlit(lambda view: (0.3, 0.2, 0.35))


def mean_psnr(found):
    return np.mean([each.psnr for each in found.scores()])


def test_harmonics_are_orthonormal_over_all_directions():
    normals = around(4096, 1) / 1.0
    z = 1.0 - 2.0 * (np.arange(4096) + 0.5) / 4096  # evenly, the poles too
    r = np.sqrt(1.0 - z * z)
    angle = np.arctan2(normals[:, 1], normals[:, 0])
    jit = arrays()
    terms = harmonics(jit.Array3f(*(jit.Float(x) for x in (r * np.cos(angle), r * np.sin(angle), z))))
    table = np.stack([np.array(t) for t in terms])
    assert np.allclose(table @ table.T / 4096, np.eye(TERMS), atol=5e-3)


def test_bounds_of_light_are_reached_by_one_far_lamp_and_hold_for_others():
    """Over evenly spread normals: irradiance by one far lamp, scaled to a mean of 1, and by many."""
    random, jit = np.random.default_rng(9), arrays()
    normals = random.normal(size=(3, 200_000))
    normals /= np.linalg.norm(normals, axis=0)
    terms = np.stack([np.array(t) for t in harmonics(jit.Array3f(*(jit.Float(x) for x in normals)))])
    for lamps in (1, 5):
        ways = random.normal(size=(lamps, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        light = np.maximum(ways @ normals, 0.0).sum(axis=0)
        numbers = np.repeat((terms @ (light / light.mean()) / light.size)[:, None], 3, axis=1)
        lengths = np.array([np.linalg.norm(numbers[rows, 0]) / most for rows, most in BANDS])
        assert (lengths < 1.02).all() and (lamps > 1 or (lengths > 0.98).all())
        assert np.allclose(within_bounds(numbers), numbers, rtol=0.0, atol=0.03)
    wild = within_bounds(1e6 * np.ones((TERMS, 3)))
    assert np.allclose(wild[0], 1.0) and np.allclose(np.linalg.norm(wild[1:4], axis=0), BANDS[0][1])


def test_light_that_is_fixed_to_the_camera_turns_with_it(moving):
    photographs, jit = moving.photographs, arrays()
    numbers = np.zeros((TERMS, 3))
    numbers[0], numbers[2] = 1.0, -0.3  # brighter from above: the y axis of cameras points down
    light = UnknownLight("camera", photographs, numbers)
    for k in (0, 5):
        normal = -photographs[k].camera.world_to_camera[1, :3]  # up in that photograph
        found = light.irradiance(jit.UInt([k, k]), jit.Array3f(*(jit.Float([float(x)] * 2) for x in normal)))
        assert np.allclose(np.array(found[0]), 1.0 + 0.3 * np.sqrt(3.0), rtol=1e-5)
        assert dr.width(found) == 2


@pytest.mark.nightly
def test_light_that_moves_with_the_camera_is_found_and_predicts_better(moving):
    found = hg.recover(moving, SETTINGS)
    assert found.look.unknown is not None and found.look.unknown.frame == "camera"
    assert found.record()["lamps"].startswith("unknown, fixed to the camera")
    assert max(found.look.tried, key=lambda kind: found.look.tried[kind]) == "camera"
    assert mean_psnr(found) > mean_psnr(hg.recover(moving, replace(SETTINGS, light="even"))) + 3.0  # dB


@pytest.mark.nightly
def test_light_that_stands_still_is_not_taken_for_one_that_moves(standing):
    found = hg.recover(standing, SETTINGS)
    assert found.look.unknown is None or found.look.unknown.frame == "object"
    assert found.look.tried["object"] > found.look.tried["camera"]


def looking_aside(capture, right, down):
    """A capture whose principal points are stated wrong [px]."""
    moved = []
    for p in capture.photographs:
        x, y = p.camera.principal
        moved.append(replace(p, camera=replace(p.camera, principal=(x + right, y + down))))
    return hg.Capture(tuple(moved), "aside")


@pytest.mark.nightly
def test_cameras_that_all_look_aside_are_turned_and_those_kept_aside_with_them(standing):
    aside, given = looking_aside(standing, ASIDE, 0.0), replace(SETTINGS, light="even")
    found, stated = hg.recover(aside, given), hg.recover(aside, replace(given, refine="none"))
    assert stated.look.cameras is None and found.look.cameras is not None
    assert found.look.cameras.values[0][1] / found.look.cameras.pixel == pytest.approx(ASIDE, abs=0.4)  # px
    assert mean_psnr(found) > mean_psnr(stated) + 1.0  # dB


@pytest.mark.nightly
def test_cameras_that_all_look_up_are_turned_though_a_shift_of_the_object_shows_nearly_the_same(standing):
    """Most cameras look from the side: the object may follow a turn upwards that is wrong."""
    found = hg.recover(looking_aside(standing, 0.0, ASIDE), replace(SETTINGS, light="even", refine="turn"))
    assert found.look.cameras is not None
    assert found.look.cameras.values[0][0] / found.look.cameras.pixel == pytest.approx(-ASIDE, abs=0.4)  # px


@pytest.mark.nightly
def test_exact_cameras_stay(standing):
    found = hg.recover(standing, replace(SETTINGS, light="even", refine="turn"))
    assert found.look.cameras is not None
    assert np.abs(found.look.cameras.values[0][:2] / found.look.cameras.pixel).max() < 0.4  # px


def test_without_lamps_dark_and_bright_pixels_count_alike(standing):
    """By one error of the model, of the size of the light, where their noise is nothing beside it."""
    p = standing.photographs[0]
    view = ObjectView(replace(p, variance=np.full_like(p.variance, 1e-12)), p.silhouette)
    pixels = PixelTable([view], Lattice.around(np.full(3, -0.06), np.full(3, 0.06), 32), 0.01, 0.5)
    weights = np.array(pixels.table[8])
    assert np.allclose(weights[weights > 0.0], (UNLIT_ERROR * 0.5) ** -2)
    assert (weights > 0.0).sum() > 100


def test_a_lattice_shrinks_to_the_surface_and_not_beyond_the_old_one():
    old = Lattice(np.array([0.1, 0.2, 0.3]), 0.01, (23, 29, 31))
    distance = np.full(old.shape, 9.0)
    distance[8:12, 10:15, 1:20] = -1.0
    new = old.around_surface(distance, 41)
    assert max(new.shape) == 41
    low, high = old.from_world(new.corner), old.from_world(new.high)
    assert np.allclose(low, (0.0, 7.0, 5.0), atol=0.6) and np.allclose(high, (22.0, 17.0, 14.0), atol=0.6)


def test_what_is_beside_a_stated_silhouette_counts_as_black(standing):
    photograph = standing.photographs[0]
    light = np.where(photograph.silhouette[..., None], photograph.values, 0.0)
    bright = replace(photograph, values=np.where(photograph.silhouette[..., None], photograph.values, np.float32(0.5)))
    assert score(bright, bright.silhouette, light).psnr > 100.0


@pytest.mark.parametrize(("key", "value"), [("light", "sun"), ("refine", "lens")])
def test_unknown_words_end_in_one_line(key, value):
    with pytest.raises(hg.InputError, match=f"{key} is {value!r}: give"):
        hg.RecoverySettings(**{key: value})
