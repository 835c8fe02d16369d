"""Scattering of smooth light: what each material sends on of incident light of the second order in direction.

All that is needed of f are its moments over the directions of light, seen from V at the cosine μ = a·V to the axis a
(t: unit, from a towards V; b across both):

    k = ∫ f dL,  A_t = ∫ f L_t dL,  A_a = ∫ f L_a dL,  B_t = ∫ f (L_t² − L_b²) dL,  B_a = ∫ f (L_a² − L_b²) dL,
    B_ta = ∫ f L_t L_a dL

σ(V) f is symmetric in L and V, so that the same six numbers also say how the light of one lamp leaves, and by a sum
over μ how smooth light leaves (`Blocks`). Body, interface and transmitted light have six each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, lru_cache

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, clip, column, lookup
from hagoromo.reflectance.body import LAMBERT, LambertBody
from hagoromo.reflectance.element import element_weights, projected_area, sphere_body, sphere_table
from hagoromo.reflectance.facets import GAUSSIAN, is_gaussian
from hagoromo.reflectance.interface_albedo import VIEWS, interface_albedo
from hagoromo.reflectance.parameters import BodyLaw
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.torrance_sparrow import cos_deviation, fresnel
from hagoromo.reflectance.transmission import around_fibre, clear_lobes, facing, far_body, lobe_widths, table_from
from hagoromo.transport.field.second_order import MEAN, SecondOrder, outer
from hagoromo.transport.gamma_rows import GammaRows

ENTRIES = 65  # of a table over the angle to the axis, on either side of it
MOMENTS = 6
REFLECTED = 2  # parts: body, interface; then what is transmitted once, and twice as far
BLOCK_NUMBERS = 14
NODES = 24  # Gauss–Legendre nodes of cosines on either side, and twice as many turns over half a circle
SPHERE_NODES, SPHERE_ENTRIES = 64, 256
LEAST_LOBE = 0.2  # [rad] as LEAST_GAMMA, of lobes of transmitted light
LEAST_GAMMA = 0.2  # [rad] narrower facets are widened, and keep their albedo: smooth light shows no difference


class ScatteringTables:
    """Tables of all materials, in the order of their numbers."""

    def __init__(self, reflectances: Sequence[Reflectance], gamma_rows: GammaRows | None = None) -> None:
        """gamma_rows: of a scene with textures of γ."""
        jit, self.gamma_rows = arrays(), gamma_rows
        reflectances = gamma_rows.reflectances if gamma_rows else reflectances
        self.parts = REFLECTED + any(r.transmits for r in reflectances) + any(r.clear_share > 0.0 for r in reflectances)
        figures = [moments_and_blocks(*_figures(r), self.parts) for r in reflectances]
        if gamma_rows:
            figures = [(_brighter(m, factor), b) for (m, b), factor in zip(figures, gamma_rows.factors, strict=True)]
        self.moments_of = lookup(jit.Float, np.stack([f[0] for f in figures]).astype(np.float32))
        self.blocks_of = lookup(jit.Float, np.stack([f[1] for f in figures]).astype(np.float32))
        dr.eval(self.moments_of, self.blocks_of)

    def moments(self, material: UInt, part: int, cosine: Float, gamma: Float | None = None) -> list[Float]:
        """The six moments of a part, as in `Palette.parts`, at μ = `cosine`; gamma: in place of the material's."""
        if gamma is None or self.gamma_rows is None:
            return self._moments(material, part, cosine)
        first, second, share = self.gamma_rows.at(material, gamma)
        both = (self._moments(row, part, cosine) for row in (first, second))
        return [dr.fma(share, b - a, a) for a, b in zip(*both, strict=True)]

    def _moments(self, row: UInt, part: int, cosine: Float) -> list[Float]:
        jit = arrays()
        place = dr.acos(dr.fmin(dr.abs(cosine), 1.0)) * ((ENTRIES - 1) / (0.5 * math.pi))
        first = dr.minimum(jit.UInt(place), ENTRIES - 2)
        side = dr.select(cosine < 0.0, jit.UInt(1), 0)
        start = (((row * self.parts + part) * 2 + side) * ENTRIES + first) * MOMENTS
        share = place - jit.Float(first)
        low, high = (
            [dr.gather(jit.Float, self.moments_of, start + (k * MOMENTS + m)) for m in range(MOMENTS)] for k in (0, 1)
        )
        return [dr.fma(share, b - a, a) for a, b in zip(low, high, strict=True)]

    def towards(
        self, material: UInt, part: int, axis: Array3f, to_eye: Array3f, gamma: Float | None = None
    ) -> list[Float]:
        """Factors on the nine numbers of the incident light whose sum is ∫ f L dω, the radiance towards the eye."""
        cosine, aside = along_and_across(axis, to_eye)
        k, a_t, a_a, b_t, b_a, b_ta = self.moments(material, part, cosine, gamma)
        v = aside * a_t + axis * a_a
        xx, yy, xy, xz, yz = (
            b_t * t + b_a * a + 2.0 * b_ta * ta
            for t, a, ta in zip(outer(aside, aside), outer(axis, axis), outer(aside, axis), strict=True)
        )
        # Q : B with the traceless matrix B; zz = −xx − yy in both
        return [k, v.x, v.y, v.z, 2.0 * xx + yy, 2.0 * yy + xx, 2.0 * xy, 2.0 * xz, 2.0 * yz]

    def from_lamp(self, material: UInt, part: int, axis: Array3f, to_lamp: Array3f) -> SecondOrder:
        """∫-projection of A(V) f(a; L, V) over V, divided by A(L): what one lamp's light leaves as."""
        cosine, aside = along_and_across(axis, to_lamp)
        k, a_t, a_a, b_t, b_a, b_ta = self.moments(material, part, cosine)
        matrix = [
            7.5 * MEAN * (b_t * t + b_a * a + 2.0 * b_ta * ta)
            for t, a, ta in zip(outer(aside, aside), outer(axis, axis), outer(aside, axis), strict=True)
        ]
        return SecondOrder(MEAN * k, 3.0 * MEAN * (aside * a_t + axis * a_a), tuple(matrix))  # type: ignore[arg-type]

    def blocks(self, material: UInt, part: int) -> list[Float]:
        """The numbers of `scattered` of a part."""
        start = (material * self.parts + part) * BLOCK_NUMBERS
        return [dr.gather(arrays().Float, self.blocks_of, start + k) for k in range(BLOCK_NUMBERS)]


def along_and_across(axis: Array3f, way: Array3f) -> tuple[Float, Array3f]:
    """Cosine of `way` to `axis`, and the unit vector across the axis towards it."""
    cosine = clip(dr.dot(axis, way), -1.0, 1.0)
    across = way - axis * cosine
    return cosine, across * dr.rsqrt(dr.fmax(dr.squared_norm(across), 1e-12))


def scattered(blocks: list[Float], axis: Array3f, light: SecondOrder) -> SecondOrder:
    """The projection of A(V) ∫ f L dω over V: light of the second order as an element of `axis` sends it on."""
    m, (x11, x21, x12, x22), y = blocks[:9], blocks[9:13], blocks[13]
    v_along, turned = dr.dot(axis, light.v), light.times(axis)
    q_along = dr.dot(axis, turned)
    v_across, q_across = light.v - axis * v_along, turned - axis * q_along
    incident = (light.s, v_along, q_along)
    s, along, matrix_along = (sum(m[3 * row + k] * incident[k] for k in range(3)) for row in range(3))
    vector = axis * along + v_across * x11 + q_across * x21
    across = v_across * x12 + q_across * x22
    axes, in_tilt, out_tilt = outer(axis, axis), outer(axis, q_across), outer(axis, across)
    matrix = [
        1.5 * matrix_along * aa + 2.0 * after + y * (q - 1.5 * q_along * aa - 2.0 * before)
        for q, aa, before, after in zip(light.q, axes, in_tilt, out_tilt, strict=True)
    ]
    return SecondOrder(s, vector, tuple(matrix))  # type: ignore[arg-type]


@lru_cache(maxsize=256)
def moments_and_blocks(
    element: str,
    alpha: float,
    beta: float,
    gamma: float,
    n: float,
    nu: float,
    body_law: BodyLaw,
    lobes: tuple,
    passed: tuple[float, float],
    parts: int,
) -> tuple[NDArray, NDArray]:
    """Tables of the moments (parts, sides, ENTRIES, 6) and the blocks (parts, 14) of a reflectance of white colours.

    passed: weight of far-side body light and share of clear light.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = 0.5 + 0.5 * nodes, 0.5 * weights
    steps = np.cos(np.linspace(0.0, 0.5 * math.pi, ENTRIES))
    steps[[0, -1]] = 1.0 - 1e-6, 1e-3  # seen along its edge a plane has no side, along its axis a cylinder no length
    seen = np.concatenate([sign * part for sign in (1.0, -1.0) for part in (steps, nodes)])
    figures = alpha, beta, gamma, n, nu, body_law, lobes, passed
    all_moments = _of_sphere(figures, seen) if element == "sphere" else _of_others(element, figures, seen)
    by_side = all_moments[:parts].reshape(parts, 2, ENTRIES + NODES, MOMENTS)
    at_nodes = by_side[:, :, ENTRIES:].reshape(parts, 2 * NODES, MOMENTS)
    cosines = np.concatenate([nodes, -nodes])
    area = np.array([projected_area(element, float(cosine)) for cosine in cosines])
    each = 0.5 * np.concatenate([weights, weights]) * area  # the mean over all directions of A times …
    blocks = np.stack([_blocks(moments, cosines, each) for moments in at_nodes])
    return by_side[:, :, :ENTRIES], blocks


def _brighter(moments: NDArray, factor: float) -> NDArray:
    """Moments of a reflectance whose β is not lower by a factor."""
    scaled = moments.copy()
    scaled[1] /= factor
    return scaled


def _figures(r: Reflectance) -> tuple:
    """What `moments_and_blocks` takes, with narrow facets widened at the same albedo."""
    lobes = [_widened(r, beta, gamma, GAUSSIAN) for beta, gamma in r.lobes]
    beta, gamma = _widened(r, r.beta, r.gamma, r.nu)
    passed = r.far_body, r.clear_share
    return r.element, r.alpha, beta, gamma, r.n, r.nu, r.body_law, tuple(lobes), passed


def _widened(r: Reflectance, beta: float, gamma: float, nu: float) -> tuple[float, float]:
    if gamma >= LEAST_GAMMA or beta == 0.0:
        return float(beta), float(gamma)
    narrow, wide = (interface_albedo(float(g), float(r.n), float(nu), r.element) for g in (gamma, LEAST_GAMMA))
    each = np.cos(VIEWS)
    return float(beta * (narrow @ each) / (wide @ each)), LEAST_GAMMA


def _of_sphere(figures: tuple, seen: NDArray) -> NDArray:
    """The six moments of all parts at the cosines `seen`: (4, seen, 6). f depends on L·V alone."""
    alpha, beta, gamma, n, nu, _, lobes, (far, _) = figures
    cosine, weight = np.polynomial.legendre.leggauss(SPHERE_NODES)
    phase = column(arrays().Float64, cosine)
    facets = beta * _facets(cosine, gamma, nu)
    for more_beta, more_gamma in lobes:
        facets = facets + more_beta * _facets(cosine, more_gamma, GAUSSIAN)
    mirror = np.array(fresnel(cos_deviation(phase), dr.opaque(arrays().Float64, n)))
    legendre = np.stack([np.ones_like(cosine), cosine, 1.5 * cosine**2 - 0.5])
    through = far * np.array(sphere_body(-phase))
    parts = alpha * np.array(sphere_body(phase)), mirror * facets, through, 0.0 * through
    sine = np.sqrt(1.0 - seen * seen)
    rows = []
    for f in parts:
        k, one, two = 2.0 * math.pi * legendre @ (weight * f)
        kinds = k + 0.0 * seen, one * sine, one * seen, two * sine**2, two * seen**2, two * sine * seen
        rows.append(np.stack(kinds, axis=-1))
    return np.stack(rows)


def _facets(cosine: NDArray, gamma: float, nu: float) -> NDArray:
    table = sphere_table(gamma, SPHERE_ENTRIES, nu=nu)
    return np.interp(np.arccos(cosine), np.linspace(0.0, math.pi, SPHERE_ENTRIES), table)


def _of_others(element: str, figures: tuple, seen: NDArray) -> NDArray:
    """As `_of_sphere`, of planes and cylinders: sums over directions of light."""
    jit = arrays()
    alpha, beta, gamma, n, nu, body_law, lobes, passed = figures
    x, y, z, weights = _lights()
    kinds = np.stack([np.ones_like(x), x, z, x * x - y * y, z * z - y * y, x * z]) * weights
    lamps = (column(jit.Float64, np.tile(part, seen.size)) for part in (x, y, z))
    eyes = (column(jit.Float64, np.repeat(part, x.size)) for part in (np.sqrt(1.0 - seen * seen), 0.0 * seen, seen))
    to_lamp, to_eye, axis = jit.Array3f64(*lamps), jit.Array3f64(*eyes), jit.Array3f64(0, 0, 1)
    through = _transmitted(element, passed, (gamma, n), axis, to_lamp, to_eye)
    axis = facing(axis, to_eye) if element == "plane" and max(passed) > 0.0 else axis

    def weights_of(alpha: float, beta: float, gamma: float, nu: float, law: LambertBody = LAMBERT) -> list[NDArray]:
        a, b, g, index = (dr.opaque(jit.Float64, part) for part in (alpha, beta, gamma, n))  # literals compile anew
        exponent = nu if is_gaussian(nu) else dr.opaque(jit.Float64, nu)
        both = element_weights(element, axis, to_lamp, to_eye, a, b, g, index, exponent, law)
        dr.eval(*both)
        return [np.broadcast_to(np.array(f), seen.size * x.size).reshape(seen.size, x.size) for f in both]

    body, interface = weights_of(alpha, beta, gamma, nu, body_law)
    for more_beta, more_gamma in lobes:
        interface = interface + weights_of(0.0, more_beta, more_gamma, GAUSSIAN)[1]
    once, twice = (np.broadcast_to(part, seen.size * x.size).reshape(body.shape) for part in through)
    return np.stack([part @ kinds.T for part in (body, interface, once, twice)])


def _transmitted(
    element: str, passed: tuple[float, float], law: tuple[float, float], axis: Array3f, lamp: Array3f, eye: Array3f
) -> tuple[NDArray, NDArray]:
    """Weights of light that has passed through once, and twice as far, its lobes not narrower than LEAST_LOBE."""
    (far, clear), (gamma, n), nothing = passed, law, np.zeros(1)
    once, twice = far * np.array(far_body(element, axis, lamp, eye)) if far > 0.0 else nothing, nothing
    if clear > 0.0:
        jit = arrays()
        table = table_from(lookup(jit.Float64, around_fibre(gamma, n)))
        widths = tuple(dr.opaque(jit.Float64, max(width, LEAST_LOBE)) for width in lobe_widths(gamma, n))
        lobes = clear_lobes(axis, lamp, eye, dr.opaque(jit.Float64, n), widths, table)  # type: ignore[arg-type]
        dr.eval(*lobes)
        once, twice = once + clear * np.array(lobes[0]), clear * np.array(lobes[1])
    return once, twice


@cache
def _lights() -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Directions of light over half of the sphere (the other half is alike): x, y, z in the order t, b, a; weights."""
    cosines, weights = np.polynomial.legendre.leggauss(NODES)
    cosines = np.concatenate([0.5 + 0.5 * cosines, -0.5 - 0.5 * cosines])
    turns = math.pi * (np.arange(2 * NODES) + 0.5) / (2 * NODES)
    z, turn = (grid.ravel() for grid in np.meshgrid(cosines, turns, indexing="ij"))
    r = np.sqrt(1.0 - z * z)
    each = np.repeat(0.5 * np.concatenate([weights, weights]), turns.size) * (math.pi / turns.size) * 2.0
    return r * np.cos(turn), r * np.sin(turn), z, each


def _blocks(moments: NDArray, cosine: NDArray, each: NDArray) -> NDArray:
    """Of one part, from its moments (nodes, 6) at the cosines of V and their weights times A: (14,).

    Nine for light that is alike around the axis, (s, a·v, a·Qa) to the same; four for what lies across it, from v and
    Qa to v and to Qa; one for the rest of Q.
    """
    k, a_t, a_a, b_t, b_a, b_ta = moments.T
    sine = np.sqrt(1.0 - cosine * cosine)
    legendre = 1.0, cosine, 1.5 * cosine * cosine - 0.5
    alike = [(2 * row + 1) * np.sum(each * p * m) for row, p in enumerate(legendre) for m in (k, a_a, b_a - 0.5 * b_t)]
    x11, x21 = 1.5 * np.sum(each * sine * a_t), 3.0 * np.sum(each * sine * b_ta)
    x12, x22 = 3.75 * np.sum(each * sine * cosine * a_t), 7.5 * np.sum(each * sine * cosine * b_ta)
    return np.array([*alike, x11, x21, x12, x22, 7.5 * 0.25 * np.sum(each * sine * sine * b_t)])
