"""Law: what a cut leaves of a picture is the picture of the matter on the side that is seen, lit by all of it."""

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

MATTE = Reflectance(0.2, 0.0, 0.2, 1.5, Spectrum.constant(0.8), element="sphere")
TAU, SIDE = 40.0, 0.1
CAMERA = Camera(13, 11, (200.0, 200.0), (6.5, 5.5))
LAMPS = (Lamp(to_lamp=(0.0, 0.0, 1.0), intensity=2.0),)


def slab(**more) -> VolumeBox:
    """A cube of SIDE [m] about (0, 0, 0), its density 1 everywhere."""
    shape, pose = (20, 20, 20), np.eye(4)
    pose[:3, 3] = -SIDE / 2
    axis = np.broadcast_to([0.0, 0.0, 1.0], (*shape, 3))
    return VolumeBox.from_arrays(np.ones(shape), axis, SIDE / 20, TAU, [MATTE], pose=pose, **more)


def opacity(eye, cut):
    """Of the middle of the picture of the slab, from `eye`."""
    scene = Scene(CAMERA.look_at(eye, (0, 0, 0), (0, 0, 1)), LAMPS, (slab(),))
    return render(scene, Settings(shadows="none", tolerance=0.002, cut=cut)).alpha[5, 6]


@pytest.mark.parametrize("eye", [(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)])
@pytest.mark.parametrize("place", [-0.02, 0.0, 0.03])
def test_opacity_behind_a_cut_is_that_of_the_rest_of_the_slab(eye, place):
    """From either side of the plane: α = 1 − exp(−τ s), s the length of the rest; at its ends densities fall to 0
    over half a voxel, which the whole slab tells.
    """
    whole = -np.log1p(-opacity(eye, None)) / TAU
    rest = -np.log1p(-opacity(eye, (0.0, 1.0, 0.0, place))) / TAU
    assert np.isclose(rest, whole / 2 - place, atol=2e-3 * SIDE)


def test_a_cut_that_leaves_everything_leaves_the_picture():
    scene = Scene(CAMERA.look_at((0.3, -1, 0.4), (0, 0, 0)), LAMPS, (slab(),))
    before, after = render(scene).weights, render(scene, Settings(cut=(0.0, 0.0, 2.0, -9.0))).weights
    assert np.allclose(after, before, rtol=1e-6)
    assert not render(scene, Settings(cut=(0.0, 0.0, 1.0, 9.0))).alpha.any()


def test_light_goes_through_what_is_not_seen():
    """The floor behind a cut block stays in its shadow."""
    block = Surface.sphere((0.0, 0.0, 0.2), 0.05, Reflectance(0.2, 0.0, 0.2, 1.5, Spectrum.constant(0.8)))
    floor = Surface.floor(0.0, 1.0, Reflectance(0.2, 0.0, 0.2, 1.5, Spectrum.constant(0.8)))
    scene = Scene(CAMERA.look_at((0.0, -1.0, 1.0), (0, 0, 0)), LAMPS, surfaces=(block, floor))
    shadow = render(scene, Settings(cut=(0.0, 0.0, -1.0, -0.05)))
    assert shadow.weights[5, 6].sum() == 0.0 and shadow.alpha[5, 6] == 1.0
    assert shadow.weights[0, 0].sum() > 0.0
    lit = render(scene, Settings(cut=(0.0, 0.0, -1.0, -0.05), shadows="none"))
    assert lit.weights[5, 6].sum() > 0.0


def test_a_cut_holds_far_from_the_worlds_origin():
    away = np.array([5000.0, -3000.0, 800.0])
    box = slab()
    pose = box.pose.copy()
    pose[:3, 3] += away
    here = opacity((0.0, -1.0, 0.0), (0.0, 1.0, 0.0, 0.01))
    scene = Scene(CAMERA.look_at(away - (0, 1, 0), away, (0, 0, 1)), LAMPS, (box.with_pose(pose),))
    there = render(scene, Settings(shadows="none", tolerance=0.002, cut=(0.0, 1.0, 0.0, away[1] + 0.01))).alpha[5, 6]
    assert np.isclose(there, here, atol=1e-3)


@pytest.mark.parametrize("cut", [(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, float("nan"))])
def test_numbers_that_make_no_plane_are_refused(cut):
    with pytest.raises(InputError, match="cut is"):
        Settings(cut=cut)
    with pytest.raises(InputError, match="mode is full"):
        render(Scene(CAMERA.look_at((0, -1, 0), (0, 0, 0)), LAMPS, (slab(),)), Settings(cut=(0, 0, 1, 0)), mode="full")
