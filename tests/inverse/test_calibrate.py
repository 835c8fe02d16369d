"""Calibration: the response that made the readings is found, within its own stated errors."""

import numpy as np
import pytest

from hagoromo.calibration.response.calibrate_response import Pairs, calibrate_response, overlap_matrix, read_pairs
from hagoromo.camera.response import Response, camera_response
from hagoromo.errors import InputError
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum, integrate_product


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
    """Tolerance: 0.5 % of the peak, to which readings exact to 1e-5 tell curves 10 nm apart."""
    wavelengths, spectra, readings, true = spectra_and_readings(11, 0.0, narrowest=4.0)
    found = calibrate_response(Pairs(wavelengths, spectra, readings))
    assert (found.response.values >= 0).all()
    assert np.abs(found.response.values - true.values).max() < 5e-3 * true.values.max()


def test_response_from_noisy_readings_predicts_others():
    """Noise 0.5 % of the mean. Tolerance: the error of 61 unseen readings is below the noise of one, as 61 readings
    are averaged over about 20 parameters.
    """
    wavelengths, spectra, readings, _ = spectra_and_readings(11, 0.005)
    found = calibrate_response(Pairs(wavelengths, spectra, readings))
    _, others, exact, _ = spectra_and_readings(12, 0.0)
    for channel, name in enumerate(readings):
        predicted = others @ overlap_matrix(wavelengths) @ found.response.values[:, channel]
        assert np.sqrt(np.mean((predicted - exact[name]) ** 2)) < 0.005 * exact[name].mean()
    assert ((found.residual > 0.003) & (found.residual < 0.006)).all()


def test_a_calibrated_response_reads_what_it_was_fitted_to(tmp_path):
    """Light at 380–760 nm by a camera that sees all of it: eq. (10) with the fitted curves, from their file too, gives
    the readings within the residual of the fit. Cut to 400–700 nm, tens of per cent of some readings are lost.
    """
    random, wavelengths = np.random.default_rng(8), np.arange(380.0, 761.0, 10.0)
    curves = np.exp(-0.5 * ((wavelengths[:, None] - (720.0, 550.0, 410.0)) / 40.0) ** 2)
    true = Response(wavelengths, curves, limits=(380.0, 760.0))
    spectra = np.exp(-0.5 * ((wavelengths - random.uniform(370, 770, (61, 1))) / random.uniform(6, 60, (61, 1))) ** 2)
    lamp = Spectrum.constant(1.0)
    read = np.array([camera_response(Spectrum(wavelengths, s), lamp, true) for s in spectra])
    found = calibrate_response(Pairs(wavelengths, spectra, dict(zip("RGB", read.T, strict=True))))
    found.save(tmp_path / "response.csv")
    for response in (found.response, Response.load(tmp_path / "response.csv")):
        again = np.array([camera_response(Spectrum(wavelengths, s), lamp, response) for s in spectra])
        assert (np.sqrt(np.mean((again - read) ** 2, axis=0)) < 2e-3 * read.mean(axis=0)).all()
    cut = np.array([camera_response(Spectrum(wavelengths, s), lamp, found.response, 400.0, 700.0) for s in spectra])
    assert np.abs(cut / read - 1.0).max() > 0.2


def test_overlap_matrix_integrates_piecewise_linear_products():
    """Oracle: the exact integral of the spectra. Tolerance: rounding."""
    wavelengths = np.array([400.0, 410.0, 430.0, 460.0, 500.0])
    f, g = np.random.default_rng(2).normal(size=(2, 5))
    exact = integrate_product(Spectrum(wavelengths, f), Spectrum(wavelengths, g))
    assert f @ overlap_matrix(wavelengths) @ g == pytest.approx(exact, rel=1e-12)


def test_pairs_are_read_from_a_table(tmp_path):
    columns = {"R": [1, 2], "400": [3, 4], "410": [5, 6], "420": [7, 8], "G": [9, 10]}
    write_table(tmp_path / "pairs.csv", columns)
    wavelengths, spectra, readings, lamps = read_pairs(tmp_path / "pairs.csv")
    assert lamps is None
    write_table(tmp_path / "lit.csv", {"lamp": [1, 2], **columns})
    lit = read_pairs(tmp_path / "lit.csv")
    assert list(lit.readings) == ["R", "G"] and lit.lamps is not None and lit.lamps.tolist() == [1, 2]
    np.testing.assert_array_equal(wavelengths, [400, 410, 420])
    np.testing.assert_array_equal(spectra, [[3, 5, 7], [4, 6, 8]])
    assert list(readings) == ["R", "G"]
    with pytest.raises(InputError, match="2 pairs are given and 5 are needed"):
        calibrate_response(Pairs(wavelengths, spectra, readings))
    for missing, said in [(("400",), "increasing wavelengths"), (("R", "G"), "no header")]:
        write_table(tmp_path / "bad.csv", {k: v for k, v in columns.items() if k not in missing})
        with pytest.raises(InputError, match=said):
            read_pairs(tmp_path / "bad.csv")
