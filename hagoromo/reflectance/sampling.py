"""Directions drawn in proportion to the reflectance of a plane, with their density (for `path`).

A mixture: with probability `share` a half vector by the density of facets D φ, else a cosine-weighted direction.
"""

from __future__ import annotations

import math

import drjit as dr

from hagoromo.backend import Array3f, Float
from hagoromo.reflectance.facets import GAUSSIAN, facet_mass, squared_angle_of_mass, tail_rise
from hagoromo.reflectance.torrance_sparrow import cosines, facet_density

HORIZON = 0.5 * math.pi


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
