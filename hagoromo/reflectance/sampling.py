"""Directions drawn in proportion to the reflectance of a plane, with their density.

A mixture: each lobe of the interface has a share of the samples, whose half vector is drawn by the density of facets
D φ; the others are cosine-weighted directions. Mode path, the plugin of Mitsuba and `Reflectance.sample` draw by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr

from hagoromo.backend import Array3f, Float
from hagoromo.reflectance.facets import GAUSSIAN, facet_mass, squared_angle_of_mass, tail_rise
from hagoromo.reflectance.torrance_sparrow import cosines, facet_density

HORIZON = 0.5 * math.pi
LEAST_SHARE = 0.1  # of the samples, for the body and for the interface together, where a reflectance has both
LobeShare = tuple[Float, Float, Float]  # share of the samples, γ [rad] and ν of a lobe


def shares_of_lobes(sent: Sequence[float], body: float, both: bool) -> list[float]:
    """Shares of the samples for lobes that send these albedos, beside that of the `body`, which gets what is left.

    both: whether there is a body and an interface; each of them gets LEAST_SHARE at least.
    """
    interface = sum(sent)
    share = interface / (interface + body) if interface + body > 0.0 else 0.0
    if both:
        share = min(max(share, LEAST_SHARE), 1.0 - LEAST_SHARE)
    return [share * one / max(interface, 1e-30) for one in sent]


def to_lamp_by_lobes(view: Array3f, lobes: Sequence[LobeShare], choice: Float, u: Float, v: Float) -> Array3f:
    """`sample_to_lamp` by one lobe or another."""
    share, gamma, nu = lobes[0]
    for more, width, exponent in lobes[1:]:
        beyond = choice >= share
        gamma, share = dr.select(beyond, width, gamma), share + more
        nu = nu if nu is exponent else dr.select(beyond, exponent, nu)
    return sample_to_lamp(view, share, gamma, choice, u, v, nu)


def density_of_lobes(to_lamp: Array3f, view: Array3f, lobes: Sequence[LobeShare]) -> Float:
    """Density of the directions of `to_lamp_by_lobes` [1/sr]."""
    kind = type(to_lamp.z)
    left, total = kind(1), kind(0)
    for share, gamma, nu in lobes:
        total = dr.fma(share, density_to_lamp(to_lamp, view, 1.0, gamma, nu), total)
        left = left - share
    return dr.fma(dr.fmax(left, 0.0), dr.fmax(to_lamp.z, 0.0) / math.pi, total)


def sample_to_lamp(
    view: Array3f, share: Float, gamma: Float, choice: Float, u: Float, v: Float, nu: Float = GAUSSIAN
) -> Array3f:
    """Direction to the lamp for the eye `view`, drawn nearly as the reflectance sends light (Array3f, normal = +z).

    view: unit direction to the eye. share: probability, 0…1, of the interface part; the rest is drawn by the cosine of
    Lambert's law. gamma: half width of the facets [rad]. choice, u, v: three independent uniform numbers in [0, 1).
    nu: exponent ν of the facets' tails; infinity: Gaussian facets.
    A mirrored direction may fall below the horizon: it carries density there and the reflectance is 0.
    """
    kind, turn = type(view), 2.0 * math.pi * v
    radius = dr.sqrt(u)
    diffuse = kind(radius * dr.cos(turn), radius * dr.sin(turn), dr.sqrt(dr.fmax(1.0 - u, 0.0)))
    polar = dr.sqrt(squared_angle_of_mass(u * facet_mass(HORIZON * HORIZON, gamma, nu), gamma, nu))
    half = kind(dr.sin(polar) * dr.cos(turn), dr.sin(polar) * dr.sin(turn), dr.cos(polar))
    mirrored = 2.0 * dr.dot(view, half) * half - view
    return dr.select(choice < share, mirrored, diffuse)


def density_to_lamp(to_lamp: Array3f, view: Array3f, share: Float, gamma: Float, nu: Float = GAUSSIAN) -> Float:
    """Probability density per solid angle [1/sr] with which `sample_to_lamp` gives the direction `to_lamp`.

    view, share, gamma, nu: as there; directions are unit, in local axes with the normal along +z. The integral over the
    sphere is 1 (chi-square test in tests/laws/test_reflectance.py).
    """
    at = cosines(type(view)(0, 0, 1), to_lamp, view)
    diffuse = dr.fmax(at.incidence, 0.0) / math.pi
    half = _half_density(at.half, gamma, nu) + _half_density(-at.half, gamma, nu)  # Q and −Q mirror V alike
    return share * half / (4.0 * at.deviation) + (1.0 - share) * diffuse


def _half_density(cos_half: Float, gamma: Float, nu: Float) -> Float:
    """Density of the half vector [1/sr]: φ is drawn in proportion to φ D(φ), cut at the horizon φ = π/2."""
    polar = dr.acos(dr.fmin(dr.fmax(cos_half, 0.0), 1.0 - 1e-7))
    inside = facet_mass(HORIZON * HORIZON, gamma, nu)
    radial = 2.0 * tail_rise(1.0 / nu) / (gamma * gamma) * facet_density(cos_half, gamma, nu) / inside
    return dr.select(cos_half > 0.0, radial * polar / (2.0 * math.pi * dr.sin(polar)), 0.0)
