"""Mirrors, glass within glass, and matter within glass show what Mitsuba's smooth `conductor` and `dielectric` show.

Pictures are judged as in `test_mitsuba_orders.py`, block by block with the variance of both solvers.
"""

import numpy as np
import pytest

import hagoromo as hg
from tests.agreement.test_mitsuba import TAU, box_of_cloud, camera, medium_of_mitsuba, pictures_of_mitsuba
from tests.agreement.test_mitsuba_lights import TURN, emitter_of
from tests.agreement.test_mitsuba_orders import assert_same_radiance, surfaces, surfaces_of_mitsuba

PATHS = 24  # of Mitsuba, a pixel of each render
CROWN, WATER, MIRRORED = 1.5, 1.33, 0.8  # refractive indices, and the share that the mirror sends back
BALL, DROP = ((0.3, 0.15, 1.0), 0.3), ((0.3, 0.2, 1.0), 0.17)  # centre and radius [m]
SILVERED = (-0.35, 0.2, 0.9), 0.25
AROUND = (0.0, 0.0, 0.0), 1.8  # the cloud


def sky():
    return hg.Environment(0.2 + np.random.default_rng(6).random((8, 16)), rotation=TURN)


def ball_of(place, optics, n=CROWN, colour=1.0):
    matter = hg.Reflectance(0.0, 0.0, 0.2, n, hg.Spectrum.constant(0.0), hg.Spectrum.constant(colour))
    centre, radius = place
    return hg.Surface(matter, "sphere", pose=pose_of(centre, radius), optics=optics, name=f"{optics} {n}")


def pose_of(centre, radius):
    pose = np.diag([radius, radius, radius, 1.0])
    pose[:3, 3] = centre
    return pose


def ball_of_mitsuba(place, bsdf):
    return {"type": "sphere", "center": list(place[0]), "radius": place[1], "bsdf": bsdf}


def glass_of_mitsuba(inside, outside=1.0):
    return {"type": "dielectric", "int_ior": inside, "ext_ior": outside}


def balls():
    """A Lambert ball and a wall, seen in a mirror and through a drop of water within glass."""
    both, wall = surfaces()
    ours = ball_of(DROP, "glass", WATER), ball_of(BALL, "glass"), ball_of(SILVERED, "mirror", colour=MIRRORED)
    mirror = {"type": "conductor", "material": "none", "specular_reflectance": {"type": "rgb", "value": MIRRORED}}
    theirs = surfaces_of_mitsuba(wall) | {
        "glass": ball_of_mitsuba(BALL, glass_of_mitsuba(CROWN)),
        "drop": ball_of_mitsuba(DROP, glass_of_mitsuba(WATER, CROWN)),
        "silvered": ball_of_mitsuba(SILVERED, mirror),
    }
    return hg.Scene(camera(), (), surfaces=(*both, *ours), environment=sky()), theirs


def cloud_in_glass():
    """A volume box within a ball of glass."""
    cube = {"type": "cube", "bsdf": {"type": "null"}, "interior": medium_of_mitsuba(TAU)}
    theirs = {"cloud": cube, "glass": ball_of_mitsuba(AROUND, glass_of_mitsuba(CROWN))}
    return hg.Scene(camera(), (), (box_of_cloud(TAU),), (ball_of(AROUND, "glass"),), environment=sky()), theirs


@pytest.mark.by_night("cloud_in_glass")
@pytest.mark.parametrize("made", [balls, cloud_in_glass])
def test_mirrors_and_glass_show_what_mitsuba_shows(made):
    scene, theirs = made()
    theirs["lamp"] = emitter_of(sky())
    assert_same_radiance(scene, *pictures_of_mitsuba("volpath", theirs, depth=-1, paths=PATHS))
