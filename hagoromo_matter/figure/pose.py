"""Pose: positions of the joints of a standing figure [mm], which stands on z = 0, faces −y, and is 270 mm high.

Joints are those of its left side, x ≥ 0; the right side mirrors them.
"""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Pose:
    """Joints [mm]; `nod`: turn of the head about x, y, z [°]."""

    wrist: Point
    elbow: Point
    fingertip: Point  # of the middle finger
    head: Point = (0.0, -2.0, 246.0)  # middle of the head, 37 mm high
    nod: Point = (-8.0, 0.0, 6.0)
    neck: Point = (0.0, 3.0, 218.0)
    shoulder: Point = (20.5, 3.5, 206.0)
    waist: Point = (0.0, 1.0, 168.0)
    hip: Point = (10.5, 1.0, 138.0)
    knee: Point = (11.5, -2.0, 76.0)
    ankle: Point = (11.0, 3.0, 9.0)
    toe: Point = (13.5, -17.0, 2.5)


PRAYER = Pose(wrist=(3.7, -36.0, 181.0), elbow=(38.0, 0.0, 164.0), fingertip=(1.17, -44.0, 209.0))
WELCOME = Pose(wrist=(47.0, -25.0, 146.0), elbow=(36.0, 2.0, 166.0), fingertip=(55.0, -41.0, 132.0))
