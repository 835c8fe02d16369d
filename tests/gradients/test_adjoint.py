"""The gradient in reverse mode against central differences of the light that it is of, and against forward mode.

A step of a difference is 2 ‰ to 1 % of what it changes: single precision leaves 1e-7 / step of the light, about 1e-4 of
a derivative. Steps of the march move with densities in a difference, and are held in the gradient.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.transport.differentiable_medium import LARGEST_TOLERANCE
from tests.oracle.lattice import Array
from tests.oracle.radiance import camera_rays
from tests.oracle.scenes import BLUE, GRAINS, LOW_LAMP, RED, SHINY, box_of, camera, centres, cloud

SHAPE = (13, 11, 10)  # two bricks along each edge
RAYS = camera_rays(camera(7))
STRENGTHS = 0.4, 1.0
NEAR_LAMP = hg.Lamp(position=(0.5, -0.4, 0.5), intensity=STRENGTHS[0])
FAR_LAMP = hg.Lamp(to_lamp=(-0.36, -0.48, 0.8), intensity=STRENGTHS[1])
ONE_PERCENT = 1e-2


def leaning_box() -> hg.VolumeBox:
    """Density 0.2 to 1 everywhere, axes that lean to eye and lamps, a colour per voxel, projected extinction."""
    x, y, z = centres((SHAPE[2], SHAPE[1], SHAPE[0]))
    axis = np.stack([0.1 + 2.0 * y, -0.75 + 2.0 * z, 0.5 + 2.0 * x], axis=-1)
    share = 0.5 + 0.4 * np.sin(40.0 * x + 20.0 * z)
    density = np.random.default_rng(1).uniform(0.2, 1.0, SHAPE)
    unit = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    colour = {"body_colour": np.stack([share, 1.0 - share], axis=-1), "basis": (RED, BLUE)}
    return box_of(density, unit, 0.25, SHINY, degrees=20.0, extinction="projected", **colour).box()


def scene_of(lamps: tuple[hg.Lamp, ...] = (NEAR_LAMP, FAR_LAMP)) -> hg.Scene:
    return hg.Scene(camera(), lamps, (leaning_box(),))


class LinearLoss:
    """A loss that is linear in light: seeded weights."""

    def __init__(self, rays: hg.RayMarch, seed: int = 2) -> None:
        light, random = rays(*RAYS), np.random.default_rng(seed)
        self.by_light = hg.RayLight(*(random.uniform(0.2, 1.0, part.shape) for part in light))

    def __call__(self, light: hg.RayLight) -> float:
        return sum(float((by * part).sum(dtype=float)) for by, part in zip(self.by_light, light, strict=True))

    def of(self, rays: hg.RayMarch, origins: Array = RAYS[0], directions: Array = RAYS[1]) -> float:
        """Of the light that gradients are of."""
        return self(rays.gradient(origins, directions, self.by_light, by=()).light)


@pytest.fixture(scope="module", params=["march", "none"], ids=["shadows", "no shadows"])
def marched(request) -> tuple[hg.RayMarch, LinearLoss, Any, hg.Settings]:
    settings = hg.Settings(shadows=request.param)
    rays = hg.RayMarch(scene_of(), settings, differentiable=True)
    loss = LinearLoss(rays)
    every = ("density", "axis", "colour", "materials", "lamps", "rays")
    return rays, loss, rays.gradient(*RAYS, loss.by_light, by=every), settings


@pytest.mark.parametrize("what", ["density", "axis", "colour"])
def test_the_gradient_by_voxels_is_the_difference(marched, what):
    """Of all voxels together, of one brick, and of a layer that bricks share."""
    rays, loss, gradient, _ = marched
    (before,), (slope,) = getattr(rays, what), getattr(gradient, what)
    assert slope.shape == before.shape
    change = np.random.default_rng(3).uniform(0.5, 1.0, before.shape) * (1.0 if what == "density" else before)
    if what == "axis":
        change = np.random.default_rng(3).normal(size=before.shape) + np.array([0.4, -0.3, 0.6])
    for part in (np.s_[:], np.s_[:8, :8, :8], np.s_[8:9]):
        masked = np.zeros(before.shape)
        masked[part] = change[part]
        ends = []
        for step in (5e-3, -5e-3):
            setattr(rays, what, (before + step * masked,))
            ends.append(loss.of(rays))
        setattr(rays, what, (before,))
        difference = (ends[0] - ends[1]) / 1e-2
        assert abs((slope * masked).sum() - difference) < ONE_PERCENT * abs(difference)


@pytest.mark.parametrize("column", ["alpha", "beta", "gamma", "n", "colour 2"])
def test_so_is_that_by_materials(marched, column):
    rays, loss, gradient, _ = marched
    rows, place = np.array(rays.materials), rays.columns.index(column)
    assert gradient.materials.shape == (1, len(rays.columns))
    ends, step = [], 1e-2 * rows[place]
    for moved in (rows[place] + step, rows[place] - step):
        rays.materials = np.where(np.arange(rows.size) == place, moved, rows)
        ends.append(loss.of(rays))
    rays.materials = rows
    assert gradient.materials[0, place] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=ONE_PERCENT)


@pytest.mark.parametrize(("lamp", "which"), [(0, 0), (0, 2), (0, 3), (1, 1), (1, 3)])
def test_so_is_that_by_lamps(marched, lamp, which):
    _, loss, gradient, settings = marched
    ends, step = [], 4e-3
    for sign in (1, -1):
        lamps = [NEAR_LAMP, FAR_LAMP]
        place = lamps[lamp].place + sign * step * np.eye(4)[which, :3]
        where = {"position": place} if lamps[lamp].near else {"to_lamp": place / np.linalg.norm(place)}
        lamps[lamp] = replace(lamps[lamp], intensity=STRENGTHS[lamp] + sign * step * (which == 3), **where)
        ends.append(loss.of(hg.RayMarch(scene_of(tuple(lamps)), settings, differentiable=True)))
    assert gradient.lamps[lamp, which] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=ONE_PERCENT)


@pytest.mark.parametrize("which", [0, 1], ids=["origins", "directions"])
def test_so_is_that_by_rays(marched, which):
    """Each ray moves a way of its own; directions need not be unit. The step is small: a ray that passes an edge of the
    box bends what the difference is of.
    """
    rays, loss, gradient, _ = marched
    change = np.random.default_rng(5).uniform(0.2, 1.0, RAYS[0].shape)
    ends, step = [], 1e-4
    for sign in (1, -1):
        moved = [ray + sign * step * change * (k == which) for k, ray in enumerate(RAYS)]
        ends.append(loss.of(rays, *moved))
    difference = (ends[0] - ends[1]) / (2.0 * step)
    assert (gradient.rays[which] * change).sum() == pytest.approx(difference, rel=ONE_PERCENT)


def test_the_light_of_gradients_is_that_of_a_call(marched):
    """Both are within the tolerance of a medium for derivatives, so that they differ by twice as much at most."""
    rays, _, gradient, _ = marched
    for own, called in zip(gradient.light, rays(*RAYS), strict=True):
        assert np.mean((own - called) ** 2) < (2.0 * LARGEST_TOLERANCE) ** 2 * np.mean(called**2)


def test_forward_and_reverse_mode_agree(marched):
    """⟨w, J dp⟩ = ⟨Jᵀ w, dp⟩ of densities and axes: 1 %, as their samples are not the same."""
    rays, loss, gradient, _ = marched
    random, before = np.random.default_rng(6), (rays.density, rays.axis)
    change = [random.uniform(0.2, 1.0, (*SHAPE, *rest)) for rest in ((), (3,))]
    values = np.array(rays.voxels)
    rays.density, rays.axis = ([change[0]], [change[1]])
    in_bricks = np.array(rays.voxels)
    rays.voxels = values
    _, slope = rays.derivative(*RAYS, voxels=in_bricks)
    product = sum((by * d).sum() for by, d in zip((gradient.density[0], gradient.axis[0]), change, strict=True))
    assert product == pytest.approx(loss(slope), rel=ONE_PERCENT)
    assert all(np.array_equal(old[0], new[0]) for old, new in zip(before, (rays.density, rays.axis), strict=True))


def among_surfaces(lamp: hg.Lamp = LOW_LAMP) -> hg.RayMarch:
    """Two boxes that overlap, one with a shadow bias, in front of a wall that they shade."""
    boxes = replace(cloud(6.0).box(), shadow_bias=0.01), cloud(6.0, (0.05, -0.04, 0.03), 30.0).box()
    wall = hg.Surface.sphere((-0.1, 0.3, -0.3), 0.25, SHINY)
    return hg.RayMarch(hg.Scene(camera(), (lamp,), boxes, (wall,)), differentiable=True)


def test_so_are_those_of_boxes_that_overlap_a_surface_and_a_shadow_bias():
    """By densities of both boxes, by materials and by the lamp; shadows of the boxes on the surface, too."""
    rays = among_surfaces()
    loss = LinearLoss(rays)
    gradient: Any = rays.gradient(*RAYS, loss.by_light, by=("density", "materials", "lamps"))
    assert abs(loss(gradient.light) - loss(rays(*RAYS))) < 1e-3 * loss(gradient.light)
    before, random = rays.density, np.random.default_rng(8)
    change = [density * random.uniform(0.5, 1.0, density.shape) for density in before]
    for k in range(2):
        ends = []
        for step in (4e-3, -4e-3):
            rays.density = [old + step * change[k] if j == k else old for j, old in enumerate(before)]
            ends.append(loss.of(rays))
        assert (gradient.density[k] * change[k]).sum() == pytest.approx((ends[0] - ends[1]) / 8e-3, rel=ONE_PERCENT)
    rays.density, rows = before, np.array(rays.materials)
    for k in range(3):  # of both boxes and the wall
        place, ends = k * len(rays.columns), []
        for factor in (1.01, 0.99):
            rays.materials = np.where(np.arange(rows.size) == place, factor * rows, rows)
            ends.append(loss.of(rays))
        slope = (ends[0] - ends[1]) / (0.02 * rows[place])
        assert gradient.materials[k, 0] == pytest.approx(slope, rel=ONE_PERCENT)
    ends = []
    for sign in (1, -1):
        place = LOW_LAMP.place + np.array([2e-3, 1e-3, 0.0]) * sign
        ends.append(loss.of(among_surfaces(replace(LOW_LAMP, position=place))))
    assert gradient.lamps[0, :3] @ (2e-3, 1e-3, 0.0) == pytest.approx(0.5 * (ends[0] - ends[1]), rel=ONE_PERCENT)


def test_a_box_that_is_used_twice_has_the_gradient_of_both():
    box = leaning_box()
    pose = np.array(box.pose)
    pose[0, 3] += 0.3
    rays = hg.RayMarch(
        hg.Scene(camera(), (FAR_LAMP,), (box, box.with_pose(pose))), hg.Settings(shadows="none"), differentiable=True
    )
    loss = LinearLoss(rays)
    gradient: Any = rays.gradient(*RAYS, loss.by_light)
    one, other = gradient.density
    assert np.array_equal(one, other) and np.abs(one).max() > 0.0


def test_voxels_of_bricks_that_are_not_stored_have_none_and_empty_ones_that_are_have_one():
    density = np.zeros((9, 9, 33))
    density[:, :, 3:6] = 0.7
    axis = np.broadcast_to((0.0, -0.6, 0.8), (*density.shape, 3))
    box = box_of(density, axis, 0.5, GRAINS).box()
    rays = hg.RayMarch(hg.Scene(camera(), (FAR_LAMP,), (box,)), hg.Settings(shadows="none"), differentiable=True)
    origins = np.stack([np.linspace(-0.11, 0.11, 90), np.full(90, -1.0), np.full(90, 0.003)], axis=1)
    ways = np.broadcast_to((0.0, 1.0, 0.0), (90, 3))
    gradient: Any = rays.gradient(origins, ways, lambda light: np.ones(light.weights.shape))
    (slope,) = gradient.density
    assert (slope[:, :, 9:] == 0.0).all() and (slope[:, :, :9].sum(axis=(0, 1)) > 0.0).all()
    (read,) = rays.density
    assert read == pytest.approx(density, abs=5e-4)  # halves
    with pytest.raises(hg.InputError, match="bricks of 8³ voxels that the box does not store"):
        rays.density = [np.ones(density.shape)]
    with pytest.raises(hg.InputError, match=r"density of box 0, of shape \(2, 2\)"):
        rays.density = [np.ones((2, 2))]
    with pytest.raises(hg.InputError, match="2 arrays for 1 boxes"):
        rays.density = [density, density]


def test_single_rays_and_functions_of_light_give_the_same(marched):
    rays, loss, gradient, _ = marched
    place = int(np.argmin(loss.by_light.transmittance))
    one = tuple(part[place : place + 1] for part in RAYS)
    of_one = hg.RayLight(*(part[place : place + 1] for part in loss.by_light))
    found: Any = rays.gradient(*one, lambda light: of_one, by=("rays",))
    for own, all_rays in zip(found.rays, gradient.rays, strict=True):
        assert own[0] == pytest.approx(all_rays[place], rel=1e-4, abs=1e-6)


def test_what_has_no_gradient_is_refused(marched):
    rays, loss, _, _ = marched
    with pytest.raises(hg.InputError, match="give a tuple of some of density, axis"):
        rays.gradient(*RAYS, loss.by_light, by="density")
    with pytest.raises(hg.InputError, match="give a tuple of some of density, axis"):
        rays.gradient(*RAYS, loss.by_light, by=("densities",))
    with pytest.raises(hg.InputError, match=r"weights of shape \(3, 2\): give finite numbers, \(49, "):
        rays.gradient(*RAYS, np.ones((3, 2)))
    with pytest.raises(hg.InputError, match="what is no number"):
        rays.gradient(*RAYS, "much")
    with pytest.raises(hg.InputError, match="prepared for them"):
        hg.RayMarch(scene_of()).gradient(*RAYS, loss.by_light)
    twice = hg.RayMarch(scene_of((FAR_LAMP, hg.Lamp(to_lamp=tuple(FAR_LAMP.place), spectrum=RED))), differentiable=True)
    with pytest.raises(hg.InputError, match="some stand at one place"):
        twice.gradient(*RAYS, loss.by_light, by=("lamps",))
    plain = hg.Scene(camera(), (FAR_LAMP,), (cloud(6.0).box(),), (hg.Surface.sphere((0.0, 1.0, 0.0), 0.2, SHINY),))
    for name, match in (("colour", "no box has a colour per voxel"), ("rays", "on which rays have no gradient")):
        with pytest.raises(hg.InputError, match=match):
            hg.RayMarch(plain, differentiable=True).gradient(*RAYS, loss.by_light, by=(name,))
