"""Face: eyes with lowered lids, nose, mouth, as additions to a head about its middle. All in mm, head 37 mm high.

Points are mirrored, x ≥ 0, the face looks towards −y. Proportions: eyes at half height, one eye's width between them;
brow, nose and chin a third of the face apart; the mouth a third of the way from nose to chin.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.backend import clip
from hagoromo.matter.shape import (
    capsule,
    ellipsoid,
    placed,
    rising,
    smooth_difference,
    smooth_union,
    sphere,
)

EYE = (5.15, -10.2, -0.05)  # middle of the ball
EYE_RADIUS = 2.7  # its radius with the lids on
CANTHI = (2.6, -0.4), (7.75, 0.1)  # inner and outer corner: x, z
MOUTH = -11.45  # height of the line between the lips
HALF_MOUTH = 4.05


def eyes(head: Any, p: Any) -> Any:
    """Sockets, balls under closed lids, the crease above them and the line of the lashes."""
    head = smooth_difference(head, ellipsoid(p, (5.15, -14.8, 0.3), (3.5, 3.0, 2.1)), 3.2)
    head = smooth_difference(head, sphere(p, (2.5, -14.0, -0.1), 0.9), 1.8)
    head = smooth_union(head, ellipsoid(p, EYE, (EYE_RADIUS * 1.14, EYE_RADIUS, EYE_RADIUS * 0.98)), 0.8)
    front = clip((-p.y - 7.0) * 0.5, 0.0, 1.0)
    along = (p.x - CANTHI[0][0]) / (CANTHI[1][0] - CANTHI[0][0])  # 0…1 from the inner to the outer corner
    inside = rising(along * 4.0) * rising((1.0 - along) * 3.0)
    bow = clip(4.0 * along * (1.0 - along), 0.0, 1.0)
    straight = CANTHI[0][1] + (CANTHI[1][1] - CANTHI[0][1]) * along
    lash = p.z - (straight - 1.2 * bow)
    crease = p.z - (straight + 0.95 * bow + 0.35)
    upper = 0.13 * _bell(lash - 0.3, 0.3) * inside  # its margin stands over the lower lid
    groove = 0.2 * _bell(lash, 0.14) * inside
    fold = 0.12 * _bell(crease, 0.24) * rising(along * 3.0) * rising((1.15 - along) * 3.0)
    return head - front * (upper - groove - fold)


def nose(head: Any, p: Any) -> Any:
    """Bridge, tip, wings with their grooves, nostrils and the bar between them."""
    root = capsule(p, (0.0, -12.2, 2.4), (0.0, -13.4, -1.0), 1.25, 1.15)
    bridge = capsule(p, (0.0, -13.0, 0.2), (0.0, -16.2, -5.4), 0.75, 0.95)
    flank = capsule(p, (0.9, -12.2, -1.0), (1.2, -14.5, -5.8), 0.8, 1.15)
    tip = ellipsoid(p, (0.0, -16.2, -5.95), (1.3, 1.3, 1.15))
    dome = sphere(p, (0.5, -16.55, -5.95), 0.85)
    wing = ellipsoid(placed(p, (1.7, -14.8, -6.5), (-16.0, 0.0, 14.0)), (0.0, 0.0, 0.0), (0.75, 1.3, 0.95))
    bar = capsule(p, (0.0, -16.2, -6.8), (0.0, -14.2, -7.6), 0.55, 0.75)
    body = smooth_union(smooth_union(root, bridge, 1.2), flank, 1.6)
    body = smooth_union(smooth_union(body, tip, 1.2), dome, 0.9)
    floor = sphere(p, (0.95, -14.6, -7.0), 1.0)
    body = smooth_union(smooth_union(smooth_union(body, bar, 0.6), wing, 0.9), floor, 0.8)
    nostril = ellipsoid(placed(p, (0.98, -15.3, -7.55), (-18.0, 0.0, 22.0)), (0.0, 0.0, 0.0), (0.3, 0.7, 0.36))
    return smooth_difference(smooth_union(head, body, 1.7), nostril, 0.25)


def mouth(head: Any, p: Any) -> Any:
    """Lips with a Cupid's bow, corners, the groove above and the hollow below."""
    head = smooth_union(head, ellipsoid(p, (0.0, -9.6, -11.2), (5.0, 4.6, 4.3)), 3.0)
    part, line, top, bottom, round_ = _lips(p)
    front = clip((-p.y - 8.0) * 0.5, 0.0, 1.0)
    taper = rising((1.05 - part) * 3.0)
    above, below = (p.z - line) / top, (line - p.z) / bottom  # 0…1 over the lips
    full = taper * (0.42 * _lip(above) * (0.4 + 0.6 * round_) + 0.68 * _lip(below) * round_)
    full += 0.14 * _bell(part, 0.2) * _bell(above - 0.4, 0.4)  # the tubercle
    gap = 0.2 * _bell(p.z - line, 0.15) * taper
    groove = 0.22 * _bell(p.x, 0.6) * _bell(p.z + 8.9, 0.9)
    ridge = 0.12 * _bell(p.x - 1.0, 0.45) * _bell(p.z + 9.2, 0.9)
    hollow = 0.3 * _bell(part, 0.6) * _bell(p.z + 14.0, 0.7)
    corner = 0.2 * _bell(p.x - HALF_MOUTH - 0.2, 0.6) * _bell(p.z - MOUTH - 0.15, 0.65)
    return head - front * (full + ridge - gap - groove - hollow - corner)


def lips(p: Any) -> Any:
    """0…1: how much a point of the face is of the lips' red."""
    part, line, top, bottom, _ = _lips(p)
    inside = dr.fmin((line + top - p.z) * 3.0, (p.z - line + bottom) * 3.0)
    return rising(dr.fmin(inside, dr.fmin((1.02 - part) * 6.0, (-p.y - 8.0) * 2.0)))


def _lips(p: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Place across the mouth, 0…1; height of the line between the lips; how far these reach up, down; their arc."""
    part = p.x * (1.0 / HALF_MOUTH)
    round_ = dr.sqrt(clip(1.0 - part * part, 1e-3, 1.0))
    line = MOUTH + 0.14 * _bell(part - 0.4, 0.25) - 0.14 * _bell(part, 0.2) + 0.2 * part * part
    top = 1.25 * round_ * (1.0 + 0.22 * _bell(part - 0.27, 0.2) - 0.1 * _bell(part, 0.13)) + 0.1
    return part, line, top, 1.85 * round_ + 0.1, round_


def _lip(part: Any) -> Any:
    """Profile of a lip from the line between the lips, 0, to its border, 1: round, and full near the line."""
    near = (0.55 + 0.45 * rising(part * 2.2)) * rising(6.0 * part + 0.5)
    return near * (1.0 - 0.25 * part) * rising((1.1 - part) * 1.7)


def _bell(offset: Any, width: float) -> Any:
    """exp(−(offset/width)²)."""
    return dr.exp(-dr.square(offset * (1.0 / width)))
