"""Transmission: light that passes through micro-elements and leaves by their far side (MODEL §2).

    f_t = T (1 − κ)/π · b(−L, V)  +  T κ · Σ_p M_p(α_L; α_V) N_p(Δ; θ),   p = 1: straight through, 2: reflected inside

b is the body of the element, Lambert's, lit from the opposite side: so body light leaves a plane, cylinder or sphere
where it would have entered. A share κ of what passes through a cylinder keeps its way, as in clear fibres of hair, silk
or flax (Marschner et al. 2003): it is refracted in, refracted out (p = 1), or reflected inside before (p = 2, with all
that is reflected more often). M_p spreads it along the cylinder, N_p around it; A(V) f_t is symmetric in L and V.

Directions are unit and leave the element; arguments are Python floats or Dr.Jit arrays alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, clip
from hagoromo.reflectance.element import cylinder_body, sphere_body
from hagoromo.reflectance.facets import LN2
from hagoromo.reflectance.torrance_sparrow import fresnel

LEAST_WIDTH, LARGEST_WIDTH = 0.05, 0.8  # [rad] standard deviation of a lobe, as tables resolve it; and as M holds it
COSINES, TURNS = 33, 129  # entries of a table over √cosθ and over Δ
OFFSETS = 256  # rays across a fibre, of which the table is the mean
ANGLES = 512  # of lamps along a fibre, over which the albedo is integrated
Table = Callable[[Float, Float], tuple[Float, Float]]  # (cosθ, Δ) → N_1, N_2


class AllWeights(NamedTuple):
    """Weights of f = body · c_b + interface · e + once · c_t + twice · c_t²  [1/sr]."""

    body: Float
    interface: Float
    once: Float  # of light that has gone through the element once
    twice: Float  # and of light that has gone twice as far in it


def far_body(element: str, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Float:
    """Body light that leaves by the far side, for α = 1: the element's body, lit from −L. Its integral over L is π.

    A plane is a sheet with two sides: |cosθ_i| where lamp and eye are on different ones. Cylinder:
    sinθ_L (sin Δ − Δ cos Δ)/4; sphere: (2/3π)(sin χ − χ cos χ).
    """
    if element == "plane":
        incidence, view = dr.dot(axis, to_lamp), dr.dot(axis, to_eye)
        return dr.select(incidence * view < 0.0, dr.abs(incidence), 0.0)
    if element == "cylinder":
        return cylinder_body(axis, -to_lamp, to_eye)
    return sphere_body(-dr.dot(to_lamp, to_eye))


def facing(normal: Array3f, to_eye: Array3f) -> Array3f:
    """The normal of the side of a sheet that the eye sees."""
    return dr.select(dr.dot(normal, to_eye) < 0.0, -normal, normal)


def lobe_widths(gamma: float, n: float) -> tuple[float, float]:
    """Standard deviations of the two lobes [rad], along the fibre and around it.

    A facet tilted by δ turns a ray by (n − 1)δ where it is refracted, and by 2nδ, as seen outside, where it reflects
    inside. Light that goes straight through meets two facets, light that is reflected inside three, with tilts that do
    not depend on each other; the standard deviation of tilts is γ/√(2 ln2).
    """
    tilt = gamma / math.sqrt(2.0 * LN2)
    through = math.sqrt(2.0) * (n - 1.0) * tilt
    reflected = math.hypot(through, 2.0 * n * tilt)
    return tuple(min(max(width, LEAST_WIDTH), LARGEST_WIDTH) for width in (through, reflected))  # type: ignore[return-value]


def along_fibre(from_axis: Float, mirrored: Float, width: Float) -> Float:
    """M: density over cosα_L of light that leaves a fibre at the angle β = π − α_V to its axis [1].

    from_axis: α_L, the angle of the lamp to the axis; mirrored: β; width: standard deviation s [rad]. With Gaussians g

        M = e^{s²/2} [g(α − β) − g(α + β) − g(2π − α − β)] / sin β

    It is the heat kernel of the three-dimensional sphere, of which α is the distance to a pole: ∫ M sinα dα = 1, and
    sin α_V M(α_L; α_V) is symmetric, as extinction by projected areas needs it (the usual M of hair is symmetric
    without sin α_V).
    """
    inverse = 1.0 / (width * width)
    near = dr.exp(0.5 * (width * width) - 0.5 * dr.square(from_axis - mirrored) * inverse)
    images = dr.exp(-2.0 * from_axis * mirrored * inverse)
    images = images + dr.exp(-2.0 * (math.pi - from_axis) * (math.pi - mirrored) * inverse)
    scale = 1.0 / (math.sqrt(2.0 * math.pi) * width)
    return scale * near * dr.fmax(1.0 - images, 0.0) / dr.fmax(dr.sin(mirrored), 1e-4)


def clear_lobes(
    axis: Array3f, to_lamp: Array3f, to_eye: Array3f, n: Float, widths: tuple[Float, Float], table: Table
) -> tuple[Float, Float]:
    """Weights of light that keeps its way through a clear cylinder, for T κ = 1: in its colour, and in that squared.

    table: N_1 and N_2 of a cosθ and Δ, see `around_fibre`; θ is the inclination of the lobe's middle.
    The way inside is longer by 1/cosθ_t where it is oblique: so much of the first lobe as linear interpolation between
    c and c² takes has the colour squared. The second lobe goes through the fibre twice.
    """
    cos_lamp, cos_eye = (clip(dr.dot(axis, way), -1.0, 1.0) for way in (to_lamp, to_eye))
    lamp, eye = to_lamp - axis * cos_lamp, to_eye - axis * cos_eye
    lengths = dr.sqrt(dr.fmax(dr.squared_norm(lamp) * dr.squared_norm(eye), 1e-20))
    turn = dr.acos(clip(dr.dot(lamp, eye) / lengths, -1.0, 1.0))
    sine = 0.5 * (cos_lamp - cos_eye)  # of θ: both lobes are about a·V = −a·L
    around = table(dr.sqrt(dr.fmax(1.0 - sine * sine, 0.0)), turn)
    alpha, mirrored = dr.acos(cos_lamp), dr.acos(-cos_eye)
    through, reflected = (along_fibre(alpha, mirrored, width) * n_p for width, n_p in zip(widths, around, strict=True))
    longer = longer_way(sine, n)
    return through * (1.0 - longer), dr.fma(through, longer, reflected)


def longer_way(sine: Float, n: Float) -> Float:
    """1/cosθ_t − 1, 0…1: how much longer the way through a fibre is at the inclination θ than across it."""
    return dr.fmin(dr.rsqrt(dr.fmax(1.0 - dr.square(sine / n), 0.25)) - 1.0, 1.0)


def passed_at(cos_offset: Float, cosine: Float, n: Float) -> tuple[Float, Float]:
    """(1 − F)² and F (1 − F) of a ray at the azimuth of incidence γ_i; cos_offset: cosγ_i, cosine: cosθ."""
    reflected = fresnel(dr.fmax(cos_offset * cosine, 1e-6), n)
    return dr.square(1.0 - reflected), reflected * (1.0 - reflected)


def turned_by(sine_offset: Float, cosine: Float, n: Float) -> tuple[Float, Float]:
    """Azimuth Φ of a ray that leaves, against the lamp: π + 2γ_t − 2γ_i, and 4γ_t − 2γ_i (Marschner et al. 2003).

    sine_offset: sinγ_i = h, the offset of the ray over the fibre's radius. cosine: cosθ; across the fibre its index is
    √(n² − sin²θ)/cosθ (Bravais).
    """
    bent = sine_offset * cosine / dr.sqrt(dr.fmax(n * n - 1.0 + cosine * cosine, 1e-12))
    inside, outside = dr.asin(clip(bent, -1.0, 1.0)), dr.asin(clip(sine_offset, -1.0, 1.0))
    return math.pi + 2.0 * (inside - outside), 4.0 * inside - 2.0 * outside


@lru_cache(maxsize=64)
def around_fibre(gamma: float, n: float) -> NDArray[np.float64]:
    """N_1 and N_2 [1/rad] at equal steps of √cosθ from 0 to 1 and of Δ from 0 to π: (COSINES, TURNS, 2).

    N_p(Δ; θ) = ½ ∫ A_p(h, θ) g(Δ − Φ_p(h, θ)) dh over the offsets h of rays, with A_1 = (1 − F)², A_2 = F (1 − F):
    light that is reflected inside more often counts with A_2, so that ∫ (N_1 + N_2) dΔ = 1 − the mean of F. Arrays are
    kept, and cannot be written to.
    """
    real = arrays().Float64
    nodes, weights = np.polynomial.legendre.leggauss(OFFSETS)
    offsets, weights = 0.25 * math.pi * (nodes + 1.0), 0.25 * math.pi * weights
    cosines = np.maximum(np.linspace(0.0, 1.0, COSINES) ** 2, 1e-4)  # where n = 1 nothing is reflected, even along it
    turns = np.linspace(0.0, math.pi, TURNS)
    cosine, offset = dr.meshgrid(real(cosines), real(offsets), indexing="ij")
    index = dr.opaque(real, n)
    passed = passed_at(dr.cos(offset), cosine, index)
    azimuths = turned_by(dr.sin(offset), cosine, index)
    columns = []
    for one, azimuth, width in zip(passed, azimuths, lobe_widths(gamma, n), strict=True):
        each = np.array(one).reshape(COSINES, OFFSETS) * weights * np.cos(offsets)
        middle = np.array(azimuth).reshape(COSINES, OFFSETS)
        columns.append(np.stack([_wrapped(turns, m, width) @ e for m, e in zip(middle, each, strict=True)]))
    table = np.stack(columns, axis=-1)
    table.flags.writeable = False
    return table


def _wrapped(turns: NDArray, middles: NDArray, width: float) -> NDArray[np.float64]:
    """Gaussians around middles and, as a fibre is alike on both sides, around the opposite: (turns, middles)."""
    apart = turns[:, None] - np.concatenate([middles, -middles])[None]
    apart -= 2.0 * math.pi * np.round(apart / (2.0 * math.pi))
    images = [np.exp(-0.5 * ((apart + k * 2.0 * math.pi) / width) ** 2) for k in (-1, 0, 1)]
    both = np.sum(images, axis=0) / (math.sqrt(2.0 * math.pi) * width)
    return 0.5 * (both[:, : middles.size] + both[:, middles.size :])


def table_from(values: Any, first: Any = 0) -> Table:
    """The `Table` of `around_fibre` values on the device, a Dr.Jit array; first: number of the fibre's table in it."""
    kind: Any = type(values)
    jit = arrays()
    packet: Any = jit.Array2f64 if kind is jit.Float64 else jit.Array2f

    def look_up(cosine: Float, turn: Float) -> tuple[Float, Float]:
        row, column = dr.sqrt(cosine) * (COSINES - 1), turn * ((TURNS - 1) / math.pi)
        one, other = dr.minimum(jit.UInt(row), COSINES - 2), dr.minimum(jit.UInt(column), TURNS - 2)
        along, aside = row - kind(one), column - kind(other)
        start = (first * COSINES + one) * TURNS + other
        near, far = (
            dr.lerp(dr.gather(packet, values, start + k), dr.gather(packet, values, start + (k + 1)), aside)
            for k in (0, TURNS)
        )
        both = dr.lerp(near, far, along)
        return both.x, both.y

    return look_up


@lru_cache(maxsize=64)
def clear_albedo(gamma: float, n: float, views: tuple[float, ...]) -> NDArray[np.float64]:
    """∫ f_t dL of a clear cylinder for T κ = c_t = 1, seen at angles from across its tangent [rad]: (views,)."""
    real, (nodes, weights) = arrays().Float64, np.polynomial.legendre.leggauss(ANGLES)
    angles, weights = 0.5 * math.pi * (nodes + 1.0), 0.5 * math.pi * weights
    mirrored = 0.5 * math.pi + np.array(views)  # for a view above the middle; below it is alike
    angle, eye = np.meshgrid(angles, mirrored)
    cosine = np.sqrt(np.maximum(1.0 - 0.25 * (np.cos(angle) + np.cos(eye)) ** 2, 0.0))
    inside = around_fibre(gamma, n)
    sums = (2.0 * inside.sum(axis=1) - inside[:, 0] - inside[:, -1]) * (math.pi / (TURNS - 1))
    total = np.zeros(len(views))
    for p, width in enumerate(lobe_widths(gamma, n)):
        along = along_fibre(real(angle.ravel()), real(eye.ravel()), dr.opaque(real, width))
        share = np.interp(np.sqrt(cosine), np.linspace(0.0, 1.0, COSINES), sums[:, p])
        total += (np.array(along).reshape(angle.shape) * share) @ (weights * np.sin(angles))
    return total
