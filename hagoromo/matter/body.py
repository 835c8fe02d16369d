"""Body: what the standing figure shows of its skin, in mm: head, neck and hands in prayer; it looks towards −y."""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.matter.shape import capsule, ellipsoid, mirrored, placed, smooth_difference, smooth_union, sphere

HEAD = (0.0, -2.0, 246.0)  # middle of the head [mm]
NOD = (-10.0, 0.0, 6.0)  # turned about x, y, z [°]


def body(point: Any) -> Any:
    """All the skin as one solid [mm]."""
    neck = capsule(point, (0.0, 3.0, 214.0), (0.0, 1.0, 238.0), 6.8, 5.9)
    chest = ellipsoid(point, (0.0, 4.0, 211.0), (11.0, 5.5, 5.0))
    return dr.fmin(smooth_union(smooth_union(chest, neck, 8.0), head(placed(point, HEAD, NOD)), 3.0), hands(point))


def head(point: Any) -> Any:
    """Skull and face about its middle: 37 mm high, one figure of nearly eight heads."""
    p = mirrored(point, 0.5)
    skull = smooth_union(
        ellipsoid(p, (0.0, 2.0, 4.0), (13.6, 16.6, 14.5)), ellipsoid(p, (0.0, -5.5, -5.5), (9.4, 10.6, 13.4)), 6.0
    )
    skull = smooth_union(skull, sphere(p, (0.0, -12.0, -15.9), 2.5), 5.0)  # chin
    skull = smooth_union(skull, capsule(p, (8.2, -2.0, -8.5), (2.0, -10.8, -15.4), 2.3, 2.0), 5.0)  # jaw
    skull = smooth_union(skull, sphere(p, (6.4, -10.0, -4.8), 3.3), 4.0)  # cheek
    skull = smooth_union(skull, capsule(p, (2.0, -13.7, 3.4), (7.0, -11.8, 3.4), 1.3, 1.1), 3.5)  # brow
    skull = smooth_difference(skull, ellipsoid(p, (5.3, -15.2, 0.2), (3.3, 2.9, 2.2)), 2.4)  # socket
    eye = ellipsoid(p, (5.3, -12.0, 0.0), (2.7, 2.2, 1.75))
    lid = capsule(p, (3.3, -13.4, 0.7), (7.2, -12.6, 0.5), 0.55)
    skull = smooth_union(smooth_union(skull, eye, 0.8), lid, 0.8)
    nose = capsule(p, (0.0, -14.2, 1.8), (0.0, -17.6, -5.0), 0.9, 1.5)
    wing = sphere(p, (1.4, -15.6, -5.8), 1.0)
    skull = smooth_union(skull, smooth_union(nose, wing, 1.2), 1.6)
    upper = capsule(p, (0.0, -15.7, -9.6), (3.1, -13.9, -10.0), 0.9, 0.35)
    lower = capsule(p, (0.0, -15.4, -11.4), (2.6, -13.9, -10.9), 1.05, 0.4)
    skull = smooth_union(smooth_union(skull, upper, 0.9), lower, 0.9)
    return smooth_difference(skull, capsule(p, (0.0, -16.6, -10.45), (3.2, -14.4, -10.35), 0.3), 0.5)


def hands(point: Any) -> Any:
    """Two hands laid palm to palm, fingers up."""
    p = placed(mirrored(point), (0.0, -39.5, 189.0), (22.0, 0.0, 0.0))  # z along the fingers, −y outwards
    wrist = capsule(p, (7.0, 6.0, -9.0), (2.9, 0.5, 2.0), 4.0, 3.4)
    palm = ellipsoid(p, (2.3, 0.0, 7.0), (2.2, 5.2, 7.5))
    hand = smooth_union(wrist, palm, 3.0)
    for place, tall in ((-4.1, 21.0), (-1.4, 24.5), (1.3, 25.5), (3.9, 23.5)):
        finger = capsule(p, (1.9, 0.92 * place, 11.0), (1.35, 0.75 * place, tall), 1.5, 1.05)
        hand = smooth_union(hand, finger, 0.7)
    thumb = capsule(p, (2.6, -4.2, 6.0), (1.2, -5.6, 16.0), 1.7, 1.25)
    return smooth_union(hand, thumb, 1.2)
