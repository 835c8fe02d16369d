"""Light from one part of an object onto another: against a closed form, and against a path tracer."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.matter import shape as sd
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.light_between import arriving, light_between, sky_of
from hagoromo.recovery.rendering import Rendering
from hagoromo.recovery.shading import START, NodeShading, coordinates, matt
from hagoromo.recovery.surface_shape import SurfaceShape
from studies.path_scenes import path_simulated, shape_mesh
from studies.recover_scenes import shots, simulated
from studies.recovery_scores import psnr
from studies.strange_captures import WhiteObject

NODES, RADIUS, ALBEDO = 44, 16.0, 0.8
QUICK = hg.RecoverySettings(side=24, steps=30, rays=1 << 12, keep=0, errors=False)


class SmallBalls(WhiteObject):
    """Two white balls that touch."""

    def distance(self, p):
        return dr.fmin(sd.sphere(p, (-0.022, 0.0, 0.0), 0.022), sd.sphere(p, (0.022, 0.0, 0.0), 0.022))


def cavity(unit=1.0):
    """A half ball that is cut out of a block, lit straight from above by two far lamps of one photograph each."""
    z, y, x = np.meshgrid(*(np.arange(NODES) - 0.5 * (NODES - 1),) * 3, indexing="ij")
    values = np.maximum(z - 8.0, RADIUS - np.sqrt(x * x + y * y + (z - 8.0) ** 2)).astype(np.float32)
    lattice = Lattice(np.zeros(3), 0.002, values.shape)
    colours = np.full((*values.shape, 3), ALBEDO / unit, np.float32)
    shape = SurfaceShape(lattice, values, colours, matt(coordinates(*START)))
    dark, camera = np.zeros((1, 1, 3), np.float32), hg.Camera(1, 1, (1.0, 1.0), (0.5, 0.5))
    lamps = [hg.Lamp(to_lamp=(0.0, 0.0, 1.0), intensity=strength) for strength in (1.0, 3.0)]
    lit = [hg.Photograph(dark, dark + 1.0, np.ones((1, 1), bool), camera, (lamp,)) for lamp in lamps]
    shading = NodeShading(LampTable(lit, lattice), shape.gloss)
    return Rendering(shape.field(), shading, 0.2, albedo=unit)


def inside(places):
    """Places deep in the half ball."""
    middle = np.array([0.5 * (NODES - 1)] * 2 + [0.5 * (NODES - 1) + 8.0])
    away = places - middle
    return (np.linalg.norm(away, axis=1) < RADIUS + 0.5) & (away[:, 2] < -4.0)


@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_light_in_a_half_ball_is_that_of_the_closed_form(unit):
    """Each place of a hollow ball has the same share of the sky of each other one: E is the same all over it.

    With s = ½ of the sky and the mean irradiance of ½ by a parallel lamp, E = ρ s · ½ / (1 − ρ s). The rim, which a
    spline rounds, is about half a voxel lower: 3 %.
    """
    rendering = cavity(unit)
    sky = sky_of(rendering)
    light = arriving(rendering, 2, unit, sky)
    deep, part = inside(sky.places), 0.5 * ALBEDO
    assert deep.sum() > 500
    between = light.between[deep]
    np.testing.assert_allclose(between[:, 1], 3.0 * between[:, 0], rtol=1e-3)
    assert between[:, 0].mean() == pytest.approx(0.5 * part / (1.0 - part), rel=0.05)
    assert between[:, 0].std() < 0.1 * between[:, 0].mean()


def test_a_single_ray_that_meets_the_object_brings_half_of_what_it_brings_twice():
    """Objects that are nearly convex have few such rays: one alone ended in a message of NumPy."""
    rendering = cavity()
    light = []
    for times in (1, 2):
        sky = sky_of(rendering)
        ray = np.flatnonzero(inside(sky.places)[sky.receiver] & inside(sky.places)[sky.sender])[:1].repeat(times)
        for name in ("receiver", "sender", "towards", "opacity"):
            setattr(sky, name, getattr(sky, name)[ray])
        light.append(arriving(rendering, 2, 1.0, sky).between)
    assert light[0].max() > 0.0
    np.testing.assert_allclose(light[0], 0.5 * light[1], rtol=1e-5)


def test_the_light_of_places_is_looked_up_on_their_own_side():
    rendering = cavity()
    sky = sky_of(rendering)
    between = light_between(rendering, 2, 1.0, sky)
    deep = inside(sky.places)
    jit = arrays()
    places = jit.Array3f(np.ascontiguousarray(sky.places[deep].T, np.float32))
    normals = np.ascontiguousarray(sky.normals[deep].T, np.float32)
    photograph = jit.UInt(0)
    own, other = (
        np.array(between.at(rendering.field, photograph, places, jit.Array3f(by * normals))[0]) for by in (1.0, -1.0)
    )
    part = 0.5 * ALBEDO
    assert own.mean() == pytest.approx(0.5 * part / (1.0 - part), rel=0.05) and not other.any()


@pytest.fixture(scope="module")
def balls():
    """Photographs by Mitsuba's path tracer, all bounces."""
    return path_simulated(shape_mesh(SmallBalls(), 0.001), shots(12, 5, 60, 1, pixels=48), 1)


@pytest.fixture(scope="module")
def by_all(balls):
    return hg.recover(balls.capture, replace(QUICK, orders="all"))


def says_light_between(found):
    return any("from other parts of the object" in each for each in found.record()["remarks"])


@pytest.mark.nightly
def test_two_white_balls_that_light_each_other_are_explained(balls, by_all):
    """Pictures of new views come nearer to the path tracer; on these 24 nodes most of the error is at outlines."""
    aside = path_simulated(shape_mesh(SmallBalls(), 0.001), shots(3, 5, 60, 2, pixels=48), 9, noise=False)
    first = hg.recover(balls.capture, replace(QUICK, orders="first"))
    assert psnr(by_all, aside) > psnr(first, aside) + 0.2
    assert first.record()["orders"] == "first" and says_light_between(first)


def test_light_of_another_photograph_is_that_of_its_lamps(balls, by_all):
    """A picture has light between parts under lamps that no photograph had; without a lamp there is none."""
    found = by_all
    assert found.record()["orders"] == "all" and not says_light_between(found)
    photograph = balls.capture.photographs[0]
    light, _ = found.picture(photograph)
    alone, _ = replace(found, orders="first").picture(photograph)
    assert (light >= alone - 1e-5).all() and light.sum() > 1.005 * alone.sum()
    strong = replace(
        photograph, lamps=tuple(replace(lamp, intensity=2.0 * lamp.intensity) for lamp in photograph.lamps)
    )
    np.testing.assert_allclose(found.picture(strong)[0], 2.0 * light, rtol=1e-3, atol=1e-5)


@pytest.mark.nightly
def test_a_ball_alone_is_recovered_as_by_the_first_order():
    """Nothing lights it but the lamps."""

    class LoneBall(WhiteObject):
        def distance(self, p):
            return sd.sphere(p, (0.0, 0.0, 0.0), 0.03)

    capture = simulated(LoneBall(), shots(8, 5, 60, 1, pixels=40), 1).capture
    quick = replace(QUICK, side=20, steps=20)
    first, both = (hg.recover(capture, replace(quick, orders=orders)) for orders in ("first", "all"))
    near = np.abs(first.distance) < 1.0
    assert np.abs(both.distance - first.distance)[near].mean() < 0.01  # voxels
    assert np.abs(both.colours - first.colours)[near].mean() < 0.005


@pytest.mark.nightly
@pytest.mark.parametrize("at", [0.8, pytest.param(0.75, marks=pytest.mark.nightly)])
def test_work_with_light_between_parts_goes_on_to_the_same_bits(balls, tmp_path, at):
    settings = hg.RecoverySettings(side=18, steps=42, rays=1 << 10, keep=0, errors=at < 0.8, orders="all")

    def stop(share, step=""):
        if share > at:
            raise KeyboardInterrupt

    work = tmp_path / "work.npz"
    assert not hg.recover(balls.capture, settings, stop, work).complete and work.exists()
    resumed, whole = hg.recover(balls.capture, settings, work=work), hg.recover(balls.capture, settings)
    for name in ("distance", "colours", "gloss"):
        assert np.array_equal(getattr(resumed, name), getattr(whole, name))
    if at < 0.8:
        assert resumed.errors is not None and whole.errors is not None
        assert np.array_equal(resumed.errors.position, whole.errors.position, equal_nan=True)


@pytest.mark.nightly
def test_auto_takes_all_orders_where_they_predict_better():
    """Three photographs judge, by their outlines, too, so one draw of pixels says little: 0.1, 0.8 and 0.6 dB."""
    balls = path_simulated(shape_mesh(SmallBalls(), 0.001), shots(16, 5, 60, 1, pixels=120), 1)
    quick, better = replace(QUICK, rays=1 << 14, steps=50, orders="auto"), []
    for seed in range(3):
        found = hg.recover(balls.capture, replace(quick, seed=seed))
        tried = found.record()["orders_tried_db"]
        better.append(tried["all"] - tried["first"])
        assert (found.orders == "all") == (better[-1] >= 0.1)
    assert np.mean(better) > 0.1


def test_bad_choices_of_orders_end_in_one_line(balls):
    with pytest.raises(hg.InputError, match="orders is 'second': give first, all, auto"):
        hg.RecoverySettings(orders="second")  # type: ignore[arg-type]
    with pytest.raises(hg.InputError, match="orders is 'all', which is of a surface"):
        hg.RecoverySettings(orders="all", matter="fuzzy")
    unlit = hg.Capture(tuple(replace(p, lamps=()) for p in balls.capture.photographs), "unlit")
    with pytest.raises(hg.InputError, match="no photograph has a lamp"):
        hg.recover(unlit, replace(QUICK, orders="all"))
