"""Lamps on all sides: whether the lamps of a capture surround the line of sight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.light.lamp import Lamp

WIDEST_GAP = 180.0  # [°] between neighbouring lamps around the line of sight; beyond it they are all on one side
ON_AXIS = 0.15  # sine of the angle from the line of sight below which a lamp is on no side
SIDES = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")


def lamp_remarks(lamps: Sequence[Lamp], camera: Camera | None) -> tuple[str, ...]:
    """One line if three far lamps or more all stand on one side of the line of sight."""
    far = [np.asarray(lamp.to_lamp) for lamp in lamps if lamp.to_lamp is not None]
    if camera is None or len(far) < max(len(lamps), 3):
        return ()
    across, down = (camera.world_to_camera[row, :3] for row in (0, 1))
    place = np.array([[to @ across, -(to @ down)] for to in far])
    place = place[np.hypot(*place.T) > ON_AXIS]
    if len(place) < max(3, 0.6 * len(far)):
        return ()
    around = np.sort(np.degrees(np.arctan2(place[:, 1], place[:, 0])))
    gaps = np.diff([*around, around[0] + 360.0])
    widest = int(np.argmax(gaps))
    if gaps[widest] <= WIDEST_GAP:
        return ()
    middle = around[widest] + 0.5 * gaps[widest]
    side = SIDES[round(middle / 45.0) % 8]
    return (
        f"all {len(far)} lamps are on one side: none lights the object from the {side} of the picture, over "
        f"{gaps[widest]:.0f}°, and what faces there is not measured: add a lamp there",
    )
