"""Derivatives of mode full by the colours of matter: differences of pictures, and products with each sweep and its
transpose.
"""

import math

import numpy as np
import pytest

import hagoromo as hg
import hagoromo.image.full.gradient as full_gradient
import hagoromo.image.full.picture as full_picture
import hagoromo.transport.field.solve as solve
from hagoromo.backend import arrays, lookup
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.image.scene.scene_palette import reflectances_of
from hagoromo.transport.field.adjoint import fitted_back
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.fit import fitted
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.field.sent_back import incident_back
from hagoromo.transport.field.sweep import Ways, sweep
from hagoromo.transport.field.swept_back import by_incident, swept_back
from hagoromo.transport.path.bands import Bands

SIDE, CELL = 6, 1 / 6
STEP = 0.05  # the field is kept as halves, which smaller differences of pictures show
SETTINGS = hg.Settings(samples=1, walks=0)
SLOPE = hg.Spectrum([360.0, 830.0], [0.95, 0.35])


@pytest.fixture(autouse=True)
def coarse_and_settled(monkeypatch):
    """Cells of the width of a voxel, the same bands for all colours, and sweeps until nothing changes."""
    for module in (full_picture, full_gradient):
        monkeypatch.setattr(module, "cell_size", lambda boxes, channels: CELL)
        monkeypatch.setattr(module, "bands_of_scene", lambda scene, lamps: Bands(np.array([450.0, 600.0]), 0.0))
    monkeypatch.setattr(solve, "RESIDUAL", 1e-6)


def constant(value):
    return hg.Spectrum.constant(value)


def scene_of(first, second, lamps):
    """A cube of spheres, and beside it one of cylinders with an interface."""
    spheres = hg.Reflectance(0.95 / math.pi, 0.0, 0.3, 1.5, first, element="sphere")
    hairs = hg.Reflectance(0.25, 0.4, 0.35, 1.5, second, element="cylinder")
    axes, boxes = np.broadcast_to((0.36, -0.48, 0.8), (SIDE,) * 3 + (3,)), []
    for material, tau, place in ((spheres, 6.0, (0.0, 0.0, 0.0)), (hairs, 5.0, (0.5, 0.0, 0.9))):
        pose = np.eye(4)
        pose[:3, 3] = place
        density = np.linspace(0.5, 1.0, SIDE**3).reshape(axes.shape[:3])
        boxes.append(
            hg.VolumeBox.from_arrays(density, axes, 1 / SIDE, tau, [material], extinction="projected", pose=pose)
        )
    camera = hg.Camera(6, 5, (7.0, 7.0), (3.0, 2.5)).look_at((1.7, -2.2, 1.6), (0.6, 0.5, 0.9))
    return hg.Scene(camera, lamps, tuple(boxes))


LAMPS = (hg.Lamp(to_lamp=(0.48, -0.6, 0.64)), hg.Lamp(to_lamp=(-0.6, -0.64, 0.48), spectrum=SLOPE))


def scaled(spectrum, change):
    return hg.Spectrum(spectrum.wavelengths, spectrum.values * (1.0 + change))


def loss(scene, weights):
    return float((weights * hg.render(scene, SETTINGS, mode="full").weights).sum(dtype=float))


def difference(of, step):
    """The derivative at 0, by central differences over two steps: their errors of the second order cancel."""
    near, far = ((of(h) - of(-h)) / (2.0 * h) for h in (step, 2.0 * step))
    return (4.0 * near - far) / 3.0


@pytest.mark.nightly
def test_the_gradient_by_body_colours_is_the_difference_of_pictures():
    """Two boxes that light each other under lamps of two spectra, in two bands, a picture of weights: 1e-3 for the
    change of each body's spectrum; and linear in the picture.
    """
    second = hg.Spectrum([360.0, 830.0], [0.5, 0.7])
    scene = scene_of(SLOPE, second, LAMPS)
    image = hg.render(scene, SETTINGS, mode="full")
    weights = np.random.default_rng(1).random((2, *image.weights.shape))
    gradient = hg.full_gradient(scene, weights[0], SETTINGS)
    assert gradient.values.shape == (3, 2) and gradient.colours == image.palette.colours[:3]
    by_scale = [colour.at(gradient.wavelengths) @ gradient.values[k] for k, colour in enumerate((SLOPE, second))]
    by_first = difference(lambda h: loss(scene_of(scaled(SLOPE, h), second, LAMPS), weights[0]), STEP)
    by_second = difference(lambda h: loss(scene_of(SLOPE, scaled(second, h), LAMPS), weights[0]), STEP)
    np.testing.assert_allclose(by_scale, [by_first, by_second], rtol=1e-3)
    weights[1, ..., [3, 8]] = 0.0  # nothing of the first band
    other, both = (hg.full_gradient(scene, w, SETTINGS).values for w in (weights[1], weights[0] + 2.0 * weights[1]))
    assert (other[:, 0] == 0.0).all() and (other[:, 1] > 0.0).all()
    np.testing.assert_allclose(both, gradient.values + 2.0 * other, rtol=2e-5)


def test_each_step_and_its_transpose_agree():
    """⟨y, A x⟩ = ⟨Aᵀ y, x⟩ of sweeps, scattering and the fit, of random light."""
    scene = scene_of(constant(0.8), constant(0.6), LAMPS[:1])
    prepared = PreparedScene(scene, SETTINGS, SceneCache())
    assert prepared.medium is not None
    colours = BandColours(Bands(np.array([500.0]), 0.0), prepared.palette)
    solver = solve.Solver(prepared.medium, prepared.lighting, colours, ScatteringTables(reflectances_of(scene)), CELL)
    cells, kept, random = solver.cells, solver.stored, np.random.default_rng(3)

    def numbers(count):
        return [[lookup(arrays().Float, random.random(count, np.float32) - 0.3) for _ in range(9)]]

    def product(a, b):
        return sum(float(np.dot(np.array(x, float), np.array(y, float))) for x, y in zip(a[0], b[0], strict=True))

    def agree(y, ax, aty, x):
        size = math.sqrt(product(y, y) * product(ax, ax))
        assert abs(product(y, ax) - product(aty, x)) < 3e-6 * size and abs(product(y, ax)) > 1e-3 * size

    of_cells, more, sent, stored = *(numbers(cells.filled) for _ in range(3)), numbers(kept.count)
    scattering = solver.samples, solver.scattering
    agree(of_cells, solver.again(more), incident_back(*scattering, of_cells, 1), more)
    agree(stored, fitted(kept, cells, more)[0], fitted_back(kept, cells, stored), more)
    ways = Ways(solver.samples, cells, random)
    agree(of_cells, sweep(ways, sent)[0], swept_back(ways, by_incident(ways, of_cells), 1), sent)


def test_what_has_no_gradient_is_refused():
    scene = scene_of(constant(0.8), constant(0.6), LAMPS[:1])
    ball = hg.Surface.sphere((0.0, 0.0, 3.0), 0.1, hg.Reflectance(0.1, 0.0, 0.3, 1.5, constant(0.5)))
    with pytest.raises(hg.InputError, match="by_weights of shape"):
        hg.full_gradient(scene, np.ones((5, 6, 7)))
    with pytest.raises(hg.InputError, match="no number"):
        hg.full_gradient(scene, "much")
    with pytest.raises(hg.InputError, match="a cut is for mode march"):
        hg.full_gradient(scene, np.ones((5, 6, 4)), hg.Settings(cut=(0.0, 0.0, 1.0, 0.0)))
    with pytest.raises(hg.InputError, match="without surfaces"):
        hg.full_gradient(hg.Scene(scene.camera, scene.lamps, scene.boxes, (ball,)), np.ones((5, 6, 4)))
    with pytest.raises(hg.InputError, match="orders is 3"):
        hg.full_gradient(scene, np.ones((5, 6, 4)), hg.Settings(orders=3))
