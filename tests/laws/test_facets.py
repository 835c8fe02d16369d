"""Laws of facets with tails: half width, limits, elements and energy against quadrature, sampling, files, kernels.

The oracle is the density as it is printed, (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν}, in NumPy and double precision.
"""

import math

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.facets import expm1_quotient, log1p_quotient
from hagoromo.reflectance.reflectance import Reflectance, reflectance_from_record
from hagoromo.reflectance.torrance_sparrow import facet_density

WHITE = Spectrum.constant(1.0)
NUS = (0.3, 0.5, 0.77, 1.0, 1.6, 3.0, 9.0, 60.0)


def printed_density(angle, gamma, nu):
    return (1 + (2 ** (1 / nu) - 1) * angle**2 / gamma**2) ** -nu


@pytest.mark.parametrize("nu", NUS)
def test_facets_follow_the_printed_density(nu):
    angle = np.linspace(0, 1.55, 211)
    got = np.array(facet_density(arrays().Float64(np.cos(angle)), 0.13, arrays().Float64(nu)))
    # cos φ keeps φ² to 2e-16, which γ² enlarges
    np.testing.assert_allclose(got, printed_density(angle, 0.13, nu), rtol=1e-11)


@pytest.mark.parametrize("gamma", [0.002, 0.05, 0.5])
@pytest.mark.parametrize("nu", [*NUS, 1e3, 1e8, 1e15, math.inf])
def test_the_density_is_one_half_at_gamma(gamma, nu):
    """For every exponent, in both precisions and as a Python number; 1e-4: 2e-16 in cos φ at γ² = 4e-6 is 1e-10."""
    assert facet_density(math.cos(gamma), gamma, nu) == pytest.approx(0.5, rel=1e-9)
    assert np.array(facet_density(arrays().Float64(math.cos(gamma)), gamma, arrays().Float64(nu)))[0] == pytest.approx(
        0.5, rel=1e-9
    )
    if gamma >= 0.05:  # single precision keeps φ² to 1e-7
        half = np.array(facet_density(arrays().Float(math.cos(gamma)), gamma, arrays().Float(nu)))[0]
        assert half == pytest.approx(0.5, rel=1e-4)


def test_without_tails_the_density_is_the_gaussian_to_the_bit():
    jit = arrays()
    cosine, gamma = jit.Float(np.cos(np.linspace(0, 1.5, 301)).astype(np.float32)), jit.Float(0.21)
    gaussian = np.array(facet_density(cosine, gamma))
    for nu in (math.inf, jit.Float(math.inf)):  # a number, and an entry of an array
        np.testing.assert_array_equal(np.array(facet_density(cosine, gamma, nu)), gaussian)


def test_the_density_tends_to_the_gaussian():
    """The difference falls as 1/ν: D ≈ exp(−ln2 x) (1 − (ln2)² x (1 − x)/2ν)."""
    angle = arrays().Float64(np.linspace(0, 0.6, 211))
    gaussian = np.array(facet_density(dr.cos(angle), 0.2))
    errors = [np.abs(np.array(facet_density(dr.cos(angle), 0.2, nu)) - gaussian).max() for nu in (1e3, 1e5, 1e7)]
    assert errors[0] / errors[1] == pytest.approx(100, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(100, rel=0.02)


@pytest.mark.parametrize("kind", ["Float", "Float64"])
def test_the_stable_quotients(kind):
    z = np.concatenate([-np.logspace(-12, np.log10(0.9), 97), [0.0], np.logspace(-12, 1.2, 97)])
    digits = 3e-6 if kind == "Float" else 1e-13
    z = z.astype(np.float32).astype(np.float64)
    safe = np.where(z == 0, 1, z)
    for quotient, true in ((expm1_quotient, np.expm1), (log1p_quotient, np.log1p)):
        got = np.array(quotient(getattr(arrays(), kind)(z)))
        np.testing.assert_allclose(got, np.where(z == 0, 1, true(safe) / safe), rtol=digits)


def test_the_derivative_by_the_tails_is_finite_everywhere():
    """Also at φ = 0, for large ν, and for entries without tails, where it is 0."""
    jit = arrays()
    cosine = np.cos(np.array([0.0, 1e-5, 0.01, 0.1, 0.3, 1.4]))
    exponents = np.array([0.3, 1.0, 7.0, 1e4, math.inf])
    nu = jit.Float64(np.repeat(exponents, len(cosine)))
    dr.enable_grad(nu)
    density = facet_density(jit.Float64(np.tile(cosine, len(exponents))), 0.1, nu)
    slope = np.array(_slope(density, nu)).reshape(len(exponents), -1)
    assert np.isfinite(slope).all() and (slope[-1] == 0).all()
    h = 1e-6
    ends = [np.array(facet_density(jit.Float64(cosine), 0.1, jit.Float64(1.0 + sign * h))) for sign in (1, -1)]
    # a central difference in double precision: h² and 1e-16/h
    np.testing.assert_allclose(slope[1], (ends[0] - ends[1]) / (2 * h), atol=1e-9)


def _slope(value, by):
    dr.set_grad(by, 1.0)
    return dr.forward_to(value)


@pytest.mark.parametrize("nu", [0.29, -1.0, 0.0, math.nan, "1"])
def test_tails_out_of_range_are_refused(nu):
    with pytest.raises(InputError, match=r"nu is .*: give a number from 0.3"):
        Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, nu=nu)


def test_a_record_has_nu_only_where_facets_have_tails():
    gaussian = Reflectance(0.1, 0.1, 0.2, 1.5, WHITE)
    assert "nu" not in gaussian.record()
    for said in ({}, {"nu": None}, {"nu": math.inf}):  # absent as in old files, null, and TOML's inf
        assert reflectance_from_record(gaussian.record() | said, "material").record() == gaussian.record()
    tailed = Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, nu=0.8)
    assert tailed.record()["nu"] == 0.8
    assert reflectance_from_record(tailed.record(), "material").record() == tailed.record()
    with pytest.raises(InputError, match=r"nu must be a number, 0.3 or more: given 0.1"):
        reflectance_from_record(gaussian.record() | {"nu": 0.1}, "material")
