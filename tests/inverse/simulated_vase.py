"""Photographs of a vase before a dim wall, under twelve far lamps in two rings, and what goes wrong in taking them."""

from dataclasses import replace

import numpy as np

import hagoromo as hg
from tests.inverse.simulated_ball import BallMaterial, reflected

SIZE, LAMPS = 200, 12
FOCAL, PIXEL = 1e5, 5e-4  # px and m: seen from afar
ELECTRONS, CLIPPED = 6e4, 6e4  # per unit of light, and from which a pixel is clipped
WALL = 0.02


def vase(gloss=0.8, seed=0, size=SIZE):
    """The capture of unknown shape, and its true normals (h, w, 3); the camera's axes are the world's, z to the eye."""
    random = np.random.default_rng(seed)
    row, column = (np.mgrid[:size, :size] + 0.5) / (size / 2) - 1.0
    radius, slope = 0.55 + 0.2 * np.sin(2.6 * row + 0.5), 0.52 * np.cos(2.6 * row + 0.5)
    inside = (np.abs(column) < 0.97 * radius) & (np.abs(row) < 0.85)
    height = np.sqrt(np.maximum(radius**2 - column**2, 1e-6))
    normals = np.stack([column / height, radius * slope / height, np.ones_like(row)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    glaze = 1.0 + 0.25 * np.sin(40 * column) * np.sin(33 * row) + 0.1 * random.standard_normal((size, size))
    camera = hg.Camera(size, size, (FOCAL, FOCAL), (size / 2, size / 2)).look_at(
        (0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)
    )
    truth, photographs = BallMaterial((0.25, 0.2, 0.15), max(gloss, 1e-6), 0.15, 1.5), []
    for number in range(LAMPS):
        tilt, turn = np.radians(28.0 if number % 2 else 50.0), 2 * np.pi * number / LAMPS
        lamp = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        eye = np.broadcast_to([0.0, 0.0, 1.0], normals.shape)
        light = reflected(normals, np.broadcast_to(lamp, normals.shape), eye, truth) * glaze[..., None]
        wall = WALL * lamp[2] * (1.0 + 0.05 * random.standard_normal((size, size, 1)))
        counted = random.poisson(np.where(inside[..., None], np.maximum(light, 0.0), np.maximum(wall, 0.0)) * ELECTRONS)
        values, clipped = counted / ELECTRONS, (counted > CLIPPED).any(axis=2)
        photographs.append(
            hg.Photograph(values, (counted + 100.0) / ELECTRONS**2, inside & ~clipped, camera,
                          (hg.Lamp(to_lamp=lamp, intensity=1.0),), f"p{number}")
        )  # fmt: skip
    return hg.Capture(tuple(photographs), "vase"), np.where(inside[..., None], normals, 0.0)


def under(capture, order):
    """The capture whose k-th photograph is said to be lit by lamp order[k]."""
    lamps = [shot.lamps for shot in capture.photographs]
    return _each(capture, lambda k, shot: replace(shot, lamps=lamps[order[k]]))


def exchanged(capture, a=2, b=5):
    """Two photographs with one another's lamps."""
    order = np.arange(len(capture.photographs))
    order[[a, b]] = b, a
    return under(capture, order)


def turned(capture, number=3, degrees=5.0, seed=0):
    """One lamp that is stated some degrees off, and where it is."""
    (lamp,) = capture.photographs[number].lamps
    across = np.cross(lamp.to_lamp, np.random.default_rng(seed).standard_normal(3))
    across /= np.linalg.norm(across)
    angle = np.radians(degrees)
    towards = np.cos(angle) * lamp.to_lamp + np.sin(angle) * np.cross(across, lamp.to_lamp)
    return with_shot(capture, number, lambda shot: replace(shot, lamps=(replace(lamp, to_lamp=towards),))), lamp.to_lamp


def uneven(capture, spread=0.4, seed=1):
    """Lamps of different strengths, which nobody states."""
    factor = np.exp(spread * np.random.default_rng(seed).standard_normal(len(capture.photographs)))
    return _each(capture, lambda k, s: replace(s, values=s.values * factor[k], variance=s.variance * factor[k] ** 2))


def coded(capture, power=1.0 / 2.2):
    """Values that follow light to a power."""
    top = max(float(np.nanmax(shot.values)) for shot in capture.photographs)
    return _each(capture, lambda k, s: replace(s, values=top * np.maximum(s.values / top, 0.0) ** power))


def twice(capture, number=4):
    """A photograph in place of the one after it."""
    before = capture.photographs[number - 1]
    return with_shot(capture, number, lambda shot: replace(before, lamps=shot.lamps, name=shot.name))


def moved(capture, number=4, across=0.5):
    """A photograph that is shifted to the right [px]."""
    from scipy.ndimage import shift

    return with_shot(capture, number, lambda s: replace(s, values=shift(s.values, (0, across, 0), mode="nearest")))


def blurred(capture, number=4, width=2.0):
    """A photograph that is out of focus, by a Gaussian [px]."""
    from scipy.ndimage import gaussian_filter

    return with_shot(capture, number, lambda s: replace(s, values=gaussian_filter(s.values, (width, width, 0))))


def masked(capture, by=5):
    """A mask that is so many pixels too large (below 0: too small)."""
    from scipy.ndimage import binary_dilation, binary_erosion, binary_fill_holes

    own = np.asarray(binary_fill_holes(np.mean([shot.mask for shot in capture.photographs], axis=0) > 0.5))
    other = binary_dilation(own, iterations=by) if by > 0 else binary_erosion(own, iterations=-by)
    return _each(capture, lambda k, shot: replace(shot, mask=np.asarray(other)))


def with_shot(capture, number, change):
    """The capture with one photograph changed."""
    return _each(capture, lambda k, shot: change(shot) if k == number else shot)


def _each(capture, change):
    return replace(capture, photographs=tuple(change(k, shot) for k, shot in enumerate(capture.photographs)))
