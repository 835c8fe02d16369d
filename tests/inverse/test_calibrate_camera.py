"""Calibration of a camera: the lens that made the photographs is found, within its own stated errors."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hagoromo.app.calibration_report import residual_plot
from hagoromo.calibration.camera.board import Board
from hagoromo.calibration.camera.calibrate_camera import NAMES, calibrate_camera
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from tests.data import DATA, real_data

BOARD = Board(7, 5, 0.02)
CHARUCO = Board(6, 5, 0.02, marker=0.012, dictionary="4X4_50")
TRUE = Camera(301, 229, (322.0, 327.0), (153.0, 112.0), (-0.21, 0.09, 0.001, -0.0007, 0.0))
WIDE = replace(TRUE, focal=(152.0, 150.0), distortion=(0.31, -0.11, 0.0009, -0.0006, 0.02, 0.61, -0.05, 0.03))
EYES = [(0, 0, -0.25), (0.14, 0.05, -0.2), (-0.13, 0.08, -0.2), (0.04, -0.15, -0.21), (-0.12, -0.11, -0.2)]
REAL = DATA / "opencv_left" / "left"
OFFICIAL_FOCAL = 535.91573396163199  # px: opencv/samples/data/left_intrinsics.yml


@cache
def drawing(board: Board, legacy: bool = False) -> np.ndarray:
    """The board with a white margin of one square, 80 px a square."""
    if not board.marker:
        row, column = np.mgrid[: board.rows + 1, : board.columns + 1]
        squares = np.pad(np.where((row + column) % 2 == 0, 30, 220), 1, constant_values=220)
        return np.kron(squares, np.ones((80, 80))).astype(float)
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}"))
    squares = (board.columns + 1, board.rows + 1)
    charuco = cv2.aruco.CharucoBoard(squares, board.square, board.marker, markers)
    charuco.setLegacyPattern(legacy)
    picture = charuco.generateImage((80 * squares[0], 80 * squares[1]))
    return np.pad(30.0 + 190.0 / 255.0 * picture, 80, constant_values=220.0)


def photograph_of_board(camera: Camera, board: Board, random: np.random.Generator, legacy: bool = False) -> np.ndarray:
    """8-bit photograph, 4 × 4 rays a pixel, 1 % noise: its corners are known to about 0.05 px."""
    row, column = np.mgrid[: camera.height * 4, : camera.width * 4]
    direction = camera.unproject(np.stack([(column + 0.5) / 4, (row + 0.5) / 4], axis=-1))
    at = camera.position[:2] - direction[..., :2] * (camera.position[2] / direction[..., 2])[..., None]
    texture = drawing(board, legacy)
    index = np.nan_to_num(np.floor((at / board.square + 2.0) * 80.0), nan=-1.0).astype(int)  # (0, 0) is a corner
    inside = ((index >= 0) & (index < texture.shape[::-1])).all(axis=-1) & (direction[..., 2] > 0.0)
    seen = texture[np.where(inside, index[..., 1], 0), np.where(inside, index[..., 0], 0)]
    grey = np.where(inside, seen, 220.0).reshape(camera.height, 4, camera.width, 4).mean(axis=(1, 3))
    return np.clip(grey + random.normal(0.0, 2.0, grey.shape), 0, 255).astype(np.uint8)


def photographs_of(camera: Camera, board: Board, eyes=EYES, legacy: bool = False) -> dict[str, np.ndarray]:
    random = np.random.default_rng(5)
    middle = np.array([(board.columns - 1) * board.square / 2, (board.rows - 1) * board.square / 2, 0.0])
    views = [camera.look_at(middle + eye, middle + 0.003 * random.normal(size=3), (0, -1, 0)) for eye in eyes]
    return {f"{k}": photograph_of_board(view, board, random, legacy) for k, view in enumerate(views)}


def assert_within_its_errors(found, true: Camera) -> None:
    """4 standard deviations as stated, for all parameters at once (99.9 % if normal)."""
    expected = dict(zip(NAMES, (*true.focal, *true.principal, *true.distortion), strict=True))
    for name, spread in found.standard_deviation.items():
        assert abs(found.record()[name] - expected[name]) < 4 * spread, name


@pytest.mark.by_night("board1")
@pytest.mark.parametrize("board", [BOARD, CHARUCO])
def test_a_board_photographed_through_a_known_lens_gives_the_lens_back(board):
    photographs = photographs_of(TRUE, board)
    photographs["blank"] = np.zeros((TRUE.height, TRUE.width), np.uint8)
    found = calibrate_camera(photographs, board)
    assert found.skipped == ("blank",)
    assert found.rms < (0.15 if board.marker else 0.1)  # px; of markers' corners OpenCV finds the middle less well
    assert list(found.standard_deviation) == list(NAMES[:9])
    assert_within_its_errors(found, TRUE)
    residuals = np.concatenate(list(found.residuals.values()))
    assert np.sqrt((residuals**2).sum(axis=1).mean()) == pytest.approx(found.rms, rel=1e-4)  # float32 corners
    assert residual_plot(found).startswith(b"\x89PNG")


@pytest.mark.nightly
def test_a_charuco_board_seen_in_part_and_drawn_by_an_old_opencv_is_found():
    """Rows even: before OpenCV 4.6 such a board began with a white square. The image is cut through the board."""
    board = replace(CHARUCO, rows=5)
    for photograph in photographs_of(TRUE, board, legacy=True).values():
        photograph[:, 190:] = 128
        found = board.find(photograph)
        assert found is not None and 8 <= len(found.points) < board.columns * board.rows


@pytest.mark.nightly
def test_the_rational_model_finds_a_lens_that_only_it_describes():
    """Eight coefficients and the focal length are known together, not one by one: judged by where they image points
    of the boards' field, to 0.1 px on average, twice the error of a corner, once the view is turned alike.
    """
    turns = [(1.2, (-1, 1, 1)), (0.9, (1, -1, 1)), (1.1, (-1, -1, 1))]
    eyes = [np.array(EYES), *(nearer * np.array(EYES[1:]) * sides for nearer, sides in turns)]
    photographs = photographs_of(WIDE, BOARD, 0.5 * np.concatenate(eyes))
    found = calibrate_camera(photographs, BOARD, coefficients=8)
    assert list(found.standard_deviation) == list(NAMES)
    at = np.concatenate(list(found.corners.values()))
    ours, theirs = found.camera.unproject(at), WIDE.unproject(at)
    turned = Rotation.align_vectors(theirs, ours)[0].apply(ours)
    assert np.abs(WIDE.project(turned) - at).mean() < 0.1
    poor = calibrate_camera(photographs, BOARD, coefficients=0)
    assert poor.rms > 2 * found.rms and list(poor.standard_deviation) == list(NAMES[:4])


@pytest.mark.nightly
def test_corners_are_the_same_in_sixteen_linear_bits():
    """The same scene as light: to 0.05 px, the error of a corner; a camera's curve moves edges by less."""
    photographs = photographs_of(TRUE, BOARD)
    for eight in photographs.values():
        linear = (65535.0 * (eight / 255.0) ** 2).astype(np.uint16)
        one, other = BOARD.find(eight), BOARD.find(linear)
        assert one is not None and other is not None
        assert np.abs(one.image - other.image).mean() < 0.05


@pytest.mark.nightly
def test_square_pixels_have_one_focal_length():
    true = replace(TRUE, focal=(325.0, 325.0))
    found = calibrate_camera(photographs_of(true, BOARD), BOARD, square_pixels=True)
    assert found.camera.focal[0] == found.camera.focal[1]
    assert_within_its_errors(found, true)


def test_a_photograph_that_does_not_fit_is_named():
    """The odd one shows the board bent: its upper half is shifted by 2 px, forty times the error of a corner."""
    photographs = photographs_of(TRUE, BOARD, [*EYES, (0.1, -0.1, -0.23), (-0.05, 0.12, -0.23)])
    assert calibrate_camera(photographs, BOARD).outliers == ()
    photographs["3"][: TRUE.height // 2] = np.roll(photographs["3"][: TRUE.height // 2], 2, axis=1)
    assert calibrate_camera(photographs, BOARD).outliers == ("3",)


@real_data("opencv_left")
def test_opencv_board_photographs():
    """OpenCV states f = 535.92 px at rms 0.393 px, found with a search window of 11 px; the issue asks for 0.3 % and
    0.41 px. The outer squares of this board are cut to half: in left02 and left12 that window reaches the edge of the
    paper and draws six outer corners by up to 6 px to it. Windows that do not reach it, whichever they are, fit these
    corners at less than half the rms, and their focal length is 0.5 % less: so is ours by default.
    """
    photographs = {path.name: read_picture(path) for path in sorted(REAL.glob("*.jpg"))}
    theirs = calibrate_camera(photographs, Board(9, 6, 0.025, window=11))
    assert theirs.rms <= 0.41 and not theirs.skipped and "left02.jpg" in theirs.outliers
    np.testing.assert_allclose(theirs.camera.focal, OFFICIAL_FOCAL, rtol=0.003)
    ours = calibrate_camera(photographs, Board(9, 6, 0.025))
    assert ours.rms < 0.5 * theirs.rms and not ours.skipped and not ours.outliers
    np.testing.assert_allclose(ours.camera.focal, OFFICIAL_FOCAL, rtol=0.01)


def test_photographs_that_make_no_calibration_are_refused():
    blank = np.zeros((53, 71), np.uint8)
    for photographs, said in [
        ({"a": blank, "b": blank[1:]}, "different sizes: a is 71x53 px and b 71x52"),
        ({"a": blank, "b": blank}, "found in 0 of 2"),
        ({}, "found in 0 of 0"),
    ]:
        with pytest.raises(InputError, match=said):
            calibrate_camera(photographs, BOARD)
    flat = photographs_of(TRUE, BOARD, [(0, 0, -0.25), (0.002, 0, -0.22), (0, 0.002, -0.28)])
    with pytest.raises(InputError, match="tilt the board more"):
        calibrate_camera(flat, BOARD)


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"columns": 2}, "at least 3x3"),
        ({"square": float("nan")}, "length above 0"),
        ({"marker": 0.02}, "below the square's"),
        ({"window": 0}, "1 or more"),
        ({"marker": 0.01, "dictionary": "9X9"}, "choose one of .*4X4_50"),
        ({"columns": 20, "marker": 0.01, "dictionary": "4X4_50"}, "has 50 markers and the board 63"),
    ],
)
def test_what_makes_no_board_is_refused(figures, said):
    with pytest.raises(InputError, match=said) as refused:
        replace(BOARD, **figures)
    assert "\n" not in str(refused.value)


@pytest.mark.nightly
def test_a_calibration_has_the_same_bits_each_time():
    """With several threads OpenCV gave eight focal lengths in 25 runs, up to 4e-10 apart."""
    photographs, threads = photographs_of(TRUE, BOARD), cv2.getNumThreads()
    cv2.setNumThreads(8)
    try:
        found = {repr(calibrate_camera(photographs, BOARD).record()) for _ in range(12)}
        assert len(found) == 1 and cv2.getNumThreads() == 8
    finally:
        cv2.setNumThreads(threads)
