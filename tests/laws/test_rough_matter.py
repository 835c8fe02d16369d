"""Matter that differs from voxel to voxel: a step is shaded at several places; shadows are marched or mapped."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, vectors
from hagoromo.image.prepared import prepared_scene
from hagoromo.transport.lighting import WayToLamp
from hagoromo.transport.march import optical_depth
from hagoromo.transport.medium import Medium
from hagoromo.transport.shadow import HIDDEN_TRANSMITTANCE, brute_attenuation, marching_is_quicker

WHITE = hg.Spectrum.constant(1.0)


def noisy_ball(voxels: int = 40, element: Any = "plane", smooth: bool = False) -> hg.VolumeBox:
    """Random densities in a ball, normals by their gradient; smooth: by that of the ball."""
    centres = (np.arange(voxels) + 0.5) / voxels * 2.0 - 1.0
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    ball = np.clip((0.8 - np.sqrt(x * x + y * y + z * z)) * voxels / 12.8, 0.0, 1.0)
    density = ball * (0.5 + np.random.default_rng(0).random(ball.shape))
    slopes = [np.asarray(slope) for slope in np.gradient(density)]
    axis = np.stack([x, y, z] if smooth else [-slope for slope in slopes[::-1]], axis=-1)
    axis /= np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-6)
    matter, pose = hg.Reflectance(0.25, 0.3, 0.2, 1.5, WHITE, element=element), np.eye(4)
    pose[:3, 3] = -1.0
    density, axis = density.astype(np.float32), axis.astype(np.float32)
    return hg.VolumeBox.from_arrays(density, axis, 2.0 / voxels, 0.4 * voxels, [matter], pose=pose)


def scene_of(box: hg.VolumeBox, pixels: int = 48) -> hg.Scene:
    camera = hg.Camera(pixels, pixels, (1.25 * pixels, 1.25 * pixels), (0.5 * pixels, 0.5 * pixels))
    places = (3.0, 3.0, 3.0), (-3.0, 2.0, 3.0)
    lamps = tuple(hg.Lamp(position=place, intensity=27.0, spectrum=WHITE) for place in places)
    return hg.Scene(camera.look_at((0, 0, 3.0), (0, 0, 0), (0, 1, 0)), lamps, (box,))


def error(seen, true):
    matter = true > 0.0
    return np.sqrt(np.mean((seen - true)[matter] ** 2)) / true[matter].mean()


def test_several_places_of_a_step_halve_the_error_of_rough_matter(monkeypatch):
    """One place, the centroid, shows axes between eight voxels, which are smoother than those at the faces of cells.
    References are marches of short steps, without shadows.
    """
    scene = scene_of(noisy_ball())

    def seen(tolerance):
        return hg.render(scene, hg.Settings(shadows="none", tolerance=tolerance)).weights.sum(axis=-1)

    true, several = seen(0.0006), seen(0.04)
    monkeypatch.setattr(Medium, "_is_rough", lambda self: False)
    fine, one = seen(0.0006), seen(0.04)
    assert error(several, true) < 0.5 * error(one, true)
    assert error(several, fine) < 0.5 * error(one, fine), "by either reference"


@pytest.mark.parametrize(("element", "smooth", "rough"), [
    ("plane", False, True), ("plane", True, False), ("sphere", False, False), ("cylinder", False, False),
])  # fmt: skip
def test_matter_is_rough_where_its_axes_differ(element, smooth, rough):
    """Of smooth matter nothing changes; cylinders take ten nodes a place; spheres have no axis that would be seen."""
    assert Medium([noisy_ball(element=element, smooth=smooth)]).rough == rough


def test_shadows_of_a_coarse_box_do_not_follow_the_voxels_of_a_fine_one():
    """A dense ball of coarse voxels, beside a speck of fine ones: maps show what marched shadows do, within 1 %."""
    ball, speck, pose = noisy_ball(24, "sphere", smooth=True), np.ones((4, 4, 4)), np.eye(4)
    pose[:3, 3] = 0.9, 0.9, 0.9
    up = np.broadcast_to((0.0, 0.0, 1.0), (4, 4, 4, 3))
    fine = hg.VolumeBox.from_arrays(speck, up, 2.0 / 24 / 40, 1.0, ball.materials, pose=pose)
    scene = scene_of(replace(ball, tau=120.0 * 24 / 2.0))
    scene = hg.Scene(scene.camera, scene.lamps[:1], (*scene.boxes, fine))
    mapped, marched = (hg.render(scene, hg.Settings(4, shadows=s)).weights.sum(axis=-1) for s in ("map", "march"))
    assert error(mapped, marched) < 0.01


def test_shadows_of_few_rays_are_marched_in_dense_matter_alone(monkeypatch):
    """A map of more rays than the picture looks up is not made, unless its size was asked for."""
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (9, 201, 201, 3))
    matter = hg.Reflectance(0.25, 0.3, 0.2, 1.5, WHITE)
    plates = (hg.VolumeBox.from_arrays(np.ones(up.shape[:3]), up, 0.01, 100.0 * each, [matter]) for each in (1.0, 0.01))
    dense, thin = (Medium([plate]) for plate in plates)
    assert marching_is_quicker(dense, 640, 128**2)
    assert not marching_is_quicker(dense, 640, 512**2)
    assert not marching_is_quicker(thin, 640, 128**2)
    loose = Medium(dense.boxes, 0.16)  # whose small steps are joined: fewer samples look up shadows
    assert [marching_is_quicker(each, 640, 576**2) for each in (dense, loose)] == [False, True]
    assert not marching_is_quicker(Medium([noisy_ball(smooth=True)]), 640, 128**2), "maps of small boxes are quick"
    made = []
    monkeypatch.setattr(prepared_scene, "mapped_attenuation", lambda *some: made.append(some[2]))
    scene = scene_of(dense.boxes[0])
    for asked in (None, 64):
        prepared_scene.PreparedScene(scene, hg.Settings(shadow_resolution=asked))
    assert made == [64]


def test_a_hidden_lamp_ends_its_shadow_ray():
    """What is cut off is at most HIDDEN_TRANSMITTANCE of a lamp, a tenth of the tolerance; all else is as it was. Of a
    point of which the eye sees little it is more, in proportion, up to MOST_HIDDEN.
    """
    jit, medium = arrays(), Medium([noisy_ball(smooth=True)])
    point = vectors(np.linspace([0.0, 0.0, 0.9], [0.0, 0.0, 0.0], 200))
    to_lamp, far = jit.Array3f(0.0, 0.0, 1.0), jit.Float(10.0)
    cut, little = (
        np.array(brute_attenuation(medium)(0, WayToLamp(point, to_lamp, far, jit.Float(0), jit.Float(seen), None)))
        for seen in (1.0, 0.5)
    )
    whole = np.exp(-np.array(optical_depth(medium, point, to_lamp, jit.Float(0), far, jit.Float(np.inf))))
    seen = whole > HIDDEN_TRANSMITTANCE
    assert 20 < seen.sum() < 180
    assert np.allclose(cut[seen], whole[seen], rtol=1e-5), "but for the two functions of the exponential"
    assert (cut[~seen] <= 1.001 * HIDDEN_TRANSMITTANCE).all()
    assert (cut[~seen] != whole[~seen]).any()
    assert np.allclose(little[whole > 2.0 * HIDDEN_TRANSMITTANCE], whole[whole > 2.0 * HIDDEN_TRANSMITTANCE], rtol=1e-5)
    assert (little <= np.maximum(1.001 * whole, 2.0 * HIDDEN_TRANSMITTANCE)).all()
    assert (np.abs(little - cut)[~seen] > 0.0).any()
