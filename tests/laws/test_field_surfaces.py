"""Laws of mode full with surfaces: light of all orders between surfaces, and between them and boxes.

The oracles are the closed form of a closed sphere, and random walks (mode path) whose noise is known.
"""

import math
from types import SimpleNamespace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
import hagoromo.image.full.picture as full
import hagoromo.image.scene.patch_meshes as patch_meshes
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.reflectance.element import Element
from hagoromo.transport.field import matter_samples
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.patches import Patches
from hagoromo.transport.film import pixel_points

WHITE = hg.Spectrum.constant(1.0)
RED = hg.Spectrum([360, 400, 700, 830], [0.15, 0.15, 0.85, 0.85])
TO_LAMP = (0.48, -0.6, 0.64)
SIZE, BLOCK = (24, 32), 4


@pytest.fixture(autouse=True)
def few_patches(monkeypatch):
    monkeypatch.setattr(patch_meshes, "MOST_PATCHES", 1500)


def paint(albedo, beta=0.0, colour=WHITE, element: Element = "plane"):
    return hg.Reflectance(albedo / math.pi, beta, 0.3, 1.5, colour, element=element)


def box_of(material, depth=3.0, side=12):
    axes = np.broadcast_to((0.36, -0.48, 0.8), (side, side, side, 3))
    one = np.ones(axes.shape[:3])
    return hg.VolumeBox.from_arrays(one, axes, 1 / side, 2.0 * depth, [material], extinction="projected")


def on_a_floor(material, floor, eye=(2.2, -2.4, 1.6)):
    """A box of 1 m just above a square floor of 4 m."""
    camera = hg.Camera(32, 24, (32, 32), (16, 12)).look_at(eye, (0.5, 0.3, 0.2))
    return hg.Scene(camera, (hg.Lamp(to_lamp=TO_LAMP),), (box_of(material),), (hg.Surface.floor(-0.05, 2.0, floor),))


def blocks(values):
    rows, columns = SIZE[0] // BLOCK, SIZE[1] // BLOCK
    return values.reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))


def higher_orders(image):
    """Of each band: (height, width, bands)."""
    return image.weights[..., len(image.palette.bodies) + len(image.palette.interfaces) :]


@pytest.mark.parametrize("orders", [1, 2, 3, None])
def test_a_closed_lambert_sphere_is_lit_as_by_its_closed_form(orders):
    """A lamp of 1 W/sr at the middle of a ball of radius 1: order n has the radiance aⁿ/π. 0.6 %: patches are flat."""
    albedo, matte = 0.7, paint(0.7)
    camera = hg.Camera(8, 6, (6, 6), (4, 3)).look_at(eye=(0.3, 0.1, -0.2), target=(1, 0, 0))
    ball = hg.Surface.sphere((0, 0, 0), 1.0, matte)
    image = hg.render(
        hg.Scene(camera, (hg.Lamp(position=(0, 0, 0)),), surfaces=(ball,)),
        hg.Settings(orders=orders, walks=0),
        mode="full",
    )
    truth = sum(albedo**n for n in range(2, (orders or 60) + 1)) / math.pi
    assert np.abs(higher_orders(image) - truth).max() <= 6e-3 * truth


@pytest.mark.by_night("sphere-0.0")
@pytest.mark.parametrize(("element", "beta"), [("sphere", 0.0), ("cylinder", 0.5)])
def test_a_floor_beside_a_white_box_is_lit_as_by_random_walks(element, beta):
    """In blocks of 4² pixels: 3 % and four deviations of the noise, where a block is full; 1 % of all light.

    A floor with and without an interface. In half of the blocks light of higher orders is more than 4 % of all.
    """
    scene = on_a_floor(paint(0.95, element=element), paint(0.8 if not beta else 0.6, beta))
    solved, walked = (
        hg.render(scene, hg.Settings(samples=4, walks=0), mode="full"),
        hg.render(scene, hg.Settings(samples=512), mode="path"),
    )
    ours, theirs = (
        (image.weights[..., :2].sum(axis=-1) + higher_orders(image).mean(axis=-1)) for image in (solved, walked)
    )
    whole = blocks(walked.alpha) > 0.999
    off = np.abs(blocks(ours) - blocks(theirs)) - 4.0 * np.sqrt(blocks(walked.variance)) / BLOCK
    assert whole.sum() > 20 and (off[whole] < 0.03 * blocks(theirs)[whole]).all()
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.01)
    share = blocks(higher_orders(walked).mean(axis=-1)) / np.maximum(blocks(theirs), 1e-9)
    assert (share[whole] > 0.04).mean() > 0.4


@pytest.mark.nightly
def test_a_robe_colours_the_plate_that_it_lies_on():
    """A red box over a white floor, of which the camera sees the floor: bands have the colour that walks find."""
    scene = on_a_floor(paint(0.95, colour=RED, element="sphere"), paint(0.8))
    solved, walked = (
        hg.render(scene, hg.Settings(samples=2, walks=0), mode="full"),
        hg.render(scene, hg.Settings(samples=512), mode="path"),
    )
    floor = solved.weights[..., 0] < 1e-6  # RED, the first body, is only the box's
    floor &= walked.weights[..., 0] < 1e-6
    ends = [higher_orders(image)[floor][:, [0, -1]].sum(axis=0) for image in (solved, walked)]
    assert ends[0] == pytest.approx(ends[1], rel=0.03) and ends[1][1] > 2.0 * ends[1][0]


@pytest.mark.nightly
def test_cells_of_samples_without_weight_hold_no_matter(monkeypatch):
    """By rounding, a place may have density in a texel, and none of its elements: a centroid was 0/0 in such cells."""
    scene, kept = on_a_floor(paint(0.9, element="sphere"), paint(0.8)), matter_samples._kept
    centroids = []

    def half_of_it(*arguments):
        parts = kept(*arguments)
        for _, _, share, _, _, _, x, *_ in parts:
            share[x > 0.5] = 0.0
        return parts

    def cells(low, size, filled, middles):
        centroids.extend(middles[:, 0])
        return Cells(low, size, filled, middles)

    monkeypatch.setattr(matter_samples, "_kept", half_of_it)
    monkeypatch.setattr(matter_samples, "Cells", cells)
    assert np.isfinite(higher_orders(hg.render(scene, hg.Settings(walks=0), mode="full"))).all()
    assert centroids and max(centroids) <= 0.5


@pytest.mark.nightly
def test_another_camera_costs_a_march(monkeypatch):
    scene, cache, points = on_a_floor(paint(0.9, element="sphere"), paint(0.8)), SceneCache(), pixel_points(1, 0)
    first = full.full_picture(scene, hg.Settings(walks=0), points, cache)
    monkeypatch.setattr(full.Joint, "solved", lambda *_: pytest.fail("it was solved again"))
    turned = scene.with_camera(on_a_floor(paint(0.9), paint(0.8), eye=(-2.2, -2.0, 1.5)).camera)
    second = full.full_picture(turned, hg.Settings(walks=0), points, cache)
    assert higher_orders(second).sum() > 0 and not np.array_equal(first.weights, second.weights)


def test_patches_cover_every_shape_and_are_small_where_other_matter_is_near(monkeypatch):
    monkeypatch.setattr(patch_meshes, "MOST_PATCHES", 6000)
    shapes = [
        hg.Surface(paint(0.5), shape, pose=np.diag([2.0, 2.0, 1.0, 1.0])) for shape in ("disk", "cylinder", "cube")
    ]
    areas = 4 * math.pi, None, 2 * 16.0 + 4 * 8.0
    camera = hg.Camera(8, 6, (6, 6), (4, 3)).look_at(eye=(9, 0, 0), target=(0, 0, 0))
    for surface, area in zip(shapes, areas, strict=True):
        patches = Patches(patch_meshes.patch_meshes(hg.Scene(camera, (hg.Lamp(to_lamp=TO_LAMP),), surfaces=(surface,))))
        assert area is None or patches.areas.sum() == pytest.approx(area, rel=5e-3)
        assert 100 < patches.count < 7000
    scene = on_a_floor(paint(0.9, element="sphere"), paint(0.8))
    (mesh,) = patch_meshes.patch_meshes(scene)
    corners = mesh.vertices[mesh.faces]
    edge = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    near = np.abs(corners.mean(axis=1)[:, :2] - 0.5).max(axis=1) < 0.6
    assert np.median(edge[near]) <= 0.5 * np.median(edge[~near])


def test_rays_of_patches_share_no_kernel_with_rays_of_surfaces(monkeypatch):
    """OptiX traces one of Mitsuba's scenes in a kernel, and leaves out the others: what goes into rays of patches is in
    memory before they are traced, and so is what comes of them.
    """
    whole, states = Patches.at, []

    def watched(patches, point, normal, active):
        scene = patches.scene

        def traced(ray, active):
            states.extend(value.state for value in (*point, *normal, active))
            return scene.ray_intersect_preliminary(ray, active=active)

        monkeypatch.setattr(patches, "scene", SimpleNamespace(ray_intersect_preliminary=traced))
        patch = whole(patches, point, normal, active)
        monkeypatch.setattr(patches, "scene", scene)
        states.extend(value.state for value in (patch.side, patch.there, patch.face, *patch.shares))
        return patch

    monkeypatch.setattr(Patches, "at", watched)
    matte = hg.Reflectance(0.25, 0.0, 0.2, 1.5, hg.Spectrum.constant(0.8))
    ball = hg.Surface.sphere((0.0, 0.0, 0.3), 0.2, matte)
    camera = hg.Camera(5, 3, (6.0, 6.0), (2.5, 1.5)).look_at((0.0, -2.0, 1.0), (0.0, 0.0, 0.1))
    hg.render(
        hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, -0.6, 0.8)),), surfaces=(ball,)), hg.Settings(walks=0), mode="full"
    )
    assert states and set(states) <= {dr.VarState.Evaluated, dr.VarState.Literal}
