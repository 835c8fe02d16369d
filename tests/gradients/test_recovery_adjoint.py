"""The adjoint of the march through a signed distance, against central differences."""

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, evaluate
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.matter_march import LatticeRays
from hagoromo_recovery.field.surface_march import SurfaceMarch, depth_between, share_of
from hagoromo_recovery.field.surface_moves import BENDING, EIKONAL, smoothness_slope
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.shading import NodeShading, coordinates, faded, two_glosses
from hagoromo_recovery.shading.unknown_light import TERMS, UnknownLight
from tests.gradients.march_loss import add_gradients, column, loss

SIDE, RAYS = 20, 400
STEPS = (1e-3, 2.5e-4)  # [voxel], or of a colour, of central differences; their mean is less rough where splines join


class Glossy:
    """Light of one far lamp."""

    channels = COLOURS

    def __call__(self, place, normal, to_eye, colours):
        to_lamp = dr.normalize(arrays().Array3f(0.4, -1.0, 0.6))
        weights = torrance_sparrow(normal, to_lamp, to_eye, 0.3, 0.5, 0.3, 1.5)
        fade = faded(dr.dot(normal, to_eye))
        return [fade * (weights.body * colour + weights.interface) for colour in colours]


class Smooth:
    """Light that nobody measured, a polynomial of the normal in the axes of a camera that looks along y."""

    channels = COLOURS

    def __init__(self):
        pose = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 5.0], [0.0, 0.0, 0.0, 1.0]])
        camera = hg.Camera(1, 1, (1.0, 1.0), (0.5, 0.5)).with_pose(pose)
        dark = np.zeros((1, 1, 3), np.float32)
        numbers = np.random.default_rng(8).normal(0.0, 0.08, (TERMS, COLOURS))
        numbers[0] = 1.0
        photograph = hg.Photograph(dark, dark + 1.0, np.ones((1, 1), bool), camera)
        self.light = UnknownLight("camera", [photograph], numbers)

    def __call__(self, place, normal, to_eye, colours):
        irradiance = self.light.irradiance(arrays().UInt(0), normal)
        return [e * colour for e, colour in zip(irradiance, colours, strict=True)]


def two():
    """Light of one near lamp on places that have shares of two glosses."""
    camera = hg.Camera(1, 1, (1.0, 1.0), (0.5, 0.5))
    dark, lamp = np.zeros((1, 1, 3), np.float32), hg.Lamp(position=(22.0, -30.0, 25.0), intensity=1500.0)
    photograph = hg.Photograph(dark, dark + 1.0, np.ones((1, 1), bool), camera, (lamp,))
    lamps = LampTable([photograph], Lattice(np.zeros(3), 1.0, (SIDE,) * 3))
    return NodeShading(lamps, two_glosses(coordinates(3.0, 0.3, 1.5)))


@pytest.fixture(scope="module", autouse=True)
def even_steps():
    """Steps go by the field, and derivatives are those of held steps: here they are the same for every field.

    What is left out, thin pieces and the end of a ray, is less, so that a difference does not jump with it.
    """
    march = "hagoromo_recovery.field.matter_march"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hagoromo_recovery.field.surface_march.step_length", lambda distance, inverse: 0.7)
        patch.setattr(f"{march}.LEAST_DEPTH", 1e-7)
        patch.setattr(f"{march}.LAST_DEPTH", 14.0)
        yield


@pytest.fixture(scope="module", params=[Glossy, Smooth, two], ids=["a lamp", "unknown light", "two glosses"])
def scene(request):
    """A bumpy ball, rays that meet it or pass it by, and the derivative of a loss by its light."""
    random, jit = np.random.default_rng(3), arrays()
    z, y, x = np.meshgrid(*[np.arange(SIDE) - 0.5 * (SIDE - 1)] * 3, indexing="ij")
    distance = np.sqrt(x * x + y * y + z * z) - 5.5 + 0.4 * np.sin(0.9 * x) * np.cos(0.8 * z)
    colours = 0.5 + 0.2 * np.sin(0.4 * np.stack([x + z, y, z - y], axis=3))
    shares = 0.5 + 0.4 * np.sin(0.5 * x - 0.4 * z) if request.param is two else None
    field = DistanceField(distance, colours, shares)
    aside = random.uniform(-7.0, 7.0, (2, RAYS)) + 0.5 * (SIDE - 1)
    origin = jit.Array3f(column(aside[0]), column(np.full(RAYS, 1.6)), column(aside[1]))
    direction = dr.normalize(
        jit.Array3f(column(random.normal(0, 0.05, RAYS)), column(np.ones(RAYS)), column(np.zeros(RAYS)))
    )
    rays = LatticeRays(origin, direction, column(np.zeros(RAYS)), column(np.full(RAYS, 16.0)))
    weights = [column(random.normal(size=RAYS)) for _ in range(COLOURS)]
    march = SurfaceMarch(field, dr.opaque(jit.Float, 1.0 / 0.5), request.param())
    evaluate(rays, weights)
    return field, march, rays, weights


@pytest.fixture(scope="module")
def gradient(scene):
    """By distances and by colours."""
    field, march, rays, weights = scene
    add_gradients(field, march, rays, weights)
    return np.array(field.by_distance, np.float64), np.array(field.by_colours, np.float64)


def differences(scene, by_distance, by_colours):
    """Central difference of the loss for a change of the field."""
    field, march, rays, weights = scene
    old, slopes = (field.distance, field.colours), []
    for step in STEPS:
        losses = []
        for move in (step, -step):
            field.distance = old[0] + column(move * by_distance)
            field.colours = old[1] + column(move * by_colours)
            dr.eval(field.distance, field.colours)
            losses.append(loss(march, rays, weights))
        slopes.append((losses[0] - losses[1]) / (2.0 * step))
    field.distance, field.colours = old
    return float(np.mean(slopes))


def test_by_distances_it_is_that_of_central_differences(scene, gradient):
    """To 1 % of what the parts of the sum amount to, for rough changes and for an even one."""
    random, count = np.random.default_rng(5), SIDE**3
    for change in (np.ones(count), *random.normal(size=(4, count))):
        found = differences(scene, change, np.zeros(count * COLOURS))
        scale = max(abs(found), np.linalg.norm(gradient[0] * change))
        assert abs(gradient[0] @ change - found) < 0.01 * scale


def test_by_colours_it_is_that_of_central_differences(scene, gradient):
    change = np.random.default_rng(6).normal(size=SIDE**3 * COLOURS)
    found = differences(scene, np.zeros(SIDE**3), change)
    assert gradient[1] @ change == pytest.approx(
        found, rel=2e-3, abs=1e-3 * float(np.linalg.norm(gradient[1] * change))
    )


def test_a_gradient_of_twice_the_weights_is_twice_as_large(scene, gradient):
    field, march, rays, weights = scene
    field.no_gradients()
    with dr.suspend_grad():
        seen = march.seen(rays)
        march.adjoint(rays, seen, [2.0 * w for w in weights], -0.6 * dr.exp(-seen.depth))
    assert np.allclose(np.array(field.by_distance), 2.0 * gradient[0], atol=1e-4 * np.abs(gradient[0]).max())


def test_optical_depth_and_mean_place_are_those_of_quadrature():
    """σ = (1/s)(1 − Φ(d/s)) over a piece in which d falls evenly, by the midpoint rule in double precision."""
    for first, second, s in ((2.0, -1.0, 0.5), (0.4, 0.1, 0.3), (5.0, 0.2, 0.7), (-0.2, -0.8, 0.4)):
        t = (np.arange(200_000) + 0.5) / 200_000
        d = first + (second - first) * t
        sigma = (first - second) / s * (1.0 - 1.0 / (1.0 + np.exp(-d / s)))
        depth = np.cumsum(sigma) / t.size
        weight = sigma * np.exp(-depth)
        jit = arrays()
        piece = depth_between(jit.Float(first), jit.Float(second), jit.Float(1.0 / s))
        share = share_of(jit.Float(first), jit.Float(second), jit.Float(1.0 / s))
        assert piece[0] == pytest.approx(depth[-1], rel=2e-4)
        assert share[0] == pytest.approx(np.average(t, weights=weight), abs=2e-3)


def test_what_leaves_a_surface_is_not_in_its_own_way(scene):
    """LatticeRays from the surface outwards, to a lamp say, pass wholly."""
    _, march, _, _ = scene
    jit, middle = arrays(), 0.5 * (SIDE - 1)
    way = np.random.default_rng(7).normal(size=(3, 200))
    way /= np.linalg.norm(way, axis=0)
    start = middle + way * 5.6
    direction, origin = (jit.Array3f(*(column(each) for each in part)) for part in (way, start))
    passed = np.array(march.transmittance(LatticeRays(origin, direction, jit.Float(0.0), column(np.full(200, 3.0)))))
    assert passed.min() > 0.98


def test_the_slope_of_smoothness_is_that_of_central_differences():
    """Of |∇d| from 1 and of the Laplacian, over the nodes that move alone."""
    random, shape = np.random.default_rng(0), (6, 7, 8)
    distance, moving = random.normal(size=shape), np.zeros(shape, bool)
    moving[1:-1, 1:-1, 1:-1] = random.random((4, 5, 6)) < 0.5
    nodes = np.flatnonzero(moving)
    field = DistanceField(distance, np.zeros((*shape, COLOURS)))
    found = np.array(smoothness_slope(field, arrays().UInt(nodes.astype(np.uint32))))

    def energy(d):
        slope = [0.5 * (np.roll(d, -1, axis) - np.roll(d, 1, axis)) for axis in range(3)]
        around = sum(np.roll(d, -1, axis) + np.roll(d, 1, axis) for axis in range(3))
        stretched = np.sqrt(sum(each**2 for each in slope)) - 1.0
        return (EIKONAL * stretched**2 + BENDING * (around - 6.0 * d) ** 2)[moving].mean()

    for k in range(0, len(nodes), 3):
        change = np.zeros(distance.size)
        change[nodes[k]] = 1e-5
        change = change.reshape(shape)
        expected = (energy(distance + change) - energy(distance - change)) / 2e-5
        assert found[k] == pytest.approx(expected, abs=float(1e-5 * np.abs(found).max()))
