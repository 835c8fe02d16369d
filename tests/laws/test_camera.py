"""Projection and its inverse, lens distortion and its inverse, conventions of the camera frame."""

import drjit as dr
import numpy as np
import pytest

from hagoromo import backend
from hagoromo.camera.camera import Camera
from hagoromo.camera.lens import distort, lens_from_coefficients, undistort
from hagoromo.camera.pose import mitsuba_from_opencv, opencv_from_opengl, opengl_from_opencv
from hagoromo.errors import InputError

BARREL = (-0.28, 0.09, 0.0007, -0.0011, -0.012)
PHONE = (0.0578421, -0.0805099, -0.000980296, 0.00015575, 0.0)  # bulges first, then turns
PINCUSHION = (0.21, 0.05, -0.003, 0.002, 0.004)
RATIONAL = (0.31, -0.11, 0.0009, -0.0006, 0.02, 0.61, -0.05, 0.03)  # a wide lens as OpenCV fits it
POLE = (-0.2, 0.03, 0.0008, 0.0011, 0.0, -0.5, 0.0, 0.0)  # the denominator is 0 at r² = 2
LENSES = (BARREL, PHONE, PINCUSHION, RATIONAL, POLE)


def camera(distortion=(0.0,) * 5) -> Camera:
    plain = Camera(331, 257, (311.0, 317.0), (163.7, 131.2), distortion)
    return plain.look_at(eye=(1.3, -2.1, 0.7), target=(0.1, 0.2, 0.3))


def image_points(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform((0.0, 0.0), (331.0, 257.0), (count, 2))


@pytest.mark.parametrize("distortion", [(0.0,) * 5, *LENSES])
def test_projection_is_the_inverse_of_unprojection(distortion):
    """Image point → ray → any point on it → the same image point, to 1e-9 px (double precision leaves 1e-12)."""
    eye, xy = camera(distortion), image_points(997, 1)
    for distance in (0.03, 1.7, 4000.0):
        back = eye.project(eye.position + distance * eye.unproject(xy))
        assert np.abs(back - xy).max() < 1e-9


@pytest.mark.parametrize("distortion", LENSES)
def test_projection_agrees_with_opencv(distortion):
    """To 1e-9 px, of 300 px: both evaluate one polynomial in double precision."""
    import cv2

    eye = camera(distortion)
    points = np.random.default_rng(2).uniform(-0.4, 0.7, (499, 3))
    rotation = cv2.Rodrigues(eye.world_to_camera[:3, :3])[0]
    (ax, ay), (x0, y0) = eye.focal, eye.principal
    intrinsics = np.array([[ax, 0.0, x0], [0.0, ay, y0], [0.0, 0.0, 1.0]])
    theirs = cv2.projectPoints(points, rotation, eye.world_to_camera[:3, 3], intrinsics, np.array(distortion))[0]
    assert np.abs(eye.project(points) - theirs[:, 0]).max() < 1e-9


@pytest.mark.parametrize("distortion", LENSES)
def test_unprojection_agrees_with_opencv(distortion):
    """To 1e-9 px of the undistorted image; OpenCV iterates until its own step is below 1e-14."""
    import cv2

    eye, xy = camera(distortion), image_points(499, 3)
    intrinsics = np.array([[311.0, 0.0, 163.7], [0.0, 317.0, 131.2], [0.0, 0.0, 1.0]])
    enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    theirs = cv2.undistortPoints(xy[:, None], intrinsics, np.array(distortion), criteria=enough)[:, 0]
    local = eye.unproject(xy) @ eye.world_to_camera[:3, :3].T
    assert np.abs(local[:, :2] / local[:, 2:] - theirs).max() * 317.0 < 1e-9


def test_eq_9_is_the_projection_without_distortion():
    eye, points = camera(), np.random.default_rng(4).uniform(-0.5, 0.5, (211, 3))
    x = eye.matrix @ np.concatenate([points, np.ones((211, 1))], axis=1).T
    assert np.abs((x[:2] / x[2]).T - eye.project(points)).max() < 1e-10  # rounding of 300 px


def test_the_centre_of_a_pixel_is_half_a_pixel_from_its_corner():
    eye = Camera(7, 5, (10.0, 10.0), (3.5, 2.5))
    np.testing.assert_array_equal(eye.pixel_directions()[2, 3], (0.0, 0.0, 1.0))
    right_of_it = eye.pixel_directions()[2, 4]
    np.testing.assert_allclose(eye.project(right_of_it), (4.5, 2.5), atol=1e-12)
    assert right_of_it[0] > 0.0 and eye.pixel_directions()[3, 3][1] > 0.0  # +x right, +y down


def test_points_behind_the_camera_have_no_image():
    eye = camera()
    behind = eye.position - eye.camera_to_world[:3, 2]
    assert np.isnan(eye.project([behind, eye.position])).all()


@pytest.mark.parametrize("rational", [(0.0, 0.0, 0.0), (0.3, 0.2, 0.1)])
def test_the_inverse_holds_in_the_whole_field_of_every_lens(rational):
    """For 499 random lenses, 101 points each, to 1e-12 where the slope of the image across the field is above 0.05.

    The error is the rounding (1e-16) over that slope, which falls to 0 at the limit of the field: no bound holds there;
    nor beside a pole of the rational model, where the image is stretched without limit (asked up to a thousandfold).
    """
    random = np.random.default_rng(5)
    limits = np.array([0.6, 0.6, 0.003, 0.003, 0.4, *rational])  # wider than lenses are
    lenses = np.repeat([lens_from_coefficients(k) for k in random.uniform(-limits, limits, (499, 8))], 101, axis=0).T
    field = np.minimum(lenses[8], 9.0)
    r, angle = np.sqrt(field * random.uniform(0.0, 0.996, field.size)), random.uniform(0.0, 2 * np.pi, field.size)
    slope = slope_of_the_image(lenses, r)
    double = backend.arrays().Float64
    lens = type(lens_from_coefficients(BARREL))(*(double(k) for k in lenses))
    x, y = double(r * np.cos(angle)), double(r * np.sin(angle))
    at_x, at_y = undistort(*distort(x, y, lens), lens)
    error = np.hypot((at_x - x).numpy(), (at_y - y).numpy())
    assert error[(slope > 0.05) & (slope < 1000.0)].max() < 1e-12


def slope_of_the_image(lens, r):
    """d/dr of the imaged radius, by the quotient rule, where p1 = p2 = 0."""
    k1, k2, _, _, k3, k4, k5, k6 = lens[:8]
    over, under = (1 + r**2 * (a + r**2 * (b + r**2 * c)) for a, b, c in ((k1, k2, k3), (k4, k5, k6)))
    rise, fall = (r * (2 * a + r**2 * (4 * b + r**2 * 6 * c)) for a, b, c in ((k1, k2, k3), (k4, k5, k6)))
    return over / under + r * (rise * under - over * fall) / under**2


@pytest.mark.parametrize("distortion", [BARREL, PHONE, RATIONAL])
def test_outside_the_field_there_is_no_point(distortion):
    lens = lens_from_coefficients(distortion)
    limit = lens.field**0.5
    assert abs(slope_of_the_image(lens, limit)) < 1e-9
    assert np.isnan(distort(1.001 * limit, 0.0, lens)).all()
    edge = max(distort(0.999 * limit, 0.0, lens)[0], distort(0.99 * limit, 0.0, lens)[0])
    assert np.isnan(undistort(1.02 * edge, 0.0, lens)).all()
    far = camera(distortion)
    assert np.isnan(far.unproject([9000.0, 9000.0])).all()


def test_python_floats_and_dr_jit_arrays_see_one_lens():
    """The same lens in single precision to 1e-6, ten of its roundings."""
    lens, jit = lens_from_coefficients(BARREL), backend.arrays()
    x, y = undistort(*distort(0.31, -0.22, lens), lens)
    assert abs(x - 0.31) < 1e-14 and abs(y + 0.22) < 1e-14
    single = undistort(*distort(jit.Float(0.31), jit.Float(-0.22), lens), lens)
    assert abs(single[0][0] - 0.31) < 1e-6 and abs(single[1][0] + 0.22) < 1e-6


@pytest.mark.parametrize("distortion", [(0.0,) * 5, *LENSES])
def test_rays_agree_with_unprojection(distortion):
    """Single precision: 1e-6 is ten roundings of a unit vector."""
    jit, eye, xy = backend.arrays(), camera(distortion), image_points(997, 6)
    origin, direction = eye.rays(jit.Float(xy[:, 0]), jit.Float(xy[:, 1]))
    assert np.abs(direction.numpy().T - eye.unproject(xy)).max() < 1e-6
    assert np.abs(origin.numpy()[:, 0] - eye.position).max() < 1e-6


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BARREL])
def test_a_camera_that_moves_compiles_no_new_kernel(distortion):
    jit, misses = backend.arrays(), []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for angle in (0.1, 0.2, 0.3):
            eye = camera(distortion).look_at((np.cos(angle), np.sin(angle), 0.5), (0.0, 0.0, angle))
            dr.kernel_history_clear()
            dr.eval(eye.rays(jit.Float([1.0, 7.0, 30.0]), jit.Float([2.0, 3.0, 5.0])))
            misses.append(sum(not k["cache_hit"] for k in dr.kernel_history([dr.KernelType.JIT])))
    assert misses[1:] == [0, 0]


def test_look_at_sees_its_target_in_the_middle_and_up_above_it():
    eye = Camera(331, 257, (311.0, 317.0), (163.7, 131.2)).look_at((3.0, 1.0, 2.0), (0.0, 0.5, 0.3))
    np.testing.assert_allclose(eye.project([0.0, 0.5, 0.3]), eye.principal, atol=1e-10)
    np.testing.assert_allclose(eye.position, (3.0, 1.0, 2.0), atol=1e-14)
    above, beside = eye.project([0.0, 0.5, 0.4]), eye.project([0.0, 0.5, 0.3] + 0.1 * eye.camera_to_world[:3, 0])
    assert above[1] < eye.principal[1] and abs(above[0] - eye.principal[0]) < 1e-9
    assert beside[0] > eye.principal[0]


def test_opengl_and_opencv_poses_are_flips_of_each_other():
    """A Blender camera looks along its −z with +y up: the ray through the middle is −z, a lower pixel lies at −y."""
    pose = camera().camera_to_world
    opengl = opengl_from_opencv(pose)
    np.testing.assert_array_equal(opencv_from_opengl(opengl), pose)
    eye = camera().with_pose(np.linalg.inv(opencv_from_opengl(opengl)))
    np.testing.assert_allclose(eye.unproject(eye.principal), -opengl[:3, 2], atol=1e-14)
    x0, y0 = eye.principal
    assert eye.unproject([x0, y0 + 50.0]) @ opengl[:3, 1] < 0.0 < eye.unproject([x0 + 50.0, y0]) @ opengl[:3, 0]


def test_mitsuba_poses_give_the_same_rays():
    """Mitsuba's own perspective camera at the converted pose, single precision."""
    mi = backend.mitsuba()
    eye = Camera(64, 48, (80.0, 80.0), (32.0, 24.0)).look_at((1.0, 2.0, 0.5), (0.0, 0.0, 0.0))
    theirs = mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2.0 * np.arctan(32.0 / 80.0))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(mitsuba_from_opencv(eye.camera_to_world)),
            "film": {"type": "hdrfilm", "width": 64, "height": 48},
        }
    )
    ray, _ = theirs.sample_ray(0.0, 0.5, mi.Point2f(10.5 / 64, 7.5 / 48), mi.Point2f(0.5), True)
    np.testing.assert_allclose(np.ravel(ray.d), eye.unproject([10.5, 7.5]), atol=1e-5)


def test_binning_keeps_the_directions():
    """The corner shared by k × k pixels is a corner of the binned pixel."""
    full, eye = Camera.preset("canon_eos_kiss_digital"), Camera.preset("canon_eos_kiss_digital", binning=8)
    assert (eye.width, eye.height) == (384, 256)
    corners = np.array([[0.0, 0.0], [100.0, 37.0], [384.0, 256.0]])
    np.testing.assert_allclose(eye.unproject(corners), full.unproject(8 * corners), atol=1e-14)


def test_the_preset_has_the_field_of_view_of_the_data_sheet():
    eye = Camera.preset("canon_eos_kiss_digital", focal_mm=55.0)
    left, right = eye.unproject([[0.0, 1024.0], [3072.0, 1024.0]])
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(np.degrees(2 * np.arctan(22.7 / 2 / 55.0)), abs=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: camera().look_at((1.0, 2.0, 3.0), (1.0, 2.0, 3.0)), "looks at itself"),
        (lambda: camera().look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)), "line of sight"),
        (lambda: camera().look_at((0.0, 1.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "line of sight"),
        (lambda: camera().look_at((0.0, np.nan, 3.0), (0.0, 0.0, 0.0)), "finite"),
        (lambda: camera().with_pose(np.diag([1.0, 1.0, 1.1, 1.0])), "rotation"),
        (lambda: camera().with_pose(np.diag([1.0, 1.0, -1.0, 1.0])), "rotation"),
        (lambda: camera().with_pose(np.eye(3)), "4 × 4"),
        (lambda: Camera(0, 5, (1.0, 1.0), (0.0, 0.0)), "whole numbers"),
        (lambda: Camera(7, 5, (1.0, -1.0), (0.0, 0.0)), "above 0"),
        (lambda: Camera(7, 5, (1.0, 1.0), (0.0, float("inf"))), "finite"),
        (lambda: Camera(7, 5, (1.0, 1.0), (0.0, 0.0), (0.1, 0.2)), "8 finite"),  # type: ignore[arg-type]
        (lambda: camera().binned(2), "divide"),
        (lambda: Camera.preset("canon"), "canon_eos_kiss_digital"),
    ],
)
def test_what_makes_no_camera_is_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=message) as refused:
        make()
    assert "\n" not in str(refused.value)
