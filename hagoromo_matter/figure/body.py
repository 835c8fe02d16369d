"""Body: the visible skin of a standing figure as one solid, by the joints of a pose. Lengths in mm.

Head, neck and collar, forearms with hands, and bare feet with their shins. Covered parts lie a little inside the
`mannequin` on which the clothes were draped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.matter.shape import capsule, ellipsoid, mirrored, placed, smooth_union
from hagoromo_matter.figure.foot import ANKLE, foot
from hagoromo_matter.figure.hand import FOLDED, OPEN, Gesture, frame, framed, hand
from hagoromo_matter.figure.head import head
from hagoromo_matter.figure.mannequin import neck
from hagoromo_matter.figure.pose import PRAYER, WELCOME, Pose


class Hold(NamedTuple):
    """How the hands are held: gesture, and where the palms turn."""

    gesture: Gesture
    palm: tuple[float, float, float]


HOLDS: Mapping[Pose, Hold] = {PRAYER: Hold(FOLDED, (-1.0, 0.0, 0.0)), WELCOME: Hold(OPEN, (-0.3, -0.6, 0.7))}
FOOT_STEP = (-0.9, -3.3, 0.0)  # of the right foot before the left
CHEST_CUT_Z = 196.0  # height below which the chest is always covered
BARE = 60.0  # height above which the legs are always covered


def body(point: Any, pose: Pose = PRAYER) -> Any:
    """All skin that may be visible."""
    solid = dr.fmin(bust(point, pose), arms(point, pose))
    return dr.fmin(solid, feet(point, pose))


def bust(point: Any, pose: Pose) -> Any:
    """Head, neck with its slanting muscles, collarbones and the top of the chest."""
    p = mirrored(point, 0.5)
    _, y, z = pose.neck
    shoulders = capsule(p, (0.0, y + 1.6, z - 8.5), pose.shoulder, 5.6, 6.4)
    chest = smooth_union(ellipsoid(point, (0.0, y - 0.3, z - 29.0), (19.0, 13.6, 22.4)), shoulders, 8.0)
    collarbone = capsule(p, (1.9, y - 6.3, z - 9.9), (15.0, y - 3.4, z - 7.0), 0.9, 0.9)
    chest = smooth_union(smooth_union(chest, collarbone, 2.2), neck(point, pose), 6.0)
    return smooth_union(dr.fmax(chest, CHEST_CUT_Z - point.z), head(placed(point, pose.head, pose.nod)), 3.0)


def arms(point: Any, pose: Pose) -> Any:
    """Both forearms and hands."""
    p = mirrored(point)
    hold = HOLDS[pose]
    axes = frame(pose.wrist, pose.fingertip, hold.palm)
    fore = capsule(p, pose.elbow, pose.wrist, 4.6, 2.8)
    return smooth_union(fore, hand(framed(p, pose.wrist, axes), hold.gesture), 2.0)


def feet(point: Any, pose: Pose) -> Any:
    """Both feet, and the shins up to BARE."""
    both = []
    for side, step in ((1.0, (0.0, 0.0, 0.0)), (-1.0, FOOT_STEP)):
        p = type(point)(side * (point.x - step[0]), point.y - step[1], point.z)
        forward = np.subtract(pose.toe, pose.ankle) * (1.0, 1.0, 0.0)
        forward /= np.linalg.norm(forward)
        axes = np.stack([np.cross(forward, (0.0, 0.0, -1.0)), forward, (0.0, 0.0, 1.0)])
        knee = axes @ (np.array(pose.knee) - np.array(pose.ankle)) + (0.0, 0.0, ANKLE)
        both.append(foot(framed(p, (pose.ankle[0], pose.ankle[1], 0.0), axes), knee))
    return dr.fmax(dr.fmin(*both), point.z - BARE)
