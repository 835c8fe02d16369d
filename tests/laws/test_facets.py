"""Laws of facets with tails: half width, limits, elements and energy against quadrature, sampling, files, kernels.

The oracle is the density as it is printed, (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν}, in NumPy and double precision.
"""

import math
from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.image.scene.surface import Surface
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import cylinder_facets, graded_place, sphere_facets, sphere_table
from hagoromo.reflectance.facets import expm1_quotient, facet_mass, log1p_quotient, squared_angle_of_mass
from hagoromo.reflectance.interface_albedo import VIEWS, interface_albedo
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.reflectance_record import reflectance_from_record
from hagoromo.reflectance.sampling import density_to_lamp
from hagoromo.reflectance.torrance_sparrow import (
    cos_deviation,
    facet_density,
    fresnel,
    squared_angle,
    squared_angle_ahead,
    torrance_sparrow,
)
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from tests.oracle.radiance import camera_rays
from tests.oracle.scenes import DAYLIGHT, OracleCase, camera, coloured_block, error_and_ratio, threads

WHITE = Spectrum.constant(1.0)
NUS = (0.3, 0.5, 0.77, 1.0, 1.6, 3.0, 9.0, 60.0)


def printed_density(angle, gamma, nu):
    return (1 + (2 ** (1 / nu) - 1) * angle**2 / gamma**2) ** -nu


def test_the_polynomial_of_the_squared_angle_holds_to_a_right_angle():
    """Against arccos² in double precision, from 1e-4 rad to π/2."""
    angle = np.geomspace(1e-4, 0.5 * math.pi, 2000)
    found = np.array(squared_angle_ahead(arrays().Float64(np.cos(angle))))
    assert np.abs(found / np.arccos(np.cos(angle)) ** 2 - 1.0).max() < 4e-7


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
    gaussian = np.array(dr.exp(-math.log(2.0) * squared_angle(cosine) / (gamma * gamma)))  # eq. (4)
    np.testing.assert_array_equal(np.array(facet_density(cosine, gamma)), gaussian)
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


@pytest.mark.usefixtures("exact_derivatives")
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
    for said in ({}, {"nu": None}, {"nu": math.inf}):  # absent as in old files, null, infinity
        assert reflectance_from_record(gaussian.record() | said, "material").record() == gaussian.record()
    tailed = Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, nu=0.8)
    assert tailed.record()["nu"] == 0.8
    assert reflectance_from_record(tailed.record(), "material").record() == tailed.record()
    with pytest.raises(InputError, match=r"nu must be a number, 0.3 or more: given 0.1"):
        reflectance_from_record(gaussian.record() | {"nu": 0.1}, "material")


def directions(seed, count):
    """Axes, lamps and eyes; every second axis lies nearly across the half vector, where f is largest."""
    rng = np.random.default_rng(seed)
    axis, lamp, eye = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in rng.normal(size=(3, count, 3)))
    half = (lamp + eye)[::2] / np.linalg.norm((lamp + eye)[::2], axis=-1, keepdims=True)
    across = np.cross(half, rng.normal(size=half.shape))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    axis[::2] = across + half * 10.0 ** rng.uniform(-4, -0.5, (len(half), 1))
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True), lamp, eye


def vectors(rows, kind="Array3f64"):
    """Rows (count, 3) as a Dr.Jit array of vectors; other values do not need a new kernel."""
    real = arrays().Float64 if kind == "Array3f64" else arrays().Float
    digits = np.float64 if kind == "Array3f64" else np.float32
    return getattr(arrays(), kind)(*(lookup(real, row) for row in rows.T.astype(digits)))


def dense_cylinder(axis, lamp, eye, gamma, nu):
    """∮ D G dψ/(2 sinθ_V) by 2001 midpoints of τ, ψ = w sinh τ from Q across the axis, over the whole turn."""
    half = (lamp + eye) / np.linalg.norm(lamp + eye)
    along = axis @ half
    first = (half - along * axis) / np.linalg.norm(half - along * axis)
    width = math.hypot(gamma / math.sqrt(2 ** (1 / nu) - 1), math.asin(min(abs(along), 1)))
    tau = np.linspace(-1, 1, 4003)[1::2] * math.asinh(math.pi / width)
    turn = width * np.sinh(tau)[:, None]
    normal = np.cos(turn) * first + np.sin(turn) * np.cross(axis, first)
    cos_half, facing = normal @ half, np.minimum(normal @ lamp, normal @ eye)
    angle = np.arctan2(np.linalg.norm(np.cross(normal, half), axis=-1), cos_half)
    shade = np.clip(2 * cos_half * facing / (eye @ half), 0, 1) * (facing > 0)
    weight = (tau[1] - tau[0]) * width * np.cosh(tau)
    return (weight * printed_density(angle, gamma, nu) * shade).sum() / (2 * np.linalg.norm(np.cross(axis, eye)))


def dense_sphere(phase, gamma, nu):
    """∫ D G dN/π by 80 nodes about Q and 400 midpoints of τ, φ = w sinh τ, up to the horizon of lamp and eye."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    cosine, sine = math.cos(phase / 2), math.sin(phase / 2) * np.cos(math.pi / 4 * (nodes + 1))[:, None]
    width = gamma / math.sqrt(2 ** (1 / nu) - 1)
    last = np.arcsinh(np.arctan2(cosine, sine) / width)
    tau = last * (np.arange(400) + 0.5) / 400
    angle = width * np.sinh(tau)
    shade = np.clip(2 * np.cos(angle) * (np.cos(angle) * cosine - np.sin(angle) * sine) / cosine, 0, 1)
    values = printed_density(angle, gamma, nu) * shade * np.sin(angle) * width * np.cosh(tau) * last / 400
    return weights @ values.sum(axis=1)  # 4 quadrants of π/2, half of it a unit of the nodes, over π: 1


GRID = [(gamma, nu) for gamma in (0.002, 0.02, 0.1, 0.5) for nu in (0.3, 0.6, 1.0, 1.5, 3.0, 60.0)]


def test_cylinders_keep_one_per_cent_for_every_width_and_tail():
    """Of the largest value, as stated; the worst of 24 pairs (γ, ν) is 0.6 %, in both precisions."""
    jit, where = arrays(), directions(5, 70)
    given = {jit.Float: [vectors(v, "Array3f") for v in where], jit.Float64: [vectors(v) for v in where]}
    for gamma, nu in GRID:
        true = np.array([dense_cylinder(*one, gamma, nu) for one in zip(*where, strict=True)])
        for real, (axis, lamp, eye) in given.items():
            got = np.array(cylinder_facets(axis, lamp, eye, dr.opaque(real, gamma), dr.opaque(real, nu)))
            assert np.abs(got - true).max() < 0.01 * true.max(), (gamma, nu)


def test_spheres_keep_one_per_cent_for_every_width_and_tail():
    """The nodes, and the table of 256 entries that kernels read, also where the value falls to 0 near χ = π."""
    phases = np.concatenate([np.linspace(0.01, 3.0, 9), math.pi - np.logspace(-3, -1, 5)])
    place = np.array([graded_place(math.cos(phase)) for phase in phases])
    for gamma, nu in GRID[::3] + GRID[1::12]:
        true = np.array([dense_sphere(phase, gamma, nu) for phase in phases])
        table = np.interp(place, np.linspace(0, 1, 256), sphere_table(gamma, 256, nu=nu, graded=True))
        assert np.abs(table - true).max() < 0.004 * true.max(), (gamma, nu)
        for k in (3, 8, 11):  # as Python numbers: kernels unroll the nodes, which takes seconds to compile
            assert abs(sphere_facets(math.cos(phases[k]), gamma, nu) - true[k]) < 0.01 * true.max(), (gamma, nu)


@pytest.mark.parametrize("element", ["plane", "cylinder", "sphere"])
def test_kernels_read_the_tails_of_each_material(element):
    """A scene of Gaussian and tailed materials, in single precision, against the printed formula in double."""
    where = directions(7, 60)
    tails = (0.4, math.inf, 2.0)
    reflectances = [Reflectance(0.1, 0.02, 0.1, 1.5, WHITE, element=element, nu=nu) for nu in tails]
    materials = Materials(reflectances, palette_of(reflectances, [], [WHITE]))
    _, lamp, eye = where
    for number, nu in enumerate(tails):
        got = materials.weights(arrays().UInt(number), *(vectors(v, "Array3f") for v in where)).interface
        finite = min(nu, 1e9)  # printed densities of large ν round to 1 in double precision
        half = (lamp + eye) / np.linalg.norm(lamp + eye, axis=-1, keepdims=True)
        deviation = (eye * half).sum(-1)
        mirror = 0.02 * np.array(fresnel(arrays().Float64(deviation), 1.5))
        if element == "plane":
            true = torrance_sparrow_in_double(*where, finite)
        elif element == "cylinder":
            true = mirror * [dense_cylinder(*one, 0.1, min(nu, 1e6)) for one in zip(*where, strict=True)]
        else:
            true = mirror * [dense_sphere(phase, 0.1, min(nu, 1e6)) for phase in 2 * np.arccos(deviation)]
        bound = {"plane": 2e-4, "cylinder": 0.01, "sphere": 0.004}[element]
        assert np.abs(np.array(got) - true).max() < bound * true.max()


def torrance_sparrow_in_double(axis, lamp, eye, nu):
    """β D F G/cosθ_r with β = 0.02, γ = 0.1, n = 1.5 by NumPy; D as printed, or eq. (4) for large ν."""
    half = (lamp + eye) / np.linalg.norm(lamp + eye, axis=-1, keepdims=True)
    incidence, view, cosine, c = ((a * b).sum(-1) for a, b in ((axis, lamp), (axis, eye), (axis, half), (eye, half)))
    angle = np.arctan2(np.linalg.norm(np.cross(axis, half), axis=-1), cosine)
    density = np.exp(-np.log(2) * (angle / 0.1) ** 2) if nu > 1e6 else printed_density(angle, 0.1, nu)
    g = np.sqrt(1.5**2 + c**2 - 1)
    mirror = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
    seen = (incidence > 0) & (view > 0)
    shade = np.minimum(1, 2 * cosine * np.minimum(view, incidence) / c)
    return np.where(seen, 0.02 * density * mirror * shade / np.where(seen, view, 1), 0)


def test_narrow_facets_keep_their_peak_in_single_precision():
    """At γ = 0.002 the cosine of φ in single precision has no digit of γ² left; kernels with tails keep 1 %."""
    jit, angle = arrays(), np.linspace(0, 0.01, 41)
    normal = vectors(np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1), "Array3f")
    up = jit.Array3f(0, 0, 1)
    for nu in (0.3, 1.0, 5.0):
        got = np.array(torrance_sparrow(normal, up, up, 0.0, 25.0, 0.002, 1.5, jit.Float(nu)).interface)
        true = printed_density(angle, 0.002, nu) / np.cos(angle)
        np.testing.assert_allclose(got, true, rtol=0.01)


def test_one_row_more_where_facets_have_tails_and_the_same_rows_without():
    gaussian, tailed = Reflectance(0.1, 0.1, 0.2, 1.5, WHITE), Reflectance(0.1, 0.1, 0.2, 1.5, WHITE, nu=0.7)
    rows = np.array([0.1, 0.1, 0.2, 1.5, 0, 1, 1], np.float32)
    for reflectances, width in (([gaussian], 7), ([gaussian, tailed], 8)):
        materials = Materials(reflectances, palette_of(reflectances, [], [WHITE]))
        assert materials.width == width and materials.have_tails == (width == 8)
        np.testing.assert_array_equal(np.array(materials.rows)[:7], rows)
    np.testing.assert_array_equal(np.array(materials.rows)[[7, 15]], np.array([math.inf, 0.7], np.float32))


def dense_albedo(view, gamma, n, nu):
    """∫ f dL of a plane for β = 1 by 700 midpoints of τ, φ = w sinh τ, and 180 of the half turn."""
    width = gamma / math.sqrt(2 ** (1 / nu) - 1)
    last = math.asinh(math.pi / 2 / width)
    tau, turn = ((np.arange(count) + 0.5) / count for count in (700, 180))
    angle, turn = width * np.sinh(last * tau)[:, None], math.pi * turn
    half = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle) + 0 * turn], -1)
    eye = np.array([math.sin(view), 0, math.cos(view)])
    c = half @ eye
    incidence = (2 * c[..., None] * half - eye)[..., 2]
    seen = (c > 0) & (incidence > 0)
    g = np.sqrt(n * n + c * c - 1)
    mirror = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
    shade = np.minimum(1, 2 * np.cos(angle) * np.minimum(eye[2], incidence) / np.where(seen, c, 1))
    values = (
        printed_density(angle, gamma, nu)
        * mirror
        * shade
        / eye[2]
        * 4
        * c
        * np.sin(angle)
        * np.cosh(last * tau)[:, None]
    )
    return (np.where(seen, values, 0)).sum() * width * last / 700 * 2 * math.pi / 180


@pytest.mark.parametrize(("gamma", "nu"), GRID[::2])
def test_energy_holds_one_per_cent_with_48_by_96_nodes(gamma, nu):
    """Views from the normal to 89.7°; the worst is 0.3 %, of the nodes and of the oracle's own midpoints."""
    albedo = interface_albedo(gamma, 1.5, nu)
    for view in (0, 4, 8, 11, 12):
        assert albedo[view] == pytest.approx(dense_albedo(VIEWS[view], gamma, 1.5, nu), rel=0.005)


@pytest.mark.parametrize("nu", [0.5, 2.0, math.inf])
@pytest.mark.parametrize("element", ["cylinder", "sphere"])
def test_the_energy_of_an_element_is_the_integral_of_its_own_f(element, nu):
    """Against equal-area points of the whole sphere of lamps, for eyes across the tangent and towards it."""
    k = np.arange(100_000) + 0.5
    z, turn = 1 - k / 50_000, math.pi * (1 + 5**0.5) * k
    lamps = vectors(np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], -1))
    albedo = interface_albedo(0.3, 1.5, nu, element)
    gamma, exponent = (dr.opaque(arrays().Float64, value) for value in (0.3, nu))
    for view in (0, 6, 9) if element == "cylinder" else (0,):
        eye = arrays().Array3f64(math.sin(VIEWS[view]), 0.0, math.cos(VIEWS[view]))
        if element == "cylinder":
            tails = nu if math.isinf(nu) else exponent
            f = np.array(cylinder_facets(arrays().Array3f64(1, 0, 0), lamps, eye, gamma, tails))
        else:
            phase = np.arccos(np.array(dr.dot(lamps, eye)))
            f = np.interp(phase, np.linspace(0, math.pi, 1001), sphere_table(0.3, 1001, nu=nu))
        mirror = np.array(fresnel(cos_deviation(dr.dot(lamps, eye)), 1.5))
        # the elements' own nodes have up to 1 % of the largest value
        assert albedo[view] == pytest.approx(4 * math.pi * (mirror * f).mean(), rel=0.01)


def test_an_element_is_refused_for_its_own_energy_alone():
    """A sphere reflects 0.834 of the light where a plane of the same figures would give back 1.131 at grazing views."""
    figures = (0.25, 0.93, 0.2, 1.5, WHITE)
    with pytest.raises(InputError, match=r"seen at .*° it reflects 1\.131"):
        Reflectance(*figures)
    sphere = Reflectance(*figures, element="sphere")
    assert sphere.directional_albedo().max() == pytest.approx(0.834, abs=0.002)
    with pytest.raises(InputError, match=r"energy conservation: it reflects"):
        Reflectance(0.25, 5.0, 0.2, 1.5, WHITE, element="sphere")


@pytest.mark.parametrize("nu", [0.3, 0.77, 1.0, 1.0 + 1e-9, 4.0, 1e6, math.inf])
def test_the_mass_of_facets_and_its_inverse(nu):
    """M against ∫ φ D dφ of the printed density, by 400 Gauss–Legendre nodes; the inverse gives φ² back."""
    jit, gamma = arrays(), 0.15
    nodes, weights = np.polynomial.legendre.leggauss(400)
    last = np.array([1e-3, 0.05, 0.2, 0.7, 1.57])
    angle = last[:, None] * (nodes + 1) / 2
    density = np.exp(-np.log(2) * (angle / gamma) ** 2) if nu > 1e5 else printed_density(angle, gamma, nu)
    rise = np.log(2) if nu > 1e5 else nu * (2 ** (1 / nu) - 1)
    true = 2 * rise / gamma**2 * (angle * density) @ weights * last / 2
    squared, exponent = jit.Float64(last**2), dr.opaque(jit.Float64, nu)
    mass = facet_mass(squared, gamma, exponent)
    # for ν of a million eq. (4) stands in for the density: 1/ν
    np.testing.assert_allclose(np.array(mass), true, rtol=1e-5 if nu == 1e6 else 1e-9)
    there = mass < 1 - 1e-9  # beyond, the Gaussian has no digit left that would tell one angle from another
    back = np.array(squared_angle_of_mass(mass, gamma, exponent))[np.array(there)]
    np.testing.assert_allclose(back, last[np.array(there)] ** 2, rtol=1e-6)


def glossy(element, nu):
    """Little of the body, so that the picture is that of the facets."""
    return Reflectance(0.002, 0.2, 0.1, 1.5, WHITE, element=element, nu=nu)


def case_of(voxels):
    scene = hg.Scene(camera(), (DAYLIGHT,), (voxels.box(),))
    return OracleCase("facets with tails", [voxels], scene, camera_rays(scene.camera))


@pytest.mark.parametrize(
    "voxels",
    [
        replace(coloured_block(), body_colour=None, basis=(), materials=(glossy("plane", 0.8), glossy("sphere", 0.5))),
        replace(threads(count=15), materials=(glossy("cylinder", 0.4),)),
        replace(
            coloured_block(), body_colour=None, basis=(), materials=(glossy("plane", math.inf), glossy("sphere", 0.4))
        ),
    ],
    ids=["planes and spheres", "cylinders", "with and without tails"],
)
def test_pictures_of_facets_with_tails_are_those_of_the_oracle(voxels):
    """Absolute radiance of a box against eq. (2)–(12) in double precision, at a tolerance of 1 %."""
    case = case_of(voxels)
    true, transmittance = case.truth()
    settings = hg.Settings(shadows="march", tolerance=0.01)
    error, ratio = error_and_ratio(case.seen(settings), true, transmittance)
    assert error < 0.01 and abs(ratio - 1) < 0.005
    gaussian = replace(voxels, materials=tuple(replace(m, nu=math.inf) for m in voxels.materials))
    other = case_of(gaussian).seen(settings)
    assert error_and_ratio(other, true, transmittance)[0] > 0.1  # the tails are seen


@pytest.mark.parametrize("nu", [0.4, 1.0, 2.5, math.inf])
def test_directions_are_drawn_by_the_density_of_facets(nu):
    """The stated density of the mirrored part is φ D/(2π sinφ ∫φ D dφ) over 4 cosθ_Q, with D as printed.

    That samples follow the stated density is decided by chi-square in tests/laws/test_reflectance.py.
    """
    gamma, view = 0.15, math.radians(20)
    nodes, weights = np.polynomial.legendre.leggauss(800)
    grid = math.pi / 4 * (nodes + 1)
    law = lambda angle: np.exp(-np.log(2) * (angle / gamma) ** 2) if nu > 1e9 else printed_density(angle, gamma, nu)  # noqa: E731
    whole = weights @ (grid * law(grid)) * math.pi / 4
    angle = np.linspace(0.01, 1.1, 67)
    half = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], -1)  # away from the eye: no −Q among them
    eye = np.array([math.sin(view), 0, math.cos(view)])
    deviation = half @ eye
    lamp = 2 * deviation[:, None] * half - eye
    there = deviation > 0.05
    stated = density_to_lamp(
        vectors(lamp[there]),
        arrays().Array3f64(*eye.tolist()),
        1.0,
        gamma,
        nu if math.isinf(nu) else arrays().Float64(nu),
    )
    true = angle * law(angle) / (2 * math.pi * np.sin(angle) * whole) / (4 * deviation)
    np.testing.assert_allclose(np.array(stated), true[there], rtol=1e-6)


def test_a_surface_with_tails_has_the_radiance_of_the_formula():
    """β D F G/cosθ_r at the point of a floor that the centre of each pixel sees, in absolute radiance."""
    camera = hg.Camera(13, 11, (25.0, 25.0), (6.5, 5.5)).look_at((0.0, -0.6, 0.7), (0.0, 0.0, 0.0))
    lamp = np.array([0.1, 0.5, 0.8]) / math.sqrt(0.9)
    for nu in (0.5, 3.0):
        matter = Reflectance(0.0, 0.02, 0.1, 1.5, WHITE, nu=nu)
        scene = hg.Scene(
            camera, (hg.Lamp(to_lamp=tuple(lamp), intensity=2.0),), surfaces=(Surface.floor(0, 2, matter),)
        )
        y, x = np.mgrid[:11, :13] + 0.5
        rays = np.stack([(x - 6.5) / 25, (y - 5.5) / 25, np.ones_like(x)], -1) @ camera.world_to_camera[:3, :3]
        eye = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        true = 2 * torrance_sparrow_in_double(np.array([0.0, 0, 1]), lamp, eye, nu)
        # single precision, and a floor that is lit 2e-5 of its extent above itself
        np.testing.assert_allclose(hg.render(scene).weights[..., 1], true, rtol=0, atol=2e-4 * true.max())
