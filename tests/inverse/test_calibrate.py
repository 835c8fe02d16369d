"""Calibration: the camera and the response that made the photographs are found, within their own stated errors."""

from pathlib import Path

import numpy as np
import pytest

from hagoromo.camera.calibrate import NAMES, calibrate_camera
from hagoromo.camera.calibrate_response import calibrate_response, overlap_matrix, read_pairs
from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response, camera_response
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum, integrate_product

BOARD, SQUARE = (7, 5), 0.02
TRUE = Camera(301, 229, (322.0, 327.0), (153.0, 112.0), (-0.21, 0.09, 0.001, -0.0007, 0.0))
REAL = Path(__file__).parents[3] / "shared" / "data" / "opencv_left" / "left"


def photograph_of_board(camera: Camera, random: np.random.Generator) -> np.ndarray:
    """8-bit photograph with a white margin, 4 × 4 rays a pixel, 1 % noise: its corners are known to about 0.05 px."""
    row, column = np.mgrid[: camera.height * 4, : camera.width * 4]
    direction = camera.unproject(np.stack([(column + 0.5) / 4, (row + 0.5) / 4], axis=-1))
    at = camera.position[:2] - direction[..., :2] * (camera.position[2] / direction[..., 2])[..., None]
    square = np.floor(at / SQUARE).astype(int)
    inside = ((square >= -1) & (square < BOARD)).all(axis=-1)
    dark = inside & (square.sum(axis=-1) % 2 == 0)
    grey = np.where(dark, 30.0, 220.0).reshape(camera.height, 4, camera.width, 4).mean(axis=(1, 3))
    return np.clip(grey + random.normal(0.0, 2.0, grey.shape), 0, 255).astype(np.uint8)


def test_a_board_photographed_through_a_known_lens_gives_the_lens_back():
    """Tolerance: 4 standard deviations as stated, for nine parameters at once (99.94 % if normal)."""
    random = np.random.default_rng(5)
    middle = np.array([(BOARD[0] - 1) * SQUARE / 2, (BOARD[1] - 1) * SQUARE / 2, 0.0])
    eyes = [(0, 0, -0.25), (0.14, 0.05, -0.2), (-0.13, 0.08, -0.2), (0.04, -0.15, -0.21), (-0.12, -0.11, -0.2)]
    views = [TRUE.look_at(middle + eye, middle + 0.003 * random.normal(size=3), (0, -1, 0)) for eye in eyes]
    photographs = {f"{k}": photograph_of_board(view, random) for k, view in enumerate(views)}
    photographs["blank"] = np.zeros((TRUE.height, TRUE.width), np.uint8)
    found = calibrate_camera(photographs, BOARD, SQUARE)
    assert found.skipped == ("blank",)
    assert found.rms < 0.1  # px
    expected = dict(zip(NAMES, (*TRUE.focal, *TRUE.principal, *TRUE.distortion), strict=True))
    for name, value in expected.items():
        assert abs(found.record()[name] - value) < 4 * found.standard_deviation[name], name


@pytest.mark.skipif(not REAL.is_dir(), reason="the photographs of OpenCV's board are not beside this repository")
def test_opencv_board_photographs():
    """OpenCV states f = 535.9 px and an error of 0.39 px; its corners were found in a wider window. 1 % of f."""
    photographs = {path.name: read_picture(path) for path in sorted(REAL.glob("*.jpg"))}
    found = calibrate_camera(photographs, (9, 6), 0.025)
    assert found.rms <= 0.393 and not found.skipped
    np.testing.assert_allclose(found.camera.focal, 535.9, rtol=0.01)


def test_photographs_that_make_no_calibration_are_refused():
    blank = np.zeros((53, 71), np.uint8)
    for photographs, board, square, said in [
        ({"a": blank, "b": blank[1:]}, BOARD, 0.02, "different sizes: a is 71x53 px and b 71x52"),
        ({"a": blank, "b": blank}, BOARD, 0.02, "found in 0 of 2"),
        ({"a": blank}, (2, 9), 0.02, "at least 3x3"),
        ({"a": blank}, BOARD, float("nan"), "length above 0"),
        ({"a": blank.astype(np.uint16)}, BOARD, 0.02, "8-bit"),
        ({}, BOARD, 0.02, "found in 0 of 0"),
    ]:
        with pytest.raises(InputError, match=said):
            calibrate_camera(photographs, board, square)


def spectra_and_readings(
    seed: int, noise: float, narrowest: float = 12.0
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], Response]:
    """61 smooth spectra, bands of `narrowest` to 60 nm, and what a camera with known curves reads of them."""
    random = np.random.default_rng(seed)
    wavelengths = np.arange(400.0, 701.0, 10.0)
    true = Response.load("canon_eos_300d")
    true = Response(wavelengths, np.stack([true.curve(c).at(wavelengths) for c in range(3)], axis=1))
    centre, width = random.uniform(390, 710, (61, 1)), random.uniform(narrowest, 60, (61, 1))
    spectra = np.exp(-0.5 * ((wavelengths - centre) / width) ** 2)
    lamp = Spectrum.constant(1.0)
    read = np.array([camera_response(Spectrum(wavelengths, s), lamp, true) for s in spectra])
    read += noise * read.mean(axis=0) * random.normal(size=read.shape)
    return wavelengths, spectra, dict(zip(true.channels, read.T, strict=True)), true


def test_response_is_found_from_exact_readings():
    """Tolerance: 0.5 % of the peak, what the smallest penalty tried (1e-10) bends away."""
    wavelengths, spectra, readings, true = spectra_and_readings(11, 0.0, narrowest=4.0)
    found = calibrate_response(wavelengths, spectra, readings)
    assert (found.response.values >= 0).all()
    assert np.abs(found.response.values - true.values).max() < 5e-3 * true.values.max()


def test_response_from_noisy_readings_predicts_others():
    """Noise 0.5 % of the mean. Tolerance: the error of 61 unseen readings is below the noise of one, as 61 readings
    are averaged over about 20 parameters.
    """
    wavelengths, spectra, readings, _ = spectra_and_readings(11, 0.005)
    found = calibrate_response(wavelengths, spectra, readings)
    _, others, exact, _ = spectra_and_readings(12, 0.0)
    for channel, name in enumerate(readings):
        predicted = others @ overlap_matrix(wavelengths) @ found.response.values[:, channel]
        assert np.sqrt(np.mean((predicted - exact[name]) ** 2)) < 0.005 * exact[name].mean()
    assert ((found.residual > 0.003) & (found.residual < 0.006)).all()


def test_overlap_matrix_integrates_piecewise_linear_products():
    """Oracle: the exact integral of the spectra. Tolerance: rounding."""
    wavelengths = np.array([400.0, 410.0, 430.0, 460.0, 500.0])
    f, g = np.random.default_rng(2).normal(size=(2, 5))
    exact = integrate_product(Spectrum(wavelengths, f), Spectrum(wavelengths, g))
    assert f @ overlap_matrix(wavelengths) @ g == pytest.approx(exact, rel=1e-12)


def test_pairs_are_read_from_a_table(tmp_path):
    columns = {"R": [1, 2], "400": [3, 4], "410": [5, 6], "420": [7, 8], "G": [9, 10]}
    write_table(tmp_path / "pairs.csv", columns)
    wavelengths, spectra, readings = read_pairs(tmp_path / "pairs.csv")
    np.testing.assert_array_equal(wavelengths, [400, 410, 420])
    np.testing.assert_array_equal(spectra, [[3, 5, 7], [4, 6, 8]])
    assert list(readings) == ["R", "G"]
    with pytest.raises(InputError, match="fewest"):
        calibrate_response(wavelengths, spectra, readings)
    for missing, said in [(("400",), "increasing wavelengths"), (("R", "G"), "no header")]:
        write_table(tmp_path / "bad.csv", {k: v for k, v in columns.items() if k not in missing})
        with pytest.raises(InputError, match=said):
            read_pairs(tmp_path / "bad.csv")
