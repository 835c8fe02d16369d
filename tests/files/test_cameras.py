"""Cameras go through the files of other programs and come back; bad files are refused in one line."""

import struct
import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera, read_views, write_views
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.files.png import write_png
from hagoromo.files.record import read_json, write_json
from hagoromo.photograph.capture import load_capture
from hagoromo.photograph.gather import gather
from hagoromo_formats.cameras.colmap import read_points
from tests.data import DATA, real_data

YAML = "%YAML:1.0\n---\n"
SIMPLE = (0.0,) * 8
BROWN = (-0.21, 0.09, 0.001, -0.0007, 0.02, 0.0, 0.0, 0.0)
RATIONAL = (0.31, -0.11, 0.0009, -0.0006, 0.02, 0.61, -0.05, 0.03)
CASES = [
    *[("a.yml", None, k) for k in (SIMPLE, BROWN, RATIONAL)],
    ("a.json", "opencv", RATIONAL),
    *[("a.json", None, k) for k in (SIMPLE, BROWN, RATIONAL)],
    *[("model", None, k) for k in (SIMPLE, (*BROWN[:4], *SIMPLE[4:]), BROWN, RATIONAL)],
    ("model", "colmap-text", RATIONAL),
    ("a_par.txt", None, SIMPLE),
]


def views_of(distortion: tuple[float, ...]) -> dict[str, Camera]:
    lens = Camera(331, 257, (311.25, 317.1), (163.7, 131.2), distortion)
    eyes = np.random.default_rng(3).normal((0.0, 0.0, 3.0), size=(5, 3))
    return {f"images/{k:03d}.png": lens.look_at(eye, (0.1, 0.2, 0.3)) for k, eye in enumerate(eyes)}


@pytest.mark.parametrize(("name", "kind", "distortion"), CASES)
def test_views_come_back_from_every_format(tmp_path, name, kind, distortion):
    """To 1e-6, as the issue asks; the formats hold 15 digits or more."""
    views = views_of(distortion)
    write_views(tmp_path / name, views, kind)
    again = read_views(tmp_path / name, (331, 257))
    assert list(again) == list(views)
    for one, other in zip(views.values(), again.values(), strict=True):
        assert (one.width, one.height) == (other.width, other.height)
        for figure in ("focal", "principal", "distortion", "world_to_camera"):
            np.testing.assert_allclose(getattr(other, figure), getattr(one, figure), rtol=0, atol=1e-6)


def test_opencv_counts_from_the_centre_of_the_first_pixel(tmp_path):
    """OpenCV's own reader and projection of the file, against ours: the same point, ½ px apart."""
    camera = next(iter(views_of(RATIONAL).values()))
    write_views(tmp_path / "a.yml", {"": camera})
    storage = cv2.FileStorage(str(tmp_path / "a.yml"), cv2.FILE_STORAGE_READ)
    k, d = (storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients"))
    point = np.array([[0.2, -0.1, 1.3]])
    theirs = cv2.projectPoints(point, np.zeros(3), np.zeros(3), k, d)[0].ravel()
    np.testing.assert_allclose(camera.with_pose(np.eye(4)).project(point)[0], theirs + 0.5, atol=1e-9)
    assert list(read_views(tmp_path / "a.yml")) == [""]


def test_a_colmap_text_model_as_colmap_writes_it(tmp_path):
    """Comments, an image that saw no point (a blank line), SIMPLE_RADIAL, points; world-to-camera (w, x, y, z)."""
    folder = tmp_path / "sparse" / "0"
    folder.mkdir(parents=True)
    (folder / "cameras.txt").write_text("# Camera list\n3 SIMPLE_RADIAL 331 257 300.5 165 128 -0.05\n")
    (folder / "images.txt").write_text(
        "# Image list\n1 0.5 0.5 0.5 0.5 1 2 3 3 a b.jpg\n10.5 20.5 -1 11 21 7\n2 1 0 0 0 0 0 0 3 c.jpg\n\n"
    )
    (folder / "points3D.txt").write_text("# 3D points\n7 0.1 0.2 0.3 255 0 9 0.75 1 1\n")
    views = read_views(tmp_path)
    assert list(views) == ["a b.jpg", "c.jpg"]
    camera = views["a b.jpg"]
    assert camera.focal == (300.5, 300.5) and camera.principal == (165.0, 128.0) and camera.distortion[0] == -0.05
    cyclic = [[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]  # a third of a turn about (1, 1, 1)
    np.testing.assert_allclose(camera.world_to_camera, cyclic, atol=1e-15)
    points = read_points(tmp_path)
    np.testing.assert_array_equal(points.positions, [[0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(points.colours, [[255, 0, 9]])


def test_a_binary_model_with_points_and_tracks_is_read(tmp_path):
    write_views(tmp_path / "m", views_of(SIMPLE))
    row = struct.pack("<Q3d3BdQ4i", 7, 0.1, 0.2, 0.3, 1, 2, 3, 0.5, 2, 1, 1, 2, 1)
    (tmp_path / "m" / "points3D.bin").write_bytes(struct.pack("<Q", 2) + row + row)
    points = read_points(tmp_path / "m")
    np.testing.assert_array_equal(points.positions, [[0.1, 0.2, 0.3]] * 2)
    assert points.error.tolist() == [0.5, 0.5] and points.colours.tolist() == [[1, 2, 3]] * 2


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_a_binary_model_cut_anywhere_is_refused(tmp_path, name):
    write_views(tmp_path / "m", views_of(SIMPLE))
    whole = (tmp_path / "m" / f"{name}.bin").read_bytes()
    for end in range(0, len(whole), 7):
        (tmp_path / "m" / f"{name}.bin").write_bytes(whole[:end])
        with pytest.raises(InputError, match="cut off"):
            (read_points if name == "points3D" else read_views)(tmp_path / "m")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.yml", "", "cannot be read"),
        ("a.yml", "hello", "cannot be read"),
        ("a.yml", f"{YAML}image_width: 3\n", "no camera_matrix"),
        ("a.yml", f"{YAML}K: !!opencv-matrix\n   rows: 30000\n   cols: 30000\n   dt: d\n   data: [1.]\n", "damaged"),
        ("a.json", '{"camera_matrix": [1, 2]}', "does not hold them"),
        ("a.json", '{"frames": 3}', "frames must be"),
        ("a.json", '{"fl_x": 3}', "lacks the key 'w'"),
        ("a_par.txt", "2\na.png 1 2 3\n", "number of its 1 other lines"),
        ("a_par.txt", "1\na.png 1 2 3\n", "K, R and t are 21"),
        ("a_par.txt", "1\na.png" + " nan" * 21 + "\n", "finite"),
        ("a_par.txt", "1\n../a.png" + " 1" * 21 + "\n", "points outside"),
        ("cameras.txt", "1 OPENCV_FISHEYE 3 5 1 1 1 1 0 0 0 0\n", "model OPENCV_FISHEYE: read are SIMPLE_PINHOLE"),
        ("cameras.txt", "1 PINHOLE 3 5 1 1\n", "takes others"),
        ("cameras.txt", "1 PINHOLE 3 x 1 1 1 1\n", "invalid literal"),
        ("images.txt", "1 1 0 0 0 0 0 0 9 a.png\n\n", "camera 9, which is not listed"),
        ("images.txt", "1 0.5 0 0 0 0 0 0 1 a.png\n\n", "quaternion of length 0.5"),
        ("images.txt", "1 1 0 0 0 0 0\n", "is no image"),
        ("images.txt", "", "lists no image"),
        ("a.xml", "", "no file of cameras"),
    ],
)
def test_a_bad_file_of_cameras_is_refused_in_one_line(tmp_path, name, text, said):
    if name in ("cameras.txt", "images.txt"):
        (tmp_path / "cameras.txt").write_text("1 PINHOLE 3 5 1 1 1 1\n")
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said) as refused:
        read_views(tmp_path / name, None if ".." in text else (3, 5))
    assert "\n" not in str(refused.value)


def test_what_a_format_does_not_hold_is_refused(tmp_path):
    views = views_of(BROWN)
    several = {name: replace(camera, width=331 + i) for i, (name, camera) in enumerate(views.items())}
    for name, kind, what, said in [
        ("a_par.txt", None, views, "undistort"),
        ("b_par.txt", None, {"a b.png": views_of(SIMPLE)["images/000.png"]}, "rename"),
        ("m", "colmap-text", {"a b.png": views["images/000.png"]}, "rename"),
        ("a.yml", None, several, "one lens and there are 5"),
        ("a.tif", None, views, "no suffix"),
    ]:
        with pytest.raises(InputError, match=said):
            write_views(tmp_path / name, what, kind)
        assert not (tmp_path / name).exists()
    with pytest.raises(InputError, match="one lens and there are 5"):
        write_views(tmp_path / "t.json", several)
        read_camera(tmp_path / "t.json")


def test_a_calibration_of_five_coefficients_still_reads(tmp_path):
    lens = {"w": 53, "h": 37, "fl_x": 91.0, "fl_y": 92.0, "cx": 26.0, "cy": 18.0}
    write_json(tmp_path / "c.json", lens | dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.1))
    assert read_camera(tmp_path / "c.json").distortion == (0.1,) * 5 + (0.0,) * 3


def test_cameras_and_images_make_a_capture(tmp_path, capsys):
    """convert --images: from COLMAP's folder to a capture that loads; an absent image is told and left out."""
    views = views_of(BROWN)
    write_views(tmp_path / "m", views)
    (tmp_path / "images").mkdir()
    numbers = np.random.default_rng(1).integers(0, 250, (5, 257, 331, 3)).astype(np.uint8)
    for name, image in list(zip(views, numbers, strict=True))[:3]:
        write_png(tmp_path / name, image)
    with pytest.warns(UserWarning, match="2 of 5 images are absent"):
        gather(views, tmp_path)
    command = ["convert", str(tmp_path / "m"), "--images", str(tmp_path), "--out", str(tmp_path / "capture")]
    with warnings.catch_warnings():
        warnings.simplefilter("always")  # the command line prints them
        assert main(command) == 0
    said = capsys.readouterr()
    assert "a capture of 3 photographs" in said.out and "2 of 5 images are absent" in said.err
    shot = load_capture(tmp_path / "capture").photographs[1]
    np.testing.assert_allclose(shot.values, numbers[1] / 255.0, rtol=1e-6)
    np.testing.assert_allclose(shot.camera.world_to_camera, views["images/001.png"].world_to_camera, atol=1e-9)
    assert main(["convert", str(tmp_path / "m"), "--out", str(tmp_path / "a.yml")]) == 0
    for file in ("m", "a.yml", "m/cameras.bin"):
        assert main(["info", str(tmp_path / file)]) == 0
        assert "views: 5" in capsys.readouterr().out
    write_png(tmp_path / "images/000.png", numbers[0, 1:])
    with pytest.raises(InputError, match="331 × 256 px and its camera 331 × 257"):
        gather({"images/000.png": views["images/000.png"]}, tmp_path)
    with pytest.raises(InputError, match="none of the 5 images"):
        gather(views, tmp_path / "m")


@real_data("middlebury_dino")
def test_the_dino_stands_where_its_cameras_look():
    """In all 16 images the whole figure, brighter than its background, lies in Middlebury's own bounding box of it,
    which fills 66–80 % of them; poses are read to their last digit.
    """
    path = DATA / "middlebury_dino" / "dinoSR_par.txt"
    views = read_views(path)
    assert len(views) == 16 and all((c.width, c.height) == (640, 480) for c in views.values())
    low, high = (-0.061897, -0.018874, -0.057845), (0.010897, 0.068227, 0.015495)
    corners = np.array([[(low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)])
    for name, camera in views.items():
        hull = np.zeros((480, 640), np.uint8)
        cv2.fillConvexPoly(hull, cv2.convexHull(camera.project(corners).astype(np.int32)), 1.0)
        figure = read_picture(path.parent / name).mean(axis=2) > 60
        assert 0.1 < figure.mean() and not (figure & (hull == 0)).any()
    row = path.read_text().splitlines()[3].split()
    given = np.array(row[10:22], float)
    pose = views[row[0]].world_to_camera
    np.testing.assert_allclose(np.concatenate([pose[:3, :3].ravel(), pose[:3, 3]]), given, atol=1e-6)
    assert len(gather(dict(list(views.items())[:2]), path.parent).photographs) == 2


@real_data("ngp_fox")
def test_the_fox_goes_through_colmap_and_back_and_its_absent_images_are_told(tmp_path, capsys):
    """67 frames, 17 without image: the cameras of all of them convert; `info` tells the absent."""
    fox = DATA / "ngp_fox" / "transforms.json"
    views = read_views(fox)
    assert len(views) == len(read_json(fox)["frames"])
    write_views(tmp_path / "m", views)
    again = read_views(tmp_path / "m")
    for name, camera in views.items():
        np.testing.assert_allclose(again[name].world_to_camera, camera.world_to_camera, atol=1e-6)
        np.testing.assert_allclose(again[name].distortion, camera.distortion, atol=1e-6)
    assert main(["info", str(fox)]) == 0
    assert "images_absent: 17" in capsys.readouterr().out
