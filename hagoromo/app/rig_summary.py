"""Summary that `hagoromo calibrate rig` prints: strength and fall-off of each lamp, with errors."""

from __future__ import annotations

import numpy as np

from hagoromo.photograph.rig import Rig, RigLampRecord


def rig_summary(rig: Rig) -> list[str]:
    """Lines of text."""
    lines = [_of_lamp(lamp, number) for number, lamp in enumerate(rig.lamps)]
    if len(rig.sources) == 1:
        lines.append("measured on one capture: what differs from capture to capture is not in these errors")
    return lines


def _of_lamp(lamp: RigLampRecord, number: int) -> str:
    strength, error = float(np.mean(lamp.strength)), 100.0 * np.sqrt(np.diag(lamp.covariance))
    (across, down), name = (100.0 * one for one in lamp.slope), lamp.name or f"lamp {number}"
    return (
        f"{name}: strength {strength:.3f} ± {strength * error[0] / 100.0:.3f}, changes by {across:+.1f} ± "
        f"{error[1]:.1f} % to the right and {down:+.1f} ± {error[2]:.1f} % downwards, over half of the picture's width"
    )
