"""Directional functions up to the second order: F(ω) = s + v·ω + ω·Qω with a traceless symmetric matrix Q.

They are the spherical harmonics up to l = 2. Nine numbers hold one: s, v and xx, yy, xy, xz, yz of Q (zz = −xx − yy).
The clamped cosine, by which bodies scatter, has 99 % of its square in these orders (Ramamoorthi & Hanrahan 2001).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays

NUMBERS = 9
MEAN = 1.0 / (4.0 * math.pi)  # ∫ → mean over all directions


@dataclass
class SecondOrder:
    """F(ω) = s + v·ω + ω·Qω. q: xx, yy, xy, xz, yz."""

    s: Float
    v: Array3f
    q: tuple[Float, Float, Float, Float, Float]

    def numbers(self) -> list[Float]:
        """The nine numbers, in order."""
        return [self.s, self.v.x, self.v.y, self.v.z, *self.q]

    def times(self, a: Array3f) -> Array3f:
        """Q a."""
        xx, yy, xy, xz, yz = self.q
        return type(a)(
            xx * a.x + xy * a.y + xz * a.z, xy * a.x + yy * a.y + yz * a.z, xz * a.x + yz * a.y - (xx + yy) * a.z
        )

    def at(self, way: Array3f) -> Float:
        """F along a unit direction."""
        return self.s + dr.dot(self.v, way) + dr.dot(way, self.times(way))


def second_order(numbers: list[Float]) -> SecondOrder:
    """The function of nine numbers."""
    vector = arrays().Array3f if dr.is_array_v(numbers[1]) and _single(numbers[1]) else arrays().Array3f64
    return SecondOrder(numbers[0], vector(*numbers[1:4]), tuple(numbers[4:9]))  # type: ignore[arg-type]


def _single(value: Float) -> bool:
    return type(value) is arrays().Float


def outer(a: Array3f, b: Array3f) -> tuple[Float, Float, Float, Float, Float]:
    """The traceless part of (a bᵀ + b aᵀ) / 2."""
    third = dr.dot(a, b) * (1.0 / 3.0)
    return (
        a.x * b.x - third,
        a.y * b.y - third,
        0.5 * (a.x * b.y + a.y * b.x),
        0.5 * (a.x * b.z + a.z * b.x),
        0.5 * (a.y * b.z + a.z * b.y),
    )


def projected(way: Array3f) -> list[Float]:
    """What light of one unit direction adds to the nine numbers: F = ∫ L(ω) projected(ω) dω."""
    q = outer(way, way)
    return [MEAN, *(3.0 * MEAN * way[k] for k in range(3)), *(7.5 * MEAN * part for part in q)]
