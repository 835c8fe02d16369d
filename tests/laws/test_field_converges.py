"""Mode full comes to mode path as cells are refined.

Noise is that of the walks, from the variance that path states; the margin is three of its deviations.
"""

import math

import numpy as np

import hagoromo as hg
import hagoromo.image.full.picture as full

WHITE = hg.Spectrum.constant(1.0)
SPHERES = hg.Reflectance(0.9 / math.pi, 0.0, 0.3, 1.5, WHITE, element="sphere")


def cube_scene(depth, size=8):
    """A cube of 12 voxels, 1 m wide, of matte spheres of albedo 0.9, `depth` mean free paths wide."""
    axes = np.broadcast_to((0.0, 0.0, 1.0), (12, 12, 12, 3))
    box = hg.VolumeBox.from_arrays(np.ones((12,) * 3), axes, 1 / 12, 2.0 * depth, [SPHERES], extinction="projected")
    camera = hg.Camera(size, size, (1.6 * size, 1.6 * size), (size / 2, size / 2))
    camera = camera.look_at((1.7, -2.2, 1.6), (0.5, 0.5, 0.5))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.48, -0.6, 0.64)),), (box,))


def light_of(image):
    """All light of a grey picture."""
    return float(image.weights[..., :2].sum() + image.weights[..., 2:].mean(axis=-1).sum())


def walked(scene, walks):
    """The light by random walks, and one deviation of its noise."""
    image = hg.render(scene, hg.Settings(samples=walks), mode="path")
    assert image.variance is not None
    return light_of(image), math.sqrt(float(image.variance.sum()))


def solved(scene, edge, monkeypatch):
    monkeypatch.setattr(full, "cell_size", lambda boxes, channels: edge)
    return light_of(hg.render(scene, hg.Settings(samples=4, walks=0), mode="full"))


def test_finer_cells_come_to_random_walks(monkeypatch):
    """A cube of 6 mean free paths in cells of 3, 1.5 and 0.5 of them: the last to 1 % of all light."""
    scene = cube_scene(6.0)
    truth, noise = walked(scene, 4000)
    errors = [abs(solved(scene, 1 / across, monkeypatch) / truth - 1.0) for across in (2, 4, 12)]
    margin = 3.0 * noise / truth
    assert errors[1] < errors[0] + margin and errors[2] < errors[1] + margin and errors[2] < 0.5 * errors[0]
    assert errors[2] < 0.01 + margin and margin < 0.01
