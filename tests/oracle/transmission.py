"""Light through micro-elements in float64, by sums alone: normals, rays across a fibre, and a series along it.

Written from the equations of docs/model/reflection.md. Directions are unit, (points, 3); gives the weights of light
that has passed through once and twice as far [1/sr], (points,) each.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from tests.oracle.reflection import dot, fresnel

NORMALS, RAYS = 360, 1000
Array = NDArray[np.float64]


def transmitted(material: hg.Reflectance, axis: Array, to_lamp: Array, to_eye: Array) -> tuple[Array, Array]:
    """Weights of c_t and of c_t²."""
    share, clear = material.transmission, material.clearness
    once = share * (1.0 - clear) / math.pi * far_body(material.element, axis, to_lamp, to_eye)
    if share * clear == 0.0:
        return once, 0.0 * once
    through, twice = clear_lobes(material, axis, to_lamp, to_eye)
    return once + share * clear * through, share * clear * twice


def far_body(element: str, axis: Array, to_lamp: Array, to_eye: Array) -> Array:
    """Mean of max(−N·L, 0) over the normals N that the eye sees, by the area that it sees of them."""
    if element == "plane":
        cos_i, cos_r = dot(axis, to_lamp), dot(axis, to_eye)
        return np.where(cos_i * cos_r < 0.0, np.abs(cos_i), 0.0)
    if element == "sphere":  # a function of ∠(L, V) alone, here that of L at (sin χ, 0, cos χ)
        normals, chi = _ball(), np.linspace(0.0, math.pi, 400)
        seen = np.maximum(normals[:, 2], 0.0)
        back = np.maximum(-(np.outer(np.sin(chi), normals[:, 0]) + np.outer(np.cos(chi), normals[:, 2])), 0.0)
        return np.interp(np.arccos(np.clip(dot(to_lamp, to_eye), -1.0, 1.0)), chi, back @ seen / seen.sum())
    totals = []
    for a, lamp, eye in zip(axis, to_lamp, to_eye, strict=True):
        normals = _ring(a)
        seen = np.maximum(normals @ eye, 0.0)
        totals.append((seen * np.maximum(-(normals @ lamp), 0.0)).sum() / seen.sum())
    return np.array(totals)


def clear_lobes(material: hg.Reflectance, axis: Array, to_lamp: Array, to_eye: Array) -> tuple[Array, Array]:
    """Light of the straight lobe and of the one that is reflected inside, split by how long its way is."""
    n = material.n
    cos_lamp, cos_eye = dot(axis, to_lamp), dot(axis, to_eye)
    lamp, eye = to_lamp - axis * cos_lamp[:, None], to_eye - axis * cos_eye[:, None]
    turn = np.arctan2(np.linalg.norm(np.cross(lamp, eye), axis=1), dot(lamp, eye))
    sine = 0.5 * (cos_lamp - cos_eye)
    cosine = np.sqrt(1.0 - sine**2)
    across = np.sqrt(n * n - sine**2) / cosine
    offset = (np.arange(RAYS) + 0.5) / RAYS * math.pi - 0.5 * math.pi  # γ_i
    inside = np.arcsin(np.sin(offset) / across[:, None])
    mirror = fresnel(np.clip(cosine[:, None] * np.cos(offset), 0.0, 1.0), n)
    tilt = material.gamma / math.sqrt(2.0 * math.log(2.0))
    lobes = []
    for out, passed, width in (
        (math.pi + 2.0 * (inside - offset), (1.0 - mirror) ** 2, math.sqrt(2.0) * (n - 1.0) * tilt),
        (
            2.0 * math.pi + 4.0 * inside - 2.0 * offset, (1.0 - mirror) * mirror,
            tilt * math.sqrt(2.0 * (n - 1.0) ** 2 + 4.0 * n * n),
        ),
    ):  # fmt: skip
        width = min(max(width, 0.05), 0.8)
        apart = np.angle(np.exp(1j * (turn[:, None] - out)))
        around = np.exp(-0.5 * (apart / width) ** 2) / (math.sqrt(2.0 * math.pi) * width)
        around = around + np.exp(-0.5 * ((2.0 * math.pi - np.abs(apart)) / width) ** 2) / (
            math.sqrt(2.0 * math.pi) * width
        )
        each = (0.5 * passed * around * np.cos(offset)).mean(axis=1) * math.pi
        lobes.append(each * along(np.arccos(cos_lamp), math.pi - np.arccos(cos_eye), width))
    longer = np.minimum(1.0 / np.sqrt(1.0 - (sine / n) ** 2) - 1.0, 1.0)
    return lobes[0] * (1.0 - longer), lobes[0] * longer + lobes[1]


def along(alpha: Array, beta: Array, width: float) -> Array:
    """(2/π) Σ exp(−s² (k² − 1)/2) sin kα sin kβ / sin β: the heat kernel of the three-sphere by its harmonics."""
    k = np.arange(1, int(9.0 / width) + 3)[:, None]
    terms = np.exp(-0.5 * width**2 * (k * k - 1.0)) * np.sin(k * alpha) * np.sin(k * beta)
    return (2.0 / math.pi) * terms.sum(axis=0) / np.sin(beta)


def _ring(axis: Array) -> Array:
    """Normals across an axis."""
    other = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.7 else [0.0, 1.0, 0.0])
    one = other / np.linalg.norm(other)
    psi = (np.arange(NORMALS) + 0.5) / NORMALS * 2.0 * math.pi
    return np.outer(np.cos(psi), one) + np.outer(np.sin(psi), np.cross(axis, one))


def _ball(count: int = 40_000) -> Any:
    """Normals all around, of equal weight: Fibonacci's spiral."""
    z, turn = 1.0 - (2.0 * np.arange(count) + 1.0) / count, np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1)
