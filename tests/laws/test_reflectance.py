"""Laws of the reflectance (MODEL §2): Fresnel's limits, reciprocity, energy, elements = quadrature, chi-square.

The oracle is a transcription of eq. (3)–(6) in NumPy that shares no line with the product.
"""

import math

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import element_weights, sphere_facets, sphere_table
from hagoromo.reflectance.interface_albedo import VIEWS, interface_albedo
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.sampling import density_to_lamp, sample_to_lamp
from hagoromo.reflectance.torrance_sparrow import fresnel, squared_angle, torrance_sparrow
from tests.judges import sampler_follows_density


def unit(count, seed):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def arrays3(v):
    return arrays().Array3f64(*(column(arrays().Float64, v[..., k].ravel()) for k in range(3)))


def oracle(N, L, V, alpha, beta, gamma, n):
    """Body and interface weight of eq. (3) by NumPy, broadcast over leading axes."""
    dot = lambda a, b: (a * b).sum(-1)  # noqa: E731
    Q = (L + V) / np.linalg.norm(L + V, axis=-1, keepdims=True)
    ti, tr, ph, tq = dot(N, L), dot(N, V), np.arccos(np.clip(dot(N, Q), -1, 1)), dot(V, Q)
    g = np.sqrt(n**2 + tq**2 - 1)
    F = 0.5 * (g - tq) ** 2 / (g + tq) ** 2 * (1 + (tq * (g + tq) - 1) ** 2 / (tq * (g - tq) + 1) ** 2)
    G = np.minimum(1, np.minimum(2 * np.cos(ph) * tr / tq, 2 * np.cos(ph) * ti / tq))
    with np.errstate(divide="ignore", invalid="ignore"):
        ws = beta * np.exp(-np.log(2) * ph**2 / gamma**2) * F * G / tr
    seen = (ti > 0) & (tr > 0)
    return np.where(seen, alpha * ti, 0), np.where(seen, ws, 0)


def test_equations_agree_with_their_transcription():
    N, L, V = unit(4999, 1), unit(4999, 2), unit(4999, 3)
    got = torrance_sparrow(arrays3(N), arrays3(L), arrays3(V), 0.21, 0.47, 0.23, 1.43)
    for mine, true in zip(got, oracle(N, L, V, 0.21, 0.47, 0.23, 1.43), strict=True):
        # grazing quotients lose digits: 1e-9 of the largest value in double precision
        assert np.abs(np.array(mine) - true).max() < 1e-9 * np.abs(true).max()


def test_python_floats_and_kernels_give_the_same_number():
    from drjit.scalar import Array3f64

    N, L, V = unit(1, 4)[0], unit(1, 5)[0], unit(1, 6)[0]
    N = N if N @ (L + V) > 0 else -N
    scalar = torrance_sparrow(Array3f64(*N), Array3f64(*L), Array3f64(*V), 0.2, 0.3, 0.4, 1.5)
    array = torrance_sparrow(arrays3(N[None]), arrays3(L[None]), arrays3(V[None]), 0.2, 0.3, 0.4, 1.5)
    assert np.allclose(
        [scalar.body, scalar.interface], [np.array(array.body)[0], np.array(array.interface)[0]], rtol=1e-12
    )


@pytest.mark.parametrize("n", [1.1, 1.33, 1.5, 2.4])
def test_fresnel_limits(n):
    assert fresnel(1.0, n) == pytest.approx(((n - 1) / (n + 1)) ** 2, rel=1e-12)
    assert fresnel(1e-7, n) == pytest.approx(1.0, abs=1e-5)  # 1 − F falls as 4 n² c / √(n²−1)


@pytest.mark.parametrize("cosine", [1e-3, 0.3, 0.7, 1.0])
def test_without_a_boundary_nothing_is_reflected(cosine):
    """n = 1: g = c, so F = 0 at every angle; with g² as the paper prints it air would reflect in air."""
    assert fresnel(cosine, 1.0) == pytest.approx(0.0, abs=1e-20)


def test_squared_angle_is_arccos_squared():
    angle = np.concatenate([np.linspace(0, 0.12, 401), np.linspace(0.12, 3.14, 401)])
    got = np.array(squared_angle(arrays().Float64(np.cos(angle))))
    # cos φ itself keeps φ² to 2e-16 only
    assert np.abs(got - angle**2).max() < 1e-9


def test_reciprocity_of_both_parts():
    """f cosθ_r = (BRDF) cosθ_i cosθ_r does not change when lamp and eye change places."""
    N, L, V = unit(2003, 7), unit(2003, 8), unit(2003, 9)
    a = torrance_sparrow(arrays3(N), arrays3(L), arrays3(V), 0.2, 0.5, 0.3, 1.4)
    b = torrance_sparrow(arrays3(N), arrays3(V), arrays3(L), 0.2, 0.5, 0.3, 1.4)
    there, back = (N * V).sum(1), (N * L).sum(1)
    for first, second in zip(a, b, strict=True):
        assert np.allclose(np.array(first) * there, np.array(second) * back, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("element", ["plane", "cylinder", "sphere"])
def test_body_alone_reflects_pi_alpha(element):
    """∫ f dL = π α c_b for every view: a Lambertian element, seen from anywhere, gives back its albedo."""
    L = _sphere_points(400_000)
    V = np.broadcast_to(np.array([0.48, 0.6, 0.64]), L.shape)
    axis = np.broadcast_to(np.array([0.0, 0.6, 0.8]), L.shape)
    body = np.array(element_weights(element, arrays3(axis), arrays3(L), arrays3(V), 0.3, 0.0, 0.2, 1.5).body)
    assert 4 * math.pi * body.mean() == pytest.approx(math.pi * 0.3, rel=1e-3)  # a horizon cuts the point set


@pytest.mark.by_night("0.05-sphere", "0.2-sphere")
@pytest.mark.parametrize("element", ["cylinder", "sphere"])
@pytest.mark.parametrize("gamma", [0.05, 0.2, 0.4])
def test_elements_are_the_mean_over_the_normals_that_the_eye_sees(element, gamma):
    count = 23
    axis, L, V = unit(count, 11), unit(count, 12), unit(count, 13)
    got = element_weights(element, arrays3(axis), arrays3(L), arrays3(V), 0.3, 0.5, gamma, 1.5)
    true = np.array([_averaged(element, *directions, gamma) for directions in zip(axis, L, V, strict=True)])
    # closed forms: only the oracle's own 1e-4; ten nodes on the cylinder: 1 % of the largest value (docstring)
    for mine, real, bound in zip(got, true.T, (2e-4, 1e-2), strict=True):
        assert np.abs(np.array(mine) - real).max() < bound * real.max()


def _averaged(element, axis, L, V, gamma):
    if element == "sphere":
        N = _sphere_points(200_000)
    else:
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        turn = (np.arange(40_000) + 0.5) / 40_000 * 2 * np.pi
        N = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(axis, across)
    seen = np.maximum(N @ V, 0)
    return [(w * seen).sum() / seen.sum() for w in oracle(N, L, V, 0.3, 0.5, gamma, 1.5)]


def _sphere_points(count):
    """Fibonacci points: equal areas."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)


def test_sphere_table_is_its_quadrature():
    phases = np.linspace(0, math.pi, 97)
    exact = sphere_table(0.2, 97, nodes=96)
    table = np.interp(phases, np.linspace(0, math.pi, 256), sphere_table(0.2, 256))
    few = np.array(sphere_facets(arrays().Float64(np.cos(phases)), arrays().Float64(0.2)))
    assert np.abs(table - exact).max() < 1e-3 * exact.max()  # 32 against 96 nodes, and linear interpolation
    assert np.abs(few - exact).max() < 3e-3 * exact.max()  # what its docstring says of 12 nodes


@pytest.mark.by_night("0.05-1.5", "0.5-1.7")
@pytest.mark.parametrize(("gamma", "n"), [(0.05, 1.5), (0.2, 1.3), (0.5, 1.7)])
def test_interface_albedo_is_the_integral_over_lamps(gamma, n):
    """The quadrature over half vectors against equal-area points of the hemisphere of lamps."""
    L = _sphere_points(2_000_000)
    for view in (0, 3, 5):
        V = np.array([math.sin(VIEWS[view]), 0, math.cos(VIEWS[view])])
        mean = 4 * math.pi * oracle(np.array([0, 0, 1.0]), L, V, 0, 1, gamma, n)[1].mean()
        assert interface_albedo(gamma, n)[view] == pytest.approx(mean, rel=2e-3)


def test_energy_is_conserved_or_the_reflectance_is_refused():
    white = Spectrum.constant(1.0)
    assert Reflectance(1 / math.pi, 0.0, 0.2, 1.5, white).directional_albedo() == pytest.approx(1.0)
    kept = Reflectance(0.25, 0.3, 0.2, 1.5, white)
    assert kept.directional_albedo().max() <= 1.0
    for alpha, beta in ((0.32, 0.0), (0.25, 5.0)):
        with pytest.raises(InputError, match="breaks energy conservation"):
            Reflectance(alpha, beta, 0.2, 1.5, white)


@pytest.mark.parametrize(
    "figures", [(-0.1, 0.1, 0.2, 1.5), (0.1, np.nan, 0.2, 1.5), (0.1, 0.1, 0.0, 1.5), (0.1, 0.1, 0.2, 0.9)]
)
def test_figures_outside_their_range_are_refused(figures):
    alpha, beta, gamma, n = figures
    with pytest.raises(InputError):
        Reflectance(alpha, beta, gamma, n, Spectrum.constant(0.5))


@pytest.mark.parametrize(
    ("gamma", "tilt", "nu"),
    [
        (0.1, 0.3, math.inf),
        (0.3, 0.9, math.inf),
        (0.6, 1.3, math.inf),
        (0.1, 0.6, 0.4),
        (0.2, 0.9, 1.0),
        (0.2, 0.3, 2.5),
    ],
)
def test_sampled_directions_follow_their_density(gamma, tilt, nu):
    """Chi-square of 400,000 directions in cells of equal area against the integrated density; significance 0.1 %."""
    jit, count, seed = arrays(), 400_000, 17
    choice, u, v = (jit.Float64(row) for row in np.random.default_rng(seed).random((3, count)))
    V = jit.Array3f64(math.sin(tilt), 0.0, math.cos(tilt))
    share, width = jit.Float64(0.6), jit.Float64(gamma)
    tails = nu if math.isinf(nu) else dr.opaque(jit.Float64, nu)
    L = np.array(sample_to_lamp(V + dr.zeros(jit.Array3f64, count), share, width, choice, u, v, tails))
    rows, columns, fine = 20, 30, 48  # fine: the density grows as 1/cosθ_Q where L = −V
    cell = _cell(L.T, rows, columns)
    seen = np.bincount(cell, minlength=rows * columns)
    z = 1 - 2 * (np.arange(rows * fine) + 0.5) / (rows * fine)
    turn = 2 * np.pi * (np.arange(columns * fine) + 0.5) / (columns * fine)
    z, turn = (grid.ravel() for grid in np.meshgrid(z, turn, indexing="ij"))
    grid = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], -1)
    density = np.array(density_to_lamp(arrays3(grid), V + dr.zeros(jit.Array3f64, len(grid)), share, width, tails))
    expected = np.bincount(_cell(grid, rows, columns), density, rows * columns) * 4 * np.pi / len(grid) * count
    assert expected.sum() == pytest.approx(count, rel=2e-3)  # the density integrates to 1
    assert sampler_follows_density(seen, expected, significance=1e-3, expected_error=0.01)  # 1 %: of the fine grid


def _cell(direction, rows, columns):
    row = np.clip(((1 - direction[:, 2]) / 2 * rows).astype(int), 0, rows - 1)
    turn = np.arctan2(direction[:, 1], direction[:, 0]) % (2 * np.pi)
    return row * columns + np.clip((turn / (2 * np.pi) * columns).astype(int), 0, columns - 1)
