"""Mode path sees the absolute radiance of all orders that Mitsuba's `volpath` and `path` see: in a cloud, between
surfaces, and between both. Pictures are judged as in `test_mitsuba.py`, with the variance of both solvers.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import mitsuba
from tests.agreement.test_mitsuba import (
    ALPHA,
    BLOCK,
    MATTE,
    TAU,
    box_of_cloud,
    camera,
    cloud_of_mitsuba,
    lamp_of,
    medium_of_mitsuba,
    pictures_of_mitsuba,
)
from tests.judges import blocks_agree

WALKS = 512  # a pixel


def assert_same_radiance(scene, mean, variance):
    """Also: without light of higher orders it is another picture."""
    image = hg.render(scene, hg.Settings(samples=WALKS), mode="path")
    radiance = image.weights @ np.array([colour.at(550.0) for colour in image.palette.colours])
    both = variance + image.variance
    assert blocks_agree(mean, radiance, both, BLOCK)
    assert not blocks_agree(mean, 1.03 * radiance, both, BLOCK)


def surfaces():
    """A Lambert ball, and a wall behind it, close enough that much light goes to and fro."""
    matter, wall = hg.Reflectance(ALPHA, 0.0, 0.2, 1.5, MATTE), np.diag([2.0, 2.0, 1.0, 1.0])
    wall[2, 3] = -0.9
    return (hg.Surface.sphere((0.1, -0.2, 0.0), 0.6, matter), hg.Surface(matter, "rectangle", pose=wall)), wall


def surfaces_of_mitsuba(wall):
    paint = {"type": "diffuse", "reflectance": {"type": "rgb", "value": math.pi * ALPHA}}
    ball = {"type": "sphere", "center": [0.1, -0.2, 0.0], "radius": 0.6, "bsdf": paint}
    paint = {"type": "twosided", "bsdf": paint}
    return {
        "ball": ball,
        "wall": {"type": "rectangle", "to_world": mitsuba().ScalarTransform4f(wall.tolist()), "bsdf": paint},
    }


def test_surfaces_in_a_cloud_see_the_light_of_volpath():
    """All orders, within the cloud, between ball and wall, and from each to the other."""
    both, wall = surfaces()
    scene = hg.Scene(camera(), (lamp_of(None),), (box_of_cloud(TAU),), both)
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium_of_mitsuba(TAU)}
    theirs = pictures_of_mitsuba("volpath", {"cloud": cube, **surfaces_of_mitsuba(wall)}, depth=-1)
    assert_same_radiance(scene, *theirs)


@pytest.mark.slow
@pytest.mark.parametrize("depth", [TAU, 10.0 * TAU])
def test_a_cloud_is_that_of_volpath(depth):
    """Optical depth 3 and 30, all orders."""
    scene = hg.Scene(camera(), (lamp_of(None),), (box_of_cloud(depth),))
    assert_same_radiance(scene, *cloud_of_mitsuba(depth, None, depth=-1))


def test_a_textured_wall_beside_a_ball_sends_on_the_light_of_path():
    """A smooth image on the wall, all orders: both interpolate between the middles of pixels."""
    (ball, wall_surface), wall = surfaces()
    values = np.random.default_rng(3).random((4, 8)).astype(np.float32)
    textured = replace(wall_surface, body_texture=hg.SurfaceTexture(values))
    objects = surfaces_of_mitsuba(wall)
    upside_down = math.pi * ALPHA * values[::-1, :, None]  # the first row of a bitmap is at v = 0
    bitmap = mitsuba().Bitmap(np.ascontiguousarray(upside_down))
    paint = {"type": "diffuse", "reflectance": {"type": "bitmap", "bitmap": bitmap, "raw": True}}
    objects["wall"]["bsdf"] = {"type": "twosided", "bsdf": paint}
    scene = hg.Scene(camera(), (lamp_of(None),), surfaces=(ball, textured))
    assert_same_radiance(scene, *pictures_of_mitsuba("path", objects, depth=-1))
