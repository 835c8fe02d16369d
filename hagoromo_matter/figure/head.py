"""Head: skull, face and ears about their middle, 37 mm high: one figure of more than seven heads. All in mm.

It looks towards −y; x is its left. Breadth and depth are 0.66 and 0.87 of the height (Farkas, "Anthropometry of the
Head and Face", 1994, women).
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.matter.shape import (
    capsule,
    ellipsoid,
    mirrored,
    placed,
    smooth_difference,
    smooth_union,
    sphere,
)
from hagoromo_matter.figure.face import eyes, mouth, nose

WRY = 0.12  # by which the features are out of the middle: no face is its own mirror image
SEAMS = 0.8, 0.25  # over which the two sides of skull and features pass into each other


def head(point: Any) -> Any:
    """All of the head but its hair, about its middle."""
    uneven = type(point)(point.x + WRY * dr.sin(0.3 * point.z), point.y, point.z - 0.1 * WRY * point.x)
    bones, p = skull(mirrored(point, SEAMS[0])), mirrored(uneven, SEAMS[1])
    return smooth_union(mouth(nose(eyes(bones, p), p), p), ear(p), 0.9)


def skull(p: Any) -> Any:
    """Cranium, cheekbones, jaw and chin, without eyes, nose and mouth."""
    cranium = ellipsoid(p, (0.0, 2.0, 4.6), (12.0, 15.4, 13.9))
    forehead = ellipsoid(p, (0.0, -3.4, 5.0), (10.4, 10.4, 10.5))
    bone = smooth_union(cranium, forehead, 4.0)
    bone = smooth_union(bone, ellipsoid(p, (0.0, -4.0, -5.4), (8.4, 9.4, 11.3)), 5.0)
    bone = smooth_union(bone, ellipsoid(p, (6.5, -7.9, -3.6), (3.6, 3.5, 3.0)), 4.0)  # cheekbone
    bone = smooth_union(bone, ellipsoid(p, (4.8, -8.6, -8.0), (3.6, 3.4, 4.2)), 4.0)  # cheek
    bone = smooth_union(bone, capsule(p, (6.2, -1.5, -8.8), (1.4, -10.4, -15.6), 2.1, 2.0), 5.0)  # jaw
    bone = smooth_union(bone, ellipsoid(p, (0.0, -11.1, -15.9), (2.2, 2.2, 2.3)), 4.0)  # chin
    brow = capsule(p, (2.2, -11.9, 3.1), (7.6, -10.2, 3.5), 1.0, 0.8)
    bone = smooth_union(bone, brow, 4.0)
    return smooth_difference(bone, sphere(p, (15.0, -9.6, 3.6), 4.8), 5.0)  # temple


def ear(p: Any) -> Any:
    """Shell with its rim, hollow and lobe, leaning back."""
    q = placed(p, (11.3, 0.8, -2.2), (-14.0, 0.0, -26.0))  # x outwards, y back, z up
    shell = ellipsoid(q, (0.3, 0.2, 0.8), (0.8, 2.6, 4.1))
    rim = smooth_difference(shell, ellipsoid(q, (1.0, 0.1, 0.9), (0.75, 1.8, 3.2)), 0.4)
    inner = capsule(q, (0.4, 1.0, 2.4), (0.5, 1.1, -1.2), 0.45)
    tragus = sphere(q, (0.6, -1.9, -0.6), 0.6)
    lobe = ellipsoid(q, (0.3, -0.6, -3.6), (0.7, 1.3, 1.2))
    return smooth_union(smooth_union(smooth_union(rim, inner, 0.5), tragus, 0.5), lobe, 0.8)
