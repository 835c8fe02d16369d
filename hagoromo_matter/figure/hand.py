"""Hand: palm, four fingers of three joints and a thumb, with nails. All in mm, 29.5 mm long.

In the hand's own axes x points to the thumb, y out of the palm and z from the wrist to the tip of the middle finger; it
is a left hand, so that the right one is its mirror image.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.matter.shape import capsule, ellipsoid, limb, smooth_difference, smooth_union, sphere, spline

WEB_WIDTH = 2.0  # width over which fingers pass into the palm
LENGTH = 29.5  # from the wrist to the tip of the middle finger
KNUCKLES = (3.9, 13.2), (1.25, 13.6), (-1.4, 13.0), (-3.9, 11.7)  # x, z; index finger first
FINGER_LENGTHS = 15.0, 15.9, 15.1, 12.6  # of the fingers from their knuckles
FINGER_HALF_WIDTHS = 1.22, 1.27, 1.2, 1.08  # half, of the fingers
PHALANGES = 0.45, 0.31, 0.24  # of a finger's length
FINGER_TAPER = 1.03, 0.97, 0.9, 0.62  # half width at the joints and the tip, of the finger's
SLIM = 0.94  # half width between two joints, of the mean at these
BEND = 0.3  # over which the line of a finger bends
TIP = 1.22, 3.05, 0.13, 0.8  # last bone: half width, half length, shift to the pad, seam [half widths at the tip]
NAIL = 0.95, 0.61, 1.5, 0.72, 0.8, 0.15  # half sides, depth, way back from the tip [half widths], border [mm]
THUMB = 1.9, 1.4, 1.3, 0.78  # half width at its joints and tip


class Gesture(NamedTuple):
    """How a hand is held: bend of each finger at its three joints [°], spread [°], joints and tip of the thumb [mm]."""

    bend: tuple[tuple[float, float, float], ...]
    spread: tuple[float, ...]
    thumb: tuple[tuple[float, float, float], ...]


FOLDED = Gesture(  # straight, side by side: palm to palm
    ((2.0, 3.0, 2.0), (1.0, 3.0, 2.0), (2.0, 3.0, 2.0), (3.0, 4.0, 3.0)),
    (-1.6, 0.0, 1.4, 3.0),
    ((3.2, 0.4, 2.5), (5.1, 0.7, 8.6), (5.6, 0.9, 13.0), (5.3, 0.7, 16.8)),
)
OPEN = Gesture(  # relaxed, more curled towards the little finger
    ((8.0, 14.0, 8.0), (13.0, 18.0, 10.0), (18.0, 22.0, 12.0), (21.0, 24.0, 14.0)),
    (7.0, 1.5, -4.0, -11.0),
    ((3.2, 0.8, 2.5), (7.0, 2.0, 7.8), (9.4, 2.6, 11.6), (11.2, 2.5, 15.0)),
)


class Digit(NamedTuple):
    """A finger or thumb: its joints and tip (4, 3), the unit vector out of its pad at the tip, half widths there."""

    joints: NDArray[np.float64]
    pad: NDArray[np.float64]
    widths: tuple[float, ...]


def hand(point: Any, gesture: Gesture) -> Any:
    """A hand at points in its own axes."""
    palm = _palm(point)
    *fingers, thumb = digits(gesture)
    solid = smooth_union(palm, _finger(point, fingers[0]), WEB_WIDTH)
    for finger in fingers[1:]:  # joined one by one, so that they blend with the palm but not with each other
        solid = dr.fmin(solid, smooth_union(palm, _finger(point, finger), WEB_WIDTH))
    root, joint = thumb.joints[0], thumb.joints[1]
    from_, to = root - np.array((1.2, -0.2, 0.5)), 0.4 * root + 0.6 * joint - np.array((0.9, -0.4, 0.0))
    mount = capsule(point, tuple(from_), tuple(to), 2.0, 1.9)
    return smooth_union(smooth_union(solid, mount, 2.4), _finger(point, thumb), 1.4)


def digits(gesture: Gesture) -> list[Digit]:
    """The four fingers and the thumb of a gesture."""
    fingers = []
    for knuckle, reach, width, bends, spread in zip(
        KNUCKLES, FINGER_LENGTHS, FINGER_HALF_WIDTHS, gesture.bend, np.radians(gesture.spread), strict=True
    ):
        joints, bend, pad = [np.array([knuckle[0], -0.2, knuckle[1]])], 0.0, np.zeros(3)
        for share, more in zip(PHALANGES, np.radians(bends), strict=True):
            bend += more
            way = np.array([np.sin(spread) * np.cos(bend), np.sin(bend), np.cos(spread) * np.cos(bend)])
            pad = np.array([-np.sin(spread) * np.sin(bend), np.cos(bend), -np.cos(spread) * np.sin(bend)])
            joints.append(joints[-1] + share * reach * way)
        joints[-1] -= FINGER_TAPER[3] * width * (joints[-1] - joints[-2]) / np.linalg.norm(joints[-1] - joints[-2])
        fingers.append(Digit(np.array(joints), pad, tuple(share * width for share in FINGER_TAPER)))
    joints = np.array(gesture.thumb)
    along = (joints[3] - joints[2]) / np.linalg.norm(joints[3] - joints[2])
    pad = np.array([-0.75, 0.65, 0.0])  # it faces the fingers more than it faces forward
    pad -= along * (pad @ along)
    return [*fingers, Digit(joints, pad / np.linalg.norm(pad), THUMB)]


def frame(wrist: Any, fingertip: Any, palm: Any) -> NDArray[np.float64]:
    """Axes x, y, z (rows) of a left hand from its wrist to its fingertip, its palm turned as far towards `palm`."""
    along = np.subtract(fingertip, wrist) / np.linalg.norm(np.subtract(fingertip, wrist))
    out = np.asarray(palm, float) - along * np.dot(palm, along)
    out /= np.linalg.norm(out)
    return np.stack([np.cross(out, along), out, along])


def framed(point: Any, origin: Any, axes: NDArray[np.float64]) -> Any:
    """`point` in axes (rows, unit) about an origin."""
    offset = point - type(point)(*(float(x) for x in origin))
    return type(point)(*(dr.dot(offset, type(point)(*(float(x) for x in row))) for row in axes))


def _palm(p: Any) -> Any:
    """Wrist, the bones of the palm with their knuckles, the ball of the little finger and the hollow between."""
    wrist = capsule(p, (0.0, 0.0, -0.5), (0.0, 0.0, 3.0), 2.6, 2.5)
    wrist = smooth_union(wrist, ellipsoid(p, (0.0, 0.0, 0.5), (3.3, 2.3, 3.0)), 2.0)
    solid = wrist
    for x, z in KNUCKLES:
        bone = capsule(p, (0.55 * x, 0.0, 2.0), (0.96 * x, -0.25, z - 0.2), 2.0, 1.45)
        solid = smooth_union(solid, bone, 2.4)
        solid = smooth_union(solid, sphere(p, (0.97 * x, -0.7, z - 0.2), 0.75), 1.0)
    solid = smooth_union(solid, capsule(p, (-2.9, 0.9, 3.0), (-4.2, 0.6, 8.5), 1.8, 1.5), 2.0)
    return smooth_difference(solid, sphere(p, (0.2, 5.6, 8.6), 4.3), 1.6)


def _finger(p: Any, digit: Digit) -> Any:
    """Three tapering bones, fuller at the joints; the last is an egg, so that the tip is no ball; and a nail."""
    joints, pad, widths = digit
    along = (joints[3] - joints[2]) / np.linalg.norm(joints[3] - joints[2])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(joints, axis=0), axis=1))])
    between = 0.5 * (reach[1:] + reach[:-1])
    slim = [SLIM * 0.5 * (widths[k] + widths[k + 1]) for k in range(2)]
    # the curve ends level: its last two values are the same
    knots = [reach[0], between[0], reach[1], between[1], reach[2], reach[3], reach[3] + 1.0]
    radii = [widths[0], slim[0], widths[1], slim[1], widths[2], widths[3], widths[3]]
    axes, end = np.array([np.cross(pad, along), pad, along], float), widths[3]

    def egg(back: float, out: float, half: tuple[float, float, float]) -> Any:
        """An ellipsoid behind the tip, towards the pad by `out`; all in half widths of the tip."""
        middle = joints[3] + end * (out * pad - back * along)
        return ellipsoid(framed(p, middle, axes), (0.0, 0.0, 0.0), (end * half[0], end * half[1], end * half[2]))

    wide, long, shift, seam = TIP
    solid = limb(p, joints, lambda way: spline(way, knots, radii), BEND)
    solid = smooth_union(solid, egg(long - 1.08, shift, (wide, wide, long)), seam * end)
    *half, depth, back, border = NAIL
    return smooth_union(solid, egg(back, -depth, (half[0], half[1], half[2])), border)
