"""Picture of chrome balls: one photograph, reduced, with the outlines of the balls and the lamps that they show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.lamp_calibration import LampCalibration, lamps_on_balls
from hagoromo.calibration.lamps.reading import LampReading
from hagoromo.light.colour import srgb_encode

SIDE = 1600  # [px] of the longer side
OUTLINE, LAMP, DISPUTED = (0, 220, 90), (255, 60, 40), (255, 210, 0)  # colours
SAID = "yellow: may be the lamp, too; the stated error holds both"
BRIGHT = 99.0  # percentile of the photograph that becomes white


def ball_picture(photograph: NDArray, found: LampCalibration) -> NDArray[np.uint8]:
    """(height, width, 3) for display: outlines, lamps, and in yellow other places that may be the lamps'.

    photograph: (height, width[, channels]) integers, or light as floats.
    """
    import cv2

    scale = min(SIDE / max(photograph.shape[:2]), 1.0)
    size = max(round(photograph.shape[1] * scale), 1), max(round(photograph.shape[0] * scale), 1)
    values = np.nan_to_num(photograph.astype(np.float32), posinf=0.0)
    small = np.asarray(cv2.resize(values if values.ndim == 2 else values[..., :3], size, interpolation=cv2.INTER_AREA))
    shown = small / max(float(np.percentile(small, BRIGHT)), 1e-30)
    shown = srgb_encode(shown) if photograph.dtype != np.uint8 else np.rint(255.0 * np.clip(shown, 0.0, 1.0))
    picture = np.ascontiguousarray(shown if shown.ndim == 3 and shown.shape[2] == 3 else _grey(shown), np.uint8)
    for ball in found.balls:
        outline = np.rint(ball.outline(180) * scale - 0.5).astype(np.int32)
        cv2.polylines(picture, [outline], True, OUTLINE, max(round(size[0] / 800), 1), cv2.LINE_AA)
    disputed = [_draw_lamp(picture, one, scale) for one in lamps_on_balls(found.readings)]
    if any(disputed):
        size_of_text = max(picture.shape[1] / 1400.0, 0.35)
        at = round(10 * size_of_text), picture.shape[0] - round(14 * size_of_text)
        cv2.putText(picture, SAID, at, cv2.FONT_HERSHEY_SIMPLEX, size_of_text, DISPUTED, 1, cv2.LINE_AA)
    return picture


def _draw_lamp(picture: NDArray[np.uint8], reading: LampReading, scale: float) -> bool:
    """A cross on the lamp's image; a line from there to another place that may be it, if there is one."""
    import cv2

    arm = max(round(picture.shape[1] / 80), 3)
    lamp, other = reading.highlight.centre, reading.highlight.disputed
    x, y = np.rint(np.array(lamp) * scale - 0.5).astype(int).tolist()
    if other is not None:
        u, v = np.rint(np.array(other) * scale - 0.5).astype(int).tolist()
        cv2.line(picture, (x, y), (u, v), DISPUTED, 1, cv2.LINE_AA)
        cv2.drawMarker(picture, (u, v), DISPUTED, cv2.MARKER_TILTED_CROSS, arm, 1, cv2.LINE_AA)
    cv2.drawMarker(picture, (x, y), LAMP, cv2.MARKER_CROSS, arm, 1, cv2.LINE_AA)
    return other is not None


def _grey(shown: NDArray) -> NDArray:
    return np.repeat(shown.reshape(*shown.shape[:2], -1).mean(axis=2)[..., None], 3, axis=2)
