"""Spectra from colours: the truth lies in the stated regions, and colours under other lamps are predicted.

The spectra here are of the prior's own set, kept out of it by turns: nothing is tested that was learnt.
"""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, apart, read_spectra, surfaces
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import (
    Reading,
    estimate_spectrum,
    reading_matrix,
    reflectance_spectrum,
)
from hagoromo.reflectance.spectra.spectrum_map import _weights, estimate_spectra

NOISE = 0.003
DAYLIGHT, TUNGSTEN = Spectrum.named("D65"), Spectrum.named("A")


def test_posterior_of_one_gaussian_is_wieners_estimate():
    """Oracle: m + K Aᵀ (A K Aᵀ + N)⁻¹ (y − A m) and its covariance, written out. Tolerance: rounding."""
    random = np.random.default_rng(3)
    centre = 0.5 + 0.1 * np.sin(WAVELENGTHS / 40.0)
    root = 0.02 * random.normal(size=(len(WAVELENGTHS), 7))
    kernel = root @ root.T + 1e-4 * np.eye(len(WAVELENGTHS))
    matrix = reading_matrix(DAYLIGHT, Response.load("canon_eos_300d"))
    values, noise = np.array([0.47, 0.53, 0.5]), np.diag([1e-5, 2e-5, 3e-5])
    found = estimate_spectrum(matrix, values, noise, [ReflectancePrior("one", centre[None], kernel[None])])
    scale = values.mean() / (matrix @ centre).mean()
    mean = scale * centre
    kernel = scale**2 * kernel + 0.3**2 * np.outer(mean, mean)
    gain = kernel @ matrix.T @ np.linalg.inv(matrix @ kernel @ matrix.T + noise)
    np.testing.assert_allclose(found.values, mean + gain @ (values - matrix @ mean), rtol=1e-9)
    np.testing.assert_allclose(found.covariance, kernel - gain @ matrix @ kernel, atol=1e-12)


def test_regions_hold_the_truth_of_spectra_that_the_prior_has_not_seen():
    """Five turns over the set; XYZ under D65, and what another camera reads under A, each region at 95 %.

    Bounds: 90 to 99.5 %. The standard error of a share of 95 % over 356 spectra is 1.2 %; the regions take a mixture
    for one Gaussian, which is right to a few percent.
    """
    random = np.random.default_rng(0)
    spectra, turn = surfaces(), np.random.default_rng(1).permutation(len(surfaces())) % 5
    matrix = reading_matrix(DAYLIGHT, Response.load("canon_eos_300d"))
    other = reading_matrix(TUNGSTEN, Response.load("Nikon 5100 (NPL)"))
    colours = reading_matrix(DAYLIGHT, Response.load("cie1931"))
    inside = []
    for kept in range(5):
        prior = ReflectancePrior.from_spectra("surfaces", spectra[turn != kept])
        for truth in spectra[turn == kept]:
            exact = matrix @ truth
            values = exact * (1.0 + NOISE * random.normal(size=3))
            found = estimate_spectrum(matrix, values, np.diag((NOISE * exact) ** 2), [prior], upper=np.inf)
            off = found.values - truth
            inside.append([_inside(predict, off, found.covariance) for predict in (colours, other)])
    share = np.mean(inside, axis=0)
    assert ((share > 0.90) & (share < 0.995)).all(), share


def test_a_second_lamp_narrows_the_spectrum():
    """Information adds: the variance falls at every wavelength under a single Gaussian; the mean error falls too."""
    truth = Spectrum(WAVELENGTHS, surfaces()[7])
    camera = Response.load("canon_eos_300d")
    readings = [_reading(truth, lamp, camera) for lamp in (DAYLIGHT, TUNGSTEN)]
    smooth = [ReflectancePrior("one", np.ones((1, 31)), ReflectancePrior.load("smooth").covariances[-1:])]
    one, two = reflectance_spectrum(readings[:1], smooth), reflectance_spectrum(readings, smooth)
    assert (two.standard_error < one.standard_error).all()
    assert np.sum((two.values - truth.values) ** 2) < np.sum((one.values - truth.values) ** 2)


def test_the_class_is_chosen_by_evidence():
    """A grey step of a class of greys is far likelier under it than under all surfaces; a saturated red is not."""
    random = np.random.default_rng(5)
    greys = 0.5 + 0.01 * np.cumsum(random.normal(size=(40, len(WAVELENGTHS))), axis=1) / 5.0
    priors = [ReflectancePrior.from_spectra("greys", greys[1:]), ReflectancePrior.load("surfaces")]
    camera = Response.load("canon_eos_300d")
    grey = reflectance_spectrum([_reading(Spectrum(WAVELENGTHS, greys[0]), DAYLIGHT, camera)], priors)
    red = Spectrum(WAVELENGTHS, 0.05 + 0.6 / (1.0 + np.exp(-(WAVELENGTHS - 600.0) / 10.0)))
    assert grey.probability["greys"] > 0.9
    assert reflectance_spectrum([_reading(red, DAYLIGHT, camera)], priors).probability["surfaces"] > 0.999
    assert sum(grey.probability.values()) == pytest.approx(1.0)


def test_a_class_weighs_as_its_odds_before_the_readings():
    """A grey, alone and in a picture: the ratio of the probabilities of two classes rises by their odds."""
    priors = [ReflectancePrior.load(name) for name in ("smooth", "skin")]
    matrix = reading_matrix(DAYLIGHT, Response.load("canon_eos_300d"))
    values, errors = matrix @ np.full(31, 0.4), np.full(3, 0.01)
    ratios = []
    for odds in (1.0, 7.0):
        classes = [replace(priors[0], odds=odds), priors[1]]
        one = estimate_spectrum(matrix, values, np.diag(errors**2), classes)
        many = estimate_spectra(matrix, values[None], errors, classes).probability[0]
        ratios.append(one.probability["smooth"] / one.probability["skin"])
        np.testing.assert_allclose(many, list(one.probability.values()), atol=1e-3)
    assert ratios[1] == pytest.approx(7.0 * ratios[0], rel=1e-6)


def test_spectra_stay_within_their_bounds():
    """A green more saturated than any surface: the unbounded mean would be below 0; the bound may not break it."""
    green = Spectrum(WAVELENGTHS, np.exp(-0.5 * ((WAVELENGTHS - 530.0) / 12.0) ** 2))
    found = reflectance_spectrum([_reading(green, DAYLIGHT, Response.load("canon_eos_300d"))])
    assert found.values.min() >= 0.0 and found.values.max() <= 1.0


def test_near_copies_are_told_apart_at_any_brightness():
    spectra = surfaces()[:5]
    assert len(apart(spectra, 0.3 * spectra[2:3])) <= 4
    assert len(apart(spectra, np.linspace(0.0, 1.0, 31)[None] ** 9)) == 5


def test_priors_are_learnt_from_a_table_of_spectra(tmp_path):
    path = tmp_path / "leaves.csv"
    columns = {f"leaf{k}": 0.1 * k + np.array([0.0, 0.1, 0.2]) for k in range(1, 6)}
    write_table(path, {"wavelength_nm": [380.0, 500.0, 720.0], **columns})
    assert ReflectancePrior.load(path).name == "leaves"
    np.testing.assert_allclose(read_spectra(path)[0][10], 0.1 + 0.1)  # 500 nm
    for change, said in [
        ({"wavelength_nm": [410.0, 500.0, 720.0]}, "cover 400–700"),
        ({"wavelength_nm": [380.0, 720.0, 710.0]}, "must increase"),
        ({"leaf2": [0.1, -0.2, 0.1]}, "leaf2 is no reflectance"),
        ({"leaf2": [0.1, 30.0, 0.1]}, "leaf2 is no reflectance"),
    ]:
        write_table(path, {"wavelength_nm": [380.0, 500.0, 720.0], **columns, **change})
        with pytest.raises(InputError, match=said):
            ReflectancePrior.load(path)


def test_readings_that_tell_no_spectrum_are_refused():
    camera = Response.load("canon_eos_300d")
    with pytest.raises(InputError, match="none is given"):
        reflectance_spectrum([])
    with pytest.raises(InputError, match="give no spectrum"):
        reflectance_spectrum([Reading([0.0, 0.01, -0.01], [0.01] * 3, DAYLIGHT, camera)])
    with pytest.raises(InputError, match="no prior of reflectance"):
        ReflectancePrior.load("leather")
    for values, errors, said in [
        ([0.1, 0.2], [0.1, 0.1], "as many values"),
        ([0.1, 0.2, np.nan], [0.1] * 3, "finite"),
        ([0.1, 0.2, 0.3], [0.1, 0.1, 0.0], "above 0"),
    ]:
        with pytest.raises(InputError, match=said):
            Reading(values, errors, DAYLIGHT, camera)
    blind = Response([400, 410], [[0.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    with pytest.raises(InputError, match="channel R has no response to this lamp"):
        reading_matrix(DAYLIGHT, blind)


def _reading(truth: Spectrum, lamp: Spectrum, camera: Response) -> Reading:
    values = reading_matrix(lamp, camera) @ truth.at(WAVELENGTHS)
    return Reading(values, NOISE * values, lamp, camera)


def _inside(predict: np.ndarray, off: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether the error `off` of a spectrum, as three readings, lies in their 95 % ellipsoid (χ² of three: 7.815)."""
    error = predict @ off
    return bool(error @ np.linalg.solve(predict @ covariance @ predict.T, error) < 7.815)


def test_no_weight_of_a_map_is_a_subnormal_number():
    """They took a third of the time of a map. What is cut off is below the rounding of the sum."""
    logs = np.linspace(-200.0, 0.0, 2001)[None]
    weight, exact = _weights(logs), np.exp(logs) / np.exp(logs).sum()
    assert ((weight == 0.0) | (weight >= np.finfo(np.float32).tiny)).all()
    np.testing.assert_allclose(weight, exact, rtol=1e-5, atol=1e-25)
