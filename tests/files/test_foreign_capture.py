"""Captures that other programs wrote load as they are; bad ones are refused in one line."""

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.jpeg import read_jpeg
from hagoromo.files.png import write_png
from hagoromo.photograph.capture import Capture, load_capture, save_capture
from tests.data import DATA, real_data

NOT_RIGID = np.diag([1.0, 1.0, 1.2, 1.0]).tolist()


def write_foreign(folder: Path, image: np.ndarray, top: dict | None = None, **frame) -> Path:
    """A one-frame capture as another program writes it."""
    write_png(folder / "a.png", image)
    pose = np.eye(4).tolist()
    record = {"fl_x": 20.0, "frames": [{"file_path": "a.png", "transform_matrix": pose, **frame}], **(top or {})}
    (folder / "transforms.json").write_text(json.dumps(record))
    return folder


def test_numbers_become_light_by_black_and_white_level_exposure_time_and_iso(tmp_path):
    """(DN − black)/(white − black) / exposure_s · 100/ISO, float32 rounding; shot and rounding noise by the gain."""
    numbers = np.random.default_rng(1).integers(600, 9000, (5, 7, 3)).astype(np.uint16)
    sensor = {"black_level": 512, "white_level": 10_000, "bits": 14, "gain": 2.0, "read_noise": 3.0}
    write_foreign(tmp_path, numbers, {"sensor": sensor}, exposure_s=0.25, iso=200)
    shot = load_capture(tmp_path).photographs[0]
    np.testing.assert_allclose(shot.values, (numbers - 512.0) / (10_000 - 512.0) / 0.25 / 2.0, rtol=1e-6)
    electrons = numbers - 512.0  # gain 1 at ISO 200
    variance = (electrons + 1.0 + 9.0 + 1.0 / 12.0) * (shot.values / electrons) ** 2
    np.testing.assert_allclose(shot.variance, variance, rtol=1e-5)
    assert shot.camera.sensor is not None and shot.lamps == () and shot.mask.all()


def test_eight_bits_are_linear_unless_the_file_says_srgb(tmp_path):
    numbers = np.arange(5 * 7 * 3, dtype=np.uint8).reshape(5, 7, 3) * 2
    plain = load_capture(write_foreign(tmp_path, numbers)).photographs[0]
    np.testing.assert_allclose(plain.values, numbers / 255.0, rtol=1e-6)
    assert plain.camera.sensor is None
    curved = load_capture(write_foreign(tmp_path, numbers, {"transfer": "srgb"})).photographs[0]
    v = numbers / 255.0
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
    np.testing.assert_allclose(curved.values, linear, rtol=1e-6)
    assert (curved.variance > 0.0).all()
    again = load_capture(save_capture(Capture((curved,)), tmp_path / "b")).photographs[0]
    np.testing.assert_array_equal(again.values, curved.values)
    np.testing.assert_array_equal(again.variance, curved.variance)


def test_saturated_transparent_and_masked_pixels_are_invalid(tmp_path):
    image = np.full((5, 7, 4), 100, np.uint8)
    image[..., 3] = 255
    image[0, 0, 1], image[1, 1, 3], image[1, 2, 3] = 255, 0, 128
    mask = np.full((5, 7), 255, np.uint8)
    mask[3, 4] = 0
    write_png(tmp_path / "mask.png", mask)
    shot = load_capture(write_foreign(tmp_path, image, mask_path="mask.png")).photographs[0]
    assert sorted(map(tuple, np.argwhere(~shot.mask).tolist())) == [(0, 0), (1, 1), (1, 2), (3, 4)]
    assert shot.values.shape == (5, 7, 3)


def test_opengl_axes_become_opencv_axes(tmp_path):
    """At the identity pose an OpenGL camera looks along −z: (0.1, 0.2, −2) is right of the middle, above."""
    shot = load_capture(write_foreign(tmp_path, np.zeros((5, 7, 3), np.uint8))).photographs[0]
    x, y = shot.camera.project([0.1, 0.2, -2.0])
    assert (x, y) == (pytest.approx(3.5 + 20.0 * 0.05), pytest.approx(2.5 - 20.0 * 0.1))


def test_lamps_of_a_frame_are_those_it_names(tmp_path):
    (tmp_path / "led.csv").write_text("wavelength_nm,value\n400,1\n700,2\n")
    top = {
        "lamps": [
            {"position": [1, 2, 3], "intensity": [1, 2, 3], "spectrum": "D65", "name": "a"},
            {"to_lamp": [0, 0, 2], "spectrum": "led.csv"},
            {"to_lamp": [0, 1, 0], "spectrum": {"wavelengths": [400, 700], "values": [1, 1]}},
        ]
    }
    image = np.zeros((5, 7, 3), np.uint8)
    shot = load_capture(write_foreign(tmp_path, image, top, lamps=[1, 0], pl_pos=[4, 5, 6])).photographs[0]
    far, near, point = shot.lamps
    np.testing.assert_array_equal(far.to_lamp, (0.0, 0.0, 1.0))
    assert far.spectrum.at(550.0) == 1.5
    assert near.name == "a" and near.intensity == (1.0, 2.0, 3.0) and near.spectrum.at(560.0) == 100.0
    np.testing.assert_array_equal(point.position, (4.0, 5.0, 6.0))
    assert point.intensity == 1.0


def test_linear_exr_without_variance_gets_an_assumed_one(tmp_path):
    write_foreign(tmp_path, np.zeros((5, 7, 3), np.uint8), file_path="a.exr", exposure_s=0.5)
    values = np.random.default_rng(2).uniform(0.0, 9.0, (5, 7, 3)).astype(np.float32)
    values[1, 2, 0] = np.nan
    channels = {name: np.ascontiguousarray(values[..., k]) for k, name in enumerate("RGB")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "a.exr"))  # as another program does: this package writes no NaN
    capture = load_capture(tmp_path)
    (shot,) = capture.photographs
    np.testing.assert_array_equal(shot.values, 2.0 * values)
    assert (~shot.mask).sum() == 1 and (shot.variance[shot.mask] > 0.0).all()
    layers, _ = read_exr(save_capture(capture, tmp_path / "own") / "images" / "0000.exr")
    assert all(np.isfinite(layer).all() for layer in layers.values()) and layers["R"][1, 2] == 0.0


def test_jpeg_reads_as_stored_and_refuses_halves(tmp_path):
    """A flat colour survives JPEG to 2 of 255 (quality 95)."""
    path = tmp_path / "a.jpg"
    image = np.full((24, 32, 3), (200, 120, 40), np.uint8)
    assert cv2.imwrite(str(path), image[..., ::-1])
    assert np.abs(read_jpeg(path).astype(int) - image).max() <= 2
    whole = path.read_bytes()
    for broken in (whole[: len(whole) // 2], b"", b"P6 3 3", whole[:4] + whole[-2:]):
        path.write_bytes(broken)
        with pytest.raises(InputError, match=r"a\.jpg") as refused:
            read_jpeg(path)
        assert "\n" not in str(refused.value)


@real_data("ngp_fox")
def test_the_fox_loads_with_its_frames_that_are_absent_left_out():
    """instant-ngp's capture: it lists 67 frames and has 50; JPEG, distortion, no lamps, w and h written as 1080.0."""
    with pytest.warns(UserWarning, match="1 of 6 frames have no image"):
        fox = load_capture(DATA / "ngp_fox", slice(6))
    assert len(fox.photographs) == 5 and fox.name == "ngp_fox"
    for shot in fox.photographs:
        assert shot.values.shape == (1920, 1080, 3) and shot.lamps == ()
        assert shot.camera.distortion[0] == 0.0578421 and shot.mask.mean() > 0.9


@real_data("ngp_fox")
def test_the_fox_stands_where_its_cameras_look():
    """The rays through the middle of all images meet within a quarter of the cameras' mean distance from that point."""
    with pytest.warns(UserWarning, match="frames have no image"):
        cameras = [p.camera for p in load_capture(DATA / "ngp_fox", slice(0, None, 9)).photographs]
    assert_rays_meet(cameras, 0.25)


@real_data("nerf_lego_30")
def test_nerf_lego_loads_with_its_alpha_as_mask():
    """RGBA, camera_angle_x only, no suffix in file_path; the cameras stand 4.03 from the origin and look at it."""
    lego = load_capture(DATA / "nerf_lego_30" / "transforms_train.json", slice(0, None, 10))
    assert len(lego.photographs) == 3
    for shot in lego.photographs:
        assert shot.values.shape == (800, 800, 3) and 0.05 < shot.mask.mean() < 0.5
        assert shot.camera.focal[0] == pytest.approx(1111.11, abs=0.01)
        assert np.linalg.norm(shot.camera.position) == pytest.approx(4.031, abs=0.001)
        np.testing.assert_allclose(shot.camera.project([0.0, 0.0, 0.0]), (400.0, 400.0), atol=0.01)


def assert_rays_meet(cameras: list[Camera], share: float) -> None:
    """The point nearest to all the cameras' middle rays, by least squares."""
    across = [np.eye(3) - np.outer(d, d) for d in (c.camera_to_world[:3, 2] for c in cameras)]
    meeting = np.linalg.solve(sum(across), sum(p @ c.position for p, c in zip(across, cameras, strict=True)))
    miss = [np.linalg.norm(p @ (meeting - c.position)) for p, c in zip(across, cameras, strict=True)]
    assert max(miss) < share * np.mean([np.linalg.norm(c.position - meeting) for c in cameras])
    assert all((meeting - c.position) @ c.camera_to_world[:3, 2] > 0.0 for c in cameras)


@pytest.mark.parametrize(
    ("top", "frame", "message"),
    [
        ({}, {"file_path": "../a.png"}, "points outside"),
        ({}, {"file_path": "/etc/passwd"}, "points outside"),
        ({}, {"mask_path": "../../mask.png"}, "points outside"),
        ({}, {"file_path": 3}, "file_path must be a text"),
        ({}, {"file_path": "transforms.json"}, "not an image of a known format"),
        ({}, {"file_path": "b.png"}, "none of the 1 frames"),
        ({}, {"mask_path": "b.png"}, "does not exist"),
        ({}, {"transform_matrix": [[1, 2], [3]]}, "pose"),
        ({}, {"transform_matrix": "identity"}, "pose"),
        ({}, {"transform_matrix": NOT_RIGID}, "rotation"),
        ({}, {"transform_matrix": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "rotation"),
        ({}, {"exposure_s": 0}, "exposure_s must be"),
        ({}, {"sensor": 5}, "sensor must be a table"),
        ({}, {"sensor": {"blak_level": 5}}, "unknown key 'blak_level'"),
        ({}, {"lamps": [0]}, "indices below 0"),
        ({}, {"lamps": 0}, "indices below 0"),
        ({}, {"pl_pos": [1, 2]}, "pl_pos must be"),
        ({"w": 9}, {}, "must be 9"),
        ({"fl_x": -3}, {}, "fl_x must be"),
        ({"fl_x": None}, {}, "fl_x must be"),
        ({"k4": 0.1}, {}, "fisheye"),
        ({"camera_model": "OPENCV_FISHEYE"}, {}, "camera_model"),
        ({"transfer": "log"}, {}, "linear, srgb"),
        ({"sensor": {"black_level": 300}}, {}, "not above"),
        ({"sensor": {"bits": 4}}, {}, "more than 4 bits"),
        ({"sensor": {"response": "nobody.csv"}}, {}, "does not exist"),
        ({"sensor": {"response": "nobody"}}, {}, "no camera response"),
        ({"lamps": [{"position": [1, 2, 3], "to_lamp": [0, 0, 1]}]}, {}, "either"),
        ({"lamps": [{"position": [1, 2, 3], "spectrum": "../led.csv"}]}, {}, "points outside"),
        ({"lamps": [{"position": [1, 2, "x"]}]}, {}, "position must be"),
        ({"frames": []}, {}, "none of the 0 frames"),
        ({"frames": {}}, {}, "frames must be a list"),
        ({"points_path": "points.exr"}, {}, "does not exist"),
    ],
)
def test_a_bad_capture_is_refused_in_one_line(tmp_path, top, frame, message):
    write_foreign(tmp_path, np.full((5, 7, 3), 90, np.uint8), top, **frame)
    with pytest.raises(InputError, match=message) as refused:
        load_capture(tmp_path)
    assert "\n" not in str(refused.value)


def test_a_capture_without_transforms_or_with_half_of_them_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"has no transforms\.json: give a capture"):
        load_capture(tmp_path)
    text = (write_foreign(tmp_path, np.zeros((5, 7, 3), np.uint8)) / "transforms.json").read_text()
    (tmp_path / "transforms.json").write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match="not valid JSON"):
        load_capture(tmp_path)
