"""Round shapes under poses that stretch them: Mitsuba's own sphere takes the longest axis for all three."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.camera.pose import turned_about_axes

AXES = np.array([0.02, 0.035, 0.05])
GREY = hg.Reflectance(0.2, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0))


def pose(axes, shift=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turned_about_axes((25.0, -40.0, 10.0))[:3, :3] * axes, shift
    return matrix


def seen(surface):
    """Points (n, 3) and normals of the surface in a picture, in its own axes before the pose."""
    sensor = hg.Sensor(40_000.0, 40_000.0, 5.0, 10.0, 0.0, 12)
    response = hg.Response.load("canon_eos_300d")
    camera = hg.Camera(120, 100, (900.0, 900.0), (60.0, 50.0), response=response, sensor=sensor)
    camera = camera.look_at((0.1, -0.8, 0.3), (0.0, 0.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(position=(0.3, -0.9, 0.5), spectrum=hg.Spectrum.constant(1.0)),), (), (surface,))
    capture = hg.simulate(scene)
    assert capture.points is not None and capture.normals is not None
    hit = np.linalg.norm(capture.normals, axis=2) > 0.5
    inverse = np.linalg.inv(surface.pose)
    local = capture.points[hit] @ inverse[:3, :3].T + inverse[:3, 3]
    return local, capture.normals[hit] @ surface.pose[:3, :3]  # normals by the transpose of the inverse


def test_an_ellipsoid_is_traced_as_one(capfd):
    local, normals = seen(hg.Surface(GREY, "sphere", pose=pose(AXES)))
    assert len(local) > 1500
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1.0, atol=1e-3)
    cosine = np.sum(local * normals, axis=1) / np.linalg.norm(local, axis=1) / np.linalg.norm(normals, axis=1)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).max() < 2.0 and np.median(cosine) > 0.99999
    assert "uniform" not in "".join(capfd.readouterr())


def test_an_elliptic_cylinder_is_traced_as_one(capfd):
    local, _ = seen(hg.Surface(GREY, "cylinder", pose=pose(AXES[[0, 2, 1]])))
    assert len(local) > 500
    np.testing.assert_allclose(np.linalg.norm(local[:, :2], axis=1), 1.0, atol=1e-3)
    assert "uniform" not in "".join(capfd.readouterr())


@pytest.mark.parametrize(
    ("shape", "axes", "as_mesh"),
    [
        ("sphere", (0.03, 0.03, 0.03), False),
        ("sphere", (0.03, 0.03, 0.0301), True),
        ("cylinder", (0.001, 0.001, 1.0), False),
        ("cylinder", (0.001, 0.00101, 1.0), True),
        ("disk", (0.03, 0.05, 0.02), False),
        ("cube", (0.01, 0.02, 0.03), False),
    ],
)
def test_shapes_stay_exact_where_they_can(shape, axes, as_mesh):
    assert hg.Surface(GREY, shape, pose=pose(np.array(axes))).traced_as_mesh == as_mesh


def test_a_sheared_cylinder_is_no_exact_one():
    sheared = pose(np.full(3, 0.03)) @ np.array([[1, 0, 0.3, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    assert hg.Surface(GREY, "cylinder", pose=sheared).traced_as_mesh


def test_images_on_a_stretched_sphere_ask_for_a_mesh():
    texture = hg.SurfaceTexture(np.full((4, 4, 3), 0.2, np.float32))
    with pytest.raises(hg.InputError, match="is a stretched sphere and has a body_texture: give a mesh with UVs"):
        hg.Surface(GREY, "sphere", pose=pose(AXES), body_texture=texture)
    hg.Surface(GREY, "sphere", pose=pose(np.full(3, 0.03)), body_texture=texture)
