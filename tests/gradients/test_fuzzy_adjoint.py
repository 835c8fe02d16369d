"""The adjoint of the march through a free density of fibres, shadows included, against central differences."""

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays, evaluate
from hagoromo.reflectance.element import element_weights
from hagoromo_recovery.field.density_field import DensityField
from hagoromo_recovery.field.fuzzy_march import FuzzyMarch
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.matter_march import LatticeRays
from hagoromo_recovery.fuzzy_shape import clearest_way_out
from tests.gradients.march_loss import add_gradients, column, loss

SHAPE, RAYS = (17, 18, 19), 300
STEP = 1e-2  # of central differences: less shows the rounding of the march in single precision


class OneLamp:
    """A far lamp."""

    each = 1

    def arriving(self, photograph, lamp, place):
        to_lamp = dr.normalize(arrays().Array3f(0.5, -1.0, 0.7)) + 0.0 * place
        return to_lamp, arrays().Float(1e6), [1.0, 1.0, 1.0]


class Fibres:
    """Light of one far lamp on fibres."""

    channels, lamps, photograph = COLOURS, OneLamp(), None

    def __call__(self, place, axis, to_eye, colours):
        to_lamp, _, _ = self.lamps.arriving(None, 0, place)
        weights = element_weights("cylinder", axis, to_lamp, to_eye, 0.3, 0.5, 0.4, 1.5)
        return [weights.body * colour + weights.interface for colour in colours]


def ball():
    """A soft ball in tufts: extinctions, unit axes, of which none points to the eye, colours of nodes, and reach."""
    z, y, x = np.meshgrid(*[np.arange(n) - 0.5 * (n - 1) for n in SHAPE], indexing="ij")
    r = np.sqrt(x * x + y * y + z * z)
    density = 0.35 / (1.0 + np.exp(1.5 * (r - 5.0))) * (1.2 + np.sin(1.1 * x) * np.cos(0.9 * z + y))
    axes = np.stack([1.2 + 0.5 * np.sin(0.5 * y), 0.6 * np.sin(0.6 * x), 0.8 + 0.4 * np.cos(0.5 * z)], axis=3)
    axes /= np.linalg.norm(axes, axis=3, keepdims=True)
    colours = 0.5 + 0.2 * np.sin(0.4 * np.stack([x + z, y, z - y], axis=3))
    return density, axes, colours, r - 8.0


@pytest.fixture(scope="module")
def scene():
    """The ball, rays that meet it, and the derivative of a loss by its light."""
    random, jit = np.random.default_rng(3), arrays()
    field = DensityField(*ball())
    with pytest.MonkeyPatch.context() as patch:  # what is left out is less, so that differences do not jump with it
        patch.setattr(FuzzyMarch, "share_of", lambda march, piece: 0.5)  # its derivative is that of held places
        patch.setattr("hagoromo_recovery.field.fuzzy_march.LEAST_DEPTH", 1e-7)
        for march in ("fuzzy_march", "matter_march"):
            patch.setattr(f"hagoromo_recovery.field.{march}.LAST_DEPTH", 14.0)
        aside = random.uniform(-6.0, 6.0, (2, RAYS)) + 8.5
        origin = jit.Array3f(column(aside[0]), column(np.full(RAYS, 1.6)), column(aside[1]))
        way = jit.Array3f(column(random.normal(0, 0.1, RAYS)), column(np.ones(RAYS)), column(np.zeros(RAYS)))
        rays = LatticeRays(origin, dr.normalize(way), column(np.zeros(RAYS)), column(np.full(RAYS, 15.0)))
        weights = [column(random.normal(size=RAYS) + 0.5) for _ in range(COLOURS)]
        march = field.march(Fibres(), 1.0, True)
        evaluate(rays, weights)
        yield field, march, rays, weights


@pytest.fixture(scope="module")
def gradient(scene):
    field, march, rays, weights = scene
    add_gradients(field, march, rays, weights)
    return {name: np.array(getattr(field, f"by_{name}"), np.float64) for name in ("density", "axes", "colours")}


@pytest.mark.parametrize("name", ["density", "axes", "colours"])
def test_it_is_that_of_central_differences(scene, gradient, name):
    """To 1 % of what the parts of the sum amount to, for rough changes and for an even one."""
    field, march, rays, weights = scene
    random, old = np.random.default_rng(5), getattr(field, name)
    count = dr.width(old)
    scales = np.array(old) if name == "density" else np.ones(count)  # none becomes negative
    for change in scales * np.stack([np.ones(count), *random.normal(size=(3, count))]):
        losses = []
        for move in (STEP, -STEP):
            new = old + column(move * change)
            dr.eval(new)
            setattr(field, name, new)
            losses.append(loss(march, rays, weights))
        setattr(field, name, old)
        found = (losses[0] - losses[1]) / (2.0 * STEP)
        scale = max(abs(found), np.linalg.norm(gradient[name] * change))
        assert abs(gradient[name] @ change - found) < 0.01 * scale


def test_optical_depth_is_that_of_quadrature(scene):
    """Of a trilinear density along rays, by a fine midpoint rule: steps of less than a voxel are near enough."""
    field, march, rays, _ = scene
    with dr.suspend_grad():
        found = -np.log(np.array(march.transmittance(rays), np.float64))
        fine = np.zeros(RAYS)
        for t in (np.arange(1500) + 0.5) / 100.0:
            fine += np.array(field.value_at(rays.at(float(t))), np.float64) / 100.0
    assert np.abs(found - fine).max() < 0.02 * fine.max()


def test_the_clearest_way_out_is_straight_along_a_neighbour():
    """Of a homogeneous block the nearest side; the trapezoidal rule has half of the first node."""
    density = np.zeros((11, 12, 13))
    density[2:9, 2:10, 2:11] = 0.4
    depth = clearest_way_out(density)
    assert depth[5, 5, 6] == pytest.approx(0.4 * 3.5)  # from node 5 to 2, and half a step
    assert depth[0, 0, 0] == 0.0 and depth.argmax() == np.ravel_multi_index((5, 5, 5), density.shape)
