"""Light on a ball: the part of a photograph that shows it, and how far each pixel stands out of its surroundings.

A lamp's image is small and brighter than what lies around it, so the surroundings are the light after an opening by a
disc (by reconstruction): what is narrower than the disc is gone, what is wider stays as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, grey
from hagoromo.calibration.opencv_threads import one_thread
from hagoromo.errors import InputError

Light = NDArray[np.float32]
WIDEST = 0.22  # of the ball's radius: radius of the disc; a lamp's image is narrower
COARSE = 96  # [px] width of the ball in the picture that is opened
FINE_BLUR, COARSE_BLUR = 1.0, 3.0  # [px] standard deviations; light between these scales is noise or marks


class LightOnBall(NamedTuple):
    """light: (h, w) of the box around the ball, over white, 0 beside it; on: (h, w) the ball; corner: (row, column).

    least: [white] what can be told from nothing in stored numbers; 0 where white is unknown.
    """

    light: Light
    on: NDArray[np.bool_]
    corner: NDArray[np.intp]
    least: float

    def points(self, rows: NDArray, columns: NDArray) -> Array:
        """(n, 2) image points (x, y) [px] of pixels of the box."""
        return np.stack([columns, rows], axis=-1) + self.corner[::-1] + np.float64(0.5)


def light_on_ball(photograph: NDArray, ball: Ball) -> LightOnBall:
    """The light of the box around the ball; NaN, which is clipped or unknown, becomes the brightest.

    photograph: (height, width[, channels]) integers, or light as floats. `InputError` where no pixel is known.
    """
    on = ball.covers(photograph.shape)
    rows, columns = (np.flatnonzero(on.any(axis=axis)) for axis in (1, 0))
    about = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    light, on = grey(photograph[about]), on[about]
    known = light[on & np.isfinite(light)]
    if not known.size:
        raise InputError("no pixel of the ball is known: expose shorter")
    brightest, whole = float(known.max()), photograph.dtype.kind in "ui"
    white = float(np.iinfo(photograph.dtype).max) if whole else max(brightest, 1e-30)
    light = np.where(on, np.where(np.isfinite(light), light, brightest) / white, 0.0)
    return LightOnBall(light.astype(np.float32), on, np.array([rows[0], columns[0]]), 1.0 / white if whole else 0.0)


def above_surroundings(seen: LightOnBall) -> Light:
    """(h, w) light [white] above the surroundings, 0 beside the ball."""
    import cv2
    from skimage.morphology import reconstruction

    with one_thread():
        coarse, scale = reduced(seen.light, COARSE)
        reach = max(round(0.5 * WIDEST * max(coarse.shape)), 2)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        opened = np.asarray(cv2.morphologyEx(coarse, cv2.MORPH_OPEN, disc, borderType=cv2.BORDER_CONSTANT))
        whole = np.asarray(reconstruction(opened, coarse), np.float32)  # what is wide, to its corners
        grown = np.asarray(cv2.dilate(whole, np.ones((3, 3), np.uint8)), np.float32)  # and over its blurred edge
        surroundings = grown if scale == 1.0 else enlarged(grown, seen.light.shape)
    return np.where(seen.on, np.maximum(seen.light - surroundings, 0.0), np.float32(0.0))


def unevenness(seen: LightOnBall) -> float:
    """Standard deviation [white] of what noise and marks make of the light under FINE_BLUR, by its median."""
    between = blurred(seen.light, FINE_BLUR) - blurred(seen.light, COARSE_BLUR)
    return 1.4826 * float(np.median(np.abs(between)[seen.on]))


def blurred(picture: Light, deviation: float) -> Light:
    """The picture under a Gaussian blur of `deviation` [px]."""
    import cv2

    with one_thread():
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), deviation), np.float32)


def reduced(picture: Light, side: int) -> tuple[Light, float]:
    """The picture, `side` pixels long at most, as means over its pixels, and its scale."""
    import cv2

    scale = min(side / max(picture.shape), 1.0)
    if scale == 1.0:
        return picture, 1.0
    size = max(round(picture.shape[1] * scale), 1), max(round(picture.shape[0] * scale), 1)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32), scale


def enlarged(picture: Light, shape: tuple[int, ...]) -> Light:
    """The inverse of `reduced`, by linear interpolation."""
    import cv2

    return np.asarray(cv2.resize(picture, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR), np.float32)
