"""Light on a ball: the part of a photograph that shows it, and how far each pixel stands out of its surroundings.

A lamp's image is small and brighter than what lies around it, so the surroundings are the light after an opening by a
disc (by reconstruction): what is narrower than the disc is gone, what is wider stays as it is.

Shading: the direction to a lamp from the diffuse light of a ball that is no mirror, such as glazed clay or plastic.

v = a + b max(N·L, 0)^p: p is 1 for linear numbers, about 0.5 for sRGB. The fit is robust, so a highlight does not draw
it. It is right to some degrees, as no body is quite Lambertian; that is enough to say where the highlight is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array, Ball, grey
from hagoromo.calibration.opencv_threads import one_thread
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status
from hagoromo.least_squares.loss import ROBUST_SCALE

Light = NDArray[np.float32]
WIDEST = 0.22  # of the ball's radius: radius of the disc; a lamp's image is narrower
COARSE = 96  # [px] width of the ball in the picture that is opened
FINE_BLUR, COARSE_BLUR = 1.0, 3.0  # [px] standard deviations; light between these scales is noise or marks
SIDE, PREDICTED = 40, 160  # [px] of the reduced ball that is fitted, and of the one whose light is predicted
INNER = 0.92  # of the radius: pixels outside are steep, and mirror much
CLIPPED, FEWEST = 0.98, 60  # of white; pixels that are not
LEAST_GAIN, LARGEST_MISFIT = 0.03, 0.06  # of white; of the gain: scatter of the residuals
POWERS, LIMITS = (0.4, 1.6), (0.3, 1.8)  # of N·L on a body; limits of the fit: a mirrored room has a power at a limit
SHADING_ERROR = 3.0  # [°] by which bodies that are not Lambertian mislead
SHADING_STEPS = 300  # largest number of evaluations of the fit
LOSS = 0.03  # of the range of the values: where robust weights begin
NEARBY, AROUND = 12.0, 25.0  # [°] from the shading's direction: the middle of the highlight, and all of it, are nearer


class LightOnBall(NamedTuple):
    """light: (h, w) of the box around the ball, over white, 0 beside it; on: (h, w) the ball; corner: (row, column).

    least: [white] what differs from nothing in stored numbers; 0 where white is unknown.
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
    return ROBUST_SCALE * float(np.median(np.abs(between)[seen.on]))


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


@dataclass(frozen=True, eq=False)
class BallShading:
    """to_lamp (3,) unit and its standard error [°]; ambient a, gain b [white], and power p of the fit.

    is_body: whether the power is that of a body. Where the lamp is near the camera no dark side shows the power.
    """

    to_lamp: Array
    standard_error_deg: float
    ambient: float
    gain: float
    power: float

    @property
    def is_body(self) -> bool:
        """Whether this is a body's shading, and no mirrored room."""
        return POWERS[0] < self.power < POWERS[1]

    def predicted(self, normals: Array) -> Array:
        """(n,) light [white] at normals (n, 3)."""
        return self.ambient + self.gain * np.maximum(normals @ self.to_lamp, 0.0) ** self.power


def shading_of(seen: LightOnBall, ball: Ball) -> BallShading | None:
    """The shading of the ball; None where its light is not that of a body under one lamp."""
    from scipy.optimize import least_squares

    values, normals = _body(seen, ball)
    if len(values) < FEWEST:
        return None
    low, high = np.percentile(values, [2.0, 98.0])
    spread = float(high - low)
    if spread < LEAST_GAIN:
        return None
    design = np.c_[normals, np.ones(len(normals))]
    start = np.linalg.lstsq(design, values, rcond=None)[0][:3]
    start = start / max(float(np.linalg.norm(start)), 1e-12)
    across = np.linalg.svd(start[None])[2][1:]

    def shading(parameters: Array) -> BallShading:
        towards = start + parameters[:2] @ across
        unit = towards / np.linalg.norm(towards)
        return BallShading(unit, SHADING_ERROR, parameters[2], parameters[3], float(np.exp(parameters[4])))

    bounds = [[-3.0, -3.0, -1.0, 0.0, np.log(LIMITS[0])], [3.0, 3.0, 1.0, 4.0, np.log(LIMITS[1])]]
    fit = least_squares(
        lambda parameters: shading(parameters).predicted(normals) - values,
        [0.0, 0.0, float(np.clip(low, -0.9, 0.9)), min(spread, 3.9), np.log(0.8)],
        bounds=bounds, loss="soft_l1", f_scale=LOSS * spread, max_nfev=SHADING_STEPS,
    )  # fmt: skip
    found = shading(fit.x)
    residuals = found.predicted(normals) - values
    misfit = ROBUST_SCALE * float(np.median(np.abs(residuals - np.median(residuals))))
    fits = scipy_status(fit).converged and found.gain > LEAST_GAIN and misfit < LARGEST_MISFIT * found.gain
    return found if fits else None


def above_shading(seen: LightOnBall, ball: Ball, shading: BallShading) -> tuple[Light, Light]:
    """(h, w) light [white] above the shading, around where the lamp's image is, and the same where that can be."""
    coarse, _ = reduced(seen.light, PREDICTED)
    shown = ball.mirrored(_centres(seen, coarse.shape))
    cosine = shown.to_lamp @ shading.to_lamp
    maps = shading.predicted(shown.normal), cosine > np.cos(np.radians(AROUND)), cosine > np.cos(np.radians(NEARBY))
    body, around, near = (enlarged(one.astype(np.float32).reshape(coarse.shape), seen.light.shape) for one in maps)
    above = np.where(seen.on & (around > 0.5), np.maximum(seen.light - body, 0.0), np.float32(0.0))
    return above, np.where(near > 0.5, above, np.float32(0.0))


def _body(seen: LightOnBall, ball: Ball) -> tuple[Array, Array]:
    """Light (n,) [white] and normals (n, 3) of the reduced ball, without what is clipped."""
    values, _ = reduced(seen.light, SIDE)
    clipped, _ = reduced((seen.light >= CLIPPED * seen.light.max()).astype(np.float32), SIDE)
    centres = _centres(seen, values.shape)
    away = np.hypot(*(centres - ball.outline(64).mean(axis=0)).T)
    used = (away < INNER * ball.radius) & (clipped.ravel() < 0.02)
    return values.ravel()[used].astype(np.float64), ball.mirrored(centres[used]).normal


def _centres(seen: LightOnBall, shape: tuple[int, ...]) -> Array:
    """(n, 2) image points (x, y) [px] of the pixels of the box, reduced to `shape`."""
    rows, columns = ((np.arange(few) + 0.5) * many / few for few, many in zip(shape, seen.light.shape, strict=True))
    y, x = np.meshgrid(rows, columns, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1) + seen.corner[::-1].astype(np.float64)
