"""Grooves a few pixels wide, seen by pixels that average them: deeper than integrated, and in their band."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo.measurement.surface.depth import surface_from_normals

SIZE, RAYS, PITCH, FOCAL = 48, 9, 1e-4, 1e5  # px, along a pixel's side, m, px
CAMERA = hg.Camera(SIZE, SIZE, (FOCAL, FOCAL), (SIZE / 2, SIZE / 2)).look_at(
    (0.0, 0.0, FOCAL * PITCH), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)
)
REACH, DRAWS = 16.0, 6  # px of a line to each side of the groove; of noise
PLACES = ((0.0, 0.0), (0.2, 0.3), (np.pi / 8, 0.0), (np.pi / 4, 0.4))  # angle of a groove, and place in its pixel


def across(x, y, angle, off):
    """Distance from the middle of the groove [px]."""
    return np.cos(angle) * x + np.sin(angle) * y - off


def groove(away, width, slope):
    """Height [px] and its slope: a Gaussian of this full width at half of its depth [px], and greatest slope."""
    reach = width / (2.0 * np.sqrt(np.log(2.0)))
    depth = slope * reach * np.sqrt(np.e / 2.0)
    height = -depth * np.exp(-((away / reach) ** 2))
    return height, -2.0 * away / reach**2 * height


def seen_normals(width, slope, angle, off):
    """(h, w, 3) means over each pixel, as a matt body shows them under lamps all around."""
    row, column = (np.mgrid[: SIZE * RAYS, : SIZE * RAYS] + 0.5) / RAYS - SIZE / 2
    rise = groove(across(column, -row, angle, off), width, slope)[1]
    normals = np.stack([-np.cos(angle) * rise, -np.sin(angle) * rise, np.ones_like(rise)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    mean = normals.reshape(SIZE, RAYS, SIZE, RAYS, 3).mean(axis=(1, 3))
    return mean / np.linalg.norm(mean, axis=2, keepdims=True)


def profiles(width, slope, noise):
    """Errors of heights in the groove [px], as integrated and as stated, and whether the band holds them."""
    random, every = np.random.default_rng(0), np.ones((SIZE, SIZE), bool)
    own, plain, found, held = np.full(every.shape, 2.0 * noise**2), [], [], []
    for angle, off in PLACES:
        clean, along = seen_normals(width, slope, angle, off), np.array([np.cos(angle), -np.sin(angle)])
        for _ in range(DRAWS):
            normals = clean + noise * random.normal(size=clean.shape)
            normals /= np.linalg.norm(normals, axis=2, keepdims=True)
            points = surface_from_normals(normals, CAMERA, FOCAL * PITCH, own, draws=0).points
            seen = SeenSurface(CAMERA, every, points, normals, None, None, own, own, None, True)
            middle = SIZE / 2 + random.uniform(-3.0, 3.0) * along[::-1] * (-1.0, 1.0)
            ends = middle - REACH * along, middle + REACH * along
            before, after = hg.profile(seen, *ends), hg.profile(seen.sharpened(), *ends)
            away = across(after.image[:, 0] - SIZE / 2, SIZE / 2 - after.image[:, 1], angle, off)
            true, share = groove(away, width, slope)[0], np.linspace(0.0, 1.0, len(away))
            true = true - (1.0 - share) * true[0] - share * true[-1]
            inside = (np.abs(away) < 1.5 * width) & (after.error > 0.0)
            plain.append((before.height / (1e3 * PITCH) - true)[inside])
            found.append((after.height / (1e3 * PITCH) - true)[inside])
            held.append((np.abs(after.height - 1e3 * PITCH * true) <= NORMAL_95 * after.error)[inside])
    root = [float(np.sqrt(np.mean(np.concatenate(one) ** 2))) for one in (plain, found)]
    return *root, float(np.mean(np.concatenate(held)))


@pytest.mark.by_night("0.002-3.0")
@pytest.mark.parametrize("width", [2.0, 3.0, pytest.param(4.0, marks=pytest.mark.nightly),
                                   pytest.param(6.0, marks=pytest.mark.nightly),
                                   pytest.param(10.0, marks=pytest.mark.nightly)])  # fmt: skip
@pytest.mark.parametrize("noise", [0.002, pytest.param(0.01, marks=pytest.mark.nightly)])
def test_the_band_holds_grooves_of_a_few_pixels(width, noise):
    """Nine tenths of the heights and more, 85 % at two pixels, the least that shows a groove; without the width of
    the pixels in it, 13 to 25 % at the lesser noise. The error is less than as integrated, or noise.
    """
    plain, found, held = profiles(width, 0.3, noise)
    assert held > (0.9 if width > 2.0 else 0.85)
    assert found < 0.85 * plain or found < 2.0 * noise


@pytest.mark.nightly
@pytest.mark.parametrize("width", [2.0, 3.0, 4.0, 6.0, 10.0])
def test_the_band_of_steep_grooves(width):
    """Slopes up to 45°: parts that face away are seen least, which no band knows; four fifths and more."""
    plain, found, held = profiles(width, 1.0, 0.002)
    assert held > 0.8 and found < 0.9 * plain
