"""Mannequin: the plain body that the clothes of the standing figure lie on, from the joints of a pose. All in mm."""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.matter.shape import capsule, ellipsoid, mirrored, placed, smooth_union, sphere
from hagoromo_matter.figure.head import SEAMS, ear, skull
from hagoromo_matter.figure.pose import Point, Pose

ROOM = 0.5  # from the skin of the neck to the mannequin's
KNEE_STEP = (-3.0, -11.0, 2.0)  # of the knee of the leg that does not carry the weight, on the figure's right


def trunk(point: Any, pose: Pose, bust: float = 6.6, step: Point = KNEE_STEP) -> Any:
    """Head, neck, trunk and legs; bust: radius of the breasts; step: how far one knee stands out."""
    p = mirrored(point, 1.0)
    x, y, z = pose.waist
    body = smooth_union(
        ellipsoid(point, (x, y + 1.0, z - 28.0), (24.0, 18.0, 21.0)),
        ellipsoid(point, pose.waist, (16.0, 12.5, 24.0)),
        8.0,
    )
    body = smooth_union(body, ellipsoid(point, (x, y + 1.5, z + 21.0), (19.5, 14.5, 23.0)), 8.0)
    body = smooth_union(body, sphere(p, (8.2, y - 9.0, z + 23.0), bust), 6.0)
    collar = (0.0, pose.shoulder[1] + 0.5, pose.shoulder[2] + 5.0)
    body = smooth_union(body, capsule(p, collar, pose.shoulder, 6.5, 7.2), 9.0)
    body = smooth_union(body, capsule(point, collar, pose.head, 6.8, 6.0), 7.0)
    body = smooth_union(body, neck(point, pose) - ROOM, 6.0)
    return dr.fmin(smooth_union(body, legs(point, pose, step), 10.0), head(point, pose))


def neck(point: Any, pose: Pose) -> Any:
    """The neck and the muscles that slant from it to the shoulders; the skin has the same."""
    p = mirrored(point, 0.5)
    x, y, z = pose.neck
    column = capsule(point, (x, y + 1.0, z - 10.0), (x, y - 1.6, z + 15.0), 6.6, 6.1)
    strap = capsule(p, (5.9, y + 0.2, z + 12.0), (1.5, y - 6.6, z - 9.6), 1.5, 0.8)
    slope = capsule(p, (2.5, y + 3.4, z + 7.0), (13.0, y + 1.6, z - 7.4), 4.2, 4.6)
    return smooth_union(smooth_union(column, strap, 2.2), slope, 4.0)


def head(point: Any, pose: Pose) -> Any:
    """Skull, jaw and hair as one egg, the face's bones, whose chin stands out of it, and the ears."""
    p = placed(point, pose.head, pose.nod)
    hair = ellipsoid(p, (0.0, 2.0, 4.0), (13.8, 16.8, 14.7))
    egg = smooth_union(hair, ellipsoid(p, (0.0, -5.0, -6.0), (9.6, 10.8, 13.0)), 6.0)
    return smooth_union(smooth_union(egg, skull(mirrored(p, SEAMS[0])), 3.0), ear(mirrored(p)), 2.0)


def legs(point: Any, pose: Pose, step: Point = KNEE_STEP) -> Any:
    """Two legs with their feet, one knee a step ahead."""
    both = []
    for side, ahead in ((1.0, (0.0, 0.0, 0.0)), (-1.0, step)):
        hip, knee, ankle, toe = (
            (side * joint[0] + share * ahead[0], joint[1] + share * ahead[1], joint[2] + share * ahead[2])
            for joint, share in ((pose.hip, 0.0), (pose.knee, 1.0), (pose.ankle, 0.3), (pose.toe, 0.3))
        )
        thigh, shin = capsule(point, hip, knee, 13.0, 9.0), capsule(point, knee, ankle, 8.8, 5.0)
        both.append(dr.fmin(smooth_union(thigh, shin, 3.0), capsule(point, ankle, toe, 5.0, 3.0)))
    return dr.fmin(*both)


def arm(point: Any, pose: Pose, side: float) -> Any:
    """The arm and hand of one side: side 1 its left, x > 0; −1 its right."""
    p = type(point)(side * point.x, point.y, point.z)
    upper = capsule(p, pose.shoulder, pose.elbow, 6.8, 5.2)
    fore = capsule(p, pose.elbow, pose.wrist, 5.2, 3.3)
    return dr.fmin(smooth_union(upper, fore, 2.0), capsule(p, pose.wrist, pose.fingertip, 4.2, 3.0))
