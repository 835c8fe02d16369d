"""Scale: whether lengths of a measurement are metres."""

from __future__ import annotations

from hagoromo.camera.camera import is_unplaced
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.photographed import Photographed


def has_scale(measurement: Measurement, taken: Photographed) -> bool:
    """Whether lengths are metres: a distance or a width was given, or lamps and camera say where the object is."""
    if any(measurement.settings.get(key) is not None for key in ("distance_m", "across_m")):
        return True
    if is_unplaced(taken.camera):
        return False
    far = not any(one.near for one in taken.lamps)
    solved = measurement.normal_variance is not None  # else the shape was given, with its lengths
    return not (far and solved and not taken.camera.position.any())
