"""Foot: heel, arch, ball and five toes, bare, on the floor, and the ankle above. All in mm, 35 mm long.

In the foot's own axes x points to the great toe's side, y forward from the ankle and z up from the floor.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.matter.shape import capsule, ellipsoid, smooth_difference, smooth_union, sphere

# root, joint and tip of each toe, and its half width at the root and the tip
TOES = (
    ((3.5, 17.5, 2.7), (3.6, 22.5, 2.5), (3.3, 26.0, 1.85), (2.0, 1.75)),
    ((0.9, 19.0, 2.7), (0.9, 23.6, 2.7), (0.75, 26.4, 1.4), (1.35, 1.2)),
    ((-1.3, 18.6, 2.6), (-1.4, 22.6, 2.6), (-1.5, 25.0, 1.35), (1.3, 1.15)),
    ((-3.2, 17.6, 2.4), (-3.5, 21.2, 2.4), (-3.55, 23.4, 1.3), (1.25, 1.1)),
    ((-4.9, 16.2, 2.1), (-5.3, 19.2, 2.2), (-5.25, 21.2, 1.2), (1.2, 1.05)),
)
ANKLE = 9.0  # its height


def foot(p: Any, knee: Any) -> Any:
    """A left foot and the shin up to the `knee` (x, y, z), at points in its own axes."""
    solid = smooth_union(
        ellipsoid(p, (0.0, -4.2, 4.2), (3.9, 4.6, 4.5)), capsule(p, (0.3, 1.0, 7.2), (1.4, 15.5, 3.6), 3.9, 2.7), 4.0
    )
    solid = smooth_union(solid, ellipsoid(p, (0.1, 15.4, 2.5), (6.1, 5.2, 2.5)), 3.0)
    solid = smooth_union(solid, capsule(p, (-2.4, -3.0, 2.6), (-4.3, 13.0, 2.1), 2.4, 2.0), 3.0)
    solid = smooth_union(solid, sphere(p, (4.3, 16.2, 2.6), 2.3), 2.0)  # ball of the great toe
    solid = smooth_difference(solid, ellipsoid(p, (4.6, 5.0, 0.2), (3.4, 6.0, 2.4)), 2.0)  # arch
    solid = smooth_union(solid, capsule(p, (0.0, -1.2, ANKLE), tuple(knee), 3.3, 6.5), 4.0)
    solid = smooth_union(solid, sphere(p, (2.7, -0.4, ANKLE + 0.8), 1.5), 1.6)  # ankle bones, the inner one higher
    solid = smooth_union(solid, sphere(p, (-2.6, -1.3, ANKLE - 0.4), 1.5), 1.6)
    solid = smooth_union(solid, capsule(p, (0.0, -5.4, 6.0), (0.0, -3.0, 18.0), 1.0, 1.2), 2.5)  # tendon of the heel
    toes = [_toe(p, toe) for toe in TOES]
    union = smooth_union(solid, toes[0], 1.2)
    for toe in toes[1:]:  # joined one by one, so that they blend with the foot but not with each other
        union = dr.fmin(union, smooth_union(solid, toe, 1.2))
    return dr.fmax(union, -p.z)


def _toe(p: Any, toe: Any) -> Any:
    """Two bones, a round pad and a nail."""
    root, joint, tip, (wide, narrow) = toe
    solid = smooth_union(
        capsule(p, root, joint, wide, 0.5 * (wide + narrow)),
        capsule(p, joint, tip, 0.48 * (wide + narrow), narrow),
        0.3,
    )
    solid = smooth_union(solid, sphere(p, (tip[0], tip[1] + 0.1, tip[2] - 0.1), 1.05 * narrow), 0.4)
    nail = (tip[0], tip[1] + 0.1 * narrow, tip[2] + 0.72 * narrow)
    return smooth_union(solid, ellipsoid(p, nail, (0.72 * narrow, 0.75 * narrow, 0.32 * narrow)), 0.1)
