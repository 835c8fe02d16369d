"""Photographs of a vase before a dim wall, under twelve far lamps in two rings."""

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
