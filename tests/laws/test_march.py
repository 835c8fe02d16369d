"""Laws of the march (MODEL §3): Beer–Lambert, the opaque box, order of convergence, and what may change nothing."""

import math
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.camera.camera import Camera
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import element_weights
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.film import tile_order
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import LitSample, march, optical_depth
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import palette_of
from hagoromo.transport.shadow import brute_attenuation
from hagoromo.transport.step_elements import centroid
from hagoromo.volume.box import VolumeBox
from tests.judges import converges_with_order

WHITE = Spectrum.constant(1.0)
MATTER = Reflectance(0.25, 0.3, 0.2, 1.5, WHITE)
AHEAD = (0.0, 0.0, 1.0)


def slab(tau=50.0, size=(13, 17, 11), density=1.0, material=MATTER, pose=None, axis=(0.0, 0.0, -1.0)) -> VolumeBox:
    """A box full of matter, voxels of 1 cm; arrays are indexed [z, y, x]."""
    full = np.full(size, density)
    return VolumeBox.from_arrays(
        full, np.broadcast_to(axis, (*size, 3)), 0.01, tau, [material], pose=np.eye(4) if pose is None else pose
    )


def soft_ball(count=48, tau=60.0) -> VolumeBox:
    """A smooth ball of 10 cm in a 16 cm box; many bricks are empty."""

    def field(p):
        offset = p - 0.08
        radius = dr.norm(offset)
        edge = dr.fmin(dr.fmax((0.05 - radius) / 0.012, 0.0), 1.0)
        return edge * edge * (3.0 - 2.0 * edge) * (1.0 + 0.3 * dr.sin(90.0 * p.x)), offset / dr.fmax(radius, 1e-6)

    pose = np.eye(4)
    pose[:3, 3] = (-0.08, -0.08, -0.08)
    return VolumeBox.from_field(field, (count, count, count), 0.16 / count, tau, [MATTER], pose=pose)


def vector(x, y, z):
    return arrays().Array3f(*(float(v) if isinstance(v, (int, float)) else v for v in (x, y, z)))


def depth(boxes, origin, direction, near=0.0, far=math.inf):
    ray = vector(*origin), vector(*direction), arrays().Float(near), arrays().Float(far)
    return float(optical_depth(Medium(boxes), *ray, deepest=math.inf)[0])


def lit(boxes, lamps, attenuation=None, tolerance=0.04):
    """A medium and lighting for hand-made rays."""
    materials = [m for box in boxes for m in box.materials]
    palette = palette_of(materials, [], [lamp.spectrum for lamp in lamps])
    return Medium(boxes, tolerance), Lighting(lamps, Materials(materials, palette), attenuation)


@pytest.mark.parametrize("tau", [0.5, 7.0, 300.0])
def test_beer_lambert_through_a_full_box(tau):
    """Along any chord the optical depth is τ ρ times its length; ρ is stored in halves (5e-4)."""
    box = slab(tau, density=0.7)
    assert depth([box], (0.055, 0.085, -1), AHEAD) == pytest.approx(0.7 * tau * 0.13, rel=6e-4)
    d = np.array([0.3, 0.5, 0.9])
    d /= np.linalg.norm(d)
    inside = np.array([0.05, 0.08, 0.06])
    faces = np.sort(np.stack([-inside / d, (box.size - inside) / d]), axis=0)
    chord = faces[1].min() - faces[0].max()
    assert depth([box], inside - 2 * d, d) == pytest.approx(0.7 * tau * chord, rel=6e-4)
    assert depth([box], inside - 2 * d, d, 0.0, 2.01) == pytest.approx(0.7 * tau * (0.01 - faces[0].max()), rel=2e-3)


def test_extinctions_of_overlapping_boxes_add():
    shifted = np.eye(4)
    shifted[:3, 3] = (0.01, 0.02, 0.05)
    a, b = slab(40.0), slab(90.0, pose=shifted)
    ray = (0.055, 0.085, -1), AHEAD
    assert depth([a, b], *ray) == pytest.approx(depth([a], *ray) + depth([b], *ray), rel=1e-5)
    assert depth([a, b], *ray) == pytest.approx(130 * 0.13, rel=6e-4)


def test_a_turned_box_is_met_where_it_stands():
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert depth([slab(10.0, pose=turn)], (-2, 0.05, 0.05), (1, 0, 0)) == pytest.approx(10 * 0.17, rel=6e-4)


@pytest.mark.parametrize("tau", [0.3, 4.0, 40.0])
def test_steps_that_are_lit_together_have_the_light_of_each(tau):
    """Spheres without shadows under a far lamp send f (1 − T), however many steps share a sample; there are gaps."""
    random, to_lamp = np.random.default_rng(3), np.array([0.6, 0.0, -0.8])
    density = random.random((60, 50, 40)) * (random.random((60, 50, 40)) < 0.4)
    grain = Reflectance(0.2, 0.1, 0.3, 1.5, WHITE, element="sphere")
    box = VolumeBox.from_arrays(density, np.zeros((60, 50, 40, 3)), 0.01, tau, [grain])
    medium, lighting = lit([box], [Lamp(to_lamp=to_lamp)], tolerance=0.64)
    assert medium.joined is not None
    jit, ahead = arrays(), np.array([0.3, 0.2, 1.0]) / math.sqrt(1.13)
    places = random.uniform(0.0, 0.3, (2, 200))
    origin = jit.Array3f(jit.Float(places[0]), jit.Float(places[1]), jit.Float(-0.1))
    light, passed = march(medium, lighting, origin, vector(*ahead), jit.Float(0), jit.Float(dr.inf))
    seen, opaque = np.sum([each.numpy() for each in light], axis=0), 1.0 - passed.numpy()
    f = seen.sum() / opaque.sum()
    true = element_weights("sphere", vector(*ahead), vector(*to_lamp), vector(*-ahead), 0.2, 0.1, 0.3, 1.5)
    assert f == pytest.approx(sum(float(part[0]) for part in true), rel=4e-3)  # tabled, see below
    assert np.ptp(opaque) > 0.01 and np.allclose(seen, f * opaque, rtol=1e-4, atol=1e-6 * f)


@pytest.mark.parametrize("nu", [math.inf, 0.6])
@pytest.mark.parametrize("element", ["plane", "cylinder", "sphere"])
def test_an_opaque_box_is_its_surface(element, nu):
    """τ → ∞: the radiance is f(a; L, V) of the element at the face."""
    material = Reflectance(0.2, 0.1, 0.3, 1.5, WHITE, element=element, nu=nu)
    axis = np.array([0.6, 0.0, -0.8])
    to_lamp = np.array([0.3, 0.2, -1.0]) / math.sqrt(1.13)
    medium, lighting = lit([slab(1e7, material=material, axis=axis)], [Lamp(to_lamp=to_lamp, intensity=2.0)])
    channels, passed = march(
        medium, lighting, vector(0.055, 0.085, -1), vector(*AHEAD), arrays().Float(0), arrays().Float(9)
    )
    normal, lamp, eye = (vector(*v) for v in (axis, to_lamp, (0.0, 0.0, -1.0)))
    true = element_weights(element, normal, lamp, eye, 0.2, 0.1, 0.3, 1.5, nu)
    for mine, real in zip(channels, true, strict=True):
        # the axis is stored in halves (5e-4); the sphere's table is linear between 256 entries
        assert float(mine[0]) == pytest.approx(2.0 * float(real[0]), rel=4e-3)
    assert float(passed[0]) == 0.0


def test_inverse_square_law():
    """Twice as far, a quarter of the light; a far lamp's light does not fall off."""
    for far, ratio in ((False, 4.0), (True, 1.0)):
        values = []
        for distance in (10.0, 20.0):
            lamp = Lamp(to_lamp=(0, 0, -1)) if far else Lamp(position=(0.055, 0.085, -distance), intensity=1.0)
            medium, lighting = lit([slab(1e7)], [lamp])
            ray = vector(0.055, 0.085, -0.5), vector(*AHEAD), arrays().Float(0), arrays().Float(9)
            values.append(float(march(medium, lighting, *ray)[0][0][0]))
        # the sample that stands for the face lies a quarter of a voxel, 2.5 mm, behind it
        assert values[0] / values[1] == pytest.approx(ratio, rel=3e-4)


def test_the_march_converges():
    """Smaller steps divide what little error there is: at the usual tolerance it is below 1e-3 already.

    Spheres under a marched shadow: what a plane reflects ends at its horizon, and a sample stands on one side of it.
    """
    box, x = soft_ball(tau=300.0), dr.linspace(arrays().Float, -0.03, 0.03, 257)
    box = replace(box, materials=(replace(MATTER, element="sphere"),))
    results = {}
    for steps in (2, 4, 8, 64):
        medium, lighting = lit([box], [Lamp(to_lamp=(0.3, 0.2, -1.0))], tolerance=0.16 / steps**2)
        lighting.attenuation = brute_attenuation(medium)
        rays = vector(x, 0.013, -1.0), vector(*AHEAD) + 0 * x, arrays().Float(0), arrays().Float(9)
        results[steps] = np.array(march(medium, lighting, *rays)[0][0])
    errors = [np.sqrt(np.mean((results[steps] - results[64]) ** 2)) / results[64].mean() for steps in (2, 4, 8)]
    assert errors[0] < 1e-3
    assert converges_with_order((1 / 2, 1 / 4, 1 / 8), errors, order=1.5)


def test_transmittance_against_quadrature():
    """Optical depth of the ball along a line against SciPy's quadrature of the trilinear density."""
    from scipy.ndimage import map_coordinates

    box = soft_ball()
    density = box.bricks.dense()[0].astype(float)
    z = (np.arange(200_000) + 0.5) / 200_000 * 0.16
    place = np.stack([z, np.full_like(z, 0.093), np.full_like(z, 0.071)]) / box.voxel_size - 0.5
    true = map_coordinates(density, place, order=1, mode="nearest").mean() * 0.16 * box.tau
    assert depth([box], (0.071 - 0.08, 0.093 - 0.08, -1), AHEAD) == pytest.approx(true, rel=2e-3)


def frame(box, order="tiles"):
    """33 × 29 rays through the ball, in tile or row order."""
    jit, width, height = arrays(), 33, 29
    numbers = tile_order(width, height) if order == "tiles" else np.arange(width * height, dtype=np.uint32)
    index = jit.UInt(numbers)
    x, y = jit.Float(index % width) / width * 0.12 - 0.06, jit.Float(index // width) / height * 0.12 - 0.06
    medium, lighting = lit([box], [Lamp(position=(0.3, 0.5, -0.9))])
    direction = dr.normalize(vector(0.1 * x, 0.1 * y, 1.0))
    channels, _ = march(medium, lighting, vector(x, y, -1.0), direction, jit.Float(0), jit.Float(9))
    picture = np.empty((width * height, len(channels)), np.float32)
    picture[numbers] = np.stack([np.array(c) for c in channels], -1)
    return picture


def test_the_order_of_rays_changes_no_bit():
    box = soft_ball()
    assert np.array_equal(frame(box, "tiles"), frame(box, "rows"))


def test_bricks_are_the_dense_lattice():
    """Keeping every brick, empty ones too, changes nothing but what 1e-7 of density adds to its neighbours."""
    box = soft_ball()
    density, axis = box.bricks.dense()
    whole = VolumeBox.from_arrays(np.maximum(density, 1e-7), axis, box.voxel_size, box.tau, [MATTER], pose=box.pose)
    assert whole.bricks.kept == np.prod(box.bricks.lattice) > box.bricks.kept
    assert np.abs(frame(whole) - frame(box)).max() < 1e-5 * frame(box).max()


def test_halves_change_the_picture_by_less_than_their_rounding():
    """Values moved by up to the rounding of a half (2⁻¹¹) move 99 % of the pixels by less than that, and none by more
    than 1 %: a sample at the horizon of its plane may fall on its other side.
    """
    box = soft_ball()
    density, axis = (array.astype(np.float32) for array in box.bricks.dense())
    values = np.random.default_rng(5).uniform(-1, 1, (*density.shape, 1)) * 2.0**-11
    rounded = VolumeBox.from_arrays(
        density * (1 + values[..., 0]), axis * (1 + values), box.voxel_size, box.tau, [MATTER], pose=box.pose
    )
    a, b = frame(rounded), frame(box)
    moved = np.abs(a - b).max(axis=1) / b.max()
    assert 0 < moved.max() < 1e-2 and np.quantile(moved, 0.99) < 2.0**-11


def test_an_empty_box_is_not_there():
    box = slab(10.0)
    empty = replace(box, bricks=replace(box.bricks, places=np.zeros((0, 3), np.int32)))
    assert depth([empty], (0.055, 0.085, -1), AHEAD) == 0.0


def test_samples_average_to_the_area_of_a_pixel():
    """The mean over many samples of an edge that cuts a pixel is the covered share."""
    camera = Camera(7, 5, (40.0, 40.0), (3.5, 2.5)).look_at((0.055, 0.085, -1.0), (0.055, 0.085, 0.0), (0, 1, 0))
    scene = Scene(camera, (Lamp(to_lamp=(0, 0, -1)),), (slab(1e5, size=(5, 17, 11)),))
    alpha = render(scene, Settings(samples=256, shadows="none")).alpha
    # the face is 0.11 m wide at 1 m: 4.4 px of 40 px focal length; 0.17 m high: 6.8 px, the picture is 5
    assert alpha.sum() == pytest.approx(4.4 * 5, rel=0.01)


def test_light_that_bends_within_a_step_is_followed():
    """ln of light that is a parabola of the depth to the eye, as behind matter with a lamp on its far side;
    a mean of the rates to both neighbours for all of the step is 0.6 % off.
    """
    jit, depth, bend = arrays(), 0.5, 0.3
    share = float(centroid(jit.Float(depth))[0])

    def log_light(place: float) -> float:
        return -4.0 + 0.8 * place - bend * place**2

    def sample(number: int, rate: float) -> LitSample:
        before, numbers = depth * number, jit.Float
        log = log_light(before + share * depth)
        return LitSample(
            jit.UInt(0), numbers(depth), numbers(depth), numbers(before), numbers(share), [numbers(log)],
            [numbers(rate)], [], [],
        )  # fmt: skip

    rates = [(log_light(place) - log_light(place + depth)) / depth for place in (depth * (share - 1.0), depth * share)]
    gain = sample(0, rates[0]).gains([jit.Float(rates[1])])[0][0]
    at = (np.arange(1000) + 0.5) / 1000 * depth
    light = np.exp([log_light(place) - log_light(share * depth) for place in at])
    assert gain == pytest.approx(float(np.mean(np.exp(-at) * light) * depth), rel=4e-3)
