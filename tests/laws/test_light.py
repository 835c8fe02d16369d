"""Light: exact integrals of spectra, the inverse-square law, colour against its standards."""

import itertools

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files.table import write_table
from hagoromo.light.colour import (
    colour_matching,
    delta_e_2000,
    srgb_decode,
    srgb_encode,
    srgb_from_xyz,
    xyz_from_srgb,
)
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum, integrate_product, smooth_rgb_basis


def random_spectrum(random: np.random.Generator, n: int) -> Spectrum:
    return Spectrum(np.sort(random.uniform(380, 720, n)), random.normal(size=n))


@pytest.mark.parametrize("factors", [1, 2, 3, 4, 5])
def test_integral_of_a_product_is_exact(factors):
    """Oracle: antiderivatives of the product's polynomials, piece by piece. Tolerance: rounding of float64 sums."""
    random = np.random.default_rng(factors)
    spectra = [random_spectrum(random, n) for n in (2, 5, 11, 17, 23)[:factors]]
    lo, hi = 412.3, 687.9
    edges = np.unique(np.clip(np.concatenate([[lo, hi], *(s.wavelengths for s in spectra)]), lo, hi))
    expected = 0.0
    for a, b in itertools.pairwise(edges):
        product = np.polynomial.Polynomial([1.0])
        for s in spectra:
            ya, yb = s.at(np.array([a + 0.25 * (b - a), a + 0.75 * (b - a)]))
            product *= np.polynomial.Polynomial([ya - 0.5 * (yb - ya), 2 * (yb - ya)])
        whole = product.integ()
        expected += (b - a) * (whole(1.0) - whole(0.0))
    scale = integrate_product(*(Spectrum(s.wavelengths, np.abs(s.values)) for s in spectra), lo=lo, hi=hi)
    assert integrate_product(*spectra, lo=lo, hi=hi) == pytest.approx(expected, abs=1e-12 * scale)


def test_spectrum_is_linear_between_and_zero_outside():
    s = Spectrum([400, 500, 700], [1, 3, 3])
    np.testing.assert_allclose(s.at([399.9, 400, 450, 600, 700, 700.1]), [0, 1, 2, 3, 3, 0], rtol=1e-15)
    assert s.mean() == pytest.approx((2 * 100 + 3 * 200) / 300, rel=1e-15)
    assert integrate_product(s, lo=800, hi=900) == 0.0


def test_product_with_a_number_and_with_a_spectrum():
    s, t = Spectrum([400, 600], [0, 2]), Spectrum([500, 700], [3, 1])
    np.testing.assert_array_equal((2 * s).at([400, 600]), [0, 4])
    np.testing.assert_allclose((s * t).at([500, 600, 650]), [3, 4, 0], rtol=1e-15)


def test_smooth_rgb_basis_is_a_partition_of_unity():
    at = np.linspace(380, 730, 1009)
    bands = np.array([band.at(at) for band in smooth_rgb_basis()])
    np.testing.assert_allclose(bands.sum(axis=0), 1.0, rtol=0, atol=1e-15)
    assert bands.min() >= 0.0
    assert bands.argmax(axis=0).tolist() == sorted(bands.argmax(axis=0).tolist(), reverse=True)


def test_spectrum_loads_from_everything_a_record_may_hold(tmp_path):
    write_table(tmp_path / "lamp.csv", {"wavelength_nm": [400, 700], "value": [1, 2]})
    write_table(tmp_path / "two.csv", {"wavelength_nm": [400, 700], "a": [1, 2], "b": [3, 4]})
    assert Spectrum.load(2).at(500) == 2.0
    assert Spectrum.load("lamp.csv", tmp_path).at(700) == 2.0
    assert Spectrum.from_csv(tmp_path / "two.csv", "b").at(400) == 3.0
    assert Spectrum.load("D65").at(560) == pytest.approx(100.0)  # CIE normalises D65 to 100 at 560 nm
    spectrum = Spectrum.load({"wavelengths": [400, 500], "values": [1, 2]})
    np.testing.assert_array_equal(Spectrum.load(spectrum.record()).values, spectrum.values)
    for source, said in [
        ("D64", "nearest names are .*D6"),
        ("../lamp.csv", "points outside"),
        ({"wavelengths": [400, 500]}, "lacks the key 'values'"),
        ("two.csv", "beside wavelength_nm it has a, b"),
        (None, "a spectrum is"),
        (float("nan"), "not finite"),
    ]:
        with pytest.raises(InputError, match=said):
            Spectrum.load(source, tmp_path)


@pytest.mark.parametrize(
    ("wavelengths", "values", "said"),
    [
        ([400], [1], "two or more"),
        ([400, 500], [1, 2, 3], "a value each"),
        ([400, 400], [1, 2], "must increase"),
        ([500, 400], [1, 2], "must increase"),
        ([400, 500], [1, np.inf], "not finite"),
        (["a", "b"], [1, 2], "needs numbers"),
    ],
)
def test_a_bad_spectrum_is_refused(wavelengths, values, said):
    with pytest.raises(InputError, match=said):
        Spectrum(wavelengths, values)


def test_inverse_square_law():
    position = np.array([1.0, 2.0, 3.0])
    lamp = Lamp(position, intensity=7.0)
    direction = np.array([2.0, -3.0, 6.0]) / 7.0
    distances = np.array([0.1, 1.0, 11.0])
    to_lamp, irradiance = lamp.direction_and_irradiance(position - distances[:, None] * direction)
    np.testing.assert_allclose(irradiance, 7.0 / distances**2, rtol=1e-12)  # rounding of the subtraction
    np.testing.assert_allclose(to_lamp, np.broadcast_to(direction, (3, 3)), rtol=0, atol=1e-12)


def test_a_far_lamp_lights_every_point_alike():
    lamp = Lamp(to_lamp=(0.0, 0.0, 5.0), intensity=(1.0, 2.0))
    to_lamp, irradiance = lamp.direction_and_irradiance(np.ones((3, 5, 3)))
    assert to_lamp.shape == (3, 5, 3) and irradiance.shape == (3, 5, 2)
    np.testing.assert_array_equal(to_lamp[1, 2], [0, 0, 1])
    np.testing.assert_array_equal(irradiance[2, 4], [1, 2])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give either"),
        ({"position": (0, 0, 1), "to_lamp": (0, 0, 1)}, "give either"),
        ({"to_lamp": (0, 0, 0)}, "direction towards"),
        ({"position": (0, 0, np.nan)}, "finite"),
        ({"position": (0, 1)}, "three"),
        ({"position": (0, 0, 1), "intensity": -1.0}, "not negative"),
    ],
)
def test_a_bad_lamp_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        Lamp(**given)


def test_equal_energy_and_d65_have_their_published_chromaticities():
    """CIE 15: E is (1/3, 1/3), D65 is (0.31272, 0.32903). Tolerance: the four digits printed there."""
    for name, expected in (("E", (1 / 3, 1 / 3)), ("D65", (0.31272, 0.32903))):
        lamp = Spectrum.named(name)
        xyz = np.array([integrate_product(lamp, band, lo=360, hi=830) for band in colour_matching()])
        np.testing.assert_allclose(xyz[:2] / xyz.sum(), expected, atol=1e-4)


def test_srgb_of_d65_white_is_one():
    """IEC 61966-2-1 prints its matrix with four decimals."""
    np.testing.assert_allclose(srgb_from_xyz([0.9505, 1.0, 1.0890]), 1.0, atol=2e-4)
    rgb = np.random.default_rng(3).uniform(-0.1, 1.1, (5, 7, 3))
    np.testing.assert_allclose(srgb_from_xyz(xyz_from_srgb(rgb)), rgb, atol=1e-12)


def test_display_encoding_has_an_inverse():
    every = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(srgb_encode(srgb_decode(every)), every)
    np.testing.assert_array_equal(srgb_encode([-1.0, np.nan, 2.0]), [0, 0, 255])


def test_delta_e_2000_of_greys():
    """Sharma et al. (2005): for greys ΔE00 is ΔL* / S_L; here against that formula. L* = 116 Y^(1/3) − 16.

    Tolerance: the matrix of sRGB is printed with four decimals, so its white has Y = 1 ± 1e-5.
    """
    y = np.array([0.2, 0.3])
    low, high = 116 * np.cbrt(y) - 16
    middle = (low + high) / 2 - 50
    expected = (high - low) / (1 + 0.015 * middle**2 / np.sqrt(20 + middle**2))
    assert delta_e_2000([y[0]] * 3, [y[1]] * 3) == pytest.approx(expected, rel=1e-5)


def test_a_lamp_with_an_axis_falls_off_by_the_power_of_the_cosine():
    """Oracle: the values at 0°, 60° and 120° off the axis, at 2 m; rounding of float64."""
    lamp = Lamp((0.0, 0.0, 0.0), intensity=8.0, axis=(0.0, 0.0, 3.0), axis_power=2.0)
    side = np.sin(np.radians(60.0))
    points = 2.0 * np.array([[0.0, 0.0, 1.0], [side, 0.0, 0.5], [0.0, side, -0.5]])
    np.testing.assert_allclose(lamp.direction_and_irradiance(points)[1], [2.0, 0.5, 0.0], rtol=1e-14)
    np.testing.assert_array_equal(lamp.shifted((0.0, 0.0, 1.0)).position, [0.0, 0.0, 1.0])
    with pytest.raises(InputError, match="axis"):
        Lamp(to_lamp=(0.0, 0.0, 1.0), axis=(0.0, 0.0, 1.0))
