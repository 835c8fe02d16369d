"""Rod: thin rods and films on a lattice that may be too coarse for them: soft edges, exact volumes.

A rod thinner than the softness of an edge is spread over it with a lower density, so that its mass is kept.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

from hagoromo.matter.shape import coverage


def rod(beside: Any, height: Any, radius: Any, half_height: Any, softness: float) -> Any:
    """Density of a rod at distances `beside` and `height` from its middle line; lengths in one unit.

    Its section is a disc of `radius` drawn out upwards: by `half_height` to both sides. The integral of the density
    over a section is the section's area.
    """
    above = dr.fmax(abs(height) - half_height, 0.0)
    distance = dr.sqrt(beside * beside + above * above) - radius
    true = radius * (math.pi * radius + 4.0 * half_height)
    spread = _disc(radius, softness) + 2.0 * half_height * _slab(radius, softness)
    return coverage(distance, softness) * (true / spread)


def film(height: Any, thickness: Any, mass: Any, softness: float) -> Any:
    """Density of a film of `thickness` around height 0 that holds `mass`: volume over area, a length."""
    half = 0.5 * thickness
    return coverage(abs(height) - half, softness) * (mass / _slab(half, softness))


def _disc(radius: Any, softness: float) -> Any:
    """∫ over the plane of the coverage of a disc."""
    reach = radius + 0.5 * softness
    thin = reach * reach * reach * (math.pi / 3.0 / softness)
    wide = math.pi * (radius * radius + softness * softness / 12.0)
    return dr.select(radius < 0.5 * softness, thin, wide)


def _slab(half: Any, softness: float) -> Any:
    """∫ over the line of the coverage of a slab."""
    reach = half + 0.5 * softness
    return dr.select(half < 0.5 * softness, reach * reach / softness, 2.0 * half)
